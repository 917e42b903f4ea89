// JSON-RPC 2.0 over one WebSocket that comes back after a lost connection.

/** The part of a WebSocket that the client needs; tests pass their own. */
export interface Socket {
  send(text: string): void;
  close(): void;
  onopen: (() => void) | null;
  onclose: (() => void) | null;
  onmessage: ((event: { data: string }) => void) | null;
}

/** An error answer of the server. */
export class RpcError extends Error {
  readonly code: number;
  readonly data: unknown;
  constructor(code: number, message: string, data: unknown) {
    super(message);
    this.code = code;
    this.data = data;
  }
}

interface Waiting {
  resolve(value: never): void;
  reject(error: Error): void;
}

/** A request under way: its answer, its number, and a way to cancel it. */
export interface Call<T> {
  id: number;
  answer: Promise<T>;
  cancel(): void;
}

const FIRST_DELAY = 250;
const LONGEST_DELAY = 4000;

export class Client {
  private socket: Socket | null = null;
  private open = false;
  private next = 1;
  private delay = FIRST_DELAY;
  private waiting = new Map<number, Waiting>();
  private listeners = new Map<string, Array<(params: never) => void>>();

  private readonly connect: () => Socket;
  private readonly onState: (connected: boolean) => void;
  private readonly later: (action: () => void, milliseconds: number) => void;

  constructor(connect: () => Socket, onState: (connected: boolean) => void, later: (action: () => void, ms: number) => void = (a, ms) => void setTimeout(a, ms)) {
    this.connect = connect;
    this.onState = onState;
    this.later = later;
  }

  /** Opens the connection and keeps it open. */
  start(): void {
    const socket = this.connect();
    this.socket = socket;
    socket.onopen = () => {
      this.open = true;
      this.delay = FIRST_DELAY;
      this.onState(true);
    };
    socket.onmessage = (event) => this.receive(event.data);
    socket.onclose = () => {
      const was = this.open;
      this.open = false;
      for (const [, waiting] of this.waiting) waiting.reject(new RpcError(0, "the connection was lost", null));
      this.waiting.clear();
      if (was) this.onState(false);
      this.later(() => this.start(), this.delay);
      this.delay = Math.min(LONGEST_DELAY, this.delay * 2);
    };
  }

  get connected(): boolean {
    return this.open;
  }

  /** Sends a request. The answer is rejected with `RpcError`. */
  call<T>(method: string, params: unknown): Call<T> {
    const id = this.next;
    this.next += 1;
    const answer = new Promise<T>((resolve, reject) => {
      if (!this.open || !this.socket) {
        reject(new RpcError(0, "not connected", null));
        return;
      }
      this.waiting.set(id, { resolve: resolve as (value: never) => void, reject });
      this.socket.send(JSON.stringify({ jsonrpc: "2.0", id, method, params }));
    });
    return { id, answer, cancel: () => this.notify("$/cancelRequest", { id }) };
  }

  /** Sends a request and waits for its answer. */
  request<T>(method: string, params: unknown): Promise<T> {
    return this.call<T>(method, params).answer;
  }

  /** Sends a notification; without a connection it is dropped. */
  notify(method: string, params: unknown): void {
    if (this.open) this.socket?.send(JSON.stringify({ jsonrpc: "2.0", method, params }));
  }

  /** Listens to a notification of the server. */
  on<T>(method: string, listener: (params: T) => void): void {
    const list = this.listeners.get(method) ?? [];
    list.push(listener as (params: never) => void);
    this.listeners.set(method, list);
  }

  private receive(text: string): void {
    const message = JSON.parse(text) as { id?: number; method?: string; params?: never; result?: never; error?: { code: number; message: string; data?: unknown } };
    if (message.method !== undefined) {
      for (const listener of this.listeners.get(message.method) ?? []) listener(message.params as never);
      return;
    }
    const waiting = message.id === undefined ? undefined : this.waiting.get(message.id);
    if (!waiting || message.id === undefined) return;
    this.waiting.delete(message.id);
    if (message.error) waiting.reject(new RpcError(message.error.code, message.error.message, message.error.data));
    else waiting.resolve(message.result as never);
  }
}
