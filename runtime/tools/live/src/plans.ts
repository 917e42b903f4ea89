// Panels of a model: their keys, and which of them are shown.

import type { Model, PanelPlan, RunResult } from "./protocol.ts";

/** Key of a panel that stays while the text and the variants change; numbers of panels move then. */
export function panelKey(plan: PanelPlan): string {
  return [plan.role, plan.group, plan.title, plan.lines[0]?.column ?? ""].join("|");
}

/** Panels in force: those that are chosen, else those that the model proposes and the run has. */
export function shownPanels(model: Model, chosen: ReadonlySet<string> | null, result: RunResult | null): PanelPlan[] {
  const present = new Set(result?.runs[0]?.columns.map((c) => c.name));
  const wanted = model.panels.filter((p) => (chosen ? chosen.has(panelKey(p)) : p.first));
  return result ? wanted.filter((p) => p.lines.some((l) => present.has(l.column))) : wanted;
}
