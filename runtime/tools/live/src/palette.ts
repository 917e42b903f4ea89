// Colours of curves: the palette of Okabe and Ito, as in the run pictures; for dark pages the same hues, lighter.

const LIGHT = ["#0072b2", "#d55e00", "#009e73", "#e69f00", "#cc79a7", "#56b4e9", "#1e1e1e", "#787878"];
const DARK = ["#56b4e9", "#f0813a", "#2dc89b", "#f2bb45", "#e09cc4", "#4a8fd8", "#e8e8e8", "#a0a0a0"];
const BANDS = ["#bebebe", "#e69f00", "#56b4e9", "#cc79a7", "#f0e442", "#009e73"];
const VIRIDIS: ReadonlyArray<readonly [number, number, number]> = [
  [68, 1, 84], [71, 44, 122], [59, 81, 139], [44, 113, 142], [33, 144, 141], [39, 173, 129], [92, 200, 99], [170, 220, 50], [253, 231, 37],
];

/** Roles with a colour of their own; other curves of a panel count on from it. */
const ROLE_START: Record<string, number> = { action: 1, disturbance: 4, reward: 2, constraint: 3 };

/** Colours that follow the page's light or dark mode. */
export interface Theme {
  dark: boolean;
  ink: string;
  grey: string;
  axis: string;
  grid: string;
  surface: string;
}

/** Reads the theme in force from the style sheet. */
export function currentTheme(): Theme {
  const style = getComputedStyle(document.documentElement);
  const read = (name: string) => style.getPropertyValue(name).trim();
  return {
    dark: read("--mode") === "dark",
    ink: read("--ink"),
    grey: read("--grey"),
    axis: read("--axis"),
    grid: read("--grid"),
    surface: read("--surface"),
  };
}

/** Colour of the curve of that number in a panel of that role. */
export function curveColour(index: number, role: string, dark: boolean): string {
  const colours = dark ? DARK : LIGHT;
  return colours[(index + (ROLE_START[role] ?? 0)) % colours.length] as string;
}

/** Colour of the band of a phase, with its opacity. */
export function bandColour(index: number, dark: boolean): string {
  return withAlpha(BANDS[index % BANDS.length] as string, dark ? 0.14 : 0.2);
}

/** A `#rrggbb` colour with an opacity. */
export function withAlpha(colour: string, alpha: number): string {
  return colour + Math.round(alpha * 255).toString(16).padStart(2, "0");
}

/** Viridis at a share from 0 to 1 as red, green, blue; grey for what is not a number. */
export function viridis(share: number): readonly [number, number, number] {
  if (Number.isNaN(share)) return [160, 160, 160];
  const place = Math.min(1, Math.max(0, share)) * (VIRIDIS.length - 1);
  const below = Math.min(VIRIDIS.length - 2, Math.floor(place));
  const [a, b] = [VIRIDIS[below] as readonly number[], VIRIDIS[below + 1] as readonly number[]];
  const mix = (i: number) => Math.round((a[i] as number) + (place - below) * ((b[i] as number) - (a[i] as number)));
  return [mix(0), mix(1), mix(2)];
}
