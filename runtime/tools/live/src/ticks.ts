// Axis ticks and ranges.

/** Round step sizes: 1, 2, 2.5 and 5 times a power of ten. */
const STEPS = [1, 2, 2.5, 5, 10];

/** Ticks of a range: round numbers, at least two wherever the range is not empty, about `count`. */
export function ticks(low: number, high: number, count: number): number[] {
  if (!Number.isFinite(low) || !Number.isFinite(high) || high <= low) return [low].filter(Number.isFinite);
  for (let wanted = Math.max(2, count); wanted <= 64; wanted += 1) {
    const found = spaced(low, high, roundStep((high - low) / wanted));
    if (found.length >= 2) return found;
  }
  return [low, high];
}

/** The smallest round step that is not below the raw one (up to rounding). */
export function roundStep(raw: number): number {
  const power = 10 ** Math.floor(Math.log10(raw));
  const factor = STEPS.find((s) => s * power >= raw * (1 - 1e-9)) ?? 10;
  return factor * power;
}

/** Decimals that tell neighbouring ticks apart. */
export function decimals(step: number): number {
  if (!(step > 0)) return 0;
  let places = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  while (places < 20 && Math.abs(step * 10 ** places - Math.round(step * 10 ** places)) > 1e-6) places += 1;
  return places;
}

/** Labels of ticks, all with the same number of decimals. */
export function tickLabels(values: readonly number[]): string[] {
  if (values.length === 0) return [];
  const step = values.length > 1 ? Math.abs((values[1] as number) - (values[0] as number)) : Math.abs(values[0] as number);
  const largest = Math.max(...values.map(Math.abs));
  if (largest >= 1e6 || (largest > 0 && largest < 1e-3)) {
    const power = Math.floor(Math.log10(largest));
    const places = decimals(step / 10 ** power);
    return values.map((v) => (v === 0 ? "0" : `${(v / 10 ** power).toFixed(Math.min(places, 6))}e${power}`.replace("-", "\u2212")));
  }
  const places = decimals(step);
  return values.map((v) => (Math.abs(v) < step * 1e-9 ? 0 : v).toFixed(Math.min(places, 12)).replace("-", "\u2212"));
}

/** Range of an axis over data: a margin of 6 %, and for constant data a band around the value, so that rounding noise stays flat. */
export function padded(low: number, high: number): [number, number] {
  if (!Number.isFinite(low) || !Number.isFinite(high)) return [0, 1];
  const size = Math.max(Math.abs(low), Math.abs(high));
  const span = high - low;
  if (span <= size * 1e-6) {
    const half = size === 0 ? 1 : size * 0.05;
    return [(low + high) / 2 - half, (low + high) / 2 + half];
  }
  return [low - span * 0.06, high + span * 0.06];
}

function spaced(low: number, high: number, step: number): number[] {
  const out: number[] = [];
  const slack = step * 1e-9;
  for (let i = Math.ceil((low - slack) / step); i * step <= high + slack && out.length < 200; i += 1) out.push(Number((i * step).toPrecision(12)));
  return out;
}
