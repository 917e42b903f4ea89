// Eigenvalues in the complex plane.

import { h, svg } from "../dom.ts";
import { formatNumber } from "../numbers.ts";
import { padded, tickLabels, ticks } from "../ticks.ts";

const WIDTH = 420;
const HEIGHT = 280;
const LEFT = 54;
const BOTTOM = 34;

/** A picture of eigenvalues; the unstable half is tinted. */
export function complexPlane(values: ReadonlyArray<{ re: number; im: number }>, unit: string): HTMLElement {
  const reals = values.map((v) => v.re);
  const imaginaries = values.map((v) => v.im);
  const [x0, x1] = around(Math.min(0, ...reals), Math.max(0, ...reals));
  const [y0, y1] = around(Math.min(...imaginaries, 0), Math.max(...imaginaries, 0));
  const x = (v: number) => LEFT + ((v - x0) / (x1 - x0)) * (WIDTH - LEFT - 10);
  const y = (v: number) => 10 + (1 - (v - y0) / (y1 - y0)) * (HEIGHT - BOTTOM - 10);
  const picture = svg("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, class: "plane", role: "img", "aria-label": `${values.length} eigenvalues in the complex plane` });
  const [right, low] = [WIDTH - 10, HEIGHT - BOTTOM];
  if (x1 > 0) picture.append(svg("rect", { x: x(0), y: 10, width: right - x(0), height: low - 10, class: "plane-unstable" }));
  const [xt, yt] = [ticks(x0, x1, 5), ticks(y0, y1, 5)];
  const [xl, yl] = [tickLabels(xt), tickLabels(yt)];
  xt.forEach((t, i) => picture.append(svg("line", { x1: x(t), x2: x(t), y1: 10, y2: low, class: "plane-grid" }), svg("text", { x: x(t), y: low + 14, "text-anchor": "middle" }, xl[i])));
  yt.forEach((t, i) => picture.append(svg("line", { x1: LEFT, x2: right, y1: y(t), y2: y(t), class: "plane-grid" }), svg("text", { x: LEFT - 6, y: y(t) + 4, "text-anchor": "end" }, yl[i])));
  picture.append(svg("line", { x1: x(0), x2: x(0), y1: 10, y2: low, class: "plane-axis" }), svg("line", { x1: LEFT, x2: right, y1: y(0), y2: y(0), class: "plane-axis" }));
  for (const v of values) {
    const where = v.re > 1e-9 * Math.max(1, Math.abs(v.re)) ? "unstable" : v.re < 0 ? "stable" : "neutral";
    const [cx, cy] = [x(v.re), y(v.im)];
    picture.append(svg("path", { d: `M${cx - 4} ${cy - 4}l8 8m0 -8l-8 8`, class: `plane-point ${where}` }, svg("title", {}, describe(v, unit))));
  }
  picture.append(svg("text", { x: right, y: HEIGHT - 4, "text-anchor": "end", class: "plane-name" }, `real part [${unit}]`));
  picture.append(svg("text", { x: 12, y: (10 + low) / 2, "text-anchor": "middle", transform: `rotate(-90 12 ${(10 + low) / 2})`, class: "plane-name" }, `imaginary part [${unit}]`));
  return h("div", { class: "plane-holder" }, picture);
}

/** An eigenvalue as text, with its time constant. */
export function describe(v: { re: number; im: number }, unit: string): string {
  const imaginary = v.im === 0 ? "" : ` ${v.im > 0 ? "+" : "−"} ${formatNumber(Math.abs(v.im), 4)}i`;
  return `${formatNumber(v.re, 4)}${imaginary} ${unit}`;
}

function around(low: number, high: number): [number, number] {
  return low === high ? [low - 1, high + 1] : padded(low - (high - low) * 0.06, high + (high - low) * 0.06);
}
