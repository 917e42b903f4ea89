// From runs to what a panel draws: curves, bands of several seeds, ghosts of pinned runs, families of a sweep.

import { extent, lastNotAbove, unpack } from "../packed.ts";
import { panelKey } from "../plans.ts";
import { curveColour, viridis } from "../palette.ts";
import type { LineStyle, PanelPlan, Run, RunResult } from "../protocol.ts";
import { padded } from "../ticks.ts";

export interface Curve {
  label: string;
  colour: string;
  style: LineStyle;
  xs: Float64Array;
  ys: Float64Array;
  width: number;
  alpha: number;
  dash: number[];
  /** Shown in the read-out of the panel. */
  named: boolean;
}
export interface Ribbon {
  colour: string;
  xs: Float64Array;
  low: Float64Array;
  high: Float64Array;
}
export interface Level {
  value: number;
  kind: "bound" | "target";
}
export interface PanelData {
  id: string;
  title: string;
  unit: string;
  text: string;
  role: string;
  curves: Curve[];
  ghosts: Curve[];
  ribbons: Ribbon[];
  levels: Level[];
  /** Curves that are left out because the panel would be crowded. */
  left: number;
}

/** A run that stays for comparison. */
export interface Pinned {
  label: string;
  result: RunResult;
}

const DASHES: number[][] = [[], [6, 3], [2, 3], [8, 3, 2, 3]];

/** Content of a panel: a result and pinned runs. */
export function panelData(plan: PanelPlan, result: RunResult, pinned: readonly Pinned[], dark: boolean, most = Infinity): PanelData {
  const data: PanelData = { id: panelKey(plan), title: plan.title, unit: plan.unit, text: plan.text, role: plan.role, curves: [], ghosts: [], ribbons: [], levels: [], left: 0 };
  const { runs } = result;
  const sweep = runs.length > 1 && runs.some((r) => r.value !== null);
  const lines = shownLines(plan, runs[0], most);
  data.left = plan.lines.filter((l) => l.style !== "dots").length - lines.filter((l) => l.style !== "dots").length;
  const colours = lines.filter((l) => l.style !== "dots");
  lines.forEach((line) => {
    // Readings have the colour of what they read.
    const owner = line.style === "dots" ? colours.findIndex((l) => readings(line, l)) : colours.indexOf(line);
    const index = owner < 0 ? colours.length : owner;
    const colour = curveColour(index, plan.role, dark);
    const found = runs.map((run) => curveOf(run, line.column, line.style)).filter((c): c is [Float64Array, Float64Array, LineStyle] => c !== null);
    if (found.length === 1 && found[0]) data.curves.push(curve(line.label, colour, found[0], true));
    else if (sweep) {
      found.forEach((xy, i) =>
        data.curves.push({ ...curve(lines.length > 1 ? `${line.label} ${runs[i]?.label ?? ""}` : (runs[i]?.label ?? ""), sweepColour(i, found.length, dark), xy, found.length * lines.length <= 8), dash: DASHES[index % 4] as number[] }),
      );
    } else if (found.length > 1) addSeeds(data, line.label, colour, found);
    for (const pin of pinned) {
      const ghost = pin.result.runs[0] && curveOf(pin.result.runs[0], line.column, line.style);
      if (ghost) data.ghosts.push({ ...curve(line.label, colour, ghost, false), width: 1.5, alpha: 0.55, dash: [5, 4] });
    }
    if (line.target !== null && line.target !== undefined) data.levels.push({ value: line.target, kind: "target" });
  });
  for (const bound of [plan.low, plan.high]) if (bound !== null) data.levels.push({ value: bound, kind: "bound" });
  return data;
}

/** The lines of a panel: readings that repeat their curve are left out, and of many curves the most changing ones stay. */
function shownLines(plan: PanelPlan, run: Run | undefined, most: number): PanelPlan["lines"] {
  if (!run) return plan.lines;
  const curves = plan.lines.filter((l) => l.style !== "dots");
  const kept = new Set(curves.length <= most ? curves : [...curves].sort((a, b) => change(run, b) - change(run, a)).slice(0, most));
  return plan.lines.filter((line) => {
    if (line.style !== "dots") return kept.has(line);
    const owner = curves.find((l) => readings(line, l));
    return !owner || (kept.has(owner) && !repeats(run, line, owner));
  });
}

function readings(line: { label: string; column: string }, curve: { label: string; column: string }): boolean {
  return line.column === `obs.${curve.column}` || line.label === `${curve.label} observed`;
}

/** Span of a curve relative to its size. */
function change(run: Run, line: { column: string; style: LineStyle }): number {
  const found = curveOf(run, line.column, line.style);
  if (!found) return -1;
  const [low, high] = extent(found[1]);
  return (high - low) / Math.max(Math.abs(low), Math.abs(high), 1e-300);
}

/** Returns whether readings are the values of their curve: without noise and delay. */
function repeats(run: Run, line: { column: string }, curve: { column: string; style: LineStyle }): boolean {
  const [points, whole] = [curveOf(run, line.column, "dots"), curveOf(run, curve.column, curve.style)];
  if (!points || !whole) return false;
  const [low, high] = extent(whole[1]);
  const slack = Math.max(high - low, Math.max(Math.abs(low), Math.abs(high)) * 1e-6) * 0.01;
  let [seen, apart] = [0, 0];
  points[0].forEach((x, i) => {
    const reading = points[1][i] as number;
    if (Number.isNaN(reading)) return;
    seen += 1;
    if (Math.abs(reading - valueAt(whole[0], whole[1], whole[2], x)) > slack) apart += 1;
  });
  // Jumps at sampling instants may have two values at one time.
  return seen === points[0].length && apart <= seen * 0.05;
}

/** Colour of the member of a family: viridis without its palest end. */
export function sweepColour(index: number, count: number, dark: boolean): string {
  const share = count > 1 ? index / (count - 1) : 0;
  const [r, g, b] = viridis(dark ? 0.25 + 0.75 * share : 0.88 * share);
  return `#${[r, g, b].map((c) => c.toString(16).padStart(2, "0")).join("")}`;
}

function curve(label: string, colour: string, [xs, ys, style]: readonly [Float64Array, Float64Array, LineStyle], named: boolean): Curve {
  return { label, colour, style, xs, ys, width: 1.75, alpha: 1, dash: [], named };
}

function curveOf(run: Run, column: string, style: LineStyle): [Float64Array, Float64Array, LineStyle] | null {
  const found = run.columns.find((c) => c.name === column);
  return found ? [unpack(run.grids[found.grid]), unpack(found.values), found.style ?? style] : null;
}

function addSeeds(data: PanelData, label: string, colour: string, found: Array<readonly [Float64Array, Float64Array, LineStyle]>): void {
  const [xs, , style] = found.reduce((a, b) => ((b[0].at(-1) ?? 0) > (a[0].at(-1) ?? 0) ? b : a));
  const [low, high, mean] = [new Float64Array(xs.length), new Float64Array(xs.length), new Float64Array(xs.length)];
  for (let i = 0; i < xs.length; i += 1) {
    const values = found.map(([x, y]) => valueAt(x, y, style, xs[i] as number)).filter((v) => !Number.isNaN(v));
    [low[i], high[i]] = values.length ? extent(values) : [NaN, NaN];
    mean[i] = values.reduce((a, b) => a + b, 0) / values.length;
  }
  if (style !== "dots") data.ribbons.push({ colour, xs, low, high });
  if (found.length <= 12) for (const xy of found) data.curves.push({ ...curve(label, colour, xy, false), width: 0.75, alpha: 0.4 });
  data.curves.push(curve(`mean ${label}`, colour, [xs, mean, style], true));
}

/** Value of a curve at a time; NaN outside of it. A step holds over the interval that ends at its row. */
export function valueAt(xs: ArrayLike<number>, ys: ArrayLike<number>, style: LineStyle, x: number): number {
  const count = xs.length;
  if (count === 0 || x < (xs[0] as number) || x > (xs[count - 1] as number)) return NaN;
  const below = lastNotAbove(xs, x);
  if (style === "step") {
    const row = xs[below] === x && below > 0 ? below : Math.min(count - 1, below + 1);
    return ys[row] as number;
  }
  if (below >= count - 1) return ys[count - 1] as number;
  const [a, b] = [xs[below] as number, xs[below + 1] as number];
  if (style === "dots") return (x - a < b - x ? ys[below] : ys[below + 1]) as number;
  return (ys[below] as number) + ((x - a) / (b - a)) * ((ys[below + 1] as number) - (ys[below] as number));
}

/** Range of the vertical axis for what is visible between two times. */
export function verticalRange(data: PanelData, from: number, to: number): [number, number] {
  let [low, high] = [Infinity, -Infinity];
  const include = (xs: Float64Array, ys: Float64Array) => {
    const first = Math.max(0, lastNotAbove(xs, from));
    const last = Math.min(xs.length, lastNotAbove(xs, to) + 2);
    const [a, b] = extent(ys, first, last);
    low = Math.min(low, a);
    high = Math.max(high, b);
  };
  for (const c of [...data.curves, ...data.ghosts]) include(c.xs, c.ys);
  for (const r of data.ribbons) {
    include(r.xs, r.low);
    include(r.xs, r.high);
  }
  if (low > high) return [0, 1];
  const span = Math.max(high - low, Math.max(Math.abs(low), Math.abs(high)) * 1e-6);
  const [a, b] = [low, high];
  for (const level of data.levels) {
    const away = Math.max(a - level.value, level.value - b, 0);
    const near = level.kind === "target" || data.role === "action" ? away < span * 4 || span < Math.abs(level.value) * 1e-3 : away < span * 0.25;
    if (near || (data.role === "action" && level.kind === "bound")) {
      low = Math.min(low, level.value);
      high = Math.max(high, level.value);
    }
  }
  return padded(low, high);
}
