// Saving: never over a version that the page has not seen.

import { type Client, RpcError } from "./client.ts";
import { choose, prompt, toast } from "./dialogs.ts";
import type { OpenDocument } from "./editor/documents.ts";
import type { Editor } from "./editor/editor.ts";
import { ErrorCode, type Changed, type Files } from "./protocol.ts";

/** Saves a document; shipped models are saved under a new name. Returns the document that holds the text afterwards. */
export async function save(client: Client, editor: Editor, document: OpenDocument, files: Files | null): Promise<OpenDocument | null> {
  const text = document.text.toString();
  if (document.readOnly) return saveAs(client, editor, document, files);
  try {
    const answer = await client.request<{ digest: string }>("smpl/save", { uri: document.uri, text, digest: document.digest });
    editor.documents.markSaved(document, text, answer.digest);
    toast(`${document.name} saved.`);
    return document;
  } catch (error) {
    if (error instanceof RpcError && error.code === ErrorCode.conflict) return conflict(client, editor, document, error.data as { digest: string; text: string | null });
    toast((error as Error).message, "error");
    return null;
  }
}

/** Saves under another name in the folder. */
export async function saveAs(client: Client, editor: Editor, document: OpenDocument, files: Files | null): Promise<OpenDocument | null> {
  if (!files) return null;
  const name = await prompt({ title: "Save as", label: `File name in ${files.folder}`, value: document.name, action: "Save" });
  if (!name) return null;
  const file = name.endsWith(".eq") || name.endsWith(".yaml") ? name : `${name}.eq`;
  const uri = `${files.folder_uri.replace(/\/$/, "")}/${file.split("/").map(encodeURIComponent).join("/")}`;
  const text = document.text.toString();
  try {
    const answer = await client.request<{ digest: string }>("smpl/save", { uri, text, digest: null });
    const copy = editor.documents.add({ uri, text, digest: answer.digest, read_only: false, name: file });
    toast(`${file} saved.`);
    return copy;
  } catch (error) {
    if (error instanceof RpcError && error.code === ErrorCode.conflict) toast(`${file} exists already: choose another name.`, "error");
    else toast((error as Error).message, "error");
    return null;
  }
}

async function conflict(client: Client, editor: Editor, document: OpenDocument, disk: { digest: string; text: string | null }): Promise<OpenDocument | null> {
  const answer = await choose<"mine" | "disk">(
    `${document.name} has changed on disk`,
    [
      { label: "Keep my text", value: "mine", note: "overwrites the version on disk" },
      { label: "Take the version on disk", value: "disk", note: "undo brings my text back" },
    ],
    "Another program wrote this file after the page had read it. Closing this dialog changes nothing.",
  );
  if (answer === "disk" && disk.text !== null) takeDisk(editor, document, { uri: document.uri, digest: disk.digest, text: disk.text });
  if (answer !== "mine") return null;
  const text = document.text.toString();
  const saved = await client.request<{ digest: string }>("smpl/save", { uri: document.uri, text, digest: disk.digest, force: true });
  editor.documents.markSaved(document, text, saved.digest);
  toast(`${document.name} saved.`);
  return document;
}

/** Puts the version on disk into the editor; one undo takes it back. */
export function takeDisk(editor: Editor, document: OpenDocument, changed: Changed): void {
  if (changed.text === null || changed.digest === null) return;
  editor.replaceText(document, changed.text);
  editor.documents.markSaved(document, document.text.toString(), changed.digest);
}
