// One request at a time: answers to newer inputs replace those of older ones, and none is asked twice.

/** Starts the work for the newest input; `done` runs when it has an answer or failed. */
export type Work = () => { done: Promise<unknown>; cancel(): void } | null;

/**
 * Asks again while inputs change. While a request is under way, the newest input waits for it; after `patience` milliseconds it goes out all the
 * same, and the server drops the older one.
 */
export class Follower {
  private under = 0;
  private dirty = false;
  private started = 0;
  private timer: ReturnType<typeof setTimeout> | null = null;
  private cancelLast: (() => void) | null = null;
  private readonly work: Work;
  private readonly patience: number;
  private readonly onBusy: (busy: boolean) => void;

  constructor(work: Work, patience = 400, onBusy: (busy: boolean) => void = () => undefined) {
    this.work = work;
    this.patience = patience;
    this.onBusy = onBusy;
  }

  get busy(): boolean {
    return this.under > 0;
  }

  /** The inputs have changed. */
  touch(): void {
    if (this.under === 0) {
      this.go();
      return;
    }
    this.dirty = true;
    if (this.timer === null) {
      const wait = Math.max(0, this.patience - (performance.now() - this.started));
      this.timer = setTimeout(() => {
        this.timer = null;
        if (this.dirty) this.go();
      }, wait);
    }
  }

  /** Ends what is under way and forgets what waits. */
  cancel(): void {
    this.dirty = false;
    this.cancelLast?.();
  }

  private go(): void {
    this.dirty = false;
    const call = this.work();
    if (!call) return;
    this.started = performance.now();
    this.under += 1;
    this.cancelLast = () => call.cancel();
    if (this.under === 1) this.onBusy(true);
    const settled = () => {
      this.under -= 1;
      if (this.under > 0) return;
      if (this.timer !== null) clearTimeout(this.timer);
      this.timer = null;
      if (this.dirty) this.go();
      if (this.under === 0) this.onBusy(false);
    };
    call.done.then(settled, settled);
  }
}
