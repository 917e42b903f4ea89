// The page of `smpl live` in Chromium, against the real server.

import assert from "node:assert/strict";
import { readFileSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { after, before, test } from "node:test";
import { closeBrowser, missing, open, panel, serve, shipped, slide, TANK, toLine, until, valueOf } from "./harness.mjs";

const options = { skip: missing, timeout: 120_000 };
let server;

before(async () => {
  if (!missing) server = await serve({ "tank.eq": TANK, "markup.eq": TANK.replace("a tank that drains", "<img src=x onerror=alert(1)>").replace('"level"', '"<b>bold</b>"') });
});
after(async () => {
  await closeBrowser();
  await server?.close();
});

/** Opens the tank, runs a test, and expects a clean console. */
async function withTank(run, { uri = server?.uri("tank.eq"), ...context } = {}) {
  const client = await open(server, uri, context);
  try {
    await run(client.page, client);
    assert.deepEqual(client.errors, []);
  } finally {
    await client.close();
  }
}

const problems = (page) => page.locator(".problems-summary");

test("the start screen lists models and opens one", options, async () => {
  const { page, errors, close } = await open(server);
  await page.getByRole("button", { name: /^Reactor/ }).click();
  await page.locator(".panel canvas").first().waitFor();
  assert.match(await page.locator(".bar-name").textContent(), /^Reactor/);
  await page.goBack();
  await page.locator(".start-card").first().waitFor();
  assert.deepEqual(errors, []);
  await close();
});

test("a new model is written, runs, and is saved", options, async () => {
  const { page, errors, close } = await open(server);
  await page.locator(".template").first().click();
  await page.getByLabel("File name").fill("fresh.eq");
  await page.getByRole("button", { name: "Create" }).click();
  await page.locator(".panel canvas").first().waitFor();
  await page.keyboard.press("Control+S");
  await page.getByText("fresh.eq saved.").waitFor();
  assert.match(readFileSync(join(server.folder, "fresh.eq"), "utf8"), /^model /);
  assert.deepEqual(errors, []);
  await close();
});

test("an error appears while it is typed and goes when it is undone", options, async () => {
  await withTank(async (page) => {
    await until(async () => /No problems/.test(await problems(page).textContent()), "no problems at first");
    await toLine(page, 7);
    await page.keyboard.type("eq zz = 1\n");
    await until(async () => /error/.test(await problems(page).textContent()), "the error");
    await page.locator(".cm-lintRange-error").first().waitFor();
    await until(() => page.locator(".result-pane.stale").count(), "greyed results");
    assert.ok(await panel(page, "h").isVisible());
    for (let i = 0; i < 12; i += 1) await page.keyboard.press("Control+Z");
    await until(async () => /No problems/.test(await problems(page).textContent()), "no problems again");
    await until(async () => (await page.locator(".result-pane.stale").count()) === 0, "results in colour");
  });
});

test("arguments of a function are shown while they are typed", options, async () => {
  await withTank(async (page) => {
    await toLine(page, 7);
    await page.keyboard.type("let y = clip(h, ");
    const help = page.locator(".signature");
    await help.waitFor();
    assert.match(await help.textContent(), /^clip\(/);
    const second = await help.locator("b").textContent();
    await page.keyboard.type("0 [m], ");
    await until(async () => (await help.locator("b").textContent()) !== second, "the third argument");
    await page.keyboard.press("Escape");
    await until(async () => (await help.count()) === 0, "no arguments");
  });
});

test("a block is folded and opened", options, async () => {
  await withTank(async (page) => {
    const line = page.locator(".cm-line", { hasText: "0.05" });
    const mark = page.locator('.cm-foldGutter span[title="Fold line"]');
    await mark.first().waitFor();
    await mark.last().click();
    await until(async () => (await line.count()) === 0, "a folded block");
    await page.locator(".cm-foldPlaceholder").click();
    await line.first().waitFor();
  });
});

test("a slider moves the curves and is reset", options, async () => {
  await withTank(async (page) => {
    const first = await valueOf(page, "h").textContent();
    await slide(page, "q", 0.9);
    await until(async () => (await valueOf(page, "h").textContent()) !== first, "another level");
    assert.match(await page.locator(".controls-head").textContent(), /1 changed/);
    await page.getByRole("button", { name: "Reset all" }).click();
    await until(async () => (await valueOf(page, "h").textContent()) === first, "the level of the model");
  });
});

test("a number field takes a value and refuses one outside of the bounds", options, async () => {
  await withTank(async (page) => {
    const first = await valueOf(page, "h").textContent();
    const field = page.getByRole("textbox", { name: "k", exact: true });
    await field.fill("5");
    await field.press("Enter");
    assert.equal(await field.getAttribute("aria-invalid"), "true");
    assert.equal(await valueOf(page, "h").textContent(), first);
    await field.fill("0,2");
    await field.press("Enter");
    await until(async () => (await valueOf(page, "h").textContent()) !== first, "another level");
  });
});

test("a variant changes the curves", options, async () => {
  await withTank(async (page) => {
    const first = await valueOf(page, "h").textContent();
    await page.getByText("Variants and choices").click();
    await page.getByLabel("leak").check();
    await until(async () => (await valueOf(page, "h").textContent()) !== first, "another level");
  });
});

test("panels keep their names when a variant adds a quantity", options, async () => {
  const uri = await shipped(server, "reactor");
  await withTank(
    async (page) => {
      const unit = panel(page, "V").locator(".panel-unit");
      assert.equal(await unit.textContent(), "m³");
      await page.getByText("Variants and choices").click();
      await page.getByLabel(/^fouling/).check();
      await panel(page, "U").locator(".panel-unit").waitFor();
      assert.equal(await panel(page, "U").locator(".panel-unit").textContent(), "kJ/(min m² K)");
      assert.equal(await unit.textContent(), "m³");
    },
    { uri },
  );
});

test("the steady state is shown with its eigenvalues", options, async () => {
  await withTank(async (page) => {
    await page.getByRole("tab", { name: "Steady state" }).click();
    // In the steady state k*sqrt(h) = q, so that h = 1 m; the eigenvalue is -k/(2*A*sqrt(h)) = -0.1/min.
    await until(async () => /Stable/.test(await page.locator("#panel-steady").textContent()), "a stable steady state");
    const text = await page.locator("#panel-steady").textContent();
    assert.match(text, /h\s*1\s*m|h1/);
    assert.match(text, /−0\.1/);
    assert.equal(await page.locator(".plane-point.stable").count(), 1);
  });
});

test("equations lead to their lines and back", options, async () => {
  await withTank(async (page) => {
    await page.getByRole("tab", { name: "Equations" }).click();
    await page.locator(".equation math").first().waitFor();
    const row = page.locator(".equation").filter({ has: page.locator(".equation-line", { hasText: /^7$/ }) }).first();
    await row.click();
    await until(async () => (await page.locator(".cm-activeLineGutter").first().textContent()) === "7", "line 7");
    await until(() => row.evaluate((e) => e.classList.contains("at-cursor")), "a marked equation");
  });
});

test("structure and task are shown", options, async () => {
  await withTank(async (page) => {
    await page.getByRole("tab", { name: "Structure" }).click();
    await page.getByText("Which equation determines what").waitFor();
    await page.getByRole("tab", { name: "Task" }).click();
    await page.getByText(/episode return/).waitFor();
    await page.locator("#panel-task .panel canvas").first().waitFor();
  });
});

test("a pinned run, several seeds and a sweep are drawn together", options, async () => {
  await withTank(async (page) => {
    await page.getByRole("button", { name: "Pin run" }).click();
    await page.locator(".chip-key.pinned").waitFor();
    await page.locator("summary", { hasText: "Sweep" }).click();
    await page.locator("#sweep-name").selectOption("k");
    await page.getByLabel("Draw a family of curves").check();
    await until(async () => (await panel(page, "h").locator(".legend-entry").count()) === 7, "seven curves");
    await page.getByLabel("Draw a family of curves").uncheck();
    await page.getByLabel("Runs").fill("3");
    await page.getByLabel("Runs").press("Enter");
    await page.getByText("3 seeds: range and mean").waitFor();
  });
});

test("a PID loop holds the level at its set-point", options, async () => {
  await withTank(async (page) => {
    await page.locator("summary", { hasText: "PID loop" }).click();
    await page.getByLabel("Close a loop").check();
    const field = page.getByRole("textbox", { name: "Set-point" });
    await field.fill("0.8");
    await field.press("Enter");
    await until(async () => Math.abs(Number(await valueOf(page, "h").textContent()) - 0.8) < 0.05, "the level at 0.8 m");
  });
});

test("zoom and read-out move in all panels at once", options, async () => {
  await withTank(async (page) => {
    const frame = panel(page, "h").locator(".panel-frame");
    await frame.focus();
    const end = await valueOf(page, "h").textContent();
    await page.keyboard.press("Home");
    await until(async () => (await valueOf(page, "h").textContent()) !== end, "the value at the start");
    assert.match(await page.locator(".strip-clock").textContent(), /t = 0 min/);
    await page.keyboard.press("+");
    await page.getByRole("button", { name: "Whole run" }).waitFor();
    await page.keyboard.press("0");
    await until(async () => !(await page.getByRole("button", { name: "Whole run" }).isVisible()), "the whole run");
  });
});

test("texts of models are text", options, async () => {
  await withTank(
    async (page) => {
      assert.match(await page.locator(".bar-name").textContent(), /<img src=x/);
      assert.equal(await page.locator("img").count(), 0);
      assert.equal(await page.locator(".panel b").count(), 0);
      for (const tab of ["Equations", "Steady state", "Structure", "Task"]) {
        await page.getByRole("tab", { name: tab }).click();
        await page.waitForTimeout(150);
      }
      assert.equal(await page.locator("img").count(), 0);
    },
    { uri: server?.uri("markup.eq") },
  );
});

test("a file that changed on disk is not overwritten silently", options, async () => {
  writeFileSync(join(server.folder, "shared.eq"), TANK);
  await withTank(
    async (page) => {
      await toLine(page, 1);
      await page.keyboard.type("# mine\n");
      writeFileSync(join(server.folder, "shared.eq"), `# theirs\n${TANK}`);
      await page.getByText("changed on disk while you were editing").waitFor();
      await page.keyboard.press("Control+S");
      await page.getByRole("dialog").getByText("Take the version on disk").waitFor();
      await page.keyboard.press("Escape");
      assert.match(readFileSync(join(server.folder, "shared.eq"), "utf8"), /^# theirs/);
      await page.locator(".banner").getByText("Take the version on disk").click();
      await until(async () => /# theirs/.test(await page.locator(".cm-content").textContent()), "the version on disk");
    },
    { uri: server?.uri("shared.eq") },
  );
});

for (const [format, pattern] of [["Copy as Python", /smpl\.Env\(/], ["Copy scenario", /parameters:/]]) {
  test(`${format} shows the text of the controls`, options, async () => {
    await withTank(async (page) => {
      await slide(page, "k", 0.4);
      await page.getByRole("button", { name: "Export" }).click();
      await page.getByRole("menuitem", { name: format }).click();
      await page.locator(".text-out").waitFor();
      assert.match(await page.locator(".text-out").textContent(), pattern);
    });
  });
}

test("tables and pictures are downloaded", options, async () => {
  await withTank(async (page) => {
    for (const [name, start] of [["CSV", "step,time,"], ["Parquet", "PAR1"], ["SVG", "<"], ["PNG", "\x89PNG"]]) {
      await page.getByRole("button", { name: "Export" }).click();
      const [download] = await Promise.all([page.waitForEvent("download"), page.getByRole("menuitem", { name }).click()]);
      const bytes = readFileSync(await download.path());
      assert.equal(bytes.subarray(0, start.length).toString("latin1"), start, name);
    }
  });
});

test("the report is one file that opens without a server", options, async () => {
  await withTank(async (page, { context }) => {
    await page.getByRole("button", { name: "Export" }).click();
    const [download] = await Promise.all([page.waitForEvent("download"), page.getByRole("menuitem", { name: "Report" }).click()]);
    const path = join(server.folder, "report.html");
    await download.saveAs(path);
    await context.setOffline(true);
    const report = await context.newPage();
    const errors = [];
    const requests = [];
    report.on("console", (message) => ["error", "warning"].includes(message.type()) && errors.push(message.text()));
    report.on("pageerror", (error) => errors.push(String(error)));
    report.on("request", (request) => requests.push(request.url()));
    await report.goto(`file://${path}`);
    assert.ok((await report.locator("math").count()) > 0);
    assert.match(await report.locator("body").textContent(), /Tank/);
    assert.deepEqual(errors, []);
    assert.deepEqual(requests.filter((url) => !url.startsWith("file:") && !url.startsWith("data:")), []);
    await context.setOffline(false);
  });
});

test("the keyboard alone reaches text, results, controls and menus", options, async () => {
  await withTank(async (page) => {
    const first = await valueOf(page, "h").textContent();
    const seen = new Set();
    const describe = () => page.evaluate(() => {
      const e = document.activeElement;
      return e.closest(".cm-content") ? "text" : e.matches("[role=tab]") ? "tab" : e.matches(".panel-frame") ? "panel" : e.matches(".control-range") ? `slider ${e.getAttribute("aria-label")}` : e.matches(".menu-button") ? "menu" : e.matches(".problems-summary") ? "problems" : e.matches(".splitter") ? "splitter" : e.tagName;
    });
    let moved = false;
    for (let i = 0; i < 120; i += 1) {
      await page.keyboard.press("Tab");
      const where = await describe();
      seen.add(where.split(" ")[0]);
      const visible = await page.evaluate(() => {
        const box = document.activeElement.getBoundingClientRect();
        return box.width > 0 && box.height > 0;
      });
      assert.ok(visible, `focus is at an invisible element: ${where}`);
      if (where === "slider q" && !moved) {
        moved = true;
        for (let k = 0; k < 5; k += 1) await page.keyboard.press("PageUp");
        await until(async () => (await valueOf(page, "h").textContent()) !== first, "another level by the keyboard");
      }
    }
    for (const part of ["text", "tab", "panel", "slider", "menu", "problems", "splitter"]) assert.ok(seen.has(part), `${part} is not reached: ${[...seen]}`);
    await page.keyboard.press("Alt+3");
    assert.equal(await page.locator("[role=tab][aria-selected=true]").textContent(), "Steady state");
  });
});

test("every control has a name for screen readers", options, async () => {
  await withTank(async (page) => {
    await page.evaluate(() => document.querySelectorAll(".section").forEach((e) => { e.open = true; }));
    await page.waitForTimeout(300);
    const nameless = await page.evaluate(() => [...document.querySelectorAll("button, input, select, [role=img], [role=separator]")]
      .filter((e) => e.getClientRects().length > 0 && !e.closest(".cm-editor"))
      .filter((e) => !(e.getAttribute("aria-label") || e.labels?.length || (e.matches("button") && e.textContent.trim())))
      .map((e) => e.outerHTML.slice(0, 120)));
    assert.deepEqual(nameless, []);
  });
});

for (const scheme of ["light", "dark"]) {
  test(`at 390 pixels nothing is cut, ${scheme}`, options, async () => {
    await withTank(
      async (page) => {
        const overflow = () => page.evaluate(() => document.documentElement.scrollWidth - innerWidth);
        assert.ok((await overflow()) <= 0);
        assert.equal(await page.locator(".text-pane").isVisible(), false);
        await page.locator(".views").getByText("Text").click();
        assert.ok(await page.locator(".cm-content").isVisible());
        assert.ok((await overflow()) <= 0);
        await page.locator(".views").getByRole("button", { name: "Controls" }).click();
        assert.ok(await page.locator(".controls").isVisible());
        for (const tab of ["Trajectories", "Equations", "Steady state", "Structure", "Task"]) {
          await page.getByRole("tab", { name: tab }).click();
          await page.waitForTimeout(150);
          assert.ok((await overflow()) <= 0, tab);
          const wide = await page.evaluate(() => { const e = document.querySelector(".tab-panel:not([hidden])"); return e.scrollWidth - e.clientWidth; });
          assert.ok(wide <= 1, `${tab} is ${wide} pixels too wide`);
        }
      },
      { viewport: { width: 390, height: 844 }, colorScheme: scheme, hasTouch: true },
    );
  });
}

for (const name of ["atropine", "mab"]) {
  test(`${name} stays responsive while one types`, options, async () => {
    const uri = await shipped(server, name);
    await withTank(
      async (page) => {
        await page.evaluate(() => {
          window.longest = 0;
          let last = performance.now();
          const frame = (now) => {
            window.longest = Math.max(window.longest, now - last);
            last = now;
            requestAnimationFrame(frame);
          };
          requestAnimationFrame(frame);
        });
        await toLine(page, 3);
        await page.keyboard.type("# a comment while the plant runs", { delay: 30 });
        assert.match(await page.locator(".cm-content").textContent(), /# a comment while the plant runs/);
        await page.keyboard.press("Enter");
        await page.keyboard.type("param nonsense : = 3\n", { delay: 30 });
        await until(async () => /error/.test(await problems(page).textContent()), "the error", 30_000);
        const longest = await page.evaluate(() => window.longest);
        assert.ok(longest < 1500, `a frame took ${longest} ms`);
      },
      { uri },
    );
  });
}

test("a lost connection is reported and the text is kept", options, async () => {
  const own = await serve({ "tank.eq": TANK });
  const { page, close } = await open(own, own.uri("tank.eq"));
  await toLine(page, 1);
  await page.keyboard.type("# kept\n");
  await own.stop();
  await page.getByText("The connection to smpl live was lost").waitFor();
  assert.match(await page.locator(".cm-content").textContent(), /# kept/);
  await close();
  await own.close();
});
