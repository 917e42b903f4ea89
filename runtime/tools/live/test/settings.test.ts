import assert from "node:assert/strict";
import { test } from "node:test";
import type { Control, Model } from "../src/protocol.ts";
import { compiledKey, countChanges, pruned, shareOf, summary, trackOf, valueAt, withKey, withValue, withVariant } from "../src/settings.ts";

const control = (part: Partial<Control>): Control => ({ name: "k", array: "k", component: "", unit: "1", text: "", value: 1, low: null, high: null, ...part });

test("a value is added and, at the value of the model, removed", () => {
  const one = withValue({}, "parameters", "k", 2);
  assert.deepEqual(one, { parameters: { k: 2 } });
  assert.deepEqual(withValue(one, "parameters", "k", null), {});
  assert.deepEqual(withValue(withValue(one, "parameters", "q", 3), "parameters", "k", null), { parameters: { q: 3 } });
});

test("settings are not changed in place", () => {
  const before = { parameters: { k: 2 } };
  withValue(before, "parameters", "k", 3);
  assert.deepEqual(before, { parameters: { k: 2 } });
});

test("an option of a choice replaces the other one", () => {
  const first = withVariant(withVariant({}, "scheme=upwind", true), "fouling", true);
  assert.deepEqual(withVariant(first, "scheme=central", true).variants, ["fouling", "scheme=central"]);
  assert.deepEqual(withVariant(withVariant(first, "scheme=central", false), "fouling", false), {});
});

test("each changed control counts once, the seed does not", () => {
  assert.equal(countChanges({}), 0);
  assert.equal(countChanges({ seed: 4 }), 0);
  assert.equal(countChanges({ parameters: { a: 1, b: 2 }, variants: ["x"], method: "ida", sweep: { name: "a", values: [1, 2, 3] } }), 5);
});

test("parameters need no new model, variants and structural settings do", () => {
  assert.equal(compiledKey({ parameters: { k: 1 }, seed: 3 }), compiledKey({}));
  assert.notEqual(compiledKey({ variants: ["x"] }), compiledKey({}));
  assert.notEqual(compiledKey({ settings: { n: 20 } }), compiledKey({}));
});

test("settings of what the text no longer has are dropped", () => {
  const model = {
    parameters: [control({ name: "k" })], states: [control({ name: "x" })], discretes: [], actions: [control({ name: "u" })], disturbances: [], variants: [{ name: "v", on: false }], choices: [],
    scenarios: ["default"], policies: ["nominal"], methods: ["ida"], rewards: [], levels: [],
  } as unknown as Model;
  const settings = {
    parameters: { k: 1, gone: 2 }, initial: { x: 1 }, actions: { w: 1 }, variants: ["v", "old"], scenario: "legacy", policy: "nominal", method: "explicit",
    pid: { measured: "x", action: "w", gain: 1, integral_time: 1, derivative_time: 0, set_point: 1 },
  };
  assert.deepEqual(pruned(settings, model), { parameters: { k: 1 }, initial: { x: 1 }, variants: ["v"], policy: "nominal" });
});

test("sliders reach both ends of their track exactly", () => {
  for (const track of [{ low: 0.05, high: 0.2, log: false }, { low: 1e9, high: 1e11, log: true }, { low: -5, high: 5, log: false }]) {
    assert.equal(valueAt(track, 0), track.low);
    assert.equal(valueAt(track, 1), track.high);
    for (const share of [0.1, 0.25, 0.5, 0.9]) assert.ok(Math.abs(shareOf(track, valueAt(track, share)) - share) < 2e-3);
  }
});

test("values of sliders are short numbers", () => {
  assert.equal(valueAt({ low: 0, high: 1, log: false }, 1 / 3), 0.333);
  assert.equal(valueAt({ low: 0.05, high: 0.2, log: false }, 1 / 3), 0.1);
});

test("the track is that of the server, else the bounds, else around the value", () => {
  assert.deepEqual(trackOf(control({ slider: { low: 1, high: 100, log: true } })), { low: 1, high: 100, log: true });
  assert.deepEqual(trackOf(control({ low: 0, high: 5 })), { low: 0, high: 5, log: false });
  assert.deepEqual(trackOf(control({ value: -4 })), { low: -6, high: -2, log: false });
  assert.deepEqual(trackOf(control({ value: 0 })), { low: -1, high: 1, log: false });
});

test("pinned runs are named after what was changed", () => {
  assert.equal(summary({}), "as in the model");
  assert.equal(summary({ parameters: { U: 60 }, seed: 2 }), "U = 60, seed 2");
  assert.equal(summary({ parameters: { a: 1, b: 2, c: 3, d: 4 } }), "a = 1, b = 2, 2 more");
});

test("undefined removes a key", () => {
  assert.deepEqual(withKey({ seed: 1 }, "seed", undefined), {});
});
