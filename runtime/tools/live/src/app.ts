// The state of the page: what is open, what the controls say, what the server answered.

import type { Client } from "./client.ts";
import type { Editor } from "./editor/editor.ts";
import type { Pinned } from "./plots/curves.ts";
import type { Shared } from "./plots/shared.ts";
import type { Files, Model, Range, RunResult, Settings } from "./protocol.ts";
import type { Signal } from "./signal.ts";

/** State that parts of the page share. */
export interface App {
  client: Client;
  editor: Editor;
  shared: Shared;
  files: Signal<Files | null>;
  /** Address of the model that the results belong to. */
  main: Signal<string | null>;
  model: Signal<Model | null>;
  settings: Signal<Settings>;
  result: Signal<RunResult | null>;
  pinned: Signal<readonly Pinned[]>;
  /** Names of panels that are shown; null shows those that the model proposes. */
  chosen: Signal<ReadonlySet<string> | null>;
  /** Shows a place of a text in the editor. */
  goTo(uri: string, range: Range): void;
  /** Asks again for what depends on the text or the settings. */
  refresh(): void;
}
