// Steady state: values, eigenvalues, other steady states.

import type { App } from "../app.ts";
import { button, type Child, fill, h } from "../dom.ts";
import { Follower } from "../follower.ts";
import { formatNumber, parseNumber, typesetUnit } from "../numbers.ts";
import { complexPlane } from "../plots/plane.ts";
import type { SteadyResult, SteadyValue } from "../protocol.ts";
import { RpcError } from "../client.ts";
import { ErrorCode } from "../protocol.ts";
import { table } from "./table.ts";
import type { Tab } from "./tab.ts";

const ROLES: Record<string, string> = { state: "States", output: "Outputs", action: "Actions", discrete: "Discrete variables", disturbance: "Disturbances" };

export class Steady implements Tab {
  readonly id = "steady";
  readonly title = "Steady state";
  readonly element = h("section", { class: "tab-body steady" });
  private readonly app: App;
  private visible = false;
  private dirty = true;
  private fixed: Record<string, number> = {};
  private readonly follower: Follower;
  private last: SteadyResult | null = null;

  constructor(app: App) {
    this.app = app;
    this.follower = new Follower(() => {
      const uri = app.main.value;
      if (!uri || !app.client.connected) return null;
      const call = app.client.call<SteadyResult>("smpl/steady", { uri, settings: app.settings.value, fixed: this.fixed, others: true, linear: true });
      return { done: call.answer.then((r) => this.paint(r), (e: unknown) => this.failed(e)), cancel: () => call.cancel() };
    }, 600, (busy) => this.element.classList.toggle("busy", busy));
    app.main.subscribe(() => { this.fixed = {}; this.last = null; fill(this.element); });
  }

  show(visible: boolean): void {
    this.visible = visible;
    if (visible && this.dirty) this.ask();
  }

  changed(): void {
    this.dirty = true;
    if (this.visible) this.ask();
  }

  private ask(): void {
    this.dirty = false;
    this.follower.touch();
  }

  private failed(error: unknown): void {
    if (error instanceof RpcError && (error.code === ErrorCode.cancelled || error.code === ErrorCode.overtaken || error.code === 0)) return;
    this.element.classList.add("stale");
    if (!this.last) fill(this.element, h("p", { class: "message error" }, (error as Error).message));
  }

  private paint(result: SteadyResult): void {
    this.last = result;
    this.element.classList.toggle("stale", result.stale);
    if (!result.found) {
      fill(this.element, h("p", { class: "message error" }, result.message ?? "No steady state was found."), this.freedom(result));
      return;
    }
    const unit = typesetUnit(`1/${this.app.model.value?.time.unit ?? "s"}`);
    fill(
      this.element,
      this.summary(result),
      this.freedom(result),
      this.columns(result, unit),
    );
  }

  private summary(result: SteadyResult): HTMLElement {
    const eigenvalues = result.eigenvalues ?? [];
    const largest = Math.max(...eigenvalues.map((e) => e.re));
    const scale = Math.max(...eigenvalues.map((e) => Math.hypot(e.re, e.im)), 1e-300);
    const verdict = eigenvalues.length === 0 ? null : largest > 1e-9 * scale ? "Unstable" : largest < -1e-9 * scale ? "Stable" : "Marginal";
    return h(
      "div", { class: "cards" },
      verdict ? h("div", { class: `card ${verdict === "Stable" ? "good" : verdict === "Unstable" ? "bad" : "fair"}` }, h("b", {}, verdict), h("small", {}, result.eigenvalue_note || (verdict === "Marginal" ? "an eigenvalue is zero" : "by the eigenvalues of the linearisation"))) : null,
      h("div", { class: "card" }, h("b", {}, formatNumber(result.residual_norm, 2)), h("small", {}, "residual norm")),
      h("div", { class: "card" }, h("b", {}, String(result.iterations ?? "–")), h("small", {}, "Newton iterations")),
      result.others ? h("div", { class: "card" }, h("b", {}, String(result.others.length)), h("small", {}, "other steady states found")) : null,
    );
  }

  private columns(result: SteadyResult, unit: string): HTMLElement {
    const [first, ...rest] = this.values(result);
    return h("div", { class: "steady-columns" }, first, result.eigenvalues?.length ? this.eigen(result, unit) : null, ...rest);
  }

  /** Fields for states that the equations leave free. */
  private freedom(result: SteadyResult): Child {
    const free = result.free ?? [];
    if (free.length === 0 && Object.keys(this.fixed).length === 0) return null;
    const names = new Map([...Object.keys(this.fixed).map((n) => [n, ""] as const), ...free.map((f) => [f.name, f.unit] as const)]);
    const fields = [...names].map(([name, unit]) => {
      const input = h("input", { type: "text", inputmode: "decimal", value: this.fixed[name] === undefined ? "" : String(this.fixed[name]), "aria-label": `Value of ${name}` });
      return { name, input, row: h("label", { class: "fix-row" }, h("span", { class: "mono" }, name), input, h("small", {}, typesetUnit(unit))) };
    });
    const apply = () => {
      this.fixed = {};
      for (const f of fields) {
        const value = parseNumber(f.input.value);
        if (value !== null) this.fixed[f.name] = value;
      }
      this.ask();
    };
    return h(
      "form", { class: "fix-form", onsubmit: (e: Event) => { e.preventDefault(); apply(); } },
      h("p", {}, "The equations leave these states free. Fix them to choose one steady state."),
      ...fields.map((f) => f.row), h("div", { class: "row" }, h("button", { type: "submit", class: "primary small" }, "Apply"), button("Clear", () => { this.fixed = {}; this.ask(); }, { class: "small" })),
    );
  }

  private values(result: SteadyResult): HTMLElement[] {
    const groups = new Map<string, SteadyValue[]>();
    for (const value of result.values) groups.set(value.role, [...(groups.get(value.role) ?? []), value]);
    return [...groups].map(([role, values]) => {
      const others = (result.others ?? []).filter((o) => values.some((v) => o.values.some((x) => x.name === v.name)));
      return h(
        "div", {}, h("h3", {}, ROLES[role] ?? role),
        table(
          ["Name", "Value", ...others.map((_, i) => (others.length > 1 ? `Other ${i + 1}` : "Other")), "Unit"],
          values.slice(0, 400).map((v) => [
            h("span", { class: "mono" }, v.name),
            mark(v),
            ...others.map((o) => { const found = o.values.find((x) => x.name === v.name); return found ? formatNumber(found.value) : ""; }),
            typesetUnit(v.unit),
          ]),
          [1, ...others.map((_, i) => i + 2)],
        ),
        values.length > 400 ? h("p", { class: "note" }, `${values.length - 400} more values are not listed.`) : null,
      );
    });
  }

  private eigen(result: SteadyResult, unit: string): HTMLElement {
    const values = result.eigenvalues ?? [];
    const time = typesetUnit(this.app.model.value?.time.unit ?? "s");
    return h(
      "div", { class: "eigen" }, h("h3", {}, "Eigenvalues"), complexPlane(values, unit),
      table(
        [`Eigenvalue [${unit}]`, `Time constant [${time}]`, "Damping"],
        values.slice(0, 40).map((v) => [
          `${formatNumber(v.re, 4)}${v.im === 0 ? "" : ` ${v.im > 0 ? "+" : "−"} ${formatNumber(Math.abs(v.im), 4)}i`}`,
          v.re === 0 ? "∞" : formatNumber(-1 / v.re, 4),
          v.im === 0 ? "" : formatNumber(-v.re / Math.hypot(v.re, v.im), 3),
        ]),
        [0, 1, 2],
      ),
    );
  }
}

function mark(v: SteadyValue): Child {
  const out = v.value !== null && ((v.low !== null && v.value < v.low) || (v.high !== null && v.value > v.high));
  return out ? h("span", { class: "out", title: `outside of its bounds ${formatNumber(v.low)} to ${formatNumber(v.high)}` }, `${formatNumber(v.value)} !`) : formatNumber(v.value, 6);
}
