// Takes the pictures of docs/live.md: `npm run screenshots` writes them into docs/pictures.

import { join } from "node:path";
import { closeBrowser, missing, open, root, serve, shipped, slide, TANK, toLine } from "./harness.mjs";

if (missing) {
  console.log(`skipped: ${missing}`);
  process.exit(0);
}

const server = await serve({ "tank.eq": TANK });
const reactor = await shipped(server, "reactor");
const mab = await shipped(server, "mab");

async function picture(name, uri, act, options = {}) {
  const { page, close } = await open(server, uri, { deviceScaleFactor: 1, ...options });
  await page.waitForTimeout(1200);
  await act(page);
  await page.waitForTimeout(700);
  await page.screenshot({ path: join(root, "docs/pictures", `${name}.png`) });
  await close();
  console.log(name);
}

const tab = (name) => async (page) => {
  await page.getByRole("tab", { name }).click();
  await page.waitForTimeout(800);
};

await picture("live", reactor, async (page) => {
  await page.getByRole("button", { name: "Pin run" }).click();
  await slide(page, "T_c", 0.75);
  await slide(page, "U", 0.8);
  await page.waitForTimeout(500);
  await page.locator(".panel-frame").first().hover({ position: { x: 180, y: 70 } });
});
await picture("live-error", server.uri("tank.eq"), async (page) => {
  await toLine(page, 7);
  await page.keyboard.press("Shift+End");
  await page.keyboard.type("eq d/dt h = q - k*sqrt(h)");
  await page.waitForTimeout(1200);
  await page.locator(".cm-lintRange-error").first().hover();
  await page.waitForTimeout(900);
});
await picture("live-steady", reactor, tab("Steady state"), { colorScheme: "dark" });
await picture("live-field", mab, async (page) => {
  await page.locator(".fields").evaluate((e) => e.scrollIntoView());
});
await picture("live-phone", reactor, async (page) => {
  await page.locator(".views").getByRole("button", { name: "Controls" }).click();
}, { viewport: { width: 390, height: 844 }, hasTouch: true });
await closeBrowser();
await server.close();
