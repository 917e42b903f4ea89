// A section of sliders: grouped by component, filtered, made when it is opened.

import type { App } from "../app.ts";
import { fill, h } from "../dom.ts";
import type { Control, Settings } from "../protocol.ts";
import { type Group, groupOf, withValue } from "../settings.ts";
import { SliderRow } from "./slider.ts";

type List = "parameters" | "states" | "discretes" | "actions" | "disturbances";
const MOST = 120;

export class SliderSection {
  readonly element: HTMLDetailsElement;
  private readonly app: App;
  private readonly lists: List[];
  private readonly count = h("span", { class: "badge" });
  private readonly body = h("div", { class: "section-body" });
  private readonly rows = new Map<string, SliderRow>();
  private filter = "";
  private controls: Array<{ control: Control; group: Group }> = [];

  constructor(app: App, title: string, lists: List[], open: boolean) {
    this.app = app;
    this.lists = lists;
    this.element = h("details", { class: "section", open }, h("summary", {}, h("span", {}, title), this.count), this.body);
    this.element.addEventListener("toggle", () => this.paint());
  }

  /** Shows what the model has now. */
  update(filter: string): void {
    const { value: model } = this.app.model;
    this.filter = filter;
    this.controls = model ? this.lists.flatMap((list) => model[list].map((control) => ({ control, group: groupOf(list, control) }))) : [];
    this.element.hidden = this.controls.length === 0;
    if (filter && this.matching().length > 0) this.element.open = true;
    this.paint();
  }

  private matching(): Array<{ control: Control; group: Group }> {
    return this.filter ? this.controls.filter(({ control }) => `${control.name} ${control.text}`.toLowerCase().includes(this.filter)) : this.controls;
  }

  private chosen(settings: Settings, group: Group, name: string): number | null {
    const value = settings[group]?.[name];
    return typeof value === "number" ? value : null;
  }

  paint(): void {
    const settings = this.app.settings.value;
    const changed = this.controls.filter(({ control, group }) => this.chosen(settings, group, control.name) !== null).length;
    this.count.textContent = changed > 0 ? `${changed} changed` : String(this.controls.length);
    this.count.classList.toggle("changed", changed > 0);
    if (!this.element.open) return;
    const shown = this.matching().slice(0, MOST);
    const nodes: Node[] = [];
    const used = new Set<string>();
    let heading = "";
    for (const { control, group } of shown) {
      if (control.component !== heading) {
        heading = control.component;
        if (heading) nodes.push(h("h4", { class: "mono" }, heading));
      }
      const key = `${group}:${control.name}`;
      used.add(key);
      let row = this.rows.get(key);
      if (!row) {
        row = new SliderRow(control, (value) => this.app.settings.set(withValue(this.app.settings.value, group, control.name, value)));
        this.rows.set(key, row);
      }
      row.update(control, this.chosen(settings, group, control.name));
      nodes.push(row.element);
    }
    for (const key of this.rows.keys()) if (!used.has(key)) this.rows.delete(key);
    const hidden = this.matching().length - shown.length;
    if (hidden > 0) nodes.push(h("p", { class: "note" }, `${hidden} more: narrow the search.`));
    const same = nodes.length === this.body.childNodes.length && nodes.every((n, i) => n === this.body.childNodes[i] || (n instanceof HTMLElement && n.tagName !== "DIV" && n.textContent === this.body.childNodes[i]?.textContent));
    if (!same) fill(this.body, ...nodes);
  }
}
