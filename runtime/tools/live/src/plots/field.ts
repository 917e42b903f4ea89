// A quantity over space and time: heat map, and the curve over space at one time, which plays.

import { button, fill, h, icon } from "../dom.ts";
import { axisScale, formatNumber, typesetUnit } from "../numbers.ts";
import { extent, lastNotAbove, unpack } from "../packed.ts";
import { curveColour, viridis } from "../palette.ts";
import type { Field } from "../protocol.ts";
import { padded, tickLabels, ticks } from "../ticks.ts";
import type { Shared } from "./shared.ts";

const HEIGHT = 210;
const SCALE_BAR = 48;
const MARGIN = { left: 58, right: 10, top: 8, bottom: 32 };
/** Time in which a whole run plays, in milliseconds. */
const PLAY_TIME = 6000;

/** A colour as a pixel of an image: bytes red, green, blue, alpha. */
function pixel(share: number): number {
  return new Uint32Array(Uint8Array.of(...viridis(share), 255).buffer)[0] as number;
}

const SHADES = Uint32Array.from({ length: 256 }, (_, i) => pixel(i / 255));
const GAP = pixel(NaN);

interface Box {
  x: number;
  y: number;
  width: number;
  height: number;
}

export class FieldPanel {
  readonly element: HTMLElement;
  private field: Field | null = null;
  private group = 0;
  private times = new Float64Array(0);
  private values = new Float64Array(0);
  private faces: Float64Array = new Float64Array(0);
  private range: [number, number] = [0, 1];
  private scale = { factor: 1, unit: "" };
  private image: HTMLCanvasElement | null = null;
  private time: number | null = null;
  private playing = 0;
  private visible = false;
  private readonly map = h("canvas", { class: "field-map" });
  private readonly curve = h("canvas", { class: "field-curve", role: "img" });
  private readonly slider = h("input", { type: "range", min: "0", max: "1000", value: "1000", class: "field-time" });
  private readonly clock = h("output", { class: "field-clock" });
  private readonly groups = h("select", { class: "small" });
  private readonly playButton: HTMLButtonElement;
  private readonly unit = h("span", { class: "panel-unit" });
  private readonly shared: Shared;
  private readonly unsubscribe: Array<() => void>;

  constructor(shared: Shared, name: string, text: string) {
    this.shared = shared;
    this.slider.setAttribute("aria-label", `Time of the curve of ${name}`);
    this.groups.setAttribute("aria-label", `Member of ${name}`);
    this.playButton = button(icon("play"), () => this.toggle(), { class: "ghost", "aria-label": `Play ${name} over time` });
    this.slider.addEventListener("input", () => {
      this.stop();
      const [low, high] = this.shared.whole;
      this.at(low + (Number(this.slider.value) / 1000) * (high - low));
    });
    this.groups.addEventListener("change", () => this.choose(Number(this.groups.value)));
    this.map.addEventListener("pointermove", (e) => this.pointed(e));
    this.map.addEventListener("pointerdown", (e) => this.pointed(e));
    this.map.addEventListener("pointerleave", () => this.shared.hover.set(null));
    this.element = h(
      "article", { class: "panel field" },
      h("header", {}, h("span", { class: "panel-title" }, name), this.unit, h("span", { class: "panel-note", title: text }, text), this.groups),
      h("div", { class: "field-pair" }, h("div", { class: "field-box" }, this.map), h("div", { class: "field-box" }, this.curve)),
      h("div", { class: "field-controls" }, this.playButton, this.slider, this.clock),
    );
    this.unsubscribe = [
      shared.hover.subscribe((t) => { if (t !== null) this.at(t); }),
      shared.zoom.subscribe(() => this.draw()),
      shared.theme.subscribe(() => this.draw()),
    ];
  }

  update(field: Field): void {
    const same = this.field?.groups.join() === field.groups.join();
    this.field = field;
    this.times = unpack(field.times) as Float64Array<ArrayBuffer>;
    this.values = unpack(field.values) as Float64Array<ArrayBuffer>;
    const faces = field.space?.faces ?? [];
    this.faces = faces.length === field.cells + 1 ? Float64Array.from(faces) : Float64Array.from({ length: field.cells + 1 }, (_, i) => i + 0.5);
    if (!same) {
      fill(this.groups, ...field.groups.map((g, i) => h("option", { value: i }, g)));
      this.groups.hidden = field.groups.length < 2;
      this.group = Math.max(0, liveliest(field.groups.length, this.values));
      this.groups.value = String(this.group);
    }
    this.choose(this.group);
  }

  show(visible: boolean): void {
    this.visible = visible;
    if (visible) this.draw();
    else this.stop();
  }

  resize(): void {
    this.draw();
  }

  destroy(): void {
    this.stop();
    for (const end of this.unsubscribe) end();
    this.element.remove();
  }

  private choose(group: number): void {
    this.group = group;
    this.range = padZero(extent(this.part()));
    this.scale = axisScale(Math.max(...this.range.map(Math.abs)), this.field?.unit);
    this.unit.textContent = this.scale.unit;
    this.image = null;
    this.curve.setAttribute("aria-label", `Curve over ${this.field?.space?.name ?? "cells"}; from ${formatNumber(this.range[0])} to ${formatNumber(this.range[1])} ${typesetUnit(this.field?.unit)}`);
    this.at(this.time ?? this.times.at(-1) ?? 0);
  }

  /** Values of the chosen member: times x cells. */
  private part(): Float64Array {
    const size = this.times.length * (this.field?.cells ?? 0);
    return this.values.subarray(this.group * size, (this.group + 1) * size);
  }

  private at(time: number): void {
    this.time = Math.min(this.times.at(-1) ?? time, time);
    const [low, high] = this.shared.whole;
    this.slider.value = String(Math.round((1000 * (this.time - low)) / (high - low || 1)));
    this.clock.textContent = `${formatNumber(this.time, 4)} ${typesetUnit(this.shared.timeUnit)}`;
    this.draw();
  }

  private toggle(): void {
    if (this.playing) this.stop();
    else this.play();
  }

  private play(): void {
    const [low, high] = this.shared.range;
    const last = Math.min(high, this.times.at(-1) ?? high);
    const from = this.time === null || this.time >= last ? low : this.time;
    const began = performance.now();
    fill(this.playButton, icon("pause"));
    const frame = (now: number) => {
      const t = from + ((now - began) / PLAY_TIME) * (last - low);
      this.at(Math.min(t, last));
      if (t < last) this.playing = requestAnimationFrame(frame);
      else this.stop();
    };
    this.playing = requestAnimationFrame(frame);
  }

  private stop(): void {
    if (this.playing) cancelAnimationFrame(this.playing);
    this.playing = 0;
    fill(this.playButton, icon("play"));
  }

  private pointed(event: PointerEvent): void {
    const box = boxOf(this.map, SCALE_BAR);
    const [low, high] = this.shared.range;
    const x = event.clientX - this.map.getBoundingClientRect().left;
    this.stop();
    this.shared.hover.set(Math.min(high, Math.max(low, low + ((x - box.x) / box.width) * (high - low))));
  }

  private draw(): void {
    if (!this.visible || !this.field || this.map.clientWidth === 0) return;
    this.drawMap();
    this.drawCurve();
  }

  private drawMap(): void {
    const ctx = prepare(this.map);
    const box = boxOf(this.map, SCALE_BAR);
    const [low, high] = this.shared.range;
    const theme = this.shared.theme.value;
    this.image ??= this.render();
    const x = (t: number) => box.x + ((t - low) / (high - low)) * box.width;
    ctx.save();
    ctx.beginPath();
    ctx.rect(box.x, box.y, box.width, box.height);
    ctx.clip();
    ctx.imageSmoothingEnabled = false;
    const [t0, t1] = [this.times[0] ?? 0, this.times.at(-1) ?? 1];
    ctx.drawImage(this.image, x(t0), box.y, x(t1) - x(t0), box.height);
    if (this.time !== null) {
      ctx.fillStyle = "#ffffff";
      ctx.fillRect(x(this.time) - 1.5, box.y, 3, box.height);
      ctx.fillStyle = "#000000";
      ctx.fillRect(x(this.time) - 0.5, box.y, 1, box.height);
    }
    ctx.restore();
    const space: [number, number] = [this.faces[0] ?? 0, this.faces.at(-1) ?? 1];
    axes(ctx, box, [low, high], space, theme, `${this.field?.space?.name ?? "cell"}${unitNote(this.field?.space?.unit)}`, unitName(this.shared.timeUnit));
    this.scaleBar(ctx, box);
  }

  /** The heat map, one pixel a column of time and a row of space; the first cell is lowest. */
  private render(): HTMLCanvasElement {
    const columns = Math.min(900, Math.max(2, this.times.length));
    const rows = Math.max(this.field?.cells ?? 1, Math.min(400, 2 * (this.field?.cells ?? 1)));
    const image = document.createElement("canvas");
    image.width = columns;
    image.height = rows;
    const ctx = image.getContext("2d") as CanvasRenderingContext2D;
    const pixels = ctx.createImageData(columns, rows);
    const words = new Uint32Array(pixels.data.buffer);
    const [low, high] = this.range;
    const part = this.part();
    const cells = this.field?.cells ?? 1;
    const [t0, t1] = [this.times[0] ?? 0, this.times.at(-1) ?? 1];
    const [z0, z1] = [this.faces[0] ?? 0, this.faces.at(-1) ?? 1];
    const cellOfRow = Array.from({ length: rows }, (_, r) => Math.min(cells - 1, Math.max(0, lastNotAbove(this.faces, z1 - ((r + 0.5) / rows) * (z1 - z0)))));
    for (let c = 0; c < columns; c += 1) {
      const row = Math.max(0, lastNotAbove(this.times, t0 + ((c + 0.5) / columns) * (t1 - t0)));
      for (let r = 0; r < rows; r += 1) {
        const share = ((part[row * cells + (cellOfRow[r] as number)] as number) - low) / (high - low);
        words[r * columns + c] = Number.isNaN(share) ? GAP : (SHADES[Math.round(Math.min(1, Math.max(0, share)) * 255)] as number);
      }
    }
    ctx.putImageData(pixels, 0, 0);
    return image;
  }

  private scaleBar(ctx: CanvasRenderingContext2D, box: Box): void {
    const theme = this.shared.theme.value;
    const x = box.x + box.width + 8;
    for (let i = 0; i < box.height; i += 1) {
      const [r, g, b] = viridis(1 - i / box.height);
      ctx.fillStyle = `rgb(${r},${g},${b})`;
      ctx.fillRect(x, box.y + i, 8, 1.5);
    }
    ctx.fillStyle = theme.grey;
    ctx.textAlign = "left";
    ctx.textBaseline = "middle";
    const [low, high] = this.range.map((v) => v / this.scale.factor) as [number, number];
    const marks = ticks(low, high, 4).filter((t) => t >= low && t <= high);
    const labels = tickLabels(marks);
    marks.forEach((t, i) => ctx.fillText(labels[i] as string, x + 11, box.y + box.height * (1 - (t - low) / (high - low))));
  }

  private drawCurve(): void {
    const ctx = prepare(this.curve);
    const box = boxOf(this.curve, 0);
    const theme = this.shared.theme.value;
    const space: [number, number] = [this.faces[0] ?? 0, this.faces.at(-1) ?? 1];
    const [low, high] = padded(...this.range);
    axes(ctx, box, space, [low / this.scale.factor, high / this.scale.factor], theme, this.scale.unit, `${this.field?.space?.name ?? "cell"}${unitNote(this.field?.space?.unit)}`);
    const part = this.part();
    const cells = this.field?.cells ?? 0;
    const y = (v: number) => box.y + box.height * (1 - (v - low) / (high - low));
    const x = (z: number) => box.x + ((z - space[0]) / (space[1] - space[0])) * box.width;
    const stroke = (row: number, colour: string, width: number) => {
      ctx.beginPath();
      ctx.strokeStyle = colour;
      ctx.lineWidth = width;
      for (let i = 0; i < cells; i += 1) ctx.lineTo(x(((this.faces[i] as number) + (this.faces[i + 1] as number)) / 2), y(part[row * cells + i] as number));
      ctx.stroke();
    };
    stroke(0, theme.axis, 1);
    stroke(Math.max(0, lastNotAbove(this.times, this.time ?? Infinity)), curveColour(0, "state", theme.dark), 2);
  }
}

function liveliest(groups: number, values: Float64Array): number {
  const size = values.length / groups;
  let [best, change] = [0, -1];
  for (let g = 0; g < groups; g += 1) {
    const [low, high] = extent(values, g * size, (g + 1) * size);
    const relative = (high - low) / Math.max(Math.abs(low), Math.abs(high), 1e-300);
    if (relative > change + 1e-3) [best, change] = [g, relative];
  }
  return best;
}

/** A range for colours: constant fields, also those with rounding noise, get a range around their value. */
function padZero([low, high]: [number, number]): [number, number] {
  if (!Number.isFinite(low)) return [0, 1];
  const size = Math.max(Math.abs(low), Math.abs(high));
  return high - low <= size * 1e-6 ? [low - (size || 1) * 0.05, high + (size || 1) * 0.05] : [low, high];
}

function prepare(canvas: HTMLCanvasElement): CanvasRenderingContext2D {
  const ratio = devicePixelRatio || 1;
  const width = canvas.clientWidth;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(HEIGHT * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(HEIGHT * ratio);
  }
  const ctx = canvas.getContext("2d") as CanvasRenderingContext2D;
  ctx.setTransform(ratio, 0, 0, ratio, 0, 0);
  ctx.clearRect(0, 0, width, HEIGHT);
  ctx.font = "11px system-ui, sans-serif";
  return ctx;
}

function boxOf(canvas: HTMLCanvasElement, extra: number): Box {
  return { x: MARGIN.left, y: MARGIN.top, width: Math.max(20, canvas.clientWidth - MARGIN.left - MARGIN.right - extra), height: HEIGHT - MARGIN.top - MARGIN.bottom };
}

function unitName(unit: string | undefined): string {
  return typesetUnit(unit);
}

function unitNote(unit: string | undefined): string {
  const text = typesetUnit(unit);
  return text ? ` [${text}]` : "";
}

function axes(ctx: CanvasRenderingContext2D, box: Box, xs: [number, number] | readonly [number, number], ys: [number, number], theme: { grey: string; axis: string; grid: string }, yName: string, xName: string): void {
  ctx.lineWidth = 1;
  ctx.fillStyle = theme.grey;
  const yt = ticks(ys[0], ys[1], box.height / 40);
  const yl = tickLabels(yt);
  ctx.textAlign = "right";
  ctx.textBaseline = "middle";
  yt.forEach((t, i) => {
    const y = Math.round(box.y + box.height * (1 - (t - ys[0]) / (ys[1] - ys[0]))) + 0.5;
    ctx.strokeStyle = theme.axis;
    ctx.beginPath();
    ctx.moveTo(box.x - 4, y);
    ctx.lineTo(box.x, y);
    ctx.stroke();
    ctx.fillText(yl[i] as string, box.x - 7, y);
  });
  const xt = ticks(xs[0], xs[1], box.width / 80);
  const xl = tickLabels(xt);
  ctx.textAlign = "center";
  ctx.textBaseline = "top";
  xt.forEach((t, i) => {
    const x = Math.round(box.x + (box.width * (t - xs[0])) / (xs[1] - xs[0])) + 0.5;
    ctx.strokeStyle = theme.axis;
    ctx.beginPath();
    ctx.moveTo(x, box.y + box.height);
    ctx.lineTo(x, box.y + box.height + 4);
    ctx.stroke();
    ctx.fillText(xl[i] as string, x, box.y + box.height + 6);
  });
  ctx.textAlign = "right";
  ctx.fillText(xName, box.x + box.width, box.y + box.height + 19);
  ctx.save();
  ctx.translate(9, box.y + box.height / 2);
  ctx.rotate(-Math.PI / 2);
  ctx.textAlign = "center";
  ctx.textBaseline = "middle";
  ctx.fillText(yName, 0, 0);
  ctx.restore();
}
