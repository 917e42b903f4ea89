import assert from "node:assert/strict";
import { test } from "node:test";
import { lastNotAbove, unpack } from "../src/packed.ts";
import { panelKey } from "../src/plans.ts";
import { panelData, valueAt, verticalRange } from "../src/plots/curves.ts";
import type { PanelPlan, Run, RunResult } from "../src/protocol.ts";

const pack = (values: number[]) => Buffer.from(Float64Array.from(values).buffer).toString("base64");

function result(runs: Array<Record<string, number[]>>, values: Array<number | null> = []): RunResult {
  const made = runs.map((columns, i): Partial<Run> => ({
    label: `run ${i}`, value: values[i] ?? null, grids: { step: pack([0, 1, 2]), fine: pack([0, 1, 1, 2]) },
    columns: Object.entries(columns).map(([name, ys]) => ({ name, unit: "m", role: "state", grid: ys.length === 4 ? "fine" : "step", style: name.startsWith("obs.") ? "dots" : ys.length === 4 ? "line" : "step", values: pack(ys) })),
  }));
  return { runs: made } as unknown as RunResult;
}

const line = (column: string, style: "line" | "step" | "dots" = "line") => ({ column, label: column, role: "state", style, low: null, high: null, target: null });
const plan = (...lines: PanelPlan["lines"]): PanelPlan => ({ id: 1, title: "x", unit: "m", text: "", role: "state", group: "", first: true, low: null, high: null, lines });

test("packed numbers come back, gaps too", () => {
  assert.deepEqual([...unpack(pack([1.5, NaN, -2e300]))], [1.5, NaN, -2e300]);
  assert.deepEqual([...unpack("")], []);
});

test("times are found by bisection", () => {
  assert.equal(lastNotAbove([0, 1, 1, 2], 1), 2);
  assert.equal(lastNotAbove([0, 1], -1), -1);
  assert.equal(lastNotAbove([0, 1], 5), 1);
});

test("lines are interpolated, steps hold over the interval that ends at their row", () => {
  assert.equal(valueAt([0, 2], [10, 20], "line", 1), 15);
  assert.equal(valueAt([0, 1, 2], [NaN, 5, 7], "step", 0.5), 5);
  assert.equal(valueAt([0, 1, 2], [NaN, 5, 7], "step", 1), 5);
  assert.equal(valueAt([0, 1, 2], [NaN, 5, 7], "step", 1.5), 7);
  assert.ok(Number.isNaN(valueAt([0, 1], [1, 2], "line", 3)));
});

test("a jump has two values at one time", () => {
  assert.equal(valueAt([0, 1, 1, 2], [0, 1, 5, 6], "line", 0.5), 0.5);
  assert.equal(valueAt([0, 1, 1, 2], [0, 1, 5, 6], "line", 1), 5);
  assert.equal(valueAt([0, 1, 1, 2], [0, 1, 5, 6], "line", 1.5), 5.5);
});

test("several seeds give their range and mean", () => {
  const data = panelData(plan(line("x")), result([{ x: [0, 1, 1, 2] }, { x: [2, 3, 3, 6] }]), [], false);
  const [ribbon] = data.ribbons;
  assert.deepEqual([...(ribbon?.low ?? [])], [0, 1, 1, 2]);
  assert.deepEqual([...(ribbon?.high ?? [])], [2, 3, 3, 6]);
  const mean = data.curves.find((c) => c.named);
  assert.deepEqual([...(mean?.ys ?? [])], [1, 2, 2, 4]);
});

test("a sweep gives one curve a value, with colours of their own", () => {
  const data = panelData(plan(line("x")), result([{ x: [0, 1, 1, 2] }, { x: [0, 2, 2, 4] }, { x: [0, 3, 3, 6] }], [1, 2, 3]), [], false);
  assert.equal(data.curves.length, 3);
  assert.equal(new Set(data.curves.map((c) => c.colour)).size, 3);
});

test("readings that repeat their curve are left out, noisy ones are shown", () => {
  const lines = [line("x"), { ...line("obs.x", "dots"), label: "x observed" }];
  const exact = panelData(plan(...lines), result([{ x: [0, 1, 1, 2], "obs.x": [0, 1, 2] }]), [], false);
  assert.deepEqual(exact.curves.map((c) => c.style), ["line"]);
  const noisy = panelData(plan(...lines), result([{ x: [0, 1, 1, 2], "obs.x": [0.3, 1.2, 1.5] }]), [], false);
  assert.deepEqual(noisy.curves.map((c) => c.style), ["line", "dots"]);
  assert.equal(noisy.curves[0]?.colour, noisy.curves[1]?.colour);
});

test("crowded panels keep the most changing curves and count the others", () => {
  const columns = Object.fromEntries(Array.from({ length: 12 }, (_, i) => [`x${i}`, [1, 1, 1, 1 + i]]));
  const data = panelData(plan(...Object.keys(columns).map((n) => line(n))), result([columns]), [], false, 8);
  assert.equal(data.left, 4);
  assert.deepEqual(data.curves.map((c) => c.label), ["x4", "x5", "x6", "x7", "x8", "x9", "x10", "x11"]);
});

test("a panel is the same when the numbers of panels move", () => {
  assert.equal(panelKey({ ...plan(line("x")), id: 3 }), panelKey({ ...plan(line("x")), id: 4 }));
  assert.notEqual(panelKey(plan(line("x"))), panelKey({ ...plan(line("x")), title: "y" }));
});

test("a pinned run is a ghost in the colour of its curve", () => {
  const first = result([{ x: [0, 1, 1, 2] }]);
  const data = panelData(plan(line("x")), result([{ x: [0, 2, 2, 4] }]), [{ label: "pin", result: first }], false);
  assert.equal(data.ghosts[0]?.colour, data.curves[0]?.colour);
  assert.deepEqual([...(data.ghosts[0]?.ys ?? [])], [0, 1, 1, 2]);
});

test("the axis includes a set-point that is near, and not one that is far", () => {
  const near = { ...panelData(plan(line("x")), result([{ x: [0, 1, 1, 2] }]), [], false), levels: [{ value: 3, kind: "target" as const }] };
  assert.ok(verticalRange(near, 0, 2)[1] > 3);
  const far = { ...near, levels: [{ value: 300, kind: "target" as const }] };
  assert.ok(verticalRange(far, 0, 2)[1] < 3);
});
