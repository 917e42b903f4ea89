// A PID loop on one measured variable and one action, tuned by three sliders.

import type { App } from "../app.ts";
import { fill, h } from "../dom.ts";
import type { Control, Model, Pid } from "../protocol.ts";
import { withKey } from "../settings.ts";
import { SliderRow } from "./slider.ts";

/** The integral time at the right end of its slider means no integral action. */
const NEVER = 1e3;

export class PidSection {
  readonly element: HTMLDetailsElement;
  private readonly app: App;
  private readonly on = h("input", { type: "checkbox", id: "pid-on" });
  private readonly measured = h("select", { id: "pid-measured" });
  private readonly action = h("select", { id: "pid-action" });
  private readonly sign = h("select", { id: "pid-sign" }, h("option", { value: "1" }, "direct: rises with error"), h("option", { value: "-1" }, "reverse: falls with error"));
  private readonly rows = h("div", {});
  private readonly badge = h("span", { class: "badge" });
  private built = "";
  private sliders: { gain: SliderRow; integral: SliderRow; derivative: SliderRow; setPoint: SliderRow } | null = null;

  constructor(app: App) {
    this.app = app;
    for (const select of [this.measured, this.action]) select.addEventListener("change", () => this.start());
    this.sign.addEventListener("change", () => this.patch({ gain: Math.abs(this.pid?.gain ?? 1) * Number(this.sign.value) }));
    this.on.addEventListener("change", () => (this.on.checked ? this.start() : this.app.settings.set(withKey(this.app.settings.value, "pid", undefined))));
    this.element = h(
      "details", { class: "section" }, h("summary", {}, h("span", {}, "PID loop"), this.badge),
      h(
        "div", { class: "section-body" }, h("label", { class: "check", for: "pid-on" }, this.on, "Close a loop"),
        h("div", { class: "form" }, row("Measured", this.measured), row("Action", this.action), row("Acting", this.sign)), this.rows,
      ),
    );
  }

  private get pid(): Pid | undefined {
    return this.app.settings.value.pid;
  }

  update(): void {
    const model = this.app.model.value;
    if (!model) return;
    this.element.hidden = model.actions.length === 0;
    const key = JSON.stringify([model.uri, candidates(model), model.actions.map((a) => a.name)]);
    if (key !== this.built) {
      this.built = key;
      fill(this.measured, ...candidates(model).map((name) => h("option", { value: name }, name)));
      fill(this.action, ...model.actions.map((a) => h("option", { value: a.name }, a.name)));
      this.sliders = null;
    }
    const { pid } = this;
    this.on.checked = pid !== undefined;
    this.badge.textContent = pid ? "on" : "";
    this.badge.classList.toggle("changed", pid !== undefined);
    this.rows.hidden = !pid;
    if (!pid) return;
    this.measured.value = pid.measured;
    this.action.value = pid.action;
    this.sign.value = pid.gain < 0 ? "-1" : "1";
    this.paintSliders(model, pid);
  }

  /** Begins with a gentle loop: a tenth of the action's range for the whole range of the error, integral time a fifth of the episode. */
  private start(): void {
    const model = this.app.model.value;
    const action = model?.actions.find((a) => a.name === this.action.value);
    if (!model || !action) return;
    const { value, span } = measuredScale(model, this.measured.value);
    const width = (action.high ?? Math.abs(action.value ?? 1) * 2) - (action.low ?? 0);
    const horizon = model.step * model.max_steps;
    this.sliders = null;
    this.app.settings.set(
      withKey(this.app.settings.value, "pid", {
        measured: this.measured.value, action: action.name, gain: Number(this.sign.value) * Number((width / span).toPrecision(2)),
        integral_time: Number((horizon / 5).toPrecision(2)), derivative_time: 0, set_point: value,
      }),
    );
  }

  private patch(part: Partial<Pid>): void {
    if (this.pid) this.app.settings.set(withKey(this.app.settings.value, "pid", { ...this.pid, ...part }));
  }

  private paintSliders(model: Model, pid: Pid): void {
    const horizon = model.step * model.max_steps;
    const gain = Math.abs(pid.gain) || 1;
    const { span, unit, low, high } = measuredScale(model, pid.measured);
    const action = model.actions.find((a) => a.name === pid.action);
    const base = ((action?.high ?? gain) - (action?.low ?? 0)) / span || gain;
    const controls = {
      gain: made("Gain", "proportional gain", "", gain, base / 100, base * 100, true),
      integral: made("Integral time", "right end: off", model.time.unit, pid.integral_time ?? horizon * NEVER, model.step / 2, horizon * NEVER, true),
      derivative: made("Derivative time", "", model.time.unit, pid.derivative_time, 0, horizon / 10, false),
      setPoint: made("Set-point", "", unit, pid.set_point ?? 0, low, high, false),
    };
    if (!this.sliders) {
      this.sliders = {
        gain: new SliderRow(controls.gain, (v) => v !== null && this.patch({ gain: v * Number(this.sign.value) })),
        integral: new SliderRow(controls.integral, (v) => v !== null && this.patch({ integral_time: v >= horizon * NEVER ? null : v })),
        derivative: new SliderRow(controls.derivative, (v) => v !== null && this.patch({ derivative_time: v })),
        setPoint: new SliderRow(controls.setPoint, (v) => v !== null && this.patch({ set_point: v })),
      };
      fill(this.rows, this.sliders.gain.element, this.sliders.integral.element, this.sliders.derivative.element, this.sliders.setPoint.element);
    }
    this.sliders.gain.update(controls.gain, null);
    this.sliders.integral.update(controls.integral, null);
    this.sliders.derivative.update(controls.derivative, null);
    this.sliders.setPoint.update(controls.setPoint, null);
  }
}

function row(label: string, control: HTMLElement): HTMLElement {
  return h("div", { class: "form-row" }, h("label", { for: control.id }, label), control);
}

/** States, observations and outputs, in the order of the panels. */
function candidates(model: Model): string[] {
  const names = model.panels.filter((p) => ["state", "output", "observation"].includes(p.role)).flatMap((p) => p.lines.map((l) => l.column));
  return [...new Set([...model.observations.map((o) => o.name).filter((n) => names.includes(n)), ...names])].slice(0, 300);
}

function measuredScale(model: Model, name: string): { value: number; span: number; unit: string; low: number; high: number } {
  const state = model.states.find((s) => s.name === name);
  const line = model.panels.flatMap((p) => p.lines.map((l) => ({ ...l, unit: p.unit }))).find((l) => l.column === name);
  const value = line?.target ?? state?.value ?? 0;
  const low = state?.low ?? line?.low ?? value - Math.abs(value || 1);
  const high = state?.high ?? line?.high ?? value + Math.abs(value || 1);
  return { value, span: Math.max(high - low, 1e-12), unit: line?.unit ?? "", low, high };
}

function made(name: string, text: string, unit: string, value: number, low: number, high: number, log: boolean): Control {
  return { name, array: name, component: "", unit, text, value, low: null, high: null, slider: { low, high, log } };
}
