// The run: scenario, policy, start, seeds, length, solver.

import type { App } from "../app.ts";
import { button, fill, h } from "../dom.ts";
import { formatNumber, parseNumber, plainNumber, typesetUnit } from "../numbers.ts";
import type { Model, Settings } from "../protocol.ts";
import { withKey } from "../settings.ts";

type Choice = { value: string; label: string };

export class RunSection {
  readonly element: HTMLElement;
  private readonly app: App;
  private readonly body = h("div", { class: "section-body form-grid" });
  private built = "";
  private painters: Array<(settings: Settings, model: Model) => void> = [];

  constructor(app: App) {
    this.app = app;
    this.element = h("details", { class: "section", open: !matchMedia("(max-width: 760px)").matches }, h("summary", {}, h("span", {}, "Run")), this.body);
  }

  update(): void {
    const model = this.app.model.value;
    if (!model) return;
    const key = JSON.stringify([model.uri, model.scenarios, model.policies, model.rewards, model.levels, model.methods]);
    if (key !== this.built) {
      this.built = key;
      this.build(model);
    }
    for (const paint of this.painters) paint(this.app.settings.value, model);
  }

  private build(model: Model): void {
    this.painters = [];
    const policies = model.policies.map((p) => ({ value: p, label: p }));
    const rows: Node[] = [];
    if (model.scenarios.length > 1) rows.push(this.select("scenario", "Scenario", model.scenarios.map(plain), (m) => m.scenario));
    rows.push(
      this.select("policy", "Policy", policies, (m) => m.policies[0] ?? "nominal"),
      this.select("start", "Start", [{ value: "sampled", label: "drawn" }, { value: "nominal", label: "nominal" }, { value: "steady", label: "steady state" }], () => "sampled"),
      this.seed(),
      this.number("seeds", "Runs", () => 1, 1, 64, true, () => "seeds"),
      this.number("steps", "Steps", (m) => m.max_steps, 1, 1_000_000, true, (m, v) => `${formatNumber(v * m.step, 4)} ${typesetUnit(m.time.unit)}`),
      this.select("method", "Method", model.methods.map(plain), (m) => m.method),
      this.number("rtol", "Tolerance", (m) => m.rtol, 1e-13, 0.1, false, () => "relative"),
    );
    if (model.rewards.length > 1) rows.push(this.select("reward", "Reward", model.rewards.map((r) => ({ value: r.name, label: r.name })), (m) => m.rewards.find((r) => r.chosen)?.name ?? ""));
    if (model.levels.length > 1) rows.push(this.select("level", "Observed", model.levels.map(plain), (m) => m.levels[0] ?? ""));
    rows.push(this.keepGoing());
    fill(this.body, ...rows);
  }

  private set<K extends keyof Settings>(key: K, value: Settings[K] | undefined): void {
    this.app.settings.set(withKey(this.app.settings.value, key, value));
  }

  private row(label: string, control: HTMLElement, ...more: Node[]): HTMLElement {
    return h("div", { class: "form-cell" }, h("label", { for: control.id }, label), h("div", { class: "form-field" }, control, ...more));
  }

  private select<K extends "scenario" | "policy" | "start" | "method" | "reward" | "level">(key: K, label: string, options: Choice[], standard: (model: Model) => string): HTMLElement {
    const select = h("select", { id: `run-${key}` }, ...options.map((o) => h("option", { value: o.value }, o.label)));
    const row = this.row(label, select);
    select.addEventListener("change", () => {
      const model = this.app.model.value;
      // The model answers with the scenario in force as its own, so that the first one is the standard.
      const base = key === "scenario" ? model?.scenarios[0] : model ? standard(model) : "";
      this.set(key, select.value === base ? undefined : (select.value as NonNullable<Settings[K]>));
    });
    this.painters.push((settings, model) => {
      select.value = settings[key] ?? (key === "scenario" ? (model.scenarios[0] ?? "") : standard(model));
      row.classList.toggle("changed", settings[key] !== undefined);
    });
    return row;
  }

  private number(key: "seeds" | "steps" | "rtol", label: string, standard: (m: Model) => number, low: number, high: number, whole: boolean, note: (m: Model, value: number) => string): HTMLElement {
    const input = h("input", { type: "text", inputmode: whole ? "numeric" : "decimal", id: `run-${key}`, autocomplete: "off" });
    const hint = h("span", { class: "form-note" });
    const row = this.row(label, input, hint);
    input.addEventListener("change", () => {
      const model = this.app.model.value;
      const value = parseNumber(input.value);
      const bad = input.value.trim() !== "" && (value === null || value < low || value > high || (whole && !Number.isInteger(value)));
      input.setAttribute("aria-invalid", String(bad));
      if (bad || !model) return;
      this.set(key, value === null || value === standard(model) ? undefined : value);
    });
    this.painters.push((settings, model) => {
      const value = settings[key] ?? standard(model);
      if (document.activeElement !== input) input.value = plainNumber(value);
      hint.textContent = note(model, value);
      row.classList.toggle("changed", settings[key] !== undefined);
    });
    return row;
  }

  private seed(): HTMLElement {
    const input = h("input", { type: "number", min: "0", step: "1", id: "run-seed" });
    input.addEventListener("input", () => {
      const value = Number(input.value);
      if (Number.isInteger(value) && value >= 0) this.set("seed", value === 0 ? undefined : value);
    });
    const next = button("Next", () => this.set("seed", (this.app.settings.value.seed ?? 0) + 1), { class: "small", "aria-label": "Next seed" });
    this.painters.push((settings) => {
      if (document.activeElement !== input) input.value = String(settings.seed ?? 0);
    });
    return this.row("Seed", input, next);
  }

  private keepGoing(): HTMLElement {
    const box = h("input", { type: "checkbox", id: "run-keep" });
    box.addEventListener("change", () => this.set("keep_going", box.checked ? true : undefined));
    this.painters.push((settings) => { box.checked = settings.keep_going ?? false; });
    return h("label", { class: "check wide", for: "run-keep" }, box, "Continue after failure or success");
  }
}

function plain(name: string): Choice {
  return { value: name, label: name };
}
