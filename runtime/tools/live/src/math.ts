// LaTeX as MathML.

import temml from "temml";

/** Typesets LaTeX; a source that cannot be typeset is shown as text. */
export function typesetMath(latex: string, display: boolean): HTMLElement {
  const holder = document.createElement(display ? "div" : "span");
  holder.className = display ? "math display" : "math";
  try {
    temml.render(latex, holder, { displayMode: display, throwOnError: true, trust: false, strict: false });
  } catch {
    holder.className = "math raw";
    holder.textContent = latex;
  }
  return holder;
}

/** The same as the text of MathML, for files that contain it. */
export function mathmlText(latex: string): string {
  try {
    return temml.renderToString(latex, { displayMode: true, throwOnError: true, trust: false, strict: false, xml: true });
  } catch {
    return "";
  }
}
