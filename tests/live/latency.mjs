// Prints latencies of the page: from a keystroke to its diagnostics, and from a slider to the new curves.
// Arguments: names of shipped models; all of them without arguments.

import { closeBrowser, missing, open, serve, shipped, TANK, toLine } from "./harness.mjs";

const ROUNDS = 15;

if (missing) {
  console.log(`skipped: ${missing}`);
  process.exit(0);
}

const server = await serve({ "tank.eq": TANK });
const names = process.argv.length > 2 ? process.argv.slice(2) : ["reactor", "beer", "pensim", "atropine", "mab"];
const models = [["tank", server.uri("tank.eq")]];
for (const name of names) models.push([name, await shipped(server, name)]);
console.log("model      keystroke to diagnostics [ms]   slider to curves [ms]   (median, 90th percentile)");
for (const [name, uri] of models) {
  const { page, close } = await open(server, uri);
  await page.waitForTimeout(1500);
  const slider = await measureSlider(page);
  const typing = await measureTyping(page);
  console.log(`${name.padEnd(10)} ${pair(typing).padStart(29)}   ${pair(slider).padStart(21)}`);
  await close();
}
await closeBrowser();
await server.close();

/** A name is made unknown and known again; the number of problems changes each time. */
async function measureTyping(page) {
  await toLine(page, 3);
  await page.keyboard.type("\nlet latency_probe = 1");
  await page.waitForTimeout(2500);
  const times = [];
  for (let i = 0; i < ROUNDS; i += 1) {
    await page.evaluate(() => {
      const target = document.querySelector(".problems-summary");
      window.seen = new Promise((resolve) => {
        let began = 0;
        document.addEventListener("keydown", () => { began = performance.now(); }, { once: true, capture: true });
        const observer = new MutationObserver(() => {
          if (began === 0) return;
          observer.disconnect();
          resolve(performance.now() - began);
        });
        observer.observe(target, { childList: true, characterData: true, subtree: true });
        setTimeout(() => resolve(NaN), 10_000);
      });
    });
    await page.keyboard.press(i % 2 === 0 ? "x" : "Backspace");
    times.push(await page.evaluate(() => window.seen));
    await page.waitForTimeout(120);
  }
  return times;
}

/** The first slider with an effect moves; the time ends when a value in the head of a panel changes and a frame is drawn. */
async function measureSlider(page) {
  const times = [];
  for (let i = 0; i < ROUNDS; i += 1) {
    times.push(await page.evaluate((share) => new Promise((resolve) => {
      const input = document.querySelector(".control-range");
      const began = performance.now();
      const observer = new MutationObserver(() => {
        observer.disconnect();
        requestAnimationFrame(() => resolve(performance.now() - began));
      });
      for (const legend of document.querySelectorAll(".panels .panel")) observer.observe(legend, { childList: true, characterData: true, subtree: true });
      setTimeout(() => { observer.disconnect(); resolve(NaN); }, 20_000);
      input.value = String(share);
      input.dispatchEvent(new Event("input", { bubbles: true }));
    }), 300 + 25 * i));
    await page.waitForTimeout(100);
  }
  return times;
}

function pair(times) {
  const sorted = times.filter((t) => !Number.isNaN(t)).sort((a, b) => a - b);
  if (sorted.length === 0) return "–";
  const at = (share) => sorted[Math.min(sorted.length - 1, Math.floor(share * sorted.length))].toFixed(0);
  return `${at(0.5)}, ${at(0.9)}${sorted.length < times.length ? ` (${times.length - sorted.length} lost)` : ""}`;
}
