// The bar at the top: model, status, pin, save, output.

import type { App } from "./app.ts";
import { dialog, menu } from "./dialogs.ts";
import { button, fill, h, icon } from "./dom.ts";
import { formatDuration } from "./numbers.ts";
import { copyAs, downloadAs } from "./output.ts";
import type { Session } from "./session.ts";
import { summary } from "./settings.ts";
import { logo } from "./start.ts";

export interface BarActions {
  home(): void;
  save(): void;
  saveAs(): void;
  rename(): void;
  format(): void;
  definition(): void;
  fix(): void;
}

const KEYS: ReadonlyArray<readonly [string, string]> = [
  ["Ctrl+S", "save"], ["Ctrl+Space", "complete"], ["F2", "rename"], ["F12", "go to the declaration"], ["Ctrl+.", "fix the problem in this line"], ["Shift+Alt+F", "format"], ["Ctrl+F", "find in the text"],
  ["F8", "next problem"], ["Alt+1 … Alt+5", "tabs of results"], ["Alt+P", "pin the run"], ["← → in a panel", "read values"], ["+ − 0 in a panel", "zoom, whole run"], ["Tab", "leave the text"],
];

export class TopBar {
  readonly element: HTMLElement;
  private readonly name = h("div", { class: "bar-name" });
  private readonly status = h("div", { class: "bar-status", role: "status" });
  private readonly progress = h("div", { class: "bar-progress", role: "progressbar", "aria-label": "Run", hidden: true }, h("i", {}));
  private readonly stop: HTMLButtonElement;
  private readonly saveButton: HTMLButtonElement;
  private stopTimer: ReturnType<typeof setTimeout> | undefined;
  private readonly app: App;
  private readonly session: Session;

  constructor(app: App, session: Session, actions: BarActions) {
    this.app = app;
    this.session = session;
    this.stop = button(h("span", {}, icon("stop"), " Interrupt") as Node, () => session.interrupt(), { class: "small stop", hidden: true });
    this.saveButton = button(h("span", {}, icon("save"), h("span", { class: "wide-only" }, " Save")) as Node, actions.save, { title: "Save (Ctrl+S)", "aria-label": "Save" });
    this.element = h(
      "header", { class: "topbar" },
      h("button", { type: "button", class: "ghost home", onclick: actions.home, "aria-label": "All models", title: "All models" }, logo()),
      this.name, this.stop, this.status,
      button(h("span", {}, icon("pin"), h("span", { class: "wide-only" }, " Pin run")) as Node, () => this.pin(), { title: "Keep this run to compare with (Alt+P)", "aria-label": "Pin run" }),
      this.saveButton,
      menu([icon("download"), h("span", { class: "wide-only" }, " Export")], "Export", () => this.outputs()),
      menu([icon("menu")], "More", () => this.more(actions)),
      this.progress,
    );
    session.status.subscribe(() => this.paintStatus());
    app.model.subscribe(() => this.paintName());
    this.paintStatus();
  }

  /** Keeps the run that is shown as a ghost; at most three. */
  pin(): void {
    const { result, pinned, settings } = this.app;
    if (result.value) pinned.set([...pinned.value.slice(-2), { label: summary(settings.value), result: result.value }]);
  }

  setDirty(dirty: boolean, readOnly: boolean): void {
    this.saveButton.classList.toggle("dirty", dirty);
    this.saveButton.setAttribute("aria-label", dirty ? "Save (unsaved changes)" : "Save");
    this.element.classList.toggle("read-only", readOnly);
  }

  private paintName(): void {
    const model = this.app.model.value;
    fill(this.name, ...(model ? [h("b", {}, model.name), h("span", {}, model.text)] : []));
    this.name.title = model?.text ?? "";
    document.title = model ? `${model.name} – smpl live` : "smpl live";
  }

  private paintStatus(): void {
    const { busy, progress, latency, error, stale } = this.session.status.value;
    const connected = this.app.client.connected;
    const kind = !connected ? "error" : error ? "error" : stale ? "warning" : busy ? "busy" : "ok";
    const text = !connected ? "offline" : (error ? "no result" : (stale ? "last valid result" : latency === null ? "" : formatDuration(latency)));
    fill(this.status, h("i", { class: `dot ${kind}`, "aria-hidden": "true" }), h("span", { title: error ?? text }, text));
    this.progress.hidden = !busy || progress === null;
    (this.progress.firstElementChild as HTMLElement).style.width = `${Math.round((progress ?? 0) * 100)}%`;
    this.progress.setAttribute("aria-valuenow", String(Math.round((progress ?? 0) * 100)));
    clearTimeout(this.stopTimer);
    if (!busy) this.stop.hidden = true;
    else this.stopTimer = setTimeout(() => { this.stop.hidden = false; }, 500);
  }

  private outputs(): Parameters<typeof menu>[2] extends () => infer R ? R : never {
    const { app } = this;
    return [
      { label: "Copy as Python", note: "smpl.Env(…)", run: () => void copyAs(app, "python", "The run in Python") },
      { label: "Copy scenario", note: "YAML", run: () => void copyAs(app, "yaml", "The controls as a scenario") },
      "line",
      { label: "Report", note: "one HTML file", run: () => void downloadAs(app, "html") },
      { label: "Picture", note: "SVG", run: () => void downloadAs(app, "svg") },
      { label: "Picture", note: "PNG", run: () => void downloadAs(app, "png") },
      { label: "Picture", note: "PDF", run: () => void downloadAs(app, "pdf") },
      "line",
      { label: "Table", note: "CSV", run: () => void downloadAs(app, "csv") },
      { label: "Table", note: "Parquet", run: () => void downloadAs(app, "parquet") },
    ];
  }

  private more(actions: BarActions): Parameters<typeof menu>[2] extends () => infer R ? R : never {
    return [
      { label: "Save as…", run: actions.saveAs },
      "line",
      { label: "Rename", note: "F2", run: actions.rename },
      { label: "Go to declaration", note: "F12", run: actions.definition },
      { label: "Fix problem", note: "Ctrl+.", run: actions.fix },
      { label: "Format text", note: "Shift+Alt+F", run: actions.format },
      "line",
      { label: "Light or dark", run: toggleTheme },
      { label: "Keyboard", run: () => void keyboardHelp() },
      { label: "Licences", run: () => void open("licenses.txt", "_blank", "noopener") },
      { label: "All models", run: actions.home },
    ];
  }
}

function toggleTheme(): void {
  const dark = getComputedStyle(document.documentElement).getPropertyValue("--mode").trim() === "dark";
  document.documentElement.dataset.theme = dark ? "light" : "dark";
  dispatchEvent(new Event("themechange"));
}

function keyboardHelp(): Promise<null> {
  return dialog<null>("Keyboard", () => [h("table", { class: "keys" }, ...KEYS.map(([keys, text]) => h("tr", {}, h("td", {}, h("kbd", {}, keys)), h("td", {}, text))))]);
}
