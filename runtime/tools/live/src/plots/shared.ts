// What all panels share: the visible times, the time under the pointer, marks of the run.

import type { Theme } from "../palette.ts";
import { Signal } from "../signal.ts";

/** Phases, events and the end of the run that is shown. */
export interface Marks {
  phases: ReadonlyArray<{ name: string; from: number; to: number; index: number }>;
  events: ReadonlyArray<{ name: string; time: number }>;
  end: { time: number; failed: boolean } | null;
}

export class Shared {
  /** Times chosen by zooming; null shows the whole run. */
  readonly zoom = new Signal<readonly [number, number] | null>(null);
  readonly hover = new Signal<number | null>(null);
  readonly theme: Signal<Theme>;
  whole: readonly [number, number] = [0, 1];
  timeUnit = "";
  marks: Marks = { phases: [], events: [], end: null };

  constructor(theme: Theme) {
    this.theme = new Signal(theme);
  }

  get range(): readonly [number, number] {
    return this.zoom.value ?? this.whole;
  }

  /** Zooms around a time; a factor below 1 enlarges. */
  zoomBy(factor: number, around: number): void {
    const [low, high] = this.range;
    const from = Math.max(this.whole[0], around - (around - low) * factor);
    const to = Math.min(this.whole[1], around + (high - around) * factor);
    if (to - from < (this.whole[1] - this.whole[0]) * 1e-5) return;
    this.zoom.set(from <= this.whole[0] && to >= this.whole[1] ? null : [from, to]);
  }

  /** Moves the visible times, at most to the ends of the run. */
  pan(share: number): void {
    const [low, high] = this.range;
    const shift = Math.min(this.whole[1] - high, Math.max(this.whole[0] - low, share * (high - low)));
    if (shift !== 0) this.zoom.set([low + shift, high + shift]);
  }
}
