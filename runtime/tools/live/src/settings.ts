// What the controls say, as the difference to the model.

import type { Control, Model, Settings } from "./protocol.ts";

/** Names of the mappings from a control's name to its number. */
export type Group = "parameters" | "initial" | "actions" | "disturbances" | "settings";

/** Group of settings that a control of a list belongs to. */
export function groupOf(list: "parameters" | "states" | "discretes" | "actions" | "disturbances", control: Control): Group {
  if (list === "parameters") return control.structural ? "settings" : "parameters";
  if (list === "states" || list === "discretes") return "initial";
  return list;
}

/** Settings with a number changed; the value of the model removes it. */
export function withValue(settings: Settings, group: Group, name: string, value: number | null): Settings {
  const map: Record<string, string | number> = { ...(settings[group] ?? {}) };
  if (value === null) delete map[name];
  else map[name] = value;
  return withKey(settings, group, Object.keys(map).length === 0 ? undefined : (map as Record<string, number>));
}

/** Settings with one entry replaced; `undefined` removes it. */
export function withKey<K extends keyof Settings>(settings: Settings, key: K, value: Settings[K] | undefined): Settings {
  const out: Settings = { ...settings };
  if (value === undefined) delete out[key];
  else out[key] = value;
  return out;
}

/** Settings with an entry of `variants` turned on or off: a name, or `choice=option`. */
export function withVariant(settings: Settings, entry: string, on: boolean): Settings {
  const key = entry.split("=")[0];
  const rest = (settings.variants ?? []).filter((v) => v.split("=")[0] !== key);
  const variants = on ? [...rest, entry] : rest;
  return withKey(settings, "variants", variants.length === 0 ? undefined : variants);
}

/** Number of differences to the model, each slider, choice and option counted once. */
export function countChanges(settings: Settings): number {
  let count = 0;
  for (const [key, value] of Object.entries(settings)) {
    if (value === undefined || key === "seed") continue;
    if (Array.isArray(value)) count += value.length;
    else if (key === "sweep" || key === "pid") count += 1;
    else if (typeof value === "object" && value !== null) count += Object.keys(value).length;
    else count += 1;
  }
  return count;
}

/** Returns whether a change of settings needs another compiled model, and so other controls. */
export function compiledKey(settings: Settings): string {
  return JSON.stringify([settings.scenario ?? "", [...(settings.variants ?? [])].sort(), settings.settings ?? {}]);
}

/** Settings without entries for what the model does not have any more. */
export function pruned(settings: Settings, model: Model): Settings {
  const known = (controls: Control[]) => new Set(controls.map((c) => c.name));
  const filter = (map: Record<string, number> | undefined, names: Set<string>) => {
    const entries = Object.entries(map ?? {}).filter(([name]) => names.has(name));
    return entries.length === 0 ? undefined : Object.fromEntries(entries);
  };
  let out = withKey(settings, "parameters", filter(settings.parameters, known(model.parameters)));
  out = withKey(out, "initial", filter(settings.initial, new Set([...known(model.states), ...known(model.discretes)])));
  out = withKey(out, "actions", filter(settings.actions, known(model.actions)));
  out = withKey(out, "disturbances", filter(settings.disturbances, known(model.disturbances)));
  const switches = new Set([...model.variants.map((v) => v.name), ...model.choices.map((c) => c.name)]);
  const variants = (settings.variants ?? []).filter((v) => switches.has(v.split("=")[0] as string));
  out = withKey(out, "variants", variants.length === 0 ? undefined : variants);
  if (out.scenario !== undefined && !model.scenarios.includes(out.scenario)) out = withKey(out, "scenario", undefined);
  if (out.policy !== undefined && !model.policies.includes(out.policy)) out = withKey(out, "policy", undefined);
  if (out.method !== undefined && !model.methods.includes(out.method)) out = withKey(out, "method", undefined);
  if (out.reward !== undefined && !model.rewards.some((r) => r.name === out.reward)) out = withKey(out, "reward", undefined);
  if (out.level !== undefined && !model.levels.includes(out.level)) out = withKey(out, "level", undefined);
  if (out.pid && !model.actions.some((a) => a.name === out.pid?.action)) out = withKey(out, "pid", undefined);
  return out;
}

/** Position 0..1 of a value on its slider, and back; logarithmic sliders move by ratios. */
export interface Track {
  low: number;
  high: number;
  log: boolean;
}

/** Track of a control: what the server proposes, else bounds, else around the value. */
export function trackOf(control: Control): Track {
  const given = control.slider;
  if (given && given.high > given.low) return { low: given.low, high: given.high, log: Boolean(given.log) && given.low > 0 && (control.value === null || control.value < given.high * 0.05 || given.high / given.low < 1e4) };
  const value = control.value ?? 0;
  if (control.low !== null && control.high !== null && control.high > control.low) return { low: control.low, high: control.high, log: false };
  if (value === 0) return { low: control.low ?? -1, high: control.high ?? 1, log: false };
  const [a, b] = [value / 2, value * 1.5];
  return { low: Math.max(Math.min(a, b), control.low ?? -Infinity), high: Math.min(Math.max(a, b), control.high ?? Infinity), log: false };
}

export function shareOf(track: Track, value: number): number {
  const share = track.log ? Math.log(Math.max(value, track.low) / track.low) / Math.log(track.high / track.low) : (value - track.low) / (track.high - track.low);
  return Math.min(1, Math.max(0, Number.isFinite(share) ? share : 0));
}

/** The value at a share of the track, rounded to a thousandth of it, so that sliders give short numbers. */
export function valueAt(track: Track, share: number): number {
  if (share <= 0) return track.low;
  if (share >= 1) return track.high;
  const raw = track.log ? track.low * (track.high / track.low) ** share : track.low + share * (track.high - track.low);
  const grain = track.log ? Math.abs(raw) * 1e-3 : (track.high - track.low) * 1e-3;
  const places = Math.max(0, Math.min(20, -Math.floor(Math.log10(grain))));
  const rounded = grain >= 1 ? Number(raw.toPrecision(4)) : Number(raw.toFixed(places));
  return Math.min(track.high, Math.max(track.low, rounded));
}

/** A short description of settings for a pinned run: `U = 60, T_c = 28, 2 more`. */
export function summary(settings: Settings): string {
  const parts = [
    ...(settings.scenario ? [settings.scenario] : []),
    ...(settings.variants ?? []),
    ...(["parameters", "initial", "actions", "disturbances", "settings"] as const).flatMap((g) => Object.entries(settings[g] ?? {}).map(([name, value]) => `${name} = ${value}`)),
    ...(settings.pid ? [`PID on ${settings.pid.measured}, gain ${settings.pid.gain}`] : []),
    ...(["policy", "start", "method", "rtol", "steps", "reward", "level"] as const).flatMap((key) => (settings[key] === undefined ? [] : [`${key} ${settings[key]}`])),
    ...(settings.seed ? [`seed ${settings.seed}`] : []),
  ];
  if (parts.length === 0) return "as in the model";
  return parts.length <= 3 ? parts.join(", ") : `${parts.slice(0, 2).join(", ")}, ${parts.length - 2} more`;
}
