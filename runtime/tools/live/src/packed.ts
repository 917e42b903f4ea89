// Lists of doubles that travel as base64.

import type { Packed } from "./protocol.ts";

const cache = new Map<Packed, Float64Array>();
const MOST_CACHED = 400;

/** Decodes base64 of little-endian doubles; the same text gives the same array while it is in the cache. */
export function unpack(packed: Packed): Float64Array {
  const known = cache.get(packed);
  if (known) return known;
  const bytes = decode(packed);
  const values = new Float64Array(bytes.buffer, 0, Math.floor(bytes.length / 8));
  if (packed.length < 65536) {
    if (cache.size >= MOST_CACHED) cache.clear();
    cache.set(packed, values);
  }
  return values;
}

/** The bytes of base64; browsers of 2025 and later decode natively. */
function decode(text: string): Uint8Array<ArrayBuffer> {
  const native = (Uint8Array as unknown as { fromBase64?: (text: string) => Uint8Array<ArrayBuffer> }).fromBase64;
  if (native) return native.call(Uint8Array, text);
  const binary = atob(text);
  const bytes = new Uint8Array(binary.length);
  for (let i = 0; i < binary.length; i += 1) bytes[i] = binary.charCodeAt(i);
  return bytes;
}

/** Index of the last value that is not above `x`; -1 before the first. The list ascends. */
export function lastNotAbove(values: ArrayLike<number>, x: number): number {
  let low = 0;
  let high = values.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if ((values[middle] as number) <= x) low = middle + 1;
    else high = middle;
  }
  return low - 1;
}

/** Smallest and largest finite value of a part of a list. */
export function extent(values: ArrayLike<number>, from = 0, to = values.length): [number, number] {
  let low = Infinity;
  let high = -Infinity;
  for (let i = Math.max(0, from); i < Math.min(values.length, to); i += 1) {
    const v = values[i] as number;
    if (v < low) low = v;
    if (v > high && v !== Infinity) high = v;
  }
  return [low, high];
}
