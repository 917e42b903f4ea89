// Structure: unknowns, the equation of each, blocks, switches.

import type { App } from "../app.ts";
import { RpcError } from "../client.ts";
import { button, type Child, fill, h } from "../dom.ts";
import { Follower } from "../follower.ts";
import { typesetUnit } from "../numbers.ts";
import type { Location, Reduction, StructureResult } from "../protocol.ts";
import { ErrorCode } from "../protocol.ts";
import { table } from "./table.ts";
import type { Tab } from "./tab.ts";

const MOST = 300;

export class Structure implements Tab {
  readonly id = "structure";
  readonly title = "Structure";
  readonly element = h("section", { class: "tab-body structure" });
  private readonly app: App;
  private visible = false;
  private dirty = true;
  private readonly follower: Follower;

  constructor(app: App) {
    this.app = app;
    this.follower = new Follower(() => {
      const uri = app.main.value;
      if (!uri || !app.client.connected) return null;
      const call = app.client.call<StructureResult>("smpl/structure", { uri, settings: app.settings.value });
      return { done: call.answer.then((r) => this.paint(r), (e: unknown) => this.failed(e)), cancel: () => call.cancel() };
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

  private ask(): void {
    this.dirty = false;
    this.follower.touch();
  }

  private failed(error: unknown): void {
    if (error instanceof RpcError && (error.code === ErrorCode.cancelled || error.code === ErrorCode.overtaken || error.code === 0)) return;
    this.element.classList.add("stale");
    if (!this.element.hasChildNodes()) fill(this.element, h("p", { class: "message error" }, (error as Error).message));
  }

  private paint(r: StructureResult): void {
    this.element.classList.toggle("stale", r.stale);
    const total = (rows: Array<{ count: number }>) => rows.reduce((sum, row) => sum + row.count, 0);
    const solved = r.algebraic.filter((a) => a.kind === "solved");
    const substituted = r.algebraic.filter((a) => a.kind !== "solved");
    const largest = Math.max(0, ...r.blocks.map((b) => b.size));
    fill(
      this.element,
      h(
        "div", { class: "cards" },
        card(total(r.states), "differential states"), card(total(solved), "algebraic unknowns, solved"), card(total(substituted), "algebraic, substituted"),
        r.nonzeros === null ? null : card(r.nonzeros, "entries of the Jacobian"), r.blocks.length > 0 ? card(r.blocks.length, largest > 1 ? `blocks, the largest of ${largest}` : "blocks") : null,
        card(r.explicit ? "explicit" : "implicit", `in its derivatives${r.method ? `; method ${r.method}` : ""}`),
      ),
      r.reduction ? section("Index reduction", this.reduction(r.reduction), 0) : null,
      section("Which equation determines what", table(["Unknown", "Equation", "Line"], r.equations.slice(0, MOST).map((e) => [mono(e.unknown), mono(e.text), this.line(e.uri, e.range, e.line)]), [2]), r.equations.length),
      section("States", this.names(r.states), r.states.length),
      r.algebraic.length ? section("Algebraic variables", table(["Name", "Unit", "Elements", "Kind", "Line"], r.algebraic.slice(0, MOST).map((a) => [mono(a.name), typesetUnit(a.unit), a.count, a.kind ?? "", this.line(a.uri, a.range)]), [2, 4]), r.algebraic.length) : null,
      r.blocks.some((b) => b.size > 1)
        ? section("Blocks of several unknowns", table(["Size", "Unknowns"], r.blocks.filter((b) => b.size > 1).slice(0, MOST).map((b) => [b.size, mono(b.unknowns.slice(0, 24).join(", ") + (b.unknowns.length > 24 ? ", …" : ""))]), [0]), 0)
        : null,
      r.roots.length ? section("Conditions that are located", table(["Condition", "Action"], r.roots.slice(0, MOST).map((x) => [mono(x.name), x.action])), r.roots.length) : null,
      r.invariants.length ? section("Invariants", h("p", {}, mono(r.invariants.join(", "))), 0) : null,
    );
  }

  private reduction(r: Reduction): HTMLElement {
    const times = (n: number) => (n === 1 ? "once" : n === 2 ? "twice" : `${n} times`);
    const few = (names: string[]) => mono(names.slice(0, 24).join(", ") + (names.length > 24 ? `, … (${names.length})` : ""));
    const rows: Child[][] = r.differentiated.slice(0, MOST).map((d) => [`differentiated ${times(d.times)}`, mono(d.equation), this.line(d.uri, d.range, d.line)]);
    if (r.projected.length) rows.push(["states projected", few(r.projected), ""]);
    if (r.follow.length) rows.push(["states that follow", few(r.follow), ""]);
    rows.push([r.freedom < r.free.length ? `free at the start: ${r.freedom} of` : "free at the start", r.free.length ? few(r.free) : "nothing", ""]);
    return table(["Effect", "Which", "Line"], rows, [2]);
  }

  private names(rows: StructureResult["states"]): HTMLElement {
    return table(["Name", "Unit", "Elements", "Meaning", "Line"], rows.slice(0, MOST).map((s) => [mono(s.name), typesetUnit(s.unit), s.count, s.text ?? "", this.line(s.uri, s.range)]), [2, 4]);
  }

  private line(uri: string | undefined, range: Location | null | undefined, number?: number | null): Child {
    const shown = range ? range.start.line + 1 : number;
    if (shown === null || shown === undefined) return "";
    const address = range?.uri ?? uri ?? this.app.main.value;
    return range && address ? button(String(shown), () => this.app.goTo(address, range), { class: "link", "aria-label": `Show line ${shown}` }) : String(shown);
  }
}

function card(value: string | number, text: string): HTMLElement {
  return h("div", { class: "card" }, h("b", {}, typeof value === "number" ? value.toLocaleString("en").replace(/,/g, "\u202f") : value), h("small", {}, text));
}

function section(title: string, content: HTMLElement, count: number): HTMLElement {
  return h("section", {}, h("h3", {}, title), content, count > MOST ? h("p", { class: "note" }, `The first ${MOST} of ${count} are listed.`) : null);
}

function mono(text: string): HTMLElement {
  return h("span", { class: "mono" }, text);
}
