// Between positions of the language server and offsets of the editor.

import type { ChangeSet, Text } from "@codemirror/state";
import type { Position, Range } from "../protocol.ts";

export interface TextEdit {
  range: Range;
  newText: string;
}
export interface WorkspaceEdit {
  changes?: Record<string, TextEdit[]>;
  documentChanges?: Array<{ textDocument: { uri: string }; edits: TextEdit[] }>;
}

/** Offset of a position; positions outside of the text give its nearest place. */
export function offsetOf(text: Text, position: Position): number {
  if (position.line >= text.lines) return text.length;
  const line = text.line(position.line + 1);
  return Math.min(line.to, line.from + position.character);
}

export function positionOf(text: Text, offset: number): Position {
  const line = text.lineAt(offset);
  return { line: line.number - 1, character: offset - line.from };
}

/** Changes for `didChange`: from the last to the first, so that each position is one of the old text. */
export function contentChanges(before: Text, changes: ChangeSet): Array<{ range: Range; text: string }> {
  const out: Array<{ range: Range; text: string }> = [];
  changes.iterChanges((from, to, _fromNew, _toNew, inserted) => {
    out.push({ range: { start: positionOf(before, from), end: positionOf(before, to) }, text: inserted.toString() });
  });
  return out.reverse();
}

/** Edits of the editor for edits of the server. */
export function editorChanges(text: Text, edits: readonly TextEdit[]): Array<{ from: number; to: number; insert: string }> {
  return edits.map((e) => ({ from: offsetOf(text, e.range.start), to: offsetOf(text, e.range.end), insert: e.newText }));
}

/** Edits of all files, whichever form the server uses. */
export function editsByFile(edit: WorkspaceEdit): Map<string, TextEdit[]> {
  const out = new Map<string, TextEdit[]>(Object.entries(edit.changes ?? {}));
  for (const change of edit.documentChanges ?? []) out.set(change.textDocument.uri, [...(out.get(change.textDocument.uri) ?? []), ...change.edits]);
  return out;
}

/** Snippet of the server (`${1:name}`, `$0`) as one of the editor (`#{1:name}`, `#{}`). */
export function snippetText(lsp: string): string {
  return lsp
    .replace(/\$\{(\d+):([^}]*)\}/g, (_, n: string, text: string) => `#{${n}:${text}}`)
    .replace(/\$\{(\d+)\}|\$(\d+)/g, (_, a?: string, b?: string) => ((a ?? b) === "0" ? "#{}" : `#{${a ?? b}}`));
}
