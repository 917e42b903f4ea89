// Equations: the text typeset; a click goes to its source, and the line of the cursor is marked here.

import type { App } from "../app.ts";
import { fill, h } from "../dom.ts";
import { typesetMath } from "../math.ts";
import type { EquationEntry, EquationsResult } from "../protocol.ts";
import { Follower } from "../follower.ts";
import type { Tab } from "./tab.ts";

export class Equations implements Tab {
  readonly id = "equations";
  readonly title = "Equations";
  readonly element = h("section", { class: "tab-body equations" });
  private readonly list = h("div", { class: "equation-list" });
  private readonly app: App;
  private visible = false;
  private dirty = true;
  private rows: Array<{ entry: EquationEntry; element: HTMLElement }> = [];
  private readonly drawn = new Map<string, HTMLElement>();
  private readonly follower: Follower;

  constructor(app: App) {
    this.app = app;
    this.element.append(this.list);
    this.follower = new Follower(() => {
      const uri = app.main.value;
      if (!uri || !app.client.connected) return null;
      const call = app.client.call<EquationsResult>("smpl/equations", { uri });
      return { done: call.answer.then((r) => this.paint(r)), cancel: () => call.cancel() };
    });
  }

  show(visible: boolean): void {
    this.visible = visible;
    if (visible && this.dirty) this.ask();
  }

  changed(): void {
    this.dirty = true;
    if (this.visible) this.ask();
  }

  /** Marks the equation of a line of the text. */
  cursor(uri: string, line: number): void {
    let found: HTMLElement | null = null;
    for (const { entry, element } of this.rows) {
      const here = this.address(entry) === uri && entry.range !== null && entry.range.start.line <= line && entry.range.end.line >= line;
      element.classList.toggle("at-cursor", here);
      if (here && !found && entry.kind !== "heading") found = element;
    }
    if (this.visible && found) found.scrollIntoView({ block: "nearest" });
  }

  private address(entry: EquationEntry): string | null {
    return entry.range?.uri ?? entry.uri ?? this.app.main.value;
  }

  private ask(): void {
    this.dirty = false;
    this.follower.touch();
  }

  private paint(result: EquationsResult): void {
    this.element.classList.toggle("stale", result.stale);
    this.rows = result.equations.map((entry) => ({ entry, element: entry.kind === "heading" ? h("h3", {}, entry.text || entry.name) : this.row(entry) }));
    fill(this.list, ...this.rows.map((r) => r.element));
    if (this.rows.length === 0) fill(this.list, h("p", { class: "note" }, "The text has no equations yet."));
  }

  private row(entry: EquationEntry): HTMLElement {
    let math = this.drawn.get(entry.latex);
    if (!math) {
      math = typesetMath(entry.latex, true);
      if (this.drawn.size > 2000) this.drawn.clear();
      this.drawn.set(entry.latex, math);
    }
    const caption = /"([^"]*)"\s*$/.exec(entry.text)?.[1];
    const go = () => {
      const uri = this.address(entry);
      if (entry.range && uri) this.app.goTo(uri, entry.range);
    };
    return h(
      "button", { type: "button", class: `equation ${entry.kind}`, onclick: go, title: entry.text, "aria-label": `${entry.kind} ${entry.name}: show its line in the text` },
      math.cloneNode(true),
      caption ? h("span", { class: "equation-caption" }, caption) : null,
      entry.range ? h("span", { class: "equation-line" }, String(entry.range.start.line + 1)) : null,
    );
  }
}
