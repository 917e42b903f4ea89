// Rename, definition, quick fixes: commands over several texts.

import type { Client } from "../client.ts";
import { choose, prompt, toast } from "../dialogs.ts";
import type { Range, ReadFile } from "../protocol.ts";
import { editsByFile, positionOf, type WorkspaceEdit } from "./convert.ts";
import type { OpenDocument } from "./documents.ts";
import type { Editor, Fix } from "./editor.ts";

interface Place {
  uri: string;
  range: Range;
}
interface Link {
  targetUri: string;
  targetSelectionRange: Range;
}

/** Opens the text of an address, from the server where it is not open. */
export async function openUri(client: Client, editor: Editor, uri: string): Promise<OpenDocument> {
  const known = editor.documents.open.get(uri);
  return known ?? editor.documents.add(await client.request<ReadFile>("smpl/read", { uri }));
}

/** Applies edits of the server to all texts that they concern. */
export async function applyWorkspaceEdit(client: Client, editor: Editor, edit: WorkspaceEdit): Promise<number> {
  let count = 0;
  for (const [uri, edits] of editsByFile(edit)) {
    editor.applyEdits(await openUri(client, editor, uri), edits);
    count += edits.length;
  }
  return count;
}

/** Renames what is at the cursor, everywhere. */
export async function rename(client: Client, editor: Editor): Promise<void> {
  const at = atCursor(editor);
  if (!at) return;
  try {
    const answer = await client.request<{ placeholder?: string; range?: Range; start?: unknown } | null>("textDocument/prepareRename", at);
    const word = answer?.placeholder ?? wordAtCursor(editor);
    if (!answer || !word) {
      toast("There is no name at the cursor.");
      return;
    }
    const name = await prompt({ title: `Rename ${word}`, label: "New name", value: word, action: "Rename" });
    if (!name || name === word) return;
    const edit = await client.request<WorkspaceEdit | null>("textDocument/rename", { ...at, newName: name });
    if (edit) toast(`${await applyWorkspaceEdit(client, editor, edit)} places renamed.`);
  } catch (error) {
    toast((error as Error).message, "error");
  }
  editor.view.focus();
}

/** Shows where the name at the cursor is declared. */
export async function goToDefinition(client: Client, editor: Editor, show: (document: OpenDocument, range: Range) => void): Promise<void> {
  const at = atCursor(editor);
  if (!at) return;
  const answer = await client.request<Place | Place[] | Link[] | null>("textDocument/definition", at).catch(() => null);
  const first = Array.isArray(answer) ? answer[0] : answer;
  if (!first) {
    toast("There is no declaration of this in the text.");
    return;
  }
  const place = "targetUri" in first ? { uri: first.targetUri, range: first.targetSelectionRange } : first;
  show(await openUri(client, editor, place.uri), place.range);
}

/** Offers the fixes of the diagnostics at the line of the cursor; the only one is applied at once. */
export async function quickFix(editor: Editor, apply: (fix: Fix) => void): Promise<void> {
  const document = editor.current;
  if (!document) return;
  const { state } = editor.view;
  const line = state.doc.lineAt(state.selection.main.head).number - 1;
  const here = document.diagnostics.filter((d) => d.range.start.line <= line && d.range.end.line >= line);
  const fixes = here.flatMap((d) => editor.fixesOf(document.uri, d));
  if (fixes.length === 0) {
    toast(here.length === 0 ? "There is no problem in this line." : "There is no automatic fix for this problem.");
    return;
  }
  const chosen = fixes.length === 1 ? fixes[0] : await choose("Fix", fixes.map((fix) => ({ label: fix.title, value: fix })));
  if (chosen) apply(chosen);
  editor.view.focus();
}

function atCursor(editor: Editor): { textDocument: { uri: string }; position: { line: number; character: number } } | null {
  if (!editor.current) return null;
  const { state } = editor.view;
  return { textDocument: { uri: editor.current.uri }, position: positionOf(state.doc, state.selection.main.head) };
}

function wordAtCursor(editor: Editor): string {
  const { state } = editor.view;
  const word = state.wordAt(state.selection.main.head);
  return word ? state.sliceDoc(word.from, word.to) : "";
}
