// Signature help: the arguments of the function or component around the cursor.

import { completionStatus } from "@codemirror/autocomplete";
import { type Extension, Prec, StateEffect, StateField } from "@codemirror/state";
import { EditorView, keymap, showTooltip, type Tooltip, ViewPlugin, type ViewUpdate } from "@codemirror/view";
import type { Client } from "../client.ts";
import { h } from "../dom.ts";
import { markdown } from "../markdown.ts";
import { positionOf } from "./convert.ts";
import { docText, documentUri } from "./features.ts";

interface SignatureHelp {
  signatures: Array<{ label: string; documentation?: unknown; parameters?: Array<{ label: string }> }>;
  activeParameter?: number | null;
}

/** Pause after which the arguments are asked for, in ms. */
const PAUSE = 80;

const show = StateEffect.define<Tooltip | null>();
const shown = StateField.define<Tooltip | null>({
  create: () => null,
  update(value, transaction) {
    let next = value && transaction.docChanged ? { ...value, pos: transaction.changes.mapPos(value.pos) } : value;
    for (const effect of transaction.effects) if (effect.is(show)) next = effect.value;
    return next;
  },
  provide: (field) => showTooltip.from(field),
});

/** Parts of a label: before the active argument, that argument, after it. */
export function labelParts(label: string, parameters: readonly string[], active: number): [string, string, string] {
  let from = 0;
  for (const [i, parameter] of parameters.entries()) {
    const at = label.indexOf(parameter, from);
    if (at < 0) break;
    if (i === active) return [label.slice(0, at), parameter, label.slice(at + parameter.length)];
    from = at + parameter.length;
  }
  return [label, "", ""];
}

function tooltip(help: SignatureHelp, pos: number): Tooltip | null {
  const signature = help.signatures[0];
  if (!signature) return null;
  const names = (signature.parameters ?? []).map((parameter) => parameter.label);
  const [before, active, after] = labelParts(signature.label, names, help.activeParameter ?? 0);
  const text = docText(signature.documentation ?? "");
  return {
    pos,
    above: true,
    create: () => ({
      dom: h("div", { class: "doc signature", role: "status" }, h("code", {}, before, h("b", {}, active), after), text ? markdown(text) : ""),
    }),
  };
}

/** Shows the arguments after `(` and `,` and at Ctrl-Shift-Space, until the cursor leaves the call. */
export function signatureHelp(client: Client): Extension {
  const plugin = ViewPlugin.fromClass(
    class {
      private timer: ReturnType<typeof setTimeout> | undefined;
      /** Number of the last question: earlier ones are not answered any more. */
      private asked = 0;
      private readonly view: EditorView;
      constructor(view: EditorView) {
        this.view = view;
      }
      update(update: ViewUpdate): void {
        let opened = false;
        if (update.docChanged && update.transactions.some((t) => t.isUserEvent("input")))
          update.changes.iterChanges((_a, _b, _c, _d, inserted) => { opened ||= /[(,]/.test(inserted.toString()); });
        if (opened || (update.state.field(shown) !== null && (update.docChanged || update.selectionSet))) this.ask();
      }
      destroy(): void {
        this.forget();
      }
      ask(): void {
        this.forget();
        const asked = this.asked;
        this.timer = setTimeout(() => void this.answer(asked), PAUSE);
      }
      /** Drops a question without an answer. */
      forget(): void {
        clearTimeout(this.timer);
        this.asked += 1;
      }
      private async answer(asked: number): Promise<void> {
        const { state } = this.view;
        const help = await client
          .request<SignatureHelp | null>("textDocument/signatureHelp", {
            textDocument: { uri: state.field(documentUri) },
            position: positionOf(state.doc, state.selection.main.head),
          })
          .catch(() => null);
        if (asked !== this.asked || this.view.state.doc !== state.doc) return;
        this.view.dispatch({ effects: show.of(help ? tooltip(help, state.selection.main.head) : null) });
      }
    },
  );
  const close = (view: EditorView): boolean => {
    view.plugin(plugin)?.forget();
    if (view.state.field(shown) === null) return false;
    view.dispatch({ effects: show.of(null) });
    // A list of completions, also one that is on its way, is closed by the same key.
    return completionStatus(view.state) === null;
  };
  const ask = (view: EditorView): boolean => {
    view.plugin(plugin)?.ask();
    return true;
  };
  return [shown, plugin, Prec.highest(keymap.of([{ key: "Escape", run: close }])), keymap.of([{ key: "Ctrl-Shift-Space", run: ask }])];
}
