// Trajectories: panels over time and fields over space.

import type { App } from "../app.ts";
import { button, fill, h, icon } from "../dom.ts";
import { formatNumber, formatQuantity, typesetUnit } from "../numbers.ts";
import { bandColour } from "../palette.ts";
import { panelKey, shownPanels } from "../plans.ts";
import { panelData, sweepColour } from "../plots/curves.ts";
import { FieldPanel } from "../plots/field.ts";
import { Panel } from "../plots/panel.ts";
import type { Model, PanelPlan, RunResult } from "../protocol.ts";
import { quantityPicker } from "./picker.ts";
import type { Tab } from "./tab.ts";

/** Most curves of a panel that is not enlarged, as in run pictures. */
const MOST_LINES = 8;

export class Trajectories implements Tab {
  readonly id = "trajectories";
  readonly title = "Trajectories";
  readonly element: HTMLElement;
  private readonly grid = h("div", { class: "panels" });
  private readonly fields = h("div", { class: "fields" });
  private readonly strip = h("div", { class: "strip" });
  private readonly clock = h("output", { class: "strip-clock", "aria-live": "off" });
  private readonly zoomOut: HTMLButtonElement;
  private readonly note = h("p", { class: "note more-panels" });
  private readonly waiting = h("p", { class: "note" }, "Simulating …");
  private panels = new Map<string, Panel>();
  private fieldPanels = new Map<string, FieldPanel>();
  private readonly observer: IntersectionObserver;
  private readonly owners = new WeakMap<Element, Panel | FieldPanel>();
  private readonly app: App;
  private visible = false;
  private stale = false;

  constructor(app: App) {
    this.app = app;
    this.zoomOut = button("Whole run", () => app.shared.zoom.set(null), { class: "small", hidden: true });
    this.element = h("section", { class: "tab-body" }, h("div", { class: "tab-bar-inner" }, quantityPicker(app), this.zoomOut, this.clock), this.strip, this.waiting, this.grid, this.note, this.fields);
    this.observer = new IntersectionObserver(
      (entries) => entries.forEach((e) => this.owners.get(e.target)?.show(e.isIntersecting && this.visible)),
      { rootMargin: "200px" },
    );
    const resize = new ResizeObserver(() => {
      for (const panel of [...this.panels.values(), ...this.fieldPanels.values()]) panel.resize();
    });
    resize.observe(this.grid);
    app.result.subscribe(() => this.paint());
    app.model.subscribe(() => this.paint());
    app.pinned.subscribe(() => this.paint());
    app.chosen.subscribe(() => this.paint());
    app.shared.theme.subscribe(() => this.paint());
    app.shared.hover.subscribe((t) => this.tick(t));
    app.shared.zoom.subscribe((z) => { this.zoomOut.hidden = z === null; this.tick(app.shared.hover.value); });
  }

  show(visible: boolean): void {
    this.visible = visible;
    if (visible && this.stale) this.paint();
    for (const panel of [...this.panels.values(), ...this.fieldPanels.values()]) {
      const box = panel.element.getBoundingClientRect();
      panel.show(visible && box.top < innerHeight + 200 && box.bottom > -200);
    }
  }

  changed(): void {
    // The run is asked for by the page itself, since the tab of the task shows it too.
  }

  private paint(): void {
    const [model, result] = [this.app.model.value, this.app.result.value];
    this.waiting.hidden = result !== null;
    if (!model || !result || !this.visible) {
      this.stale = true;
      this.keep(this.panels, new Set(result ? this.panels.keys() : []));
      return;
    }
    this.stale = false;
    this.paintStrip(result);
    const plans = shownPanels(model, this.app.chosen.value, result);
    this.keep(this.panels, new Set(plans.map(panelKey)));
    plans.forEach((plan, place) => {
      const panel = this.panels.get(panelKey(plan)) ?? this.addPanel(plan, model);
      if (this.grid.children[place] !== panel.element) this.grid.insertBefore(panel.element, this.grid.children[place] ?? null);
      panel.update(panelData(plan, result, this.app.pinned.value, this.app.shared.theme.value.dark, panel.enlarged ? Infinity : MOST_LINES));
    });
    const hidden = model.panels.length - plans.length;
    this.note.textContent = hidden > 0 ? `${hidden} more under “Quantities”.` : "";
    const fields = result.runs[0]?.fields ?? [];
    this.keep(this.fieldPanels, new Set(fields.map((f) => f.name)));
    for (const field of fields) {
      const panel = this.fieldPanels.get(field.name) ?? this.addField(field.name, field.text);
      panel.update(field);
    }
  }

  private keep(panels: Map<string, Panel | FieldPanel>, wanted: Set<string>): void {
    for (const [id, panel] of panels) {
      if (wanted.has(id)) continue;
      this.observer.unobserve(panel.element);
      panel.destroy();
      panels.delete(id);
    }
  }

  private addPanel(plan: PanelPlan, model: Model): Panel {
    const control = [...model.states, ...model.actions, ...model.discretes].find((c) => c.name === plan.lines[0]?.column || c.array === plan.title);
    const range = control?.range;
    const panel = new Panel(this.app.shared, plan.title, plan.text, range ? () => this.app.goTo(range.uri ?? model.uri, range) : undefined);
    panel.onEnlarge = () => this.paint();
    this.panels.set(panelKey(plan), panel);
    this.watch(panel);
    return panel;
  }

  private addField(name: string, text: string): FieldPanel {
    const panel = new FieldPanel(this.app.shared, name, text);
    this.fieldPanels.set(name, panel);
    this.fields.append(panel.element);
    this.watch(panel);
    return panel;
  }

  private watch(panel: Panel | FieldPanel): void {
    this.owners.set(panel.element, panel);
    this.observer.observe(panel.element);
  }

  private paintStrip(result: RunResult): void {
    const { dark } = this.app.shared.theme.value;
    const first = result.runs[0];
    const parts: Node[] = [];
    const phases = [...new Map(this.app.shared.marks.phases.map((p) => [p.name, p.index])).entries()];
    for (const [name, index] of phases) parts.push(h("span", { class: "chip-key" }, h("i", { class: "block", style: `background:${bandColour(index, dark)}` }), name));
    const counts = new Map<string, number>();
    for (const event of first?.events ?? []) counts.set(event.name, (counts.get(event.name) ?? 0) + 1);
    for (const [name, count] of counts) parts.push(h("span", { class: "chip-key" }, h("i", { class: "mark-key" }), count > 1 ? `${name} ×${count}` : name));
    if (result.runs.length > 1 && result.runs.some((r) => r.value !== null)) {
      result.runs.forEach((r, i) => parts.push(h("span", { class: "chip-key" }, h("i", { class: "swatch", style: `background:${sweepColour(i, result.runs.length, dark)}` }), r.label)));
    } else if (result.runs.length > 1) parts.push(h("span", { class: "chip-key" }, `${result.runs.length} seeds: range and mean`));
    const levels = [...this.panels.values()].some((p) => p.data?.levels.some((l) => l.kind === "target"));
    if (levels) parts.push(h("span", { class: "chip-key" }, h("i", { class: "target-key" }), "set-point"));
    this.app.pinned.value.forEach((pin, i) =>
      parts.push(
        h(
          "span", { class: "chip-key pinned" }, h("i", { class: "ghost-key" }), pin.label,
          button(icon("close"), () => this.app.pinned.set(this.app.pinned.value.filter((_, k) => k !== i)), { class: "ghost tiny", "aria-label": `Remove the pinned run ${pin.label}` }),
        ),
      ),
    );
    for (const warning of result.warnings) parts.push(h("span", { class: "strip-warning" }, warning));
    fill(this.strip, ...parts);
    this.tick(this.app.shared.hover.value);
  }

  private tick(time: number | null): void {
    const { shared } = this.app;
    if (time === null) {
      this.clock.textContent = `${formatNumber(shared.range[0], 4)} – ${formatQuantity(shared.range[1], shared.timeUnit, 4)}`;
      return;
    }
    const phase = shared.marks.phases.find((p) => time >= p.from && time < p.to);
    this.clock.textContent = `${this.app.model.value?.time.name ?? "t"} = ${formatNumber(time, 4)} ${typesetUnit(shared.timeUnit)}${phase ? ` · ${phase.name}` : ""}`;
  }
}
