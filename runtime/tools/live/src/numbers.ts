// Numbers and units as text: significant digits, SI prefixes, typeset units.

const SUPERSCRIPTS: Record<string, string> = {
  "0": "⁰", "1": "¹", "2": "²", "3": "³", "4": "⁴", "5": "⁵", "6": "⁶", "7": "⁷", "8": "⁸", "9": "⁹", "-": "⁻", ".": "·",
};
const MINUS = "\u2212";

/** Digits and signs raised: `-3` becomes `⁻³`. */
export function superscript(text: string): string {
  return [...text].map((c) => SUPERSCRIPTS[c] ?? c).join("");
}

/** Returns the number with that many significant digits and no trailing zeros; `1.2×10⁻⁶` outside of 1e-4..1e6. */
export function formatNumber(value: number | null | undefined, digits = 5): string {
  if (value === null || value === undefined || Number.isNaN(value)) return "–";
  if (!Number.isFinite(value)) return value > 0 ? "∞" : `${MINUS}∞`;
  if (value === 0) return "0";
  const [mantissa = "", power = "0"] = value.toExponential(Math.max(0, digits - 1)).split("e");
  const exponent = Number(power);
  if (exponent >= -4 && exponent < 6) {
    return withMinus(trimZeros(value.toFixed(Math.max(0, Math.min(20, digits - 1 - exponent)))));
  }
  const factor = trimZeros(mantissa);
  const raised = `10${superscript(String(exponent))}`;
  return withMinus(factor === "1" ? raised : factor === "-1" ? `-${raised}` : `${factor}×${raised}`);
}

/** The shortest text that a number field can read back: `72000000000` is `7.2e10`. */
export function plainNumber(value: number): string {
  if (!Number.isFinite(value)) return value > 0 ? "inf" : "-inf";
  const short = Number(value.toPrecision(12));
  const size = Math.abs(short);
  if (size !== 0 && (size >= 1e7 || size < 1e-4)) return short.toExponential().replace("e+", "e");
  return String(short);
}

/** Reads what a person types: decimal comma, unicode minus, `7.2×10¹⁰`, `1e-3`; `null` for anything else. */
export function parseNumber(text: string): number | null {
  const raised = (digits: string) => [...digits].map((c) => Object.keys(SUPERSCRIPTS).find((k) => SUPERSCRIPTS[k] === c) ?? c).join("");
  const plain = text
    .trim()
    .replace(/[\u2212–]/g, "-")
    .replace(/\s/g, "")
    .replace(/[×x*]10\^?([⁻⁰¹²³⁴⁵⁶⁷⁸⁹+-]?[⁰¹²³⁴⁵⁶⁷⁸⁹\d]+)$/, (_, digits: string) => `e${raised(digits)}`)
    .replace(/^([+-]?\d+),(\d+)/, "$1.$2");
  if (!/^[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?$/i.test(plain)) return null;
  const value = Number(plain);
  return Number.isFinite(value) ? value : null;
}

/** A unit as printed: `kJ/(min m^2 K)` becomes `kJ/(min m² K)`, `degC` becomes `°C`, the unit of numbers is empty. */
export function typesetUnit(unit: string | null | undefined): string {
  if (!unit || unit === "1") return "";
  return unit
    .replace(/\^\(([-+]?\d+)\/(\d+)\)/g, (_, a: string, b: string) => `${superscript(a)}/${superscript(b)}`)
    .replace(/\^(?:\(([-+]?\d+(?:\.\d+)?)\)|([-+]?\d+(?:\.\d+)?))/g, (_, a?: string, b?: string) => superscript(a ?? b ?? ""))
    .replace(/\bdeg([CF])\b/g, "°$1")
    .replace(/\bdeg\b/g, "°")
    .replace(/\bohm\b/g, "Ω")
    .replace(/\bu(?=(?:m|g|s|L|mol|M|A|V|W|Pa|J)\b)/g, "µ")
    .replace(/\s*\*\s*/g, " ");
}

const PREFIXES: ReadonlyArray<readonly [string, number]> = [
  ["p", -12], ["n", -9], ["µ", -6], ["m", -3], ["", 0], ["k", 3], ["M", 6], ["G", 9], ["T", 12],
];
const PREFIXED = /^(p|n|u|m|k|M|G|T)?(Pa|J|W|V|A|Hz|N|mol|L|g|m|Wh)(?=$|[/ (])/;

/** A scale for display: divide by `factor` and print `unit` (typeset). */
export interface Scale {
  factor: number;
  unit: string;
}

/** Chooses an SI prefix where the number of that size would be printed with a power of ten; `4.2e6 J/kg` is shown in MJ/kg. */
export function scaleFor(size: number, unit: string | null | undefined): Scale {
  const plain: Scale = { factor: 1, unit: typesetUnit(unit) };
  const magnitude = Math.abs(size);
  if (!unit || !Number.isFinite(magnitude) || magnitude === 0 || (magnitude >= 1e-3 && magnitude < 1e5)) return plain;
  const match = PREFIXED.exec(unit);
  if (!match) return plain;
  const [whole, prefix = "", base = ""] = match;
  const rest = unit.slice(whole.length);
  const present = PREFIXES.find(([symbol]) => symbol === (prefix === "u" ? "µ" : prefix))?.[1] ?? 0;
  const wanted = present + 3 * Math.floor(Math.log10(magnitude) / 3);
  const chosen = PREFIXES.find(([, power]) => power === wanted);
  if (!chosen || (base === "m" && wanted > 3) || (base === "g" && wanted > 3)) return plain;
  return { factor: 10 ** (wanted - present), unit: typesetUnit(chosen[0] + base + rest) };
}

/** Scale of an axis: an SI prefix, else a power of a thousand before the unit, where plain numbers would be long. */
export function axisScale(size: number, unit: string | null | undefined): Scale {
  const scale = scaleFor(size, unit);
  const magnitude = Math.abs(size);
  if (scale.factor !== 1 || !Number.isFinite(magnitude) || magnitude === 0 || (magnitude >= 1e-3 && magnitude < 1e5)) return scale;
  const power = 3 * Math.floor(Math.log10(magnitude) / 3);
  return { factor: 10 ** power, unit: `10${superscript(String(power))} ${typesetUnit(unit)}`.trim() };
}

/** The number with its unit, with an SI prefix where that avoids a power of ten. */
export function formatQuantity(value: number | null | undefined, unit?: string | null, digits = 5): string {
  if (value === null || value === undefined || !Number.isFinite(value)) return formatNumber(value, digits);
  const scale = scaleFor(value, unit);
  const number = formatNumber(value / scale.factor, digits);
  if (!scale.unit) return number;
  return scale.unit === "%" || scale.unit === "°" ? `${number}${scale.unit === "%" ? "\u202f%" : "°"}` : `${number}\u202f${scale.unit}`;
}

/** A duration in milliseconds, for people: `0.8 ms`, `340 ms`, `2.1 s`, `3 min 20 s`. */
export function formatDuration(milliseconds: number): string {
  if (milliseconds < 10) return `${formatNumber(milliseconds, 2)} ms`;
  if (milliseconds < 1000) return `${Math.round(milliseconds)} ms`;
  if (milliseconds < 60_000) return `${formatNumber(milliseconds / 1000, 2)} s`;
  return `${Math.floor(milliseconds / 60_000)} min ${Math.round((milliseconds % 60_000) / 1000)} s`;
}

function trimZeros(text: string): string {
  return text.includes(".") ? text.replace(/0+$/, "").replace(/\.$/, "") : text;
}

function withMinus(text: string): string {
  return text.startsWith("-") ? MINUS + text.slice(1) : text;
}
