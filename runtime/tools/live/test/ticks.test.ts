import assert from "node:assert/strict";
import { test } from "node:test";
import { decimals, padded, tickLabels, ticks } from "../src/ticks.ts";

test("every axis has at least two ticks inside of its range", () => {
  let seed = 1;
  const random = () => (seed = (seed * 16807) % 2147483647) / 2147483647;
  for (let i = 0; i < 2000; i += 1) {
    const low = (random() - 0.5) * 10 ** (random() * 24 - 12);
    const high = low + Math.max(Math.abs(low) * 1e-6, 1e-9) * 10 ** (random() * 8);
    const found = ticks(low, high, 1 + Math.floor(random() * 8));
    assert.ok(found.length >= 2, `${low} ${high}: ${found}`);
    const slack = (high - low) * 1e-6;
    assert.ok(found.every((t) => t >= low - slack && t <= high + slack), `${low} ${high}: ${found}`);
  }
});

test("ticks are round numbers", () => {
  assert.deepEqual(ticks(0, 10, 5), [0, 2, 4, 6, 8, 10]);
  assert.deepEqual(ticks(0.877, 0.932, 3), [0.88, 0.9, 0.92]);
  assert.deepEqual(ticks(-0.3, 0.3, 3), [-0.2, 0, 0.2]);
});

test("an empty range has one tick", () => {
  assert.deepEqual(ticks(3, 3, 4), [3]);
  assert.deepEqual(ticks(NaN, 1, 4), []);
});

test("labels tell ticks apart with equal decimals", () => {
  assert.deepEqual(tickLabels([0.88, 0.9, 0.92]), ["0.88", "0.90", "0.92"]);
  assert.deepEqual(tickLabels([0, 2.5, 5]), ["0.0", "2.5", "5.0"]);
  assert.deepEqual(tickLabels([-1, 0, 1]), ["−1", "0", "1"]);
  assert.equal(decimals(0.25), 2);
  assert.equal(decimals(20), 0);
});

test("constant curves are drawn flat in the middle", () => {
  assert.deepEqual(padded(2, 2), [1.9, 2.1]);
  assert.deepEqual(padded(0, 0), [-1, 1]);
  const [low, high] = padded(1.9, 1.9 + 1e-9);
  assert.ok(high - low > 0.1);
});
