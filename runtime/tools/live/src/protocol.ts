// Shapes of the messages between the page and `smpl live`.

export interface Position {
  line: number;
  character: number;
}
export interface Range {
  start: Position;
  end: Position;
}

/** A range of a text, which may be an imported one. */
export interface Location extends Range {
  uri?: string;
}

/** A list of doubles as base64, little endian; NaN is a gap. */
export type Packed = string;

export interface FileEntry {
  uri: string;
  path: string;
  title?: string | null;
}
export interface ShippedModel {
  name: string;
  title: string;
  uri: string;
  states?: number | null;
}
export interface Template {
  name: string;
  title: string;
  text: string;
}
export interface Files {
  version: string;
  folder: string;
  folder_uri: string;
  open: string | null;
  files: FileEntry[];
  models: ShippedModel[];
  templates: Template[];
  recent: FileEntry[];
}
export interface ReadFile {
  uri: string;
  text: string;
  digest: string;
  read_only: boolean;
  name: string;
}
export interface Changed {
  uri: string;
  digest: string | null;
  text: string | null;
}

export interface Slider {
  low: number;
  high: number;
  log?: boolean;
  step?: number | null;
}
export interface Control {
  name: string;
  array: string;
  component: string;
  unit: string;
  text: string;
  value: number | null;
  low: number | null;
  high: number | null;
  slider?: Slider | null;
  structural?: boolean;
  drawn?: boolean;
  computed?: boolean;
  range?: Location | null;
}
export type LineStyle = "line" | "step" | "dots";
export interface PanelLine {
  column: string;
  label: string;
  role: string;
  style: LineStyle;
  low: number | null;
  high: number | null;
  target?: number | null;
}
export interface PanelPlan {
  id: string | number;
  title: string;
  unit: string;
  text: string;
  role: string;
  group: string;
  first: boolean;
  low: number | null;
  high: number | null;
  lines: PanelLine[];
}
export interface FieldHeading {
  name: string;
  unit: string;
  text: string;
  groups: string[];
  cells: number;
  space: { name: string; unit: string; faces: number[] } | null;
}
export interface Model {
  uri: string;
  stale: boolean;
  version: number | null;
  name: string;
  text: string;
  time: { name: string; unit: string };
  step: number;
  max_steps: number;
  scenarios: string[];
  scenario: string;
  variants: { name: string; on: boolean; text?: string }[];
  choices: { name: string; options: string[]; chosen: string; text?: string }[];
  methods: string[];
  method: string;
  rtol: number;
  policies: string[];
  rewards: { name: string; unit: string; text: string; chosen: boolean }[];
  levels: string[];
  parameters: Control[];
  states: Control[];
  discretes: Control[];
  actions: Control[];
  disturbances: Control[];
  observations: { name: string; unit: string; low: number | null; high: number | null }[];
  constraints: string[];
  panels: PanelPlan[];
  fields: FieldHeading[];
  sizes: Record<string, number>;
  compile_ms: number;
  large?: { array: string; count: number; role: string }[];
}

export interface Pid {
  measured: string;
  action: string;
  gain: number;
  integral_time: number | null;
  derivative_time: number;
  set_point: number | null;
}
export interface Sweep {
  name: string;
  values: number[];
}
export interface Settings {
  scenario?: string;
  variants?: string[];
  settings?: Record<string, string | number>;
  parameters?: Record<string, number>;
  initial?: Record<string, number>;
  actions?: Record<string, number>;
  disturbances?: Record<string, number>;
  start?: "sampled" | "nominal" | "steady";
  seed?: number;
  seeds?: number;
  policy?: string;
  pid?: Pid;
  method?: string;
  rtol?: number;
  steps?: number;
  reward?: string;
  level?: string;
  keep_going?: boolean;
  sweep?: Sweep;
}

export interface Column {
  name: string;
  unit: string;
  role: string;
  grid: "step" | "fine";
  style: LineStyle;
  values: Packed;
}
export interface Field extends FieldHeading {
  times: Packed;
  values: Packed;
  low: number | null;
  high: number | null;
}
export interface End {
  kind: "failure" | "success" | "time_limit" | "open" | "error";
  step: number;
  time: number;
  name: string;
  message: string;
}
export interface RewardCourse {
  name: string;
  unit: string;
  text: string;
  total: number | null;
  values: Packed;
}
export interface ConstraintCourse {
  name: string;
  worst: number | null;
  step_of_worst: number | null;
  values: Packed;
}
export interface Run {
  label: string;
  seed: number;
  value: number | null;
  grids: { step: Packed; fine: Packed };
  columns: Column[];
  fields: Field[];
  phases: { name: string; from: number; to: number }[];
  events: { time: number; name: string }[];
  end: End;
  rewards: RewardCourse[];
  episode_return: number | null;
  reward: string;
  constraints: ConstraintCourse[];
  excursion: string | null;
  statistics: Record<string, number>;
}
export interface RunResult {
  uri: string;
  stale: boolean;
  channel: string;
  ms: { compile: number; run: number; total: number };
  time_unit: string;
  step: number;
  runs: Run[];
  warnings: string[];
}

export interface NamedValue {
  name: string;
  unit: string;
  value: number | null;
}
export interface SteadyValue extends NamedValue {
  role: string;
  low: number | null;
  high: number | null;
}
export interface SteadyResult {
  uri: string;
  stale: boolean;
  found: boolean;
  message?: string | null;
  free?: { name: string; unit: string }[];
  values: SteadyValue[];
  residual_norm?: number | null;
  iterations?: number | null;
  eigenvalues: { re: number; im: number }[] | null;
  eigenvalue_note?: string | null;
  others: { values: NamedValue[] }[] | null;
}

export interface StructureRow {
  name: string;
  unit: string;
  text?: string;
  count: number;
  kind?: string;
  range?: Location | null;
  uri?: string;
}
export interface StructureResult {
  uri: string;
  stale: boolean;
  states: StructureRow[];
  algebraic: StructureRow[];
  equations: { unknown: string; count?: number; range: Location | null; line: number | null; uri?: string; text: string }[];
  blocks: { size: number; unknowns: string[] }[];
  explicit: boolean;
  method?: string;
  nonzeros: number | null;
  roots: { name: string; action: string }[];
  invariants: string[];
  reduction: Reduction | null;
}

/** What index reduction did. */
export interface Reduction {
  differentiated: { times: number; place: string; equation: string; range: Location | null; line: number | null; uri?: string }[];
  follow: string[];
  projected: string[];
  free: string[];
  freedom: number;
}

export interface EquationEntry {
  latex: string;
  uri?: string;
  range: Location | null;
  kind: string;
  text: string;
  name: string;
}
export interface EquationsResult {
  stale: boolean;
  equations: EquationEntry[];
}
export interface Exported {
  name: string;
  mime: string;
  text?: string;
  base64?: string;
}

/** Codes of errors that the page treats in a way of its own. */
export const ErrorCode = { methodNotFound: -32601, cancelled: -32800, overtaken: -32801, conflict: 1, invalidModel: 2, setting: 3 } as const;
