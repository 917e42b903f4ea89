// A sweep of one quantity: a family of curves.

import type { App } from "../app.ts";
import { fill, h } from "../dom.ts";
import { formatNumber, parseNumber, plainNumber, typesetUnit } from "../numbers.ts";
import type { Control, Model } from "../protocol.ts";
import { trackOf, valueAt, withKey } from "../settings.ts";

const MOST = 32;

export class SweepSection {
  readonly element: HTMLDetailsElement;
  private readonly app: App;
  private readonly on = h("input", { type: "checkbox", id: "sweep-on" });
  private readonly name = h("select", { id: "sweep-name" });
  private readonly low = h("input", { type: "text", inputmode: "decimal", id: "sweep-low" });
  private readonly high = h("input", { type: "text", inputmode: "decimal", id: "sweep-high" });
  private readonly count = h("input", { type: "number", min: "2", max: String(MOST), value: "7", id: "sweep-count" });
  private readonly unit = h("span", { class: "form-note" });
  private readonly badge = h("span", { class: "badge" });
  private built = "";

  constructor(app: App) {
    this.app = app;
    this.name.addEventListener("change", () => { this.propose(); this.apply(); });
    for (const input of [this.low, this.high, this.count]) input.addEventListener("change", () => this.apply());
    this.on.addEventListener("change", () => this.apply());
    this.element = h(
      "details", { class: "section" }, h("summary", {}, h("span", {}, "Sweep"), this.badge),
      h(
        "div", { class: "section-body" }, h("label", { class: "check", for: "sweep-on" }, this.on, "Draw a family of curves"),
        h("div", { class: "form" }, row("Quantity", this.name), row("From", this.low, this.unit), row("To", this.high), row("Curves", this.count)),
      ),
    );
  }

  update(): void {
    const model = this.app.model.value;
    if (!model) return;
    const list = all(model);
    const key = JSON.stringify([model.uri, list.map((c) => c.name)]);
    if (key !== this.built) {
      this.built = key;
      const keep = this.name.value;
      fill(this.name, ...groups(model).map(([label, controls]) => h("optgroup", { label }, ...controls.map((c) => h("option", { value: c.name }, c.name)))));
      if (list.some((c) => c.name === keep)) this.name.value = keep;
      this.propose();
    }
    const { sweep } = this.app.settings.value;
    this.on.checked = sweep !== undefined;
    this.badge.textContent = sweep ? `${sweep.values.length} curves` : "";
    this.badge.classList.toggle("changed", sweep !== undefined);
  }

  private propose(): void {
    const model = this.app.model.value;
    const control = model && all(model).find((c) => c.name === this.name.value);
    if (!control) return;
    const track = trackOf(control);
    this.low.value = plainNumber(valueAt(track, 0.1));
    this.high.value = plainNumber(valueAt(track, 0.9));
    this.unit.textContent = typesetUnit(control.unit);
  }

  private apply(): void {
    if (!this.on.checked) {
      this.app.settings.set(withKey(this.app.settings.value, "sweep", undefined));
      return;
    }
    const [low, high] = [parseNumber(this.low.value), parseNumber(this.high.value)];
    const count = Math.min(MOST, Math.max(2, Math.round(Number(this.count.value) || 2)));
    this.low.setAttribute("aria-invalid", String(low === null));
    this.high.setAttribute("aria-invalid", String(high === null));
    if (low === null || high === null) return;
    const log = low > 0 && high / low > 30;
    const values = Array.from({ length: count }, (_, i) => {
      const share = i / (count - 1);
      return Number((log ? low * (high / low) ** share : low + share * (high - low)).toPrecision(6));
    });
    this.badge.title = `${formatNumber(low)} to ${formatNumber(high)}`;
    this.app.settings.set(withKey(this.app.settings.value, "sweep", { name: this.name.value, values }));
  }
}

function groups(model: Model): Array<[string, Control[]]> {
  const list: Array<[string, Control[]]> = [["Parameters", model.parameters], ["Actions", model.actions], ["Initial values", model.states]];
  return list.filter(([, controls]) => controls.length > 0).map(([label, controls]) => [label, controls.slice(0, 400)]);
}

function all(model: Model): Control[] {
  return groups(model).flatMap(([, controls]) => controls);
}

function row(label: string, control: HTMLElement, ...more: Node[]): HTMLElement {
  return h("div", { class: "form-row" }, h("label", { for: control.id }, label), control, ...more);
}
