// The start screen: shipped models, new models, files of the folder, recent files.

import { button, fill, h, icon } from "./dom.ts";
import { prompt } from "./dialogs.ts";
import type { Files, Template } from "./protocol.ts";

export interface StartActions {
  open(uri: string): void;
  create(name: string, text: string): void;
}

/** Builds the start screen. */
export function startScreen(files: Files, actions: StartActions): HTMLElement {
  const search = h("input", { type: "search", placeholder: "Find a model", "aria-label": "Find a model" });
  const models = h("div", { class: "start-cards" });
  const own = h("ul", { class: "start-files" });
  const paint = () => {
    const text = search.value.trim().toLowerCase();
    const has = (...words: Array<string | null | undefined>) => text === "" || words.some((w) => w?.toLowerCase().includes(text));
    fill(models, ...files.models.filter((m) => has(m.name, m.title)).map((m) => card(headOf(m.title, m.name), tailOf(m.title), m.states ? `${m.states} states` : "", () => actions.open(m.uri))));
    fill(own, ...files.files.filter((f) => has(f.path, f.title)).slice(0, 200).map((f) => fileRow(f.path, f.title, () => actions.open(f.uri))));
  };
  search.addEventListener("input", paint);
  paint();
  return h(
    "main", { class: "start" },
    h("header", { class: "start-head" }, logo(), h("div", {}, h("h1", {}, "smpl live"), h("p", {}, "Write a process model and watch its trajectories, steady state and errors follow."))),
    h(
      "div", { class: "start-columns" },
      h(
        "section", {},
        h("div", { class: "start-title" }, h("h2", {}, "Models"), search), models,
      ),
      h(
        "section", {},
        h("h2", {}, "New model"),
        h("div", { class: "start-templates" }, ...files.templates.map((t) => button(h("span", {}, icon("plus"), h("b", {}, t.name), h("small", {}, t.title)) as Node, () => void create(t, actions), { class: "template" }))),
        files.files.length ? h("h2", {}, "In this folder") : null,
        files.files.length ? h("p", { class: "note mono" }, files.folder) : null, own,
        files.recent.length ? h("h2", {}, "Recent") : null,
        h("ul", { class: "start-files" }, ...files.recent.map((f) => fileRow(f.path, f.title, () => actions.open(f.uri)))),
      ),
    ),
  );
}

async function create(template: Template, actions: StartActions): Promise<void> {
  const name = await prompt({ title: "New model", label: "File name", value: `${template.name}.eq`, action: "Create", note: "The file is written when you save it." });
  if (name) actions.create(name.endsWith(".eq") ? name : `${name}.eq`, template.text);
}

function card(name: string, title: string, note: string, open: () => void): HTMLElement {
  return h("button", { type: "button", class: "start-card", onclick: open }, h("b", {}, name), h("span", {}, title), h("small", {}, note));
}

function fileRow(path: string, title: string | null | undefined, open: () => void): HTMLElement {
  return h("li", {}, h("button", { type: "button", class: "file-row", onclick: open }, icon("file"), h("span", {}, h("span", { class: "mono" }, path), title ? h("small", {}, tailOf(title)) : null)));
}

/** Titles are `Name: text`. */
function headOf(title: string, name: string): string {
  return /^\w+(?=: )/.exec(title)?.[0] ?? name;
}

function tailOf(title: string): string {
  return title.replace(/^\w+: /, "");
}

/** The mark of the page. */
export function logo(): HTMLElement {
  const mark = h("span", { class: "logo", "aria-hidden": "true" });
  const ns = "http://www.w3.org/2000/svg";
  const picture = document.createElementNS(ns, "svg");
  picture.setAttribute("viewBox", "0 0 32 32");
  const path = document.createElementNS(ns, "path");
  path.setAttribute("d", "M5 24C10 24 10 9 15 9s5 9 12 9");
  picture.append(path);
  mark.append(picture);
  return mark;
}
