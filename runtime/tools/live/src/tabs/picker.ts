// Which quantities are shown: a list with search, by role and component.

import type { App } from "../app.ts";
import { button, fill, h } from "../dom.ts";
import { typesetUnit } from "../numbers.ts";
import { panelKey } from "../plans.ts";
import type { PanelPlan } from "../protocol.ts";

const ROLES: Record<string, string> = {
  state: "States", output: "Outputs", action: "Actions", discrete: "Discrete variables", disturbance: "Disturbances", observation: "Observations", reward: "Rewards",
};

/** The button “Quantities” with its list. */
export function quantityPicker(app: App): HTMLElement {
  const search = h("input", { type: "search", placeholder: "Find a quantity", "aria-label": "Find a quantity" });
  const list = h("div", { class: "picker-list" });
  const opener = h("summary", { class: "menu-button" }, "Quantities");
  const paint = () => fill(list, ...groups(app, search.value.trim().toLowerCase()));
  search.addEventListener("input", paint);
  const holder = h(
    "details", { class: "picker" }, opener,
    h(
      "div", { class: "popover" }, search,
      h("div", { class: "row" }, button("All", () => setAll(app, true, paint), { class: "small" }), button("None", () => setAll(app, false, paint), { class: "small" }), button("As proposed", () => { app.chosen.set(null); app.refresh(); paint(); }, { class: "small" })),
      list,
    ),
  );
  holder.addEventListener("toggle", () => {
    if (holder.open) {
      paint();
      search.focus();
    }
  });
  holder.addEventListener("keydown", (event) => {
    if (event.key !== "Escape") return;
    holder.open = false;
    opener.focus();
  });
  document.addEventListener("pointerdown", (event) => {
    if (holder.open && !holder.contains(event.target as Node)) holder.open = false;
  });
  return holder;
}

function current(app: App): Set<string> {
  return new Set(app.chosen.value ?? app.model.value?.panels.filter((p) => p.first).map(panelKey) ?? []);
}

function setAll(app: App, on: boolean, paint: () => void): void {
  app.chosen.set(new Set(on ? (app.model.value?.panels.map(panelKey) ?? []) : []));
  app.refresh();
  paint();
}

function groups(app: App, text: string): Node[] {
  const panels = (app.model.value?.panels ?? []).filter((p) => text === "" || `${p.title} ${p.text} ${p.group}`.toLowerCase().includes(text));
  const chosen = current(app);
  const byHeading = new Map<string, PanelPlan[]>();
  for (const panel of panels) {
    const heading = `${ROLES[panel.role] ?? panel.role}${panel.group ? ` · ${panel.group}` : ""}`;
    byHeading.set(heading, [...(byHeading.get(heading) ?? []), panel]);
  }
  if (panels.length === 0) return [h("p", { class: "note" }, "No quantity has this name.")];
  return [...byHeading].map(([heading, members]) => h("fieldset", {}, h("legend", {}, heading), ...members.map((panel) => entry(app, panel, chosen.has(panelKey(panel))))));
}

function entry(app: App, panel: PanelPlan, on: boolean): HTMLElement {
  const box = h("input", { type: "checkbox", checked: on });
  box.addEventListener("change", () => {
    const next = current(app);
    if (box.checked) next.add(panelKey(panel));
    else next.delete(panelKey(panel));
    app.chosen.set(next);
    app.refresh();
  });
  return h("label", { class: "picker-entry" }, box, h("span", { class: "mono" }, panel.title), h("small", {}, typesetUnit(panel.unit)), h("small", { class: "picker-text" }, panel.text));
}
