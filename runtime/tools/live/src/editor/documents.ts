// The texts that are open, in step with the server.

import type { ChangeSet, EditorState, Text } from "@codemirror/state";
import type { Client } from "../client.ts";
import { Signal } from "../signal.ts";
import { contentChanges } from "./convert.ts";
import type { ReadFile } from "../protocol.ts";

/** One open text. The editor owns the state of the one that is shown; `state` is that at the last change of file. */
export interface OpenDocument {
  uri: string;
  name: string;
  version: number;
  /** Digest of the version on disk that this text began from; null for a text that was never saved. */
  digest: string | null;
  readOnly: boolean;
  /** Text as it was read or saved. */
  saved: string;
  text: Text;
  state: EditorState;
  diagnostics: LspDiagnostic[];
}

export interface LspDiagnostic {
  range: import("../protocol.ts").Range;
  severity?: 1 | 2 | 3 | 4;
  code?: string | number;
  codeDescription?: { href: string };
  message: string;
  relatedInformation?: Array<{ location: { uri: string; range: import("../protocol.ts").Range }; message: string }>;
  data?: unknown;
}

export class Documents {
  readonly open = new Map<string, OpenDocument>();
  /** Rises when a document is opened, closed, saved or its text changes from clean to changed. */
  readonly shape = new Signal(0);
  private readonly client: Client;
  private readonly makeState: (text: string, readOnly: boolean, uri: string) => EditorState;

  constructor(client: Client, makeState: (text: string, readOnly: boolean, uri: string) => EditorState) {
    this.client = client;
    this.makeState = makeState;
  }

  /** Opens a text, or returns the open one. `digest` null is a text that is not on disk. */
  add(file: Omit<ReadFile, "digest"> & { digest: string | null }): OpenDocument {
    const known = this.open.get(file.uri);
    if (known) return known;
    const state = this.makeState(file.text, false, file.uri);
    const document: OpenDocument = {
      uri: file.uri, name: file.name, version: 1, digest: file.digest, readOnly: file.read_only,
      saved: file.digest === null ? "" : state.doc.toString(), text: state.doc, state, diagnostics: [],
    };
    this.open.set(file.uri, document);
    this.announce(document);
    this.shape.set(this.shape.value + 1);
    return document;
  }

  close(uri: string): void {
    if (!this.open.delete(uri)) return;
    this.client.notify("textDocument/didClose", { textDocument: { uri } });
    this.shape.set(this.shape.value + 1);
  }

  /** Sends all texts to a server that has just been connected to. */
  announceAll(): void {
    for (const document of this.open.values()) this.announce(document);
  }

  changed(document: OpenDocument, before: Text, changes: ChangeSet, after: Text): void {
    const was = this.isDirty(document);
    document.version += 1;
    document.text = after;
    this.client.notify("textDocument/didChange", {
      textDocument: { uri: document.uri, version: document.version },
      contentChanges: contentChanges(before, changes),
    });
    if (was !== this.isDirty(document)) this.shape.set(this.shape.value + 1);
  }

  isDirty(document: OpenDocument): boolean {
    return document.digest === null || document.text.length !== document.saved.length || document.text.toString() !== document.saved;
  }

  markSaved(document: OpenDocument, text: string, digest: string): void {
    document.saved = text;
    document.digest = digest;
    this.shape.set(this.shape.value + 1);
  }

  private announce(document: OpenDocument): void {
    this.client.notify("textDocument/didOpen", {
      textDocument: { uri: document.uri, languageId: "smpl", version: document.version, text: document.text.toString() },
    });
  }
}
