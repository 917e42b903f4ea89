// Task: return, end, rewards over time, constraint violations.

import type { App } from "../app.ts";
import { fill, h } from "../dom.ts";
import { formatDuration, formatNumber, formatQuantity, typesetUnit } from "../numbers.ts";
import { unpack } from "../packed.ts";
import { curveColour } from "../palette.ts";
import type { Curve, PanelData } from "../plots/curves.ts";
import { Panel } from "../plots/panel.ts";
import type { End, Run } from "../protocol.ts";
import { table } from "./table.ts";
import type { Tab } from "./tab.ts";

const ENDS: Record<End["kind"], string> = { failure: "Failure", success: "Success", time_limit: "Time limit", open: "Open end", error: "Solver failure" };

export class Task implements Tab {
  readonly id = "task";
  readonly title = "Task";
  readonly element = h("section", { class: "tab-body task" });
  private readonly cards = h("div", { class: "cards" });
  private readonly grid = h("div", { class: "panels" });
  private readonly tables = h("div", {});
  private panels = new Map<string, Panel>();
  private readonly app: App;
  private visible = false;

  constructor(app: App) {
    this.app = app;
    this.element.append(this.cards, this.grid, this.tables);
    new ResizeObserver(() => this.panels.forEach((p) => p.resize())).observe(this.grid);
    app.result.subscribe(() => this.paint());
    app.shared.theme.subscribe(() => this.paint());
  }

  show(visible: boolean): void {
    this.visible = visible;
    this.paint();
  }

  changed(): void {
    // Painted with the result of the run.
  }

  private paint(): void {
    const result = this.app.result.value;
    const run = result?.runs[0];
    if (!this.visible || !result || !run) return;
    const failed = run.end.kind === "failure" || run.end.kind === "error";
    const time = formatQuantity(run.end.time, result.time_unit, 4);
    fill(
      this.cards,
      h("div", { class: "card" }, h("b", {}, formatNumber(run.episode_return, 6)), h("small", {}, `episode return: sum of ${run.reward || "the reward"}`)),
      h("div", { class: `card ${failed ? "bad" : run.end.kind === "success" ? "good" : ""}` }, h("b", {}, ENDS[run.end.kind] ?? run.end.kind), h("small", {}, reason(run.end) || `after ${run.end.step} steps`)),
      h("div", { class: "card" }, h("b", {}, String(run.end.step)), h("small", {}, `steps, ${time}`)),
      run.excursion ? h("div", { class: "card fair" }, h("b", {}, "Bounds"), h("small", {}, run.excursion)) : null,
      h("div", { class: "card" }, h("b", {}, formatDuration(result.ms.run)), h("small", {}, `to simulate${run.statistics.steps ? `, ${run.statistics.steps} solver steps` : ""}`)),
    );
    this.paintPanels(run);
    fill(
      this.tables,
      h("h3", {}, "Rewards"),
      table(["Reward", "Sum", "Unit", "Meaning"], run.rewards.map((r) => [h("span", { class: "mono" }, r.name + (r.name === run.reward ? " (chosen)" : "")), formatNumber(r.total, 6), typesetUnit(r.unit), r.text]), [1]),
      ...(run.constraints.length ? [h("h3", {}, "Constraints"), table(["Constraint", "Largest violation", "At step", "Steps violated"], run.constraints.map((c) => [h("span", { class: "mono" }, c.name), formatNumber(c.worst), c.step_of_worst ?? "–", violated(unpack(c.values))]), [1, 2, 3])] : []),
      ...(result.runs.length > 1 ? [h("h3", {}, "All runs"), table(["Run", "Return", "Steps", "End"], result.runs.map((r) => [r.label || `seed ${r.seed}`, formatNumber(r.episode_return, 6), r.end.step, [ENDS[r.end.kind] ?? r.end.kind, reason(r.end)].filter(Boolean).join(": ")]), [1, 2])] : []),
    );
  }

  private paintPanels(run: Run): void {
    const wanted = [
      ...run.rewards.flatMap((r) => [
        this.data(run, r.name, r.unit, r.text || "reward", "reward", unpack(r.values)),
        ...(r.name === run.reward ? [this.sum(run, r.name, r.unit, unpack(r.values))] : []),
      ]),
      ...run.constraints.filter((c) => (c.worst ?? 0) > 0).map((c) => this.data(run, c.name, "1", "constraint violation", "constraint", unpack(c.values))),
    ].slice(0, 24);
    const names = new Set(wanted.map((d) => d.id));
    for (const [id, panel] of this.panels) {
      if (names.has(id)) continue;
      panel.destroy();
      this.panels.delete(id);
    }
    wanted.forEach((data) => {
      let panel = this.panels.get(data.id);
      if (!panel) {
        panel = new Panel(this.app.shared, data.title, data.text);
        this.panels.set(data.id, panel);
        this.grid.append(panel.element);
      }
      panel.show(true);
      panel.update(data);
    });
  }

  private data(run: Run, title: string, unit: string, text: string, role: string, values: Float64Array, style: Curve["style"] = "step"): PanelData {
    const times = unpack(run.grids.step);
    // Rewards of steps have no value at the start.
    const ys = values.length === times.length ? values : Float64Array.from([NaN, ...values]);
    const colour = curveColour(0, role, this.app.shared.theme.value.dark);
    return { id: title, title, unit, text, role, ghosts: [], ribbons: [], levels: [], left: 0, curves: [{ label: title, colour, style, xs: times.subarray(0, ys.length), ys, width: 1.75, alpha: 1, dash: [], named: true }] };
  }

  private sum(run: Run, name: string, unit: string, values: Float64Array): PanelData {
    let total = 0;
    const sums = values.map((v) => (total += Number.isNaN(v) ? 0 : v));
    const ys = values.length === unpack(run.grids.step).length ? sums : Float64Array.from([0, ...sums]);
    return this.data(run, `sum of ${name}`, unit, "reward up to the time", "reward", ys, "line");
  }
}

/** Name and message of an end, without what the kind says already. */
function reason(end: End): string {
  const plain = end.kind.replace("_", " ");
  const parts = [end.name, end.message].filter((text) => text && text !== plain);
  return [...new Set(parts)].join(": ");
}

function violated(values: Float64Array): number {
  return values.reduce((count, v) => count + (v > 0 ? 1 : 0), 0);
}
