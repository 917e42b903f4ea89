// Folding: the blocks of the text that the language server names.

import { foldGutter, foldKeymap, foldService } from "@codemirror/language";
import { type Extension, StateEffect, StateField } from "@codemirror/state";
import { type EditorView, keymap, ViewPlugin, type ViewUpdate } from "@codemirror/view";
import type { Client } from "../client.ts";
import { documentUri } from "./features.ts";

interface FoldingRange {
  startLine: number;
  endLine: number;
}
interface Fold {
  from: number;
  to: number;
}

/** Pause after which the blocks are asked for again, in ms. */
const PAUSE = 300;

const setFolds = StateEffect.define<Fold[]>();
const folds = StateField.define<readonly Fold[]>({
  create: () => [],
  update(value, transaction) {
    let next = transaction.docChanged
      ? value.map(({ from, to }) => ({ from: transaction.changes.mapPos(from), to: transaction.changes.mapPos(to) }))
      : value;
    for (const effect of transaction.effects) if (effect.is(setFolds)) next = effect.value;
    return next;
  },
});

/** Gutter, keys and blocks of folding for one editor. */
export function folding(client: Client): Extension {
  const plugin = ViewPlugin.fromClass(
    class {
      private timer: ReturnType<typeof setTimeout> | undefined;
      private readonly view: EditorView;
      constructor(view: EditorView) {
        this.view = view;
        this.ask();
      }
      update(update: ViewUpdate): void {
        if (update.docChanged) this.ask();
      }
      destroy(): void {
        clearTimeout(this.timer);
      }
      private ask(): void {
        clearTimeout(this.timer);
        this.timer = setTimeout(() => void this.answer(), PAUSE);
      }
      private async answer(): Promise<void> {
        const { state } = this.view;
        const found = await client
          .request<FoldingRange[] | null>("textDocument/foldingRange", { textDocument: { uri: state.field(documentUri) } })
          .catch(() => null);
        if (!found || this.view.state.doc !== state.doc) return;
        const inside = found.filter(({ startLine, endLine }) => endLine > startLine && endLine < state.doc.lines);
        const blocks = inside.map(({ startLine, endLine }) => ({ from: state.doc.line(startLine + 1).to, to: state.doc.line(endLine + 1).to }));
        this.view.dispatch({ effects: setFolds.of(blocks) });
      }
    },
  );
  return [
    folds,
    plugin,
    foldService.of((state, from, to) => state.field(folds).find((fold) => from <= fold.from && fold.from <= to && fold.to > to) ?? null),
    foldGutter({ foldingChanged: (update) => update.startState.field(folds) !== update.state.field(folds) }),
    keymap.of(foldKeymap),
  ];
}
