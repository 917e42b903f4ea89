// The client: finds the command `smpl` and starts its language server.

import { existsSync } from "node:fs";
import { delimiter, dirname, join } from "node:path";
import { commands, ExtensionContext, extensions, window, workspace } from "vscode";
import { LanguageClient, TransportKind } from "vscode-languageclient/node";

const NAME = process.platform === "win32" ? "smpl.exe" : "smpl";
const BIN = process.platform === "win32" ? "Scripts" : "bin";

let client: LanguageClient | undefined;

/** Folders of the active interpreter, as the Python extension knows it. */
async function interpreters(): Promise<string[]> {
  const python = extensions.getExtension("ms-python.python");
  if (!python) {
    return [];
  }
  const api = python.isActive ? python.exports : await python.activate();
  const path = api?.environments?.getActiveEnvironmentPath?.()?.path;
  return typeof path === "string" ? [dirname(path), join(path, BIN)] : [];
}

/** The command `smpl`: the setting, else environments of the folder, the active Python, the path. */
async function find(): Promise<string | undefined> {
  const configured = workspace.getConfiguration("smpl").get<string>("path");
  if (configured) {
    return configured;
  }
  const roots = (workspace.workspaceFolders ?? []).map((folder) => folder.uri.fsPath);
  const folders = [
    ...roots.flatMap((root) => [".venv", "venv"].map((name) => join(root, name, BIN))),
    ...(await interpreters().catch(() => [])),
    ...(process.env.VIRTUAL_ENV ? [join(process.env.VIRTUAL_ENV, BIN)] : []),
    ...(process.env.PATH ?? "").split(delimiter).filter(Boolean),
  ];
  return folders.map((folder) => join(folder, NAME)).find(existsSync);
}

async function start(): Promise<void> {
  const command = await find();
  if (!command) {
    void window.showWarningMessage("The command smpl was not found. Install smpl-process, or set smpl.path.");
    return;
  }
  const settings = workspace.getConfiguration("smpl");
  client = new LanguageClient(
    "smpl",
    "smpl",
    { command, args: ["lsp"], transport: TransportKind.stdio },
    {
      documentSelector: [{ language: "smpl" }, { language: "yaml", pattern: "**/*.*.yaml" }],
      initializationOptions: { inlayHints: settings.get("inlayHints"), codeLens: settings.get("codeLens") },
      synchronize: { configurationSection: "smpl", fileEvents: workspace.createFileSystemWatcher("**/*.{eq,yaml}") },
    },
  );
  await client.start();
}

export async function activate(context: ExtensionContext): Promise<void> {
  const restart = async (): Promise<void> => {
    await client?.stop();
    client = undefined;
    await start();
  };
  context.subscriptions.push(commands.registerCommand("smpl.restart", restart));
  await start();
}

export async function deactivate(): Promise<void> {
  await client?.stop();
}
