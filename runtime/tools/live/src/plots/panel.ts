// One panel over time: uPlot gives frame, axes, cursor and zoom; the curves are drawn here, since each has its own times.

import uPlot from "uplot";
import { button, fill, h, icon } from "../dom.ts";
import { axisScale, formatNumber, typesetUnit } from "../numbers.ts";
import { extent } from "../packed.ts";
import { tickLabels, ticks } from "../ticks.ts";
import { type Curve, type PanelData, valueAt, verticalRange } from "./curves.ts";
import { drawBack, drawFront } from "./paint.ts";
import type { Shared } from "./shared.ts";

const HEIGHT = 156;
const TALL = 380;

export class Panel {
  readonly element: HTMLElement;
  data: PanelData | null = null;
  private plot: uPlot | null = null;
  private readonly frame: HTMLElement;
  private readonly unitText: HTMLElement;
  private readonly note: HTMLElement;
  private readonly legend: HTMLElement;
  private readonly single = h("span", { class: "panel-single" });
  private values: HTMLElement[] = [];
  private readonly shared: Shared;
  private readonly unsubscribe: Array<() => void>;
  private visible = false;
  private tall = false;
  onEnlarge: () => void = () => undefined;
  private factor = 1;
  private moving = false;

  constructor(shared: Shared, title: string, note: string, onSource?: () => void) {
    this.shared = shared;
    this.unitText = h("span", { class: "panel-unit" });
    this.note = h("span", { class: "panel-note", title: note }, note);
    this.legend = h("div", { class: "panel-legend" });
    this.frame = h("div", { class: "panel-frame", tabindex: "0", role: "img", onkeydown: (e: KeyboardEvent) => this.key(e) });
    const name = onSource ? button(title, onSource, { class: "panel-title link", title: "Show the declaration" }) : h("span", { class: "panel-title" }, title);
    const enlarge = button(icon("plus"), () => this.enlarge(enlarge), { class: "ghost panel-enlarge", "aria-label": `Enlarge ${title}`, "aria-pressed": "false" });
    this.element = h("article", { class: "panel" }, h("header", {}, name, this.unitText, this.note, this.single, enlarge), this.legend, this.frame);
    this.unsubscribe = [shared.zoom.subscribe(() => this.redraw()), shared.hover.subscribe(() => this.readOut()), shared.theme.subscribe(() => this.rebuild())];
  }

  get enlarged(): boolean {
    return this.tall;
  }

  /** Gives the panel what to show; it is drawn when the panel is in view. */
  update(data: PanelData): void {
    this.data = data;
    const names = data.curves.filter((c) => c.named);
    const alone = names.length === 1 && names[0]?.label === data.title;
    this.values = [];
    const entries = names.map((c) => this.legendEntry(c, alone));
    fill(this.legend, ...(alone ? [] : entries), data.left > 0 ? h("span", { class: "note" }, `+ ${data.left} more`) : null);
    fill(this.single, ...(alone ? entries : []));
    const [low, high] = verticalRange(data, ...this.shared.whole);
    const size = Math.max(Math.abs(low), Math.abs(high));
    const scale = axisScale(size, data.unit);
    this.factor = scale.factor;
    this.unitText.textContent = scale.unit;
    const [a, b] = extentOf(data);
    this.frame.setAttribute("aria-label", `${data.title}: from ${formatNumber(a)} to ${formatNumber(b)} ${typesetUnit(data.unit)}. Arrow keys read values, plus and minus zoom.`);
    this.redraw();
    this.readOut();
  }

  /** The panel has come into view or left it. */
  show(visible: boolean): void {
    if (this.visible === visible) return;
    this.visible = visible;
    if (visible) this.redraw();
  }

  resize(): void {
    if (this.plot && this.frame.clientWidth > 0) this.plot.setSize({ width: this.frame.clientWidth, height: this.tall ? TALL : HEIGHT });
  }

  destroy(): void {
    for (const end of this.unsubscribe) end();
    this.plot?.destroy();
    this.element.remove();
  }

  private enlarge(control: HTMLElement): void {
    this.tall = !this.tall;
    control.setAttribute("aria-pressed", String(this.tall));
    this.element.classList.toggle("tall", this.tall);
    this.resize();
    this.onEnlarge();
  }

  private legendEntry(c: Curve, alone: boolean): HTMLElement {
    const value = h("output", { class: "panel-value" });
    this.values.push(value);
    return h("span", { class: "legend-entry" }, alone ? null : h("i", { class: "swatch", style: `background:${c.colour}`, "aria-hidden": "true" }), alone ? null : h("span", { class: "legend-name" }, c.label), value);
  }

  private rebuild(): void {
    this.plot?.destroy();
    this.plot = null;
    this.redraw();
  }

  private redraw(): void {
    if (!this.visible || !this.data || this.frame.clientWidth === 0) return;
    const [from, to] = this.shared.range;
    const table: uPlot.AlignedData = [[from, to], verticalRange(this.data, from, to)];
    if (!this.plot) this.plot = this.create(table);
    else this.plot.setData(table);
  }

  private create(table: uPlot.AlignedData): uPlot {
    const theme = this.shared.theme.value;
    const axis = { stroke: theme.grey, font: "11px system-ui, sans-serif", ticks: { stroke: theme.axis, width: 1, size: 4 }, grid: { stroke: theme.grid, width: 1 } };
    const plot = new uPlot(
      {
        width: this.frame.clientWidth,
        height: this.tall ? TALL : HEIGHT,
        padding: [8, 12, 0, 0],
        legend: { show: false },
        cursor: {
          y: false, points: { show: false }, drag: { x: true, y: false, setScale: false },
          bind: { dblclick: () => () => { this.shared.zoom.set(null); return null; } },
        },
        scales: { x: { time: false, range: () => [...this.shared.range] as [number, number] }, y: { range: (u) => [u.data[1]?.[0] as number, u.data[1]?.[1] as number] } },
        series: [{}, { paths: () => null, points: { show: false } }],
        axes: [
          { ...axis, size: 26, gap: 3, splits: (u, _i, min, max) => ticks(min, max, u.width / 80), values: (_u, s) => tickLabels(s), grid: { show: false } },
          {
            ...axis, gap: 4,
            size: (_u, labels) => Math.max(46, 14 + 6.6 * Math.max(0, ...(labels ?? []).map((l) => l.length))),
            splits: (u, _i, min, max) => ticks(min / this.factor, max / this.factor, (u.height - 30) / 38).map((t) => t * this.factor),
            values: (_u, s) => tickLabels(s.map((t) => Number((t / this.factor).toPrecision(12)))),
          },
        ],
        hooks: {
          drawClear: [(u) => drawBack(u, this.shared)],
          draw: [(u) => { if (this.data) drawFront(u, this.data, this.shared); }],
          setCursor: [(u) => this.pointed(u)],
          setSelect: [(u) => this.selected(u)],
        },
      },
      table,
      this.frame,
    );
    this.touch(plot);
    return plot;
  }

  private pointed(u: uPlot): void {
    if (this.moving) return;
    const left = u.cursor.left ?? -1;
    this.moving = true;
    this.shared.hover.set(left < 0 ? null : u.posToVal(left, "x"));
    this.moving = false;
  }

  private selected(u: uPlot): void {
    if (u.select.width < 4) return;
    const [a, b] = [u.posToVal(u.select.left, "x"), u.posToVal(u.select.left + u.select.width, "x")];
    u.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
    this.shared.zoom.set([Math.max(this.shared.whole[0], a), Math.min(this.shared.whole[1], b)]);
  }

  /** A finger that moves sideways reads values; up and down scrolls the page. */
  private touch(u: uPlot): void {
    const move = (e: PointerEvent) => {
      if (e.pointerType !== "touch") return;
      const left = e.clientX - u.over.getBoundingClientRect().left;
      if (left >= 0 && left <= u.over.clientWidth) this.shared.hover.set(u.posToVal(left, "x"));
    };
    u.over.addEventListener("pointerdown", move);
    u.over.addEventListener("pointermove", move);
  }

  private readOut(): void {
    const { data } = this;
    if (!data) return;
    const time = this.shared.hover.value;
    const at = time ?? this.shared.range[1];
    data.curves.filter((c) => c.named).forEach((c, i) => {
      const value = valueAt(c.xs, c.ys, c.style, Math.min(at, c.xs.at(-1) ?? at));
      const out = this.values[i];
      if (out) out.textContent = formatNumber(time !== null && at > (c.xs.at(-1) ?? at) ? NaN : value / this.factor, this.values.length > 1 ? 4 : 5);
    });
    if (this.plot && this.visible && !this.moving) {
      this.moving = true;
      this.plot.setCursor({ left: time === null ? -10 : this.plot.valToPos(time, "x"), top: time === null ? -10 : 5 }, false);
      this.moving = false;
    }
  }

  private key(event: KeyboardEvent): void {
    const [low, high] = this.shared.range;
    const step = (high - low) / (event.shiftKey ? 10 : 100);
    const now = this.shared.hover.value ?? low;
    const clamp = (t: number) => Math.min(high, Math.max(low, t));
    const actions: Record<string, () => void> = {
      ArrowLeft: () => this.shared.hover.set(clamp(now - step)),
      ArrowRight: () => this.shared.hover.set(clamp(now + step)),
      Home: () => this.shared.hover.set(low),
      End: () => this.shared.hover.set(high),
      PageUp: () => this.shared.pan(-0.5),
      PageDown: () => this.shared.pan(0.5),
      "+": () => this.shared.zoomBy(0.5, now),
      "=": () => this.shared.zoomBy(0.5, now),
      "-": () => this.shared.zoomBy(2, now),
      "0": () => this.shared.zoom.set(null),
      Escape: () => this.shared.hover.set(null),
    };
    const action = actions[event.key];
    if (!action || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    action();
  }
}

function extentOf(data: PanelData): [number, number] {
  const ends = data.curves.map((c) => extent(c.ys));
  return [Math.min(...ends.map((e) => e[0])), Math.max(...ends.map((e) => e[1]))];
}
