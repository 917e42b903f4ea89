// Tables.

import { type Child, h } from "../dom.ts";

/** A table; columns of numbers are aligned at the right. */
export function table(headings: string[], rows: Child[][], numeric: number[] = []): HTMLElement {
  const kind = (i: number) => (numeric.includes(i) ? "number" : null);
  return h(
    "div", { class: "table-holder", tabindex: "0", role: "region", "aria-label": headings.join(", ") },
    h(
      "table", {}, h("thead", {}, h("tr", {}, ...headings.map((t, i) => h("th", { scope: "col", class: kind(i) }, t)))),
      h("tbody", {}, ...rows.map((cells) => h("tr", {}, ...cells.map((c, i) => h("td", { class: kind(i) }, c))))),
    ),
  );
}
