// The problems of the shown text, below the editor, with their fixes.

import type { Client } from "./client.ts";
import { button, fill, h } from "./dom.ts";
import type { LspDiagnostic } from "./editor/documents.ts";
import type { Editor, Fix } from "./editor/editor.ts";

export class Problems {
  readonly element: HTMLDetailsElement;
  private readonly summary = h("summary", { class: "problems-summary" });
  private readonly list = h("ul", { class: "problems-list" });
  private readonly editor: Editor;
  private readonly apply: (fix: Fix) => void;
  private readonly show: (uri: string, diagnostic: LspDiagnostic) => void;
  private readonly live = h("span", { class: "visually-hidden", role: "status", "aria-live": "polite" });

  constructor(editor: Editor, _client: Client, apply: (fix: Fix) => void, show: (uri: string, diagnostic: LspDiagnostic) => void) {
    this.editor = editor;
    this.apply = apply;
    this.show = show;
    this.element = h("details", { class: "problems", "aria-label": "Problems" }, this.summary, this.list);
  }

  get liveRegion(): HTMLElement {
    return this.live;
  }

  /** Shows the diagnostics of all open texts, those of the shown one first. */
  paint(): void {
    const documents = [...this.editor.documents.open.values()].sort((a, b) => Number(b === this.editor.current) - Number(a === this.editor.current));
    const rows = documents.flatMap((document) => document.diagnostics.map((diagnostic) => ({ document, diagnostic })));
    const errors = rows.filter((r) => (r.diagnostic.severity ?? 1) === 1).length;
    const warnings = rows.filter((r) => r.diagnostic.severity === 2).length;
    const text = rows.length === 0 ? "No problems" : [plural(errors, "error"), plural(warnings, "warning")].filter(Boolean).join(", ") || plural(rows.length, "hint");
    fill(this.summary, h("i", { class: `dot ${errors ? "error" : warnings ? "warning" : "ok"}`, "aria-hidden": "true" }), text, rows[0] && !this.element.open ? h("span", { class: "problems-first" }, rows[0].diagnostic.message.split("\n")[0]) : null);
    if (this.live.textContent !== text) this.live.textContent = text;
    this.element.classList.toggle("empty", rows.length === 0);
    fill(this.list, ...rows.slice(0, 100).map(({ document, diagnostic }) => this.row(document.uri, document === this.editor.current ? "" : document.name, diagnostic)));
  }

  private row(uri: string, file: string, diagnostic: LspDiagnostic): HTMLElement {
    const [message, ...help] = diagnostic.message.split(/\n+(?:help: )?/).filter(Boolean);
    const kind = (diagnostic.severity ?? 1) === 1 ? "error" : diagnostic.severity === 2 ? "warning" : "info";
    return h(
      "li", { class: kind },
      h("button", { type: "button", class: "problem", onclick: () => this.show(uri, diagnostic) },
        h("i", { class: `dot ${kind}`, "aria-hidden": "true" }), h("span", { class: "problem-line" }, `${file ? `${file}:` : ""}${diagnostic.range.start.line + 1}`),
        h("span", {}, message, ...help.map((line) => h("small", {}, line))), h("span", { class: "problem-code" }, diagnostic.code ?? "")),
      ...this.editor.fixesOf(uri, diagnostic).map((fix) => button(fix.title, () => this.apply(fix), { class: "fix" })),
    );
  }
}

function plural(count: number, word: string): string {
  return count === 0 ? "" : `${count} ${word}${count === 1 ? "" : "s"}`;
}
