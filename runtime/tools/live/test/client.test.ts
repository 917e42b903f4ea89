import assert from "node:assert/strict";
import { test } from "node:test";
import { Client, RpcError, type Socket } from "../src/client.ts";
import { Follower } from "../src/follower.ts";

class FakeSocket implements Socket {
  sent: Array<{ id?: number; method: string; params: unknown }> = [];
  onopen: (() => void) | null = null;
  onclose: (() => void) | null = null;
  onmessage: ((event: { data: string }) => void) | null = null;
  send(text: string): void {
    this.sent.push(JSON.parse(text));
  }
  close(): void {
    this.onclose?.();
  }
  answer(message: object): void {
    this.onmessage?.({ data: JSON.stringify({ jsonrpc: "2.0", ...message }) });
  }
}

function connected(): { client: Client; sockets: FakeSocket[]; states: boolean[]; waits: Array<[() => void, number]> } {
  const sockets: FakeSocket[] = [];
  const states: boolean[] = [];
  const waits: Array<[() => void, number]> = [];
  const client = new Client(
    () => {
      const socket = new FakeSocket();
      sockets.push(socket);
      return socket;
    },
    (state) => states.push(state),
    (action, milliseconds) => waits.push([action, milliseconds]),
  );
  client.start();
  sockets[0]?.onopen?.();
  return { client, sockets, states, waits };
}

test("answers reach their requests in any order", async () => {
  const { client, sockets } = connected();
  const [first, second] = [client.request("a", {}), client.request("b", {})];
  sockets[0]?.answer({ id: 2, result: "second" });
  sockets[0]?.answer({ id: 1, result: "first" });
  assert.deepEqual(await Promise.all([first, second]), ["first", "second"]);
});

test("an error answer has its code and data", async () => {
  const { client, sockets } = connected();
  const request = client.request("smpl/save", {});
  sockets[0]?.answer({ id: 1, error: { code: 1, message: "conflict", data: { digest: "x" } } });
  await assert.rejects(request, (e: RpcError) => e.code === 1 && e.message === "conflict" && (e.data as { digest: string }).digest === "x");
});

test("notifications reach all their listeners", () => {
  const { client, sockets } = connected();
  const seen: unknown[] = [];
  client.on("smpl/progress", (p) => seen.push(p));
  client.on("smpl/progress", (p) => seen.push(p));
  sockets[0]?.answer({ method: "smpl/progress", params: { done: 1 } });
  assert.deepEqual(seen, [{ done: 1 }, { done: 1 }]);
});

test("a lost connection rejects what waits and comes back with growing delays", async () => {
  const { client, sockets, states, waits } = connected();
  const request = client.request("a", {});
  sockets[0]?.onclose?.();
  await assert.rejects(request, RpcError);
  assert.deepEqual(states, [true, false]);
  assert.equal(waits[0]?.[1], 250);
  waits[0]?.[0]();
  sockets[1]?.onclose?.();
  assert.equal(waits[1]?.[1], 500);
  waits[1]?.[0]();
  sockets[2]?.onopen?.();
  assert.deepEqual(states, [true, false, true]);
  assert.ok(client.connected);
});

test("requests without a connection are rejected at once", async () => {
  const { client, sockets } = connected();
  sockets[0]?.onclose?.();
  await assert.rejects(client.request("a", {}), RpcError);
});

test("cancelling names the request", () => {
  const { client, sockets } = connected();
  const call = client.call("smpl/run", {});
  void call.answer.catch(() => undefined);
  call.cancel();
  assert.deepEqual(sockets[0]?.sent[1], { jsonrpc: "2.0", method: "$/cancelRequest", params: { id: call.id } });
});

test("inputs that change during a request are asked for once, with the newest", async () => {
  const asked: number[] = [];
  const ends: Array<() => void> = [];
  let input = 0;
  const follower = new Follower(() => {
    asked.push(input);
    return { done: new Promise<void>((resolve) => ends.push(resolve)), cancel: () => undefined };
  }, 10_000);
  for (input = 1; input <= 5; input += 1) follower.touch();
  input = 5;
  assert.deepEqual(asked, [1]);
  ends[0]?.();
  await new Promise((resolve) => setTimeout(resolve, 0));
  assert.deepEqual(asked, [1, 5]);
  ends[1]?.();
  await new Promise((resolve) => setTimeout(resolve, 0));
  assert.deepEqual(asked, [1, 5]);
  assert.equal(follower.busy, false);
});

test("a request that takes long is overtaken by a newer input", async () => {
  let asked = 0;
  const follower = new Follower(() => {
    asked += 1;
    return { done: new Promise<void>(() => undefined), cancel: () => undefined };
  }, 20);
  follower.touch();
  follower.touch();
  assert.equal(asked, 1);
  await new Promise((resolve) => setTimeout(resolve, 60));
  assert.equal(asked, 2);
});

test("a request that fails does not stop the following", async () => {
  let asked = 0;
  const follower = new Follower(() => {
    asked += 1;
    return { done: Promise.reject(new Error("no")), cancel: () => undefined };
  });
  follower.touch();
  follower.touch();
  await new Promise((resolve) => setTimeout(resolve, 5));
  assert.equal(asked, 2);
});
