// The Markdown of hover texts as elements: paragraphs, lists, code, tables, links, mathematics. Never markup of the text itself.

import { h } from "./dom.ts";
import { typesetMath } from "./math.ts";

/** Renders Markdown; what is not understood is shown as it is written. */
export function markdown(source: string): DocumentFragment {
  const out = document.createDocumentFragment();
  const lines = source.split("\n");
  for (let i = 0; i < lines.length; ) i = block(lines, i, out);
  return out;
}

function block(lines: string[], at: number, out: DocumentFragment): number {
  const line = lines[at] as string;
  if (line.trim() === "") return at + 1;
  if (/^```/.test(line)) {
    const end = find(lines, at + 1, (l) => /^```/.test(l));
    out.append(h("pre", {}, h("code", {}, lines.slice(at + 1, end).join("\n"))));
    return end + 1;
  }
  if (line.trim() === "$$") {
    const end = find(lines, at + 1, (l) => l.trim() === "$$");
    out.append(typesetMath(lines.slice(at + 1, end).join("\n"), true));
    return end + 1;
  }
  const oneLine = /^\$\$(.+)\$\$$/.exec(line.trim());
  if (oneLine) {
    out.append(typesetMath(oneLine[1] as string, true));
    return at + 1;
  }
  if (/^(-{3,}|\*{3,})$/.test(line.trim())) {
    out.append(h("hr"));
    return at + 1;
  }
  const heading = /^(#{1,6}) (.*)$/.exec(line);
  if (heading) {
    out.append(h("p", {}, h("strong", {}, inline(heading[2] as string))));
    return at + 1;
  }
  if (/^\s*\|/.test(line)) return table(lines, at, out);
  if (/^\s*[-*] /.test(line)) {
    const end = find(lines, at, (l) => !/^\s*[-*] /.test(l));
    out.append(h("ul", {}, ...lines.slice(at, end).map((l) => h("li", {}, inline(l.replace(/^\s*[-*] /, ""))))));
    return end;
  }
  const end = find(lines, at + 1, (l) => l.trim() === "" || /^(```|\||\$\$|#{1,6} )/.test(l));
  out.append(h("p", {}, inline(lines.slice(at, end).join(" "))));
  return end;
}

function table(lines: string[], at: number, out: DocumentFragment): number {
  const end = find(lines, at, (l) => !/^\s*\|/.test(l));
  const rows = lines.slice(at, end).filter((l) => !/^[\s|:-]+$/.test(l));
  const cells = (l: string) => l.trim().replace(/^\||\|$/g, "").split(/(?<!\\)\|/).map((c) => c.trim());
  out.append(h("table", {}, ...rows.map((l, i) => h("tr", {}, ...cells(l).map((c) => (i === 0 ? h("th", {}, inline(c)) : h("td", {}, inline(c))))))));
  return end;
}

const INLINE = /`([^`]+)`|\$([^$\s](?:[^$]*[^$\s])?)\$|\*\*([^*]+)\*\*|\*([^*\s][^*]*)\*|\[([^\]]+)\]\(([^)\s]+)\)/g;

function inline(text: string): DocumentFragment {
  const out = document.createDocumentFragment();
  let last = 0;
  for (const match of text.matchAll(INLINE)) {
    out.append(text.slice(last, match.index));
    const [whole, code, math, strong, weak, label, target] = match;
    if (code !== undefined) out.append(h("code", {}, code));
    else if (math !== undefined) out.append(typesetMath(math, false));
    else if (strong !== undefined) out.append(h("strong", {}, strong));
    else if (weak !== undefined) out.append(h("em", {}, weak));
    else if (label !== undefined && target !== undefined) out.append(link(label, target));
    last = match.index + whole.length;
  }
  out.append(text.slice(last).replace(/\\([\\`*_{}[\]()#+\-.!|<>])/g, "$1"));
  return out;
}

function link(label: string, target: string): Node {
  if (!/^https?:\/\//.test(target)) return document.createTextNode(label);
  return h("a", { href: target, target: "_blank", rel: "noopener noreferrer" }, label);
}

function find(lines: string[], from: number, test: (line: string) => boolean): number {
  for (let i = from; i < lines.length; i += 1) if (test(lines[i] as string)) return i;
  return lines.length;
}
