// Elements without markup: every text becomes a text node.

export type Child = Node | string | number | null | undefined | false;
type Handler = (event: never) => void;
type Attributes = Record<string, string | number | boolean | null | undefined | Handler>;

/** Creates an element. `onclick` and the like are listeners, `class` and others are attributes; texts are never markup. */
export function h<K extends keyof HTMLElementTagNameMap>(tag: K, attributes: Attributes = {}, ...children: Child[]): HTMLElementTagNameMap[K] {
  const element = document.createElement(tag);
  apply(element, attributes);
  append(element, children);
  return element;
}

/** Creates an SVG element. */
export function svg<K extends keyof SVGElementTagNameMap>(tag: K, attributes: Attributes = {}, ...children: Child[]): SVGElementTagNameMap[K] {
  const element = document.createElementNS("http://www.w3.org/2000/svg", tag);
  apply(element, attributes);
  append(element, children);
  return element;
}

/** Replaces everything inside of an element. */
export function fill(element: Element, ...children: Child[]): void {
  element.replaceChildren(...children.filter(present).map(asNode));
}

/** A button with a text, or with an icon and a name for screen readers. */
export function button(label: Child, action: () => void, attributes: Attributes = {}): HTMLButtonElement {
  return h("button", { type: "button", onclick: action, ...attributes }, label);
}

/** An icon of the set below; decorative. */
export function icon(name: keyof typeof ICONS): SVGSVGElement {
  const picture = svg("svg", { viewBox: "0 0 16 16", class: "icon", "aria-hidden": "true", focusable: "false" });
  for (const d of ICONS[name].split("|")) picture.append(svg("path", { d }));
  return picture;
}

const ICONS = {
  save: "M3 2.5h8l2.5 2.5v8.5h-11z|M5 2.5v4h5v-4|M5 13.5v-4h6v4",
  pin: "M8 10v4.5|M5 2.5h6l-1 4 2 3.5H4l2-3.5z",
  reset: "M3.5 8a4.5 4.5 0 1 1 1.5 3.4|M3 13v-3h3",
  close: "M4 4l8 8|M12 4l-8 8",
  play: "M5 3l8 5-8 5z",
  pause: "M5 3v10|M11 3v10",
  menu: "M2.5 4.5h11|M2.5 8h11|M2.5 11.5h11",
  sliders: "M2.5 4.5h11|M2.5 11.5h11|M6 2.5v4|M10.5 9.5v4",
  download: "M8 2.5v8|M4.5 7.5L8 11l3.5-3.5|M3 13.5h10",
  home: "M2.5 8L8 3l5.5 5|M4.5 7v6.5h7V7",
  stop: "M4 4h8v8H4z",
  down: "M4 6l4 4 4-4",
  right: "M6 4l4 4-4 4",
  search: "M7 11.5a4.5 4.5 0 1 1 0-9 4.5 4.5 0 0 1 0 9z|M10.5 10.5L14 14",
  file: "M4 1.5h5l3 3v10H4z|M9 1.5v3h3",
  plus: "M8 3v10|M3 8h10",
  sun: "M8 5a3 3 0 1 1 0 6 3 3 0 0 1 0-6z|M8 1v2|M8 13v2|M1 8h2|M13 8h2|M3 3l1.5 1.5|M11.5 11.5L13 13|M13 3l-1.5 1.5|M4.5 11.5L3 13",
} as const;

function apply(element: Element, attributes: Attributes): void {
  for (const [name, value] of Object.entries(attributes)) {
    if (value === null || value === undefined || value === false) continue;
    if (typeof value === "function") element.addEventListener(name.replace(/^on/, ""), value as EventListener);
    else element.setAttribute(name, value === true ? "" : String(value));
  }
}

function append(element: Element, children: Child[]): void {
  element.append(...children.filter(present).map(asNode));
}

function present(child: Child): child is Node | string | number {
  return child !== null && child !== undefined && child !== false;
}

function asNode(child: Node | string | number): Node | string {
  return typeof child === "number" ? String(child) : child;
}
