// What the editor asks the language server: completion, hover, definition, rename, format, hints.

import { autocompletion, type Completion, type CompletionContext, type CompletionResult, snippet } from "@codemirror/autocomplete";
import { forEachDiagnostic } from "@codemirror/lint";
import { type EditorState, type Extension, RangeSetBuilder, StateEffect, StateField } from "@codemirror/state";
import { Decoration, type DecorationSet, EditorView, hoverTooltip, ViewPlugin, type ViewUpdate, WidgetType } from "@codemirror/view";
import type { Client } from "../client.ts";
import { h } from "../dom.ts";
import { markdown } from "../markdown.ts";
import type { Position, Range } from "../protocol.ts";
import { editorChanges, offsetOf, positionOf, snippetText, type TextEdit } from "./convert.ts";

/** The document that a state belongs to. */
export const documentUri = StateField.define<string>({ create: () => "", update: (value) => value });

interface CompletionItem {
  label: string;
  kind?: number;
  detail?: string;
  labelDetails?: { detail?: string; description?: string };
  documentation?: string | { value: string };
  insertText?: string;
  insertTextFormat?: number;
  textEdit?: TextEdit | { newText: string; insert: Range; replace: Range };
  filterText?: string;
  sortText?: string;
}

const KINDS: Record<number, string> = {
  2: "method", 3: "function", 4: "function", 5: "property", 6: "variable", 7: "class", 8: "interface", 9: "namespace", 10: "property",
  11: "unit", 12: "constant", 13: "enum", 14: "keyword", 15: "keyword", 17: "file", 20: "enum", 21: "constant", 22: "type",
};

/** Text of documentation, whichever form it has. */
export function docText(doc: unknown): string {
  if (typeof doc === "string") return doc;
  if (Array.isArray(doc)) return doc.map(docText).join("\n\n");
  const value = (doc as { value?: string; language?: string } | null)?.value ?? "";
  return (doc as { language?: string } | null)?.language ? `\`\`\`\n${value}\n\`\`\`` : value;
}

function completionSource(client: Client) {
  return async (context: CompletionContext): Promise<CompletionResult | null> => {
    const word = context.matchBefore(/[\p{L}\p{N}_]*/u);
    const before = context.pos > 0 ? context.state.sliceDoc(context.pos - 1, context.pos) : "";
    if (!context.explicit && (!word || word.from === word.to) && !/[.[:]/.test(before)) return null;
    let answer: { items: CompletionItem[] } | CompletionItem[] | null;
    try {
      answer = await client.request("textDocument/completion", {
        textDocument: { uri: context.state.field(documentUri) },
        position: positionOf(context.state.doc, context.pos),
      });
    } catch {
      return null;
    }
    const items = Array.isArray(answer) ? answer : (answer?.items ?? []);
    if (context.aborted || items.length === 0) return null;
    return { from: word?.from ?? context.pos, options: items.map((item) => toCompletion(item)), validFor: /^[\p{L}\p{N}_]*$/u };
  };
}

function toCompletion(item: CompletionItem): Completion {
  const text = item.textEdit?.newText ?? item.insertText ?? item.label;
  const documentation = docText(item.documentation ?? "");
  return {
    label: item.filterText ?? item.label,
    displayLabel: item.label,
    detail: item.labelDetails?.description ?? item.labelDetails?.detail ?? item.detail ?? "",
    type: KINDS[item.kind ?? 0] ?? "text",
    ...(item.sortText ? { sortText: item.sortText } : {}),
    ...(documentation ? { info: () => h("div", { class: "doc" }, markdown(documentation)) } : {}),
    apply: (view, completion, from, to) => {
      const range = item.textEdit && "range" in item.textEdit ? item.textEdit.range : item.textEdit?.replace;
      const start = range ? Math.min(from, offsetOf(view.state.doc, range.start)) : from;
      if (item.insertTextFormat === 2) snippet(snippetText(text))(view, completion, start, to);
      else view.dispatch({ changes: { from: start, to, insert: text }, selection: { anchor: start + text.length }, userEvent: "input.complete" });
    },
  };
}

/** Returns whether a diagnostic is at that place; its own tooltip is then the only one. */
function hasDiagnostic(state: EditorState, pos: number): boolean {
  let found = false;
  forEachDiagnostic(state, (_, from, to) => { found ||= from <= pos && pos <= to; });
  return found;
}

function hover(client: Client): Extension {
  return hoverTooltip(
    async (view, pos) => {
      if (hasDiagnostic(view.state, pos)) return null;
      const uri = view.state.field(documentUri);
      const result = await client
        .request<{ contents: unknown; range?: Range } | null>("textDocument/hover", { textDocument: { uri }, position: positionOf(view.state.doc, pos) })
        .catch(() => null);
      const text = docText(result?.contents ?? "");
      if (!text) return null;
      const from = result?.range ? offsetOf(view.state.doc, result.range.start) : pos;
      const end = result?.range ? offsetOf(view.state.doc, result.range.end) : pos;
      return { pos: from, end, above: true, create: () => ({ dom: h("div", { class: "doc hover-doc" }, markdown(text)) }) };
    },
    { hoverTime: 350 },
  );
}

interface InlayHint {
  position: Position;
  label: string | Array<{ value: string }>;
  paddingLeft?: boolean;
  paddingRight?: boolean;
}

class HintWidget extends WidgetType {
  private readonly label: string;
  constructor(label: string) {
    super();
    this.label = label;
  }
  override eq(other: HintWidget): boolean {
    return other.label === this.label;
  }
  override toDOM(): HTMLElement {
    return h("span", { class: "inlay", "aria-hidden": "true" }, this.label);
  }
}

const setMarks = StateEffect.define<{ hints?: DecorationSet; highlights?: DecorationSet }>();
const marks = StateField.define<{ hints: DecorationSet; highlights: DecorationSet }>({
  create: () => ({ hints: Decoration.none, highlights: Decoration.none }),
  update(value, transaction) {
    let next = transaction.docChanged ? { hints: value.hints.map(transaction.changes), highlights: Decoration.none } : value;
    for (const effect of transaction.effects) if (effect.is(setMarks)) next = { ...next, ...effect.value };
    return next;
  },
  provide: (field) => [EditorView.decorations.from(field, (v) => v.hints), EditorView.decorations.from(field, (v) => v.highlights)],
});

/** Asks for inlay hints and for the uses of the name at the cursor when typing pauses. */
function annotations(client: Client): Extension {
  return ViewPlugin.fromClass(
    class {
      private timer: ReturnType<typeof setTimeout> | undefined;
      private cursor: ReturnType<typeof setTimeout> | undefined;
      private readonly view: EditorView;
      constructor(view: EditorView) {
        this.view = view;
        this.timer = setTimeout(() => void this.hints(), 300);
      }
      update(update: ViewUpdate): void {
        if (update.docChanged) {
          clearTimeout(this.timer);
          this.timer = setTimeout(() => void this.hints(), 300);
        }
        if (update.selectionSet || update.docChanged) {
          clearTimeout(this.cursor);
          this.cursor = setTimeout(() => void this.highlights(), 250);
        }
      }
      destroy(): void {
        clearTimeout(this.timer);
        clearTimeout(this.cursor);
      }
      private async hints(): Promise<void> {
        const { state } = this.view;
        const answer = await client
          .request<InlayHint[] | null>("textDocument/inlayHint", {
            textDocument: { uri: state.field(documentUri) },
            range: { start: { line: 0, character: 0 }, end: positionOf(state.doc, state.doc.length) },
          })
          .catch(() => null);
        if (!answer || this.view.state.doc !== state.doc) return;
        this.view.dispatch({ effects: setMarks.of({ hints: hintDecorations(state, answer) }) });
      }
      private async highlights(): Promise<void> {
        const { state } = this.view;
        const answer = await client
          .request<Array<{ range: Range }> | null>("textDocument/documentHighlight", {
            textDocument: { uri: state.field(documentUri) },
            position: positionOf(state.doc, state.selection.main.head),
          })
          .catch(() => null);
        if (this.view.state.doc !== state.doc) return;
        const builder = new RangeSetBuilder<Decoration>();
        const ranges = (answer ?? []).map((a) => [offsetOf(state.doc, a.range.start), offsetOf(state.doc, a.range.end)] as const);
        for (const [from, to] of ranges.sort((a, b) => a[0] - b[0])) if (to > from) builder.add(from, to, Decoration.mark({ class: "same-name" }));
        this.view.dispatch({ effects: setMarks.of({ highlights: builder.finish() }) });
      }
    },
  );
}

function hintDecorations(state: EditorState, hints: InlayHint[]): DecorationSet {
  const label = (hint: InlayHint) => (typeof hint.label === "string" ? hint.label : hint.label.map((p) => p.value).join(""));
  return Decoration.set(
    hints.map((hint) => Decoration.widget({ widget: new HintWidget(label(hint)), side: 1 }).range(offsetOf(state.doc, hint.position))),
    true,
  );
}

/** Formats the text; one undo takes it back. */
export async function format(client: Client, view: EditorView): Promise<boolean> {
  const { doc } = view.state;
  const edits = await client.request<TextEdit[] | null>("textDocument/formatting", {
    textDocument: { uri: view.state.field(documentUri) },
    options: { tabSize: 2, insertSpaces: true },
  });
  if (!edits || edits.length === 0 || view.state.doc !== doc) return false;
  const changes = editorChanges(doc, edits);
  // A whole-text edit would lose the cursor: only the differing middle is replaced.
  const only = changes[0];
  if (changes.length === 1 && only && only.from === 0 && only.to === doc.length) view.dispatch({ changes: middle(doc.toString(), only.insert), userEvent: "format" });
  else view.dispatch({ changes, userEvent: "format" });
  return true;
}

/** The smallest replacement of one text by another. */
export function middle(before: string, after: string): { from: number; to: number; insert: string } {
  let start = 0;
  while (start < before.length && start < after.length && before[start] === after[start]) start += 1;
  let end = 0;
  while (end < before.length - start && end < after.length - start && before[before.length - 1 - end] === after[after.length - 1 - end]) end += 1;
  return { from: start, to: before.length - end, insert: after.slice(start, after.length - end) };
}

/** Completion, hover, hints and highlights for one editor. */
export function languageFeatures(client: Client): Extension {
  return [autocompletion({ override: [completionSource(client)], icons: true, activateOnTyping: true }), hover(client), marks, annotations(client)];
}
