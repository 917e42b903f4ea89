// The editor: one view, several open texts.

import { acceptCompletion, closeBrackets, closeBracketsKeymap, completionKeymap } from "@codemirror/autocomplete";
import { defaultKeymap, history, historyKeymap } from "@codemirror/commands";
import { bracketMatching, indentOnInput, indentUnit } from "@codemirror/language";
import { type Diagnostic, lintGutter, setDiagnostics } from "@codemirror/lint";
import { highlightSelectionMatches, searchKeymap } from "@codemirror/search";
import { Annotation, EditorState, type Extension } from "@codemirror/state";
import { drawSelection, EditorView, highlightActiveLine, highlightActiveLineGutter, keymap, lineNumbers, tooltips } from "@codemirror/view";
import type { Client } from "../client.ts";
import { button, h } from "../dom.ts";
import type { Range } from "../protocol.ts";
import { editorChanges, offsetOf, type TextEdit } from "./convert.ts";
import { Documents, type LspDiagnostic, type OpenDocument } from "./documents.ts";
import { documentUri, languageFeatures, middle } from "./features.ts";
import { folding } from "./folding.ts";
import { smplLanguage } from "./language.ts";
import { signatureHelp } from "./signature.ts";

/** A fix of a diagnostic that the server offers. */
export interface Fix {
  title: string;
  diagnostics?: LspDiagnostic[];
  edit?: import("./convert.ts").WorkspaceEdit;
  isPreferred?: boolean;
}

export interface EditorHandlers {
  /** The text of a document has changed. */
  onChange(document: OpenDocument): void;
  /** The cursor is at another line of the shown document. */
  onCursor(uri: string, line: number): void;
  onDiagnostics(uri: string): void;
  keys: ReadonlyArray<{ key: string; run: () => boolean }>;
  applyFix(fix: Fix): void;
}

const fromOutside = Annotation.define<boolean>();

export class Editor {
  readonly view: EditorView;
  readonly documents: Documents;
  current: OpenDocument | null = null;
  /** Fixes of the diagnostics of each document. */
  readonly fixes = new Map<string, Fix[]>();
  private readonly client: Client;
  private readonly handlers: EditorHandlers;
  private line = -1;

  constructor(parent: HTMLElement, client: Client, handlers: EditorHandlers) {
    this.client = client;
    this.handlers = handlers;
    const extensions = this.extensions();
    this.documents = new Documents(client, (text, readOnly, uri) =>
      EditorState.create({ doc: text, extensions: [documentUri.init(() => uri), EditorState.readOnly.of(readOnly), extensions] }),
    );
    this.view = new EditorView({ parent });
    client.on<{ uri: string; version?: number; diagnostics: LspDiagnostic[] }>("textDocument/publishDiagnostics", (p) => this.publish(p));
  }

  /** Shows an open document. */
  show(document: OpenDocument): void {
    if (this.current === document) return;
    if (this.current) this.current.state = this.view.state;
    this.current = document;
    this.view.setState(document.state);
    this.paintDiagnostics(document);
    this.line = -1;
  }

  /** Selects a range of the shown document and brings it into view. */
  reveal(range: Range, focus = true): void {
    const { doc } = this.view.state;
    const [from, to] = [offsetOf(doc, range.start), offsetOf(doc, range.end)];
    this.view.dispatch({ selection: { anchor: from, head: focus ? from : to }, effects: EditorView.scrollIntoView(from, { y: "center" }) });
    if (focus) this.view.focus();
  }

  /** Replaces the text of a document, keeping what is equal at both ends. */
  replaceText(document: OpenDocument, text: string): void {
    this.change(document, [middle(document.text.toString(), text)]);
  }

  /** Applies edits of the server to an open document, shown or not. */
  applyEdits(document: OpenDocument, edits: readonly TextEdit[]): void {
    this.change(document, editorChanges(document.text, edits));
  }

  private change(document: OpenDocument, changes: Array<{ from: number; to: number; insert: string }>): void {
    if (document === this.current) {
      this.view.dispatch({ changes, annotations: fromOutside.of(true) });
      return;
    }
    const transaction = document.state.update({ changes });
    const before = document.state.doc;
    document.state = transaction.state;
    this.documents.changed(document, before, transaction.changes, document.state.doc);
    this.handlers.onChange(document);
  }

  private extensions(): Extension {
    return [
      lineNumbers(), highlightActiveLineGutter(), highlightActiveLine(), history(), drawSelection(), indentOnInput(), bracketMatching(), closeBrackets(),
      highlightSelectionMatches(), lintGutter(), indentUnit.of("  "), EditorState.tabSize.of(2),
      tooltips({ position: "fixed", parent: document.body }),
      EditorView.contentAttributes.of({ "aria-label": "Text of the model", spellcheck: "false", autocapitalize: "off" }),
      smplLanguage,
      languageFeatures(this.client),
      signatureHelp(this.client),
      folding(this.client),
      keymap.of([
        ...this.handlers.keys.map(({ key, run }) => ({ key, run, preventDefault: true })),
        ...closeBracketsKeymap, ...completionKeymap, ...searchKeymap, ...historyKeymap, ...defaultKeymap,
        // Tab accepts a completion and otherwise leaves the editor, so that the keyboard is never caught.
        { key: "Tab", run: acceptCompletion },
      ]),
      EditorView.updateListener.of((update) => {
        const shown = this.current;
        if (!shown || update.state.field(documentUri) !== shown.uri) return;
        if (update.docChanged) {
          this.documents.changed(shown, update.startState.doc, update.changes, update.state.doc);
          this.handlers.onChange(shown);
        }
        const line = update.state.doc.lineAt(update.state.selection.main.head).number - 1;
        if (line !== this.line && (update.selectionSet || update.docChanged)) {
          this.line = line;
          this.handlers.onCursor(shown.uri, line);
        }
      }),
    ];
  }

  private publish(params: { uri: string; version?: number; diagnostics: LspDiagnostic[] }): void {
    const document = this.documents.open.get(params.uri);
    if (!document || (params.version !== undefined && params.version !== null && params.version !== document.version)) return;
    document.diagnostics = params.diagnostics;
    this.fixes.set(document.uri, []);
    this.paintDiagnostics(document);
    this.handlers.onDiagnostics(document.uri);
    if (params.diagnostics.length > 0) void this.askFixes(document);
  }

  /** Asks for the fixes of the first diagnostics; they appear in the tooltips and in the list of problems. */
  private async askFixes(document: OpenDocument): Promise<void> {
    const { diagnostics, version } = document;
    const answers = await Promise.all(
      diagnostics.slice(0, 12).map((d) =>
        this.client
          .request<Fix[] | null>("textDocument/codeAction", { textDocument: { uri: document.uri }, range: d.range, context: { diagnostics: [d], triggerKind: 2 } })
          .then((fixes) => (fixes ?? []).filter((f) => f.edit).map((f) => ({ ...f, diagnostics: [d] })))
          .catch(() => [] as Fix[]),
      ),
    );
    if (document.version !== version || document.diagnostics !== diagnostics) return;
    this.fixes.set(document.uri, answers.flat());
    this.paintDiagnostics(document);
    this.handlers.onDiagnostics(document.uri);
  }

  /** Fixes of one diagnostic. */
  fixesOf(uri: string, diagnostic: LspDiagnostic): Fix[] {
    return (this.fixes.get(uri) ?? []).filter((f) => f.diagnostics?.includes(diagnostic));
  }

  private paintDiagnostics(document: OpenDocument): void {
    if (document !== this.current) return;
    const { doc } = this.view.state;
    const list = document.diagnostics.map((d): Diagnostic => {
      const from = offsetOf(doc, d.range.start);
      const to = Math.max(from, offsetOf(doc, d.range.end));
      return {
        from, to,
        severity: d.severity === 1 || d.severity === undefined ? "error" : d.severity === 2 ? "warning" : "info",
        source: d.code === undefined ? "" : String(d.code),
        message: d.message,
        renderMessage: () => this.renderDiagnostic(document, d),
      };
    });
    this.view.dispatch(setDiagnostics(this.view.state, list));
  }

  private renderDiagnostic(document: OpenDocument, diagnostic: LspDiagnostic): Node {
    const [message, ...help] = diagnostic.message.split(/\n+(?:help: )?/);
    const related = (diagnostic.relatedInformation ?? []).map((r) => r.message).filter((m) => m && m !== message);
    return h(
      "div", { class: "diagnostic" },
      h("div", { class: "diagnostic-message" }, message),
      ...help.filter(Boolean).map((line) => h("div", { class: "diagnostic-help" }, line)),
      ...related.map((line) => h("div", { class: "diagnostic-related" }, line)),
      ...this.fixesOf(document.uri, diagnostic).map((fix) => button(fix.title, () => this.handlers.applyFix(fix), { class: "fix" })),
    );
  }
}
