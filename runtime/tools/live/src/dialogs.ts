// Dialogs, menus and short messages.

import { button, type Child, fill, h, icon } from "./dom.ts";

/** A modal dialog; Escape and the close button give `null`. */
export function dialog<T>(title: string, build: (close: (value: T | null) => void) => Child[]): Promise<T | null> {
  return new Promise((resolve) => {
    const before = document.activeElement;
    const element = h("dialog", { class: "dialog", "aria-label": title });
    let result: T | null = null;
    const close = (value: T | null) => {
      result = value;
      element.close();
    };
    element.append(
      h("header", {}, h("h2", {}, title), button(icon("close"), () => close(null), { class: "ghost", "aria-label": "Close" })),
      ...build(close).filter((c): c is Node | string => c !== null && c !== undefined && c !== false && typeof c !== "number"),
    );
    element.addEventListener("click", (event) => {
      if (event.target === element) close(null);
    });
    element.addEventListener("close", () => {
      element.remove();
      if (before instanceof HTMLElement) before.focus();
      resolve(result);
    });
    document.body.append(element);
    element.showModal();
  });
}

/** Asks for one line of text. */
export function prompt(options: { title: string; label: string; value: string; action: string; note?: string }): Promise<string | null> {
  return dialog<string>(options.title, (close) => {
    const input = h("input", { type: "text", value: options.value, spellcheck: "false", autocomplete: "off", id: "prompt-field" });
    queueMicrotask(() => input.select());
    return [
      h(
        "form",
        { method: "dialog", onsubmit: (event: Event) => { event.preventDefault(); close(input.value.trim() || null); } },
        h("label", { for: "prompt-field" }, options.label), input,
        options.note ? h("p", { class: "note" }, options.note) : null,
        h("div", { class: "dialog-actions" }, button("Cancel", () => close(null)), h("button", { type: "submit", class: "primary" }, options.action)),
      ),
    ];
  });
}

/** Asks for one of several answers. */
export function choose<T>(title: string, options: Array<{ label: string; value: T; note?: string; primary?: boolean }>, text?: string): Promise<T | null> {
  return dialog<T>(title, (close) => [
    text ? h("p", {}, text) : null,
    h(
      "div", { class: "choices" },
      ...options.map((o) =>
        h("button", { type: "button", class: o.primary ? "primary choice" : "choice", onclick: () => close(o.value) }, h("span", {}, o.label), o.note ? h("small", {}, o.note) : null),
      ),
    ),
  ]);
}

/** Shows a text to copy; it is on the clipboard already where the browser allows it. */
export async function showText(title: string, text: string, fileName: string, save: (name: string, text: string) => void): Promise<void> {
  const copy = () =>
    navigator.clipboard.writeText(text).then(
      () => true,
      () => false,
    );
  const copied = await copy();
  await dialog<null>(title, (close) => {
    const status = h("span", { class: "note", role: "status" }, copied ? "Copied to the clipboard." : "");
    const again = async () => {
      status.textContent = (await copy()) ? "Copied to the clipboard." : "Select the text and copy it.";
    };
    return [
      h("pre", { class: "text-out", tabindex: "0" }, text),
      h(
        "div", { class: "dialog-actions" }, status,
        button("Download", () => save(fileName, text)), button("Copy", () => void again()), button("Close", () => close(null), { class: "primary" }),
      ),
    ];
  });
}

let toasts: HTMLElement | null = null;

/** A short message that leaves by itself; errors stay longer. */
export function toast(text: string, kind: "info" | "error" = "info"): void {
  if (!toasts) {
    toasts = h("div", { class: "toasts", role: "status", "aria-live": "polite" });
    document.body.append(toasts);
  }
  const item = h("div", { class: `toast ${kind}` }, text);
  toasts.append(item);
  setTimeout(() => item.remove(), kind === "error" ? 9000 : 3500);
}

/** A button with a menu below it. Arrow keys move, Escape closes. */
export function menu(label: Child[], name: string, entries: () => Array<{ label: string; note?: string; run: () => void } | "line">): HTMLElement {
  const list = h("div", { class: "menu-list", role: "menu", "aria-label": name, hidden: true });
  const opener = h("button", { type: "button", class: "menu-button", "aria-label": name, "aria-haspopup": "menu", "aria-expanded": "false" });
  fill(opener, ...label);
  const holder = h("div", { class: "menu" }, opener, list);
  const items = () => [...list.querySelectorAll<HTMLButtonElement>("button")];
  const close = (focus: boolean) => {
    list.hidden = true;
    opener.setAttribute("aria-expanded", "false");
    if (focus) opener.focus();
  };
  const open = () => {
    fill(
      list,
      ...entries().map((e) =>
        e === "line"
          ? h("hr")
          : h("button", { type: "button", role: "menuitem", tabindex: "-1", onclick: () => { close(true); e.run(); } }, h("span", {}, e.label), e.note ? h("small", {}, e.note) : null),
      ),
    );
    list.hidden = false;
    opener.setAttribute("aria-expanded", "true");
    items()[0]?.focus();
  };
  opener.addEventListener("click", () => (list.hidden ? open() : close(false)));
  holder.addEventListener("focusout", (event) => {
    if (!holder.contains(event.relatedTarget as Node | null)) close(false);
  });
  holder.addEventListener("keydown", (event) => {
    if (list.hidden) {
      if (event.key === "ArrowDown") { event.preventDefault(); open(); }
      return;
    }
    const all = items();
    const at = all.indexOf(document.activeElement as HTMLButtonElement);
    const move: Record<string, number> = { ArrowDown: at + 1, ArrowUp: at - 1 + all.length, Home: 0, End: all.length - 1 };
    if (event.key === "Escape") close(true);
    else if (move[event.key] !== undefined) all[(move[event.key] as number) % all.length]?.focus();
    else return;
    event.preventDefault();
    event.stopPropagation();
  });
  return holder;
}
