// What leaves the page: files, pictures, scenario, script, report.

import type { App } from "./app.ts";
import { showText, toast } from "./dialogs.ts";
import { mathmlText } from "./math.ts";
import type { EquationsResult, Exported } from "./protocol.ts";
import { shownPanels } from "./plans.ts";

type Format = "csv" | "parquet" | "svg" | "png" | "pdf" | "yaml" | "python" | "html";

/** Gives the browser a file to save. */
export function download(name: string, content: BlobPart, mime: string): void {
  const address = URL.createObjectURL(new Blob([content], { type: mime }));
  const link = document.createElement("a");
  link.href = address;
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(address), 10_000);
}

/** Asks the server for a file; tables have all columns, pictures those that are shown. */
export async function exported(app: App, format: Format): Promise<Exported> {
  const uri = app.main.value;
  const model = app.model.value;
  const columns = model && format !== "csv" && format !== "parquet" ? shownPanels(model, app.chosen.value, app.result.value).flatMap((p) => p.lines.map((l) => l.column)) : undefined;
  const mathml = format === "html" ? await equationsAsMathml(app) : undefined;
  return app.client.request<Exported>("smpl/export", { uri, format, settings: app.settings.value, ...(columns ? { columns } : {}), ...(mathml ? { mathml } : {}) });
}

/** Downloads a file of that format. */
export async function downloadAs(app: App, format: Format): Promise<void> {
  try {
    const file = await exported(app, format);
    const content = file.base64 !== undefined ? Uint8Array.from(atob(file.base64), (c) => c.charCodeAt(0)) : (file.text ?? "");
    download(file.name, content, file.mime);
  } catch (error) {
    toast((error as Error).message, "error");
  }
}

/** Shows a text of that format to copy. */
export async function copyAs(app: App, format: "yaml" | "python", title: string): Promise<void> {
  try {
    const file = await exported(app, format);
    await showText(title, file.text ?? "", file.name, (name, text) => download(name, text, file.mime));
  } catch (error) {
    toast((error as Error).message, "error");
  }
}

async function equationsAsMathml(app: App): Promise<string[]> {
  const answer = await app.client.request<EquationsResult>("smpl/equations", { uri: app.main.value });
  return answer.equations.filter((e) => e.kind !== "heading" && e.latex).map((e) => mathmlText(e.latex)).filter(Boolean);
}
