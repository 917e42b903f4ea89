// The page as a whole: start screen or workspace, and what connects their parts.

import type { App } from "./app.ts";
import type { Client } from "./client.ts";
import { controls } from "./controls/controls.ts";
import { toast } from "./dialogs.ts";
import { button, fill, h, icon } from "./dom.ts";
import { applyWorkspaceEdit, goToDefinition, openUri, quickFix, rename } from "./editor/commands.ts";
import type { OpenDocument } from "./editor/documents.ts";
import { Editor, type Fix } from "./editor/editor.ts";
import { format } from "./editor/features.ts";
import { nextDiagnostic } from "@codemirror/lint";
import { Banners, splitter, tabList, viewSwitch } from "./layout.ts";
import { currentTheme } from "./palette.ts";
import type { Pinned } from "./plots/curves.ts";
import { Shared } from "./plots/shared.ts";
import { Problems } from "./problems.ts";
import type { Changed, Files, Model, Range, RunResult, Settings } from "./protocol.ts";
import { save, saveAs, takeDisk } from "./save.ts";
import { Session } from "./session.ts";
import { Signal } from "./signal.ts";
import { startScreen } from "./start.ts";
import { Equations } from "./tabs/equations.ts";
import { Steady } from "./tabs/steady.ts";
import { Structure } from "./tabs/structure.ts";
import { Task } from "./tabs/task.ts";
import { Trajectories } from "./tabs/trajectories.ts";
import { TopBar } from "./topbar.ts";

export class Page implements App {
  readonly client: Client;
  readonly editor: Editor;
  readonly shared = new Shared(currentTheme());
  readonly files = new Signal<Files | null>(null);
  readonly main = new Signal<string | null>(null);
  readonly model = new Signal<Model | null>(null);
  readonly settings = new Signal<Settings>({});
  readonly result = new Signal<RunResult | null>(null);
  readonly pinned = new Signal<readonly Pinned[]>([]);
  readonly chosen = new Signal<ReadonlySet<string> | null>(null);
  private readonly root: HTMLElement;
  private readonly session: Session;
  private readonly bar: TopBar;
  private readonly banners = new Banners();
  private readonly problems: Problems;
  private readonly fileTabs = h("div", { class: "file-tabs", role: "group", "aria-label": "Open files" });
  private readonly editorPane = h("div", { class: "editor" });
  private readonly workspace = h("div", { class: "workspace" });
  private readonly results = h("section", { class: "pane result-pane", "aria-label": "Results" });
  private readonly message = h("p", { class: "message error run-message", role: "status", hidden: true });
  private readonly equations: Equations;
  private readonly views: ReturnType<typeof viewSwitch>;
  private readonly tabs: ReturnType<typeof tabList>;
  private readonly frame: HTMLElement;

  constructor(root: HTMLElement, client: Client) {
    this.root = root;
    this.client = client;
    this.editor = new Editor(this.editorPane, client, {
      onChange: () => this.session.textChanged(),
      onCursor: (uri, line) => this.equations.cursor(uri, line),
      onDiagnostics: () => this.problems.paint(),
      applyFix: (fix) => void this.fix(fix),
      keys: this.keys(),
    });
    this.session = new Session(this);
    this.problems = new Problems(this.editor, client, (fix) => void this.fix(fix), (uri, d) => this.goTo(uri, d.range));
    this.equations = new Equations(this);
    const tabs = [new Trajectories(this), this.equations, new Steady(this), new Structure(this), new Task(this)];
    this.tabs = tabList(tabs, () => undefined);
    this.session.onChanged = () => tabs.forEach((tab) => tab.changed());
    this.bar = new TopBar(this, this.session, {
      home: () => this.home(), save: () => void this.save(), saveAs: () => void this.save(true), rename: () => void rename(client, this.editor), format: () => void this.format(),
      definition: () => void this.definition(), fix: () => void quickFix(this.editor, (fix) => void this.fix(fix)),
    });
    this.views = viewSwitch(this.workspace);
    this.frame = this.layOut();
    this.listen();
    fill(root, this.banners.element, h("p", { class: "loading" }, "Connecting…"));
  }

  /** The connection has come or gone. */
  async connection(connected: boolean): Promise<void> {
    this.session.status.set({ ...this.session.status.value });
    if (!connected) {
      this.banners.show("connection", "The connection to smpl live was lost. Trying again; your text is kept in this page.", "warn");
      return;
    }
    this.banners.hide("connection");
    await this.client.request("initialize", { processId: null, rootUri: null, capabilities: clientCapabilities() }).catch(() => null);
    this.client.notify("initialized", {});
    this.editor.documents.announceAll();
    this.files.set(await this.client.request<Files>("smpl/files", {}));
    if (this.main.value) this.session.textChanged();
    else await this.openFromAddress();
  }

  goTo(uri: string, range: Range): void {
    void openUri(this.client, this.editor, uri)
      .then((document) => {
        this.showDocument(document);
        this.views.show("text");
        this.editor.reveal(range);
      })
      .catch((error: Error) => toast(error.message, "error"));
  }

  refresh(): void {
    this.session.refresh();
  }

  private layOut(): HTMLElement {
    const text = h("section", { class: "pane text-pane", "aria-label": "Text" }, this.fileTabs, this.editorPane, this.problems.element, this.problems.liveRegion);
    this.results.append(this.tabs.bar, this.message, this.tabs.panels);
    this.workspace.append(text, splitter(text, "Width of the text", 240, () => this.workspace.clientWidth * 0.7), this.results, controls(this));
    this.tabs.select("trajectories");
    return h("div", { class: "page" }, this.bar.element, this.banners.element, this.workspace, this.views.element);
  }

  private listen(): void {
    this.client.on<Changed>("smpl/changed", (changed) => this.changedOnDisk(changed));
    this.editor.documents.shape.subscribe(() => this.paintFiles());
    this.session.status.subscribe((status) => {
      this.results.classList.toggle("stale", status.stale);
      this.message.textContent = status.error ?? "";
      this.message.hidden = !status.error;
    });
    const theme = () => this.shared.theme.set(currentTheme());
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", theme);
    addEventListener("themechange", theme);
    addEventListener("popstate", () => void this.openFromAddress());
    addEventListener("beforeunload", (event) => {
      if ([...this.editor.documents.open.values()].some((d) => this.isUnsaved(d))) event.preventDefault();
    });
    addEventListener("keydown", (event) => this.globalKey(event));
  }

  private isUnsaved(document: OpenDocument): boolean {
    return this.editor.documents.isDirty(document) && document.text.length > 0;
  }

  private keys(): Array<{ key: string; run: () => boolean }> {
    const action = (run: () => void) => () => {
      run();
      return true;
    };
    return [
      { key: "F2", run: action(() => void rename(this.client, this.editor)) },
      { key: "F12", run: action(() => void this.definition()) },
      { key: "Mod-.", run: action(() => void quickFix(this.editor, (fix) => void this.fix(fix))) },
      { key: "Shift-Alt-f", run: action(() => void this.format()) },
      { key: "F8", run: () => nextDiagnostic(this.editor.view) },
    ];
  }

  private globalKey(event: KeyboardEvent): void {
    if ((event.ctrlKey || event.metaKey) && event.key.toLowerCase() === "s") {
      event.preventDefault();
      if (this.main.value) void this.save(event.shiftKey);
    }
    if (!event.altKey || event.ctrlKey || event.metaKey) return;
    const tab = ["trajectories", "equations", "steady", "structure", "task"][Number(event.key) - 1];
    if (tab) {
      event.preventDefault();
      this.views.show("result");
      this.tabs.select(tab);
    } else if (event.key.toLowerCase() === "p") {
      event.preventDefault();
      this.bar.pin();
    }
  }

  private home(): void {
    history.pushState(null, "", location.pathname);
    void this.openFromAddress(true);
  }

  private async openFromAddress(start = false): Promise<void> {
    const files = this.files.value;
    if (!files) return;
    const uri = new URLSearchParams(location.search).get("open") ?? (start || this.main.value ? null : files.open);
    if (uri) {
      await this.openModel(uri, false);
      return;
    }
    const fresh = start ? await this.client.request<Files>("smpl/files", {}).catch(() => files) : files;
    this.files.set(fresh);
    document.title = "smpl live";
    fill(this.root, this.banners.element, startScreen(fresh, { open: (u) => void this.openModel(u, true), create: (name, text) => this.create(name, text) }));
  }

  private create(name: string, text: string): void {
    const folder = (this.files.value?.folder_uri ?? "").replace(/\/$/, "");
    const uri = `${folder}/${name.split("/").map(encodeURIComponent).join("/")}`;
    this.begin(this.editor.documents.add({ uri, text, digest: null, read_only: false, name }), true);
  }

  private async openModel(uri: string, remember: boolean): Promise<void> {
    try {
      this.begin(await openUri(this.client, this.editor, uri), remember);
    } catch (error) {
      toast((error as Error).message, "error");
      if (this.root.querySelector(".loading")) {
        history.replaceState(null, "", location.pathname);
        await this.openFromAddress(true);
      }
    }
  }

  /** Makes a document the model of the page. */
  private begin(document: OpenDocument, remember: boolean): void {
    if (remember) history.pushState(null, "", `${location.pathname}?open=${encodeURIComponent(document.uri)}`);
    for (const other of [...this.editor.documents.open.values()]) if (other !== document && !this.isUnsaved(other)) this.editor.documents.close(other.uri);
    fill(this.root, this.frame);
    this.frame.insertBefore(this.banners.element, this.workspace);
    if (this.main.value !== document.uri) {
      this.main.set(document.uri);
      this.model.set(null);
      this.result.set(null);
      this.pinned.set([]);
      this.chosen.set(null);
      this.shared.zoom.set(null);
      this.settings.set({});
    }
    this.showDocument(document);
    this.tabs.select(this.tabs.current().id);
    this.session.textChanged();
  }

  private showDocument(document: OpenDocument): void {
    this.editor.show(document);
    this.paintFiles();
    this.problems.paint();
  }

  private paintFiles(): void {
    const { open } = this.editor.documents;
    const shown = this.editor.current;
    fill(this.fileTabs, ...[...open.values()].map((document) => this.fileTab(document, document === shown)));
    if (shown && shown.uri !== this.main.value) {
      this.fileTabs.append(button("Run this file", () => this.begin(shown, true), { class: "small run-file" }));
    }
    if (shown) this.bar.setDirty(this.isUnsaved(shown), shown.readOnly);
  }

  private fileTab(document: OpenDocument, on: boolean): HTMLElement {
    const dirty = this.isUnsaved(document);
    const note = document.readOnly ? " (shipped: save under a new name)" : "";
    const closable = document.uri !== this.main.value && !dirty;
    return h(
      "span", { class: `file-tab${on ? " on" : ""}` },
      h("button", { type: "button", "aria-pressed": String(on), title: document.uri + note, onclick: () => this.showDocument(document) }, document.name, dirty ? h("i", { class: "unsaved", title: "unsaved changes" }, h("span", { class: "visually-hidden" }, " unsaved")) : null, document.readOnly ? h("small", {}, "shipped") : null),
      closable ? button(icon("close"), () => this.closeFile(document), { class: "ghost tiny", "aria-label": `Close ${document.name}` }) : null,
    );
  }

  private closeFile(document: OpenDocument): void {
    const main = this.main.value ? this.editor.documents.open.get(this.main.value) : undefined;
    if (document === this.editor.current && main) this.showDocument(main);
    this.editor.documents.close(document.uri);
  }

  private async save(under = false): Promise<void> {
    const document = this.editor.current;
    if (!document) return;
    const files = this.files.value;
    const saved = under ? await saveAs(this.client, this.editor, document, files) : await save(this.client, this.editor, document, files);
    if (!saved) return;
    this.banners.hide(`disk:${document.uri}`);
    if (saved !== document) {
      if (document.readOnly) this.editor.documents.close(document.uri);
      this.begin(saved, true);
    }
  }

  private async format(): Promise<void> {
    try {
      if (!(await format(this.client, this.editor.view))) toast("The text is in its canonical form.");
    } catch (error) {
      toast((error as Error).message, "error");
    }
  }

  private async definition(): Promise<void> {
    try {
      await goToDefinition(this.client, this.editor, (document, range) => {
        this.showDocument(document);
        this.editor.reveal(range);
      });
    } catch (error) {
      toast((error as Error).message, "error");
    }
  }

  private async fix(fix: Fix): Promise<void> {
    if (fix.edit) await applyWorkspaceEdit(this.client, this.editor, fix.edit).catch((error: Error) => toast(error.message, "error"));
  }

  private changedOnDisk(changed: Changed): void {
    const document = this.editor.documents.open.get(changed.uri);
    if (!document || changed.digest === document.digest) return;
    const key = `disk:${changed.uri}`;
    if (changed.digest === null) {
      this.banners.show(key, `${document.name} was deleted on disk. Saving writes it again.`, "warn", [{ label: "Save", run: () => { document.digest = null; void this.save(); } }, { label: "Close this message", run: () => undefined }]);
      return;
    }
    if (!this.editor.documents.isDirty(document)) {
      takeDisk(this.editor, document, changed);
      toast(`${document.name} was read again: it changed on disk.`);
      return;
    }
    this.banners.show(key, `${document.name} changed on disk while you were editing it.`, "warn", [
      { label: "Take the version on disk", run: () => takeDisk(this.editor, document, changed) },
      { label: "Keep my text", run: () => { document.digest = changed.digest; } },
    ]);
  }
}

function clientCapabilities(): object {
  return {
    general: { positionEncodings: ["utf-16"] },
    textDocument: {
      synchronization: {},
      completion: { completionItem: { snippetSupport: true, documentationFormat: ["markdown"], labelDetailsSupport: true } },
      hover: { contentFormat: ["markdown"] },
      codeAction: { codeActionLiteralSupport: { codeActionKind: { valueSet: ["quickfix"] } } },
      publishDiagnostics: { relatedInformation: true, versionSupport: true, codeDescriptionSupport: true },
      rename: { prepareSupport: true },
      inlayHint: {},
      signatureHelp: { signatureInformation: { documentationFormat: ["markdown"], activeParameterSupport: true } },
      foldingRange: { lineFoldingOnly: true },
    },
  };
}
