// Starts `smpl live` on a folder of its own and a page in Chromium.
//
// Environment: SMPL (the command, else target/release/smpl), CHROMIUM (else the first one that is installed).

import { spawn } from "node:child_process";
import { existsSync, mkdtempSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { dirname, join } from "node:path";
import { createInterface } from "node:readline";
import { fileURLToPath, pathToFileURL } from "node:url";
import { chromium } from "playwright-core";

const here = dirname(fileURLToPath(import.meta.url));
export const root = join(here, "../..");
const smpl = process.env.SMPL ?? join(root, "target/release/smpl");
const browserPath = process.env.CHROMIUM ?? ["/usr/bin/chromium", "/usr/bin/chromium-browser", "/usr/bin/google-chrome"].find((path) => existsSync(path));

/** Reason to skip, where the command or the browser is missing. */
export const missing = !existsSync(smpl) ? `${smpl} is not built` : browserPath === undefined ? "Chromium is not installed" : false;

/** A tank with a level to control: small, and different from the shipped models. */
export const TANK = `model Tank "a tank that drains"
time t : min
param A : m^2 = 0.5 in 0.1..2 "cross-section"
param k : m^2.5/min = 0.1 in 0.01..1 "valve constant"
action q : m^3/min = 0.1 in 0..0.3 "inflow"
state h : m = 0.5 in 0..2 "level"
eq d/dt h = (q - k*sqrt(h)) / A
observe h
reward setpoint default = -sq((h - 1 [m]) / 1 [m])
fail overflow when outside bounds(h)
episode { step = 1 [min], max_steps = 50, error_reward = -100 }
variant leak "the bottom leaks" {
  eq d/dt h = (q - k*sqrt(h) - 0.05 [m^3/min]) / A
}
`;

/** Starts the server; \`files\` are written into its folder first. */
export async function serve(files = {}) {
  const folder = mkdtempSync(join(tmpdir(), "smpl-live-"));
  for (const [name, text] of Object.entries(files)) writeFileSync(join(folder, name), text);
  const server = spawn(smpl, ["live", "--no-open", "--port", "0", folder], { stdio: ["ignore", "pipe", "inherit"], env: { ...process.env, HOME: folder, XDG_STATE_HOME: folder, XDG_CACHE_HOME: folder } });
  const address = await new Promise((resolve, reject) => {
    createInterface({ input: server.stdout }).once("line", resolve);
    server.once("exit", (code) => reject(new Error(`smpl live ended with ${code}`)));
  });
  const stop = () => new Promise((resolve) => {
    if (server.exitCode !== null || server.signalCode !== null) resolve();
    server.once("exit", resolve);
    server.kill();
  });
  return { address, folder, uri: (name) => pathToFileURL(join(folder, name)).href, stop, close: async () => { await stop(); rmSync(folder, { recursive: true, force: true }); } };
}

let browser;

/** Opens the page on a model; messages of the console are collected in \`errors\`. */
export async function open(server, uri, options = {}) {
  browser ??= await chromium.launch({ executablePath: browserPath, args: ["--no-sandbox"] });
  const context = await browser.newContext({ viewport: { width: 1400, height: 900 }, permissions: [], ...options });
  const page = await context.newPage();
  const errors = [];
  page.on("console", (message) => ["error", "warning"].includes(message.type()) && errors.push(message.text()));
  page.on("pageerror", (error) => errors.push(String(error.stack ?? error)));
  page.setDefaultTimeout(60_000);
  await page.goto(uri ? `${server.address}?open=${encodeURIComponent(uri)}` : server.address);
  if (uri) await page.locator(".panel canvas").first().waitFor();
  return { page, context, errors, close: () => context.close() };
}

/** Address of a shipped model, from the start screen's request. */
export async function shipped(server, name) {
  const { page, close } = await open(server);
  await page.locator(".start").waitFor();
  const uri = await page.evaluate(
    (wanted) => new Promise((resolve) => {
      const socket = new WebSocket(new URL("ws", location.href.replace(/\?.*/, "").replace(/^http/, "ws")));
      socket.onopen = () => socket.send(JSON.stringify({ jsonrpc: "2.0", id: 1, method: "smpl/files", params: {} }));
      socket.onmessage = (event) => {
        const { id, result } = JSON.parse(event.data);
        if (id === 1) resolve(result.models.find((m) => m.name === wanted)?.uri);
      };
    }),
    name,
  );
  await close();
  return uri;
}

export async function closeBrowser() {
  await browser?.close();
  browser = undefined;
}

/** Value in the head of a panel. */
export const valueOf = (page, title) => panel(page, title).locator(".panel-value").first();

export const panel = (page, title) => page.locator(".panel").filter({ has: page.locator(".panel-title", { hasText: new RegExp(`^${title}$`) }) }).first();

/** Puts the cursor at the start of a line of the text. */
export async function toLine(page, line) {
  await page.locator(".cm-content").click();
  await page.keyboard.press("Control+Home");
  for (let i = 1; i < line; i += 1) await page.keyboard.press("ArrowDown");
  await page.keyboard.press("Home");
}

/** Moves a slider to a share of its track, as a pointer does. */
export async function slide(page, name, share) {
  await page.locator(`.control-range[aria-label="${name}"]`).evaluate((input, value) => {
    input.value = String(value);
    input.dispatchEvent(new Event("input", { bubbles: true }));
    input.dispatchEvent(new Event("change", { bubbles: true }));
  }, Math.round(share * 1000));
}

/** Waits until a condition holds in this process. */
export async function until(condition, text, milliseconds = 15_000) {
  const end = Date.now() + milliseconds;
  while (Date.now() < end) {
    if (await condition()) return;
    await new Promise((resolve) => setTimeout(resolve, 40));
  }
  throw new Error(`not in ${milliseconds} ms: ${text}`);
}
