// All controls, with their search and the number of changes.

import type { App } from "../app.ts";
import { button, h } from "../dom.ts";
import { countChanges, withKey } from "../settings.ts";
import type { Settings } from "../protocol.ts";
import { PidSection } from "./pid.ts";
import { RunSection } from "./run.ts";
import { SliderSection } from "./section.ts";
import { SweepSection } from "./sweep.ts";
import { VariantSection } from "./variants.ts";

export function controls(app: App): HTMLElement {
  const search = h("input", { type: "search", placeholder: "Find a parameter", "aria-label": "Find a parameter" });
  const changes = h("span", { class: "note", role: "status" }, "");
  const resetAll = button("Reset all", () => app.settings.set(keptSeed(app.settings.value)), { class: "small", hidden: true });
  const parts = [new RunSection(app), new VariantSection(app)] as const;
  const sliders = [
    new SliderSection(app, "Actions", ["actions"], true),
    new SliderSection(app, "Parameters", ["parameters"], true),
    new SliderSection(app, "Initial values", ["states", "discretes"], false),
    new SliderSection(app, "Disturbances", ["disturbances"], false),
  ];
  const others = [new PidSection(app), new SweepSection(app)] as const;
  const update = () => {
    const filter = search.value.trim().toLowerCase();
    for (const part of [...parts, ...others]) part.update();
    for (const section of sliders) section.update(filter);
    counted();
  };
  const counted = () => {
    const count = countChanges(app.settings.value);
    changes.textContent = count === 0 ? "As the model has it" : `${count} changed`;
    resetAll.hidden = count === 0;
  };
  search.addEventListener("input", update);
  app.model.subscribe(update);
  app.settings.subscribe(() => {
    for (const part of [...parts, ...others]) part.update();
    for (const section of sliders) section.paint();
    counted();
  });
  return h(
    "aside", { class: "controls", "aria-label": "Controls" },
    h("header", { class: "controls-head" }, h("h2", {}, "Controls"), changes, resetAll),
    h("div", { class: "controls-search" }, search),
    h("div", { class: "controls-body" }, ...parts.slice(0, 1).map((p) => p.element), ...sliders.slice(0, 2).map((s) => s.element), parts[1].element, ...sliders.slice(2).map((s) => s.element), ...others.map((o) => o.element)),
  );
}

/** Everything as in the model, with the seed, which is not a change. */
function keptSeed(settings: Settings): Settings {
  return withKey({}, "seed", settings.seed);
}
