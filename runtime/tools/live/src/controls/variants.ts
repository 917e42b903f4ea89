// Variants and choices of the model.

import type { App } from "../app.ts";
import { fill, h } from "../dom.ts";
import { withVariant } from "../settings.ts";

export class VariantSection {
  readonly element: HTMLDetailsElement;
  private readonly app: App;
  private readonly body = h("div", { class: "section-body" });
  private readonly count = h("span", { class: "badge" });
  private built = "";
  private boxes = new Map<string, HTMLInputElement | HTMLSelectElement>();

  constructor(app: App) {
    this.app = app;
    this.element = h("details", { class: "section" }, h("summary", {}, h("span", {}, "Variants and choices"), this.count), this.body);
  }

  update(): void {
    const model = this.app.model.value;
    if (!model) return;
    this.element.hidden = model.variants.length + model.choices.length === 0;
    const key = JSON.stringify([model.variants.map((v) => [v.name, v.text]), model.choices.map((c) => [c.name, c.options, c.text])]);
    if (key !== this.built) {
      this.built = key;
      this.build();
    }
    const chosen = this.app.settings.value.variants ?? [];
    this.count.textContent = chosen.length > 0 ? `${chosen.length} changed` : String(model.variants.length + model.choices.length);
    this.count.classList.toggle("changed", chosen.length > 0);
    for (const v of model.variants) (this.boxes.get(v.name) as HTMLInputElement).checked = chosen.includes(v.name) || v.on;
    for (const c of model.choices) {
      const given = chosen.find((x) => x.startsWith(`${c.name}=`));
      (this.boxes.get(c.name) as HTMLSelectElement).value = given ? given.slice(c.name.length + 1) : c.chosen;
    }
  }

  private build(): void {
    const model = this.app.model.value;
    if (!model) return;
    this.boxes.clear();
    const choices = model.choices.map((c) => {
      const select = h("select", { id: `choice-${c.name}` }, ...c.options.map((o) => h("option", { value: o }, o)));
      select.addEventListener("change", () => this.app.settings.set(withVariant(this.app.settings.value, `${c.name}=${select.value}`, select.value !== c.options[0])));
      this.boxes.set(c.name, select);
      return h("div", { class: "form-row", title: c.text }, h("label", { class: "mono", for: `choice-${c.name}` }, c.name), select);
    });
    const variants = model.variants.map((v) => {
      const box = h("input", { type: "checkbox" });
      box.addEventListener("change", () => this.app.settings.set(withVariant(this.app.settings.value, v.name, box.checked)));
      this.boxes.set(v.name, box);
      return h("label", { class: "check variant" }, box, h("span", {}, h("span", { class: "mono" }, v.name), v.text ? h("small", {}, v.text) : null));
    });
    fill(this.body, h("div", { class: "form" }, ...choices), ...variants);
  }
}
