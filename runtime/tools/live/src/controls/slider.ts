// One quantity: name, number field with unit, slider, reset.

import { button, h, icon } from "../dom.ts";
import { formatNumber, parseNumber, plainNumber, typesetUnit } from "../numbers.ts";
import type { Control } from "../protocol.ts";
import { shareOf, trackOf, valueAt } from "../settings.ts";

let serial = 0;

export class SliderRow {
  readonly element: HTMLElement;
  private control: Control;
  private value: number | null = null;
  private dragging = false;
  private readonly onChange: (value: number | null) => void;
  private readonly name: HTMLElement;
  private readonly text = h("span", { class: "control-text" });
  private readonly field: HTMLInputElement;
  private readonly unit = h("span", { class: "control-unit" });
  private readonly range: HTMLInputElement;
  private readonly reset: HTMLButtonElement;

  constructor(control: Control, onChange: (value: number | null) => void) {
    this.control = control;
    this.onChange = onChange;
    serial += 1;
    const id = `control-${serial}`;
    this.name = h("label", { class: "control-name mono", for: id }, control.name);
    this.field = h("input", { type: "text", inputmode: "decimal", id, class: "control-field", spellcheck: "false", autocomplete: "off" });
    this.range = h("input", { type: "range", min: "0", max: "1000", step: "1", class: "control-range", "aria-label": control.name });
    this.reset = button(icon("reset"), () => this.restore(), { class: "ghost tiny control-reset", "aria-label": `Reset ${control.name}`, title: "Reset" });
    this.element = h("div", { class: "control" }, h("div", { class: "control-head" }, this.name, this.text, this.reset, this.field, this.unit), this.range);
    this.range.addEventListener("input", () => {
      this.dragging = true;
      this.set(valueAt(trackOf(this.control), Number(this.range.value) / 1000));
    });
    this.range.addEventListener("change", () => { this.dragging = false; this.paint(); });
    this.range.addEventListener("dblclick", () => this.restore());
    this.field.addEventListener("focus", () => { this.field.value = plainNumber(this.shown); this.field.select(); });
    this.field.addEventListener("blur", () => {
      this.field.removeAttribute("aria-invalid");
      this.paint();
    });
    this.field.addEventListener("change", () => this.typed());
    this.field.addEventListener("keydown", (event) => this.step(event));
    this.update(control, null);
  }

  /** Shows the control as the model has it now, with the value that was chosen, if any. */
  update(control: Control, value: number | null): void {
    this.control = control;
    this.value = value;
    this.text.textContent = control.text;
    this.name.title = [control.text, control.drawn ? "drawn at the start of an episode" : "", control.computed ? "computed from others" : "", bounds(control)].filter(Boolean).join("; ");
    this.unit.textContent = typesetUnit(control.unit);
    this.element.classList.toggle("structural", Boolean(control.structural));
    this.paint();
  }

  private get shown(): number {
    return this.value ?? this.control.value ?? 0;
  }

  private paint(): void {
    const changed = this.value !== null;
    this.element.classList.toggle("changed", changed);
    this.element.classList.toggle("drawn", Boolean(this.control.drawn) && !changed);
    this.reset.hidden = !changed;
    if (document.activeElement !== this.field) this.field.value = this.control.value === null && !changed ? "" : plainNumber(Number(this.shown.toPrecision(6)));
    const share = shareOf(trackOf(this.control), this.shown);
    if (!this.dragging) this.range.value = String(Math.round(share * 1000));
    this.range.style.setProperty("--share", `${share * 100}%`);
    this.range.setAttribute("aria-valuetext", `${formatNumber(this.shown)} ${typesetUnit(this.control.unit)}`);
  }

  private set(value: number): void {
    this.value = value === this.control.value ? null : value;
    this.paint();
    this.onChange(this.value);
  }

  private restore(): void {
    this.value = null;
    this.dragging = false;
    this.paint();
    this.onChange(null);
  }

  private typed(): void {
    if (this.field.value.trim() === "") {
      this.restore();
      return;
    }
    const value = parseNumber(this.field.value);
    const out = value === null || (this.control.low !== null && value < this.control.low) || (this.control.high !== null && value > this.control.high);
    this.field.setAttribute("aria-invalid", String(out));
    this.field.title = out ? (value === null ? "not a number" : bounds(this.control)) : "";
    if (value !== null && !out && value !== Number(plainNumber(this.shown))) this.set(value);
  }

  private step(event: KeyboardEvent): void {
    if (event.key === "Enter") this.typed();
    if (event.key !== "ArrowUp" && event.key !== "ArrowDown") return;
    event.preventDefault();
    const track = trackOf(this.control);
    const grain = event.shiftKey ? 0.1 : 0.01;
    this.set(valueAt(track, shareOf(track, this.shown) + (event.key === "ArrowUp" ? grain : -grain)));
    this.field.value = plainNumber(this.shown);
  }
}

function bounds(control: Control): string {
  if (control.low === null && control.high === null) return "";
  const unit = typesetUnit(control.unit);
  return `between ${formatNumber(control.low ?? -Infinity)} and ${formatNumber(control.high ?? Infinity)}${unit ? ` ${unit}` : ""}`;
}
