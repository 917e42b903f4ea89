import assert from "node:assert/strict";
import { test } from "node:test";
import { axisScale, formatDuration, formatNumber, formatQuantity, parseNumber, plainNumber, scaleFor, typesetUnit } from "../src/numbers.ts";

test("numbers have significant digits and no trailing zeros", () => {
  const cases: Array<[number, string]> = [
    [0, "0"], [1, "1"], [0.1 + 0.2, "0.3"], [51.34660619, "51.347"], [-0.00012345678, "−0.00012346"], [123456.7, "123457"], [72e9, "7.2×10¹⁰"], [1e-8, "10⁻⁸"], [-1e9, "−10⁹"], [9.99999e-5, "0.0001"], [9.9e-5, "9.9×10⁻⁵"],
  ];
  for (const [value, text] of cases) assert.equal(formatNumber(value), text);
});

test("values that are not finite are shown as signs", () => {
  assert.equal(formatNumber(NaN), "–");
  assert.equal(formatNumber(null), "–");
  assert.equal(formatNumber(Infinity), "∞");
  assert.equal(formatNumber(-Infinity), "−∞");
});

test("rounding up to the next power keeps the digits", () => {
  assert.equal(formatNumber(999999.9, 5), "10⁶");
  assert.equal(formatNumber(0.99999999, 3), "1");
});

test("number fields read what they show", () => {
  for (const value of [0, 1.5, -2, 7.2e10, 1e-8, 0.219, 123456, -5e4]) assert.equal(parseNumber(plainNumber(value)), value);
});

test("typed numbers may have a comma, a unicode minus or a power of ten", () => {
  assert.equal(parseNumber("0,5"), 0.5);
  assert.equal(parseNumber("−3"), -3);
  assert.equal(parseNumber("7.2×10¹⁰"), 7.2e10);
  assert.equal(parseNumber("7.2*10^10"), 7.2e10);
  assert.equal(parseNumber("1.2×10⁻⁶"), 1.2e-6);
  assert.equal(parseNumber(" .5 "), 0.5);
});

test("what is not a number is refused", () => {
  for (const text of ["", "abc", "1 2 x", "1e", "--1", "1e999"]) assert.equal(parseNumber(text), null);
});

test("units are typeset as in the documents of models", () => {
  // The same cases as in runtime/tools/src/document/markdown.rs.
  assert.equal(typesetUnit("kJ/(min m^2 K)"), "kJ/(min m² K)");
  assert.equal(typesetUnit("1/(m^2)"), "1/(m²)");
  assert.equal(typesetUnit("m^2.5/min"), "m²·⁵/min");
  assert.equal(typesetUnit("degC"), "°C");
  assert.equal(typesetUnit("1"), "");
  assert.equal(typesetUnit("s^-1"), "s⁻¹");
  assert.equal(typesetUnit("umol/L"), "µmol/L");
  assert.equal(typesetUnit("ohm"), "Ω");
  assert.equal(typesetUnit("m^(1/2) s"), "m¹/² s");
  assert.equal(typesetUnit("m^(-2)"), "m⁻²");
});

test("prefixes replace powers of ten", () => {
  assert.equal(formatQuantity(4.2e6, "J/kg"), "4.2\u202fMJ/kg");
  assert.equal(formatQuantity(4.2e6, "kJ/kg"), "4.2\u202fGJ/kg");
  assert.equal(formatQuantity(101325, "Pa"), "101.33\u202fkPa");
  assert.equal(formatQuantity(2e-6, "m"), "2\u202fµm");
  assert.equal(formatQuantity(51.3, "degC"), "51.3\u202f°C");
});

test("units without prefixes keep their power of ten", () => {
  assert.equal(formatQuantity(4.2e6, "1/min"), "4.2×10⁶\u202f1/min");
  assert.equal(formatQuantity(4.2e6, "m^3/s"), "4.2×10⁶\u202fm³/s");
  assert.deepEqual(scaleFor(5e5, "kg"), { factor: 1, unit: "kg" });
});

test("an axis has a prefix or a power before its unit", () => {
  assert.deepEqual(axisScale(2.4e6, "Pa"), { factor: 1e6, unit: "MPa" });
  assert.deepEqual(axisScale(7.2e10, "1/min"), { factor: 1e9, unit: "10⁹ 1/min" });
  assert.deepEqual(axisScale(3, "m"), { factor: 1, unit: "m" });
  assert.deepEqual(axisScale(0, "m"), { factor: 1, unit: "m" });
});

test("durations are short", () => {
  assert.equal(formatDuration(0.83), "0.83 ms");
  assert.equal(formatDuration(342.3), "342 ms");
  assert.equal(formatDuration(2140), "2.1 s");
  assert.equal(formatDuration(200_000), "3 min 20 s");
});
