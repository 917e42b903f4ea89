// The frame of the page: bar, panes, tabs, splitter, and the two views of narrow screens.

import { button, fill, h, icon } from "./dom.ts";
import type { Tab } from "./tabs/tab.ts";

/** A list of tabs after the ARIA pattern: arrow keys move, one panel is shown. */
export function tabList(tabs: readonly Tab[], onChange: (tab: Tab) => void): { bar: HTMLElement; panels: HTMLElement; select(id: string): void; current(): Tab } {
  let shown = tabs[0] as Tab;
  const buttons = tabs.map((tab) =>
    h("button", { type: "button", role: "tab", id: `tab-${tab.id}`, "aria-controls": `panel-${tab.id}`, onclick: () => select(tab.id) }, tab.title),
  );
  const panels = tabs.map((tab) => h("div", { role: "tabpanel", id: `panel-${tab.id}`, "aria-labelledby": `tab-${tab.id}`, class: "tab-panel", tabindex: "-1" }, tab.element));
  const bar = h("div", { role: "tablist", class: "tabs", "aria-label": "Results" }, ...buttons);
  const select = (id: string) => {
    const next = tabs.find((t) => t.id === id) ?? shown;
    tabs.forEach((tab, i) => {
      const on = tab === next;
      buttons[i]?.setAttribute("aria-selected", String(on));
      buttons[i]?.setAttribute("tabindex", on ? "0" : "-1");
      (panels[i] as HTMLElement).hidden = !on;
    });
    if (shown !== next) shown.show(false);
    shown = next;
    shown.show(true);
    onChange(shown);
  };
  bar.addEventListener("keydown", (event) => {
    const at = tabs.indexOf(shown);
    const to: Record<string, number> = { ArrowRight: at + 1, ArrowLeft: at - 1 + tabs.length, Home: 0, End: tabs.length - 1 };
    const target = to[event.key];
    if (target === undefined) return;
    event.preventDefault();
    select((tabs[target % tabs.length] as Tab).id);
    buttons[target % tabs.length]?.focus();
  });
  return { bar, panels: h("div", { class: "tab-panels" }, ...panels), select, current: () => shown };
}

/** A separator that resizes the pane before it, by pointer or arrow keys. */
export function splitter(pane: HTMLElement, name: string, low: number, high: () => number): HTMLElement {
  const bar = h("div", { class: "splitter", role: "separator", tabindex: "0", "aria-orientation": "vertical", "aria-label": name });
  const set = (width: number) => {
    const clamped = Math.round(Math.min(high(), Math.max(low, width)));
    pane.style.flexBasis = `${clamped}px`;
    bar.setAttribute("aria-valuenow", String(clamped));
  };
  bar.addEventListener("pointerdown", (event) => {
    bar.setPointerCapture(event.pointerId);
    const [x, width] = [event.clientX, pane.getBoundingClientRect().width];
    const move = (e: PointerEvent) => set(width + e.clientX - x);
    bar.addEventListener("pointermove", move);
    bar.addEventListener("pointerup", () => bar.removeEventListener("pointermove", move), { once: true });
  });
  bar.addEventListener("keydown", (event) => {
    const step = event.key === "ArrowLeft" ? -24 : event.key === "ArrowRight" ? 24 : 0;
    if (step === 0) return;
    event.preventDefault();
    set(pane.getBoundingClientRect().width + step);
  });
  return bar;
}

/** The views of narrow screens. */
export function viewSwitch(workspace: HTMLElement): { element: HTMLElement; show(view: "text" | "result"): void } {
  const buttons = (["text", "result"] as const).map((view) => button(view === "text" ? "Text" : "Result", () => show(view), { "aria-pressed": "false" }));
  const toggle = button(icon("sliders"), () => {
    const open = workspace.classList.toggle("with-controls");
    toggle.setAttribute("aria-pressed", String(open));
    if (open) show("result");
  }, { "aria-label": "Controls", "aria-pressed": "false" });
  const show = (view: "text" | "result") => {
    workspace.dataset.view = view;
    buttons[0]?.setAttribute("aria-pressed", String(view === "text"));
    buttons[1]?.setAttribute("aria-pressed", String(view === "result"));
    if (view === "text") {
      workspace.classList.remove("with-controls");
      toggle.setAttribute("aria-pressed", "false");
    }
  };
  show("result");
  return { element: h("nav", { class: "views", "aria-label": "Views" }, ...buttons, toggle), show };
}

/** Messages across the page: a lost connection, a file that changed on disk. */
export class Banners {
  readonly element = h("div", { class: "banners", role: "alert" });
  private readonly entries = new Map<string, HTMLElement>();

  show(key: string, text: string, kind: "info" | "warn", actions: Array<{ label: string; run: () => void }> = []): void {
    this.entries.set(key, h("div", { class: `banner ${kind}` }, h("span", {}, text), ...actions.map((a) => button(a.label, () => { this.hide(key); a.run(); }, { class: "small" }))));
    this.paint();
  }

  hide(key: string): void {
    if (this.entries.delete(key)) this.paint();
  }

  private paint(): void {
    fill(this.element, ...this.entries.values());
  }
}
