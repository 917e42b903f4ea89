// Drawing on the canvas of a panel: bands of phases behind, curves and marks in front.

import type uPlot from "uplot";
import { bandColour, withAlpha } from "../palette.ts";
import type { Curve, PanelData, Ribbon } from "./curves.ts";
import type { Shared } from "./shared.ts";

/** Phases as bands, events and the end as vertical lines, behind the grid. */
export function drawBack(u: uPlot, shared: Shared): void {
  const { ctx, bbox } = u;
  const theme = shared.theme.value;
  ctx.save();
  clip(u);
  for (const phase of shared.marks.phases) {
    const [left, right] = [u.valToPos(phase.from, "x", true), u.valToPos(phase.to, "x", true)];
    ctx.fillStyle = bandColour(phase.index, theme.dark);
    ctx.fillRect(left, bbox.top, right - left, bbox.height);
  }
  ctx.restore();
}

/** Curves, ghosts, bounds, set-points and marks. */
export function drawFront(u: uPlot, data: PanelData, shared: Shared): void {
  const { ctx } = u;
  const theme = shared.theme.value;
  ctx.save();
  clip(u);
  ctx.lineJoin = "round";
  for (const level of data.levels) {
    const y = u.valToPos(level.value, "y", true);
    line(u, level.kind === "bound" ? theme.grey : theme.ink, 1.25, level.kind === "bound" ? [5, 4] : [1.5, 3], () => {
      ctx.moveTo(u.bbox.left, y);
      ctx.lineTo(u.bbox.left + u.bbox.width, y);
    });
  }
  marks(u, shared);
  for (const ribbon of data.ribbons) drawRibbon(u, ribbon);
  for (const curve of [...data.ghosts, ...data.curves]) drawCurve(u, curve);
  ctx.restore();
}

function clip(u: uPlot): void {
  u.ctx.beginPath();
  u.ctx.rect(u.bbox.left, u.bbox.top, u.bbox.width, u.bbox.height);
  u.ctx.clip();
}

function marks(u: uPlot, shared: Shared): void {
  const { ctx, bbox } = u;
  const theme = shared.theme.value;
  for (const event of shared.marks.events) {
    const x = Math.round(u.valToPos(event.time, "x", true)) + 0.5;
    line(u, withAlpha(theme.dark ? "#e09cc4" : "#a04f7f", 0.7), 1, [2, 2], () => {
      ctx.moveTo(x, bbox.top);
      ctx.lineTo(x, bbox.top + bbox.height);
    });
  }
  const { end } = shared.marks;
  if (end?.failed) {
    const x = u.valToPos(end.time, "x", true);
    line(u, theme.dark ? "#ff8f70" : "#b3261e", 1.5, [], () => {
      ctx.moveTo(x, bbox.top);
      ctx.lineTo(x, bbox.top + bbox.height);
    });
  }
}

function line(u: uPlot, colour: string, width: number, dash: number[], path: () => void): void {
  const { ctx } = u;
  ctx.beginPath();
  ctx.strokeStyle = colour;
  ctx.lineWidth = width * devicePixelRatio;
  ctx.setLineDash(dash.map((d) => d * devicePixelRatio));
  path();
  ctx.stroke();
  ctx.setLineDash([]);
}

function drawCurve(u: uPlot, c: Curve): void {
  const { ctx } = u;
  ctx.globalAlpha = c.alpha;
  if (c.style === "dots") {
    ctx.fillStyle = c.colour;
    for (let i = 0; i < c.xs.length; i += 1) {
      const y = c.ys[i] as number;
      if (Number.isNaN(y)) continue;
      ctx.beginPath();
      ctx.arc(u.valToPos(c.xs[i] as number, "x", true), u.valToPos(y, "y", true), 2 * devicePixelRatio, 0, 7);
      ctx.fill();
    }
  } else {
    line(u, c.colour, c.width, c.dash, () => (c.style === "step" ? stepPath(u, c) : linePath(u, c)));
  }
  ctx.globalAlpha = 1;
}

/** Positions of a scale as a linear function, since calls of `valToPos` for each point are slow. */
function linear(u: uPlot, key: "x" | "y"): [number, number] {
  const { min = 0, max = 1 } = u.scales[key] as { min?: number; max?: number };
  const [a, b] = [u.valToPos(min, key, true), u.valToPos(max, key, true)];
  const slope = (b - a) / (max - min);
  return [a - slope * min, slope];
}

function linePath(u: uPlot, c: Curve): void {
  const { ctx } = u;
  const [[x0, dx], [y0, dy]] = [linear(u, "x"), linear(u, "y")];
  const { xs, ys } = c;
  const dense = xs.length > u.bbox.width * 4;
  let pen = false;
  for (let i = 0; i < xs.length; i += 1) {
    const y = ys[i] as number;
    if (Number.isNaN(y)) {
      pen = false;
      continue;
    }
    const px = x0 + dx * (xs[i] as number);
    if (dense && pen) {
      // Points of one pixel column become their lowest, highest and last.
      let [low, high, last] = [y, y, y];
      while (i + 1 < xs.length && x0 + dx * (xs[i + 1] as number) - px < 0.5) {
        const next = ys[i + 1] as number;
        if (Number.isNaN(next)) break;
        i += 1;
        if (next < low) low = next;
        if (next > high) high = next;
        last = next;
      }
      ctx.lineTo(px, y0 + dy * low);
      ctx.lineTo(px, y0 + dy * high);
      ctx.lineTo(px, y0 + dy * last);
    } else if (pen) ctx.lineTo(px, y0 + dy * y);
    else ctx.moveTo(px, y0 + dy * y);
    pen = true;
  }
}

function stepPath(u: uPlot, c: Curve): void {
  const { ctx } = u;
  const [[x0, dx], [y0, dy]] = [linear(u, "x"), linear(u, "y")];
  let pen = false;
  for (let i = 1; i < c.xs.length; i += 1) {
    const y = c.ys[i] as number;
    if (Number.isNaN(y)) {
      pen = false;
      continue;
    }
    const [a, b, py] = [x0 + dx * (c.xs[i - 1] as number), x0 + dx * (c.xs[i] as number), y0 + dy * y];
    if (pen) ctx.lineTo(a, py);
    else ctx.moveTo(a, py);
    ctx.lineTo(b, py);
    pen = true;
  }
}

function drawRibbon(u: uPlot, r: Ribbon): void {
  const { ctx } = u;
  const [[x0, dx], [y0, dy]] = [linear(u, "x"), linear(u, "y")];
  ctx.beginPath();
  for (let i = 0; i < r.xs.length; i += 1) if (!Number.isNaN(r.high[i])) ctx.lineTo(x0 + dx * (r.xs[i] as number), y0 + dy * (r.high[i] as number));
  for (let i = r.xs.length - 1; i >= 0; i -= 1) if (!Number.isNaN(r.low[i])) ctx.lineTo(x0 + dx * (r.xs[i] as number), y0 + dy * (r.low[i] as number));
  ctx.fillStyle = withAlpha(r.colour, 0.18);
  ctx.fill();
}
