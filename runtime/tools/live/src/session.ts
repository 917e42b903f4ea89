// Requests that follow the text and the controls: model, then run.

import type { App } from "./app.ts";
import { type Client, RpcError } from "./client.ts";
import { Follower } from "./follower.ts";
import { unpack } from "./packed.ts";
import { shownPanels } from "./plans.ts";
import { ErrorCode, type Model, type RunResult } from "./protocol.ts";
import { compiledKey, pruned } from "./settings.ts";
import { Signal } from "./signal.ts";

/** Content of the status line. */
export interface Status {
  busy: boolean;
  /** Part of a long run that is done; null when unknown. */
  progress: number | null;
  /** Duration of the last run in milliseconds, from the request to its answer. */
  latency: number | null;
  error: string | null;
  /** The text is faulty, or the last answer failed: what is shown is older than the text. */
  stale: boolean;
}

export class Session {
  readonly status = new Signal<Status>({ busy: false, progress: null, latency: null, error: null, stale: false });
  /** Called after each change of text or settings, for tabs that ask by themselves. */
  onChanged: () => void = () => undefined;
  private readonly app: App;
  private readonly models: Follower;
  private readonly runs: Follower;
  private modelKey = "";

  constructor(app: App) {
    this.app = app;
    this.models = new Follower(() => this.askModel(), 400, () => this.busy());
    this.runs = new Follower(() => this.askRun(), 400, () => this.busy());
    app.client.on<{ done: number; total: number; channel: string }>("smpl/progress", (p) => {
      if (p.channel === "main") this.patch({ progress: p.total > 0 ? p.done / p.total : null });
    });
    app.settings.subscribe((settings) => {
      if (!app.model.value) return;
      if (compiledKey(settings) !== this.modelKey) this.models.touch();
      this.runs.touch();
      this.onChanged();
    });
  }

  /** The text has changed, or another model is shown. */
  textChanged(): void {
    this.models.touch();
    this.runs.touch();
    this.onChanged();
  }

  /** Asks for the run again, as when other columns are shown. */
  refresh(): void {
    this.runs.touch();
  }

  /** Interrupts the run under way. */
  interrupt(): void {
    this.runs.cancel();
  }

  private busy(): void {
    const busy = this.models.busy || this.runs.busy;
    this.patch(busy ? { busy } : { busy, progress: null });
  }

  private patch(part: Partial<Status>): void {
    this.status.set({ ...this.status.value, ...part });
  }

  private askModel(): ReturnType<ConstructorParameters<typeof Follower>[0]> {
    const { client, main, settings } = this.app;
    const uri = main.value;
    if (!uri || !client.connected) return null;
    const key = compiledKey(settings.value);
    const call = client.call<Model>("smpl/model", { uri, settings: settings.value });
    const done = call.answer.then(
      (model) => {
        if (this.app.main.value !== uri) return;
        this.modelKey = key;
        this.app.model.set(model);
        const kept = pruned(settings.value, model);
        if (JSON.stringify(kept) !== JSON.stringify(settings.value)) settings.set(kept);
      },
      (error: unknown) => this.failed(error),
    );
    return { done, cancel: () => call.cancel() };
  }

  private askRun(): ReturnType<ConstructorParameters<typeof Follower>[0]> {
    const { client, main, settings, chosen, model } = this.app;
    const uri = main.value;
    if (!uri || !client.connected) return null;
    const shown = model.value && chosen.value ? shownPanels(model.value, chosen.value, null).flatMap((p) => p.lines.map((l) => l.column)) : null;
    const began = performance.now();
    const call = client.call<RunResult>("smpl/run", { uri, channel: "main", settings: settings.value, columns: shown, fields: null });
    const done = call.answer.then(
      (result) => {
        if (this.app.main.value !== uri) return;
        this.prepare(result);
        this.app.result.set(result);
        this.patch({ latency: performance.now() - began, error: null, stale: result.stale });
      },
      (error: unknown) => this.failed(error),
    );
    return { done, cancel: () => call.cancel() };
  }

  /** Times, phases and events for all panels, before they are drawn. */
  private prepare(result: RunResult): void {
    const { shared } = this.app;
    const ends = result.runs.map((r) => Math.max(unpack(r.grids.fine).at(-1) ?? 0, unpack(r.grids.step).at(-1) ?? 0));
    const starts = result.runs.map((r) => unpack(r.grids.step)[0] ?? 0);
    const [low, high] = [Math.min(...starts), Math.max(...ends)];
    const whole: [number, number] = high > low ? [low, high] : [low, low + 1];
    const moved = whole[0] !== shared.whole[0] || whole[1] !== shared.whole[1];
    shared.whole = whole;
    shared.timeUnit = result.time_unit;
    const first = result.runs[0];
    const names = [...new Set((first?.phases ?? []).map((p) => p.name))];
    shared.marks = {
      phases: result.runs.length === 1 ? (first?.phases ?? []).map((p) => ({ ...p, index: names.indexOf(p.name) })) : [],
      events: result.runs.length === 1 ? (first?.events ?? []) : [],
      end: first && result.runs.length === 1 ? { time: first.end.time, failed: first.end.kind === "failure" || first.end.kind === "error" } : null,
    };
    const zoom = shared.zoom.value;
    if (moved && zoom && (zoom[0] >= whole[1] || zoom[1] > whole[1])) shared.zoom.set(null);
  }

  private failed(error: unknown): void {
    if (!(error instanceof RpcError)) throw error;
    if (error.code === ErrorCode.overtaken || error.code === 0) return;
    if (error.code === ErrorCode.cancelled) {
      this.patch({ error: "Interrupted", stale: true });
      return;
    }
    this.patch({ error: error.code === ErrorCode.invalidModel ? null : error.message, stale: true });
  }
}

/** Opens the connection of the page: the token is part of its address. */
export function connectFromPage(onState: (connected: boolean) => void, make: (connect: () => WebSocket, onState: (connected: boolean) => void) => Client): Client {
  const address = new URL("ws", location.href);
  address.protocol = location.protocol === "https:" ? "wss:" : "ws:";
  address.search = "";
  address.hash = "";
  return make(() => new WebSocket(address), onState);
}
