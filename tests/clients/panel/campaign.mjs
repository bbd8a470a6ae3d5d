// The page of a campaign: filters, a worst cell's trace, a command, which is run and gives the same verdict; keyboard, paper, and
// axe in both themes.

import assert from "node:assert/strict";
import { spawnSync } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync, statSync, writeFileSync } from "node:fs";
import { createRequire } from "node:module";
import { tmpdir } from "node:os";
import { dirname, join } from "node:path";
import { fileURLToPath, pathToFileURL } from "node:url";
import { withBrowser } from "./rig.mjs";

const [binary, modules] = process.argv.slice(2);
const root = join(dirname(fileURLToPath(import.meta.url)), "../../..");
const axe = readFileSync(createRequire(`${modules}/`).resolve("axe-core/axe.min.js"), "utf8");
const folder = mkdtempSync(join(tmpdir(), "campaign-"));
const run = (...words) => spawnSync(binary, words, { cwd: root, encoding: "utf8" });

const plan = join(folder, "plan.toml"), file = join(folder, "campaign.html");
writeFileSync(plan, `
title = "A careless master"
scenario = "${join(root, "scenarios/campaigns/careless.toml")}"
faults = [{ plant = { temperature_c = 130 }, reference = "row 7" }, { plant = { spool = "drifting" } }, { power = { on = false } }, { lose = "220", count = 1 }]
instants = { from_ms = 1000, to_ms = 1800, step_ms = 50 }
detected = { expect = "000#02..", within_ms = 500 }
safe = { expect = { solenoids = false }, within_ms = 500 }
`);
const told = run("campaign", plan, "--html", file, "--results", join(folder, "results"));
assert.equal(told.status, 1, told.stdout + told.stderr);
const [, passed, failed] = /^(\d+) passed, (\d+) failed$/m.exec(told.stdout).map(Number);
assert(statSync(file).size < 1_000_000);

for (const colorScheme of ["light", "dark"]) {
  await withBrowser({ colorScheme }, async (page) => {
    const trouble = [];
    page.on("pageerror", (error) => trouble.push(error.message));
    page.on("console", (message) => message.type() === "error" && trouble.push(message.text()));
    page.on("request", (request) => request.url().startsWith("file:") || trouble.push(`asks for ${request.url()}`));
    await page.goto(pathToFileURL(file).href);

    // The counts are those of the summary.
    const number = (cells) => cells.toLocaleString("en");
    assert.equal(await page.locator("#outcome").textContent(), `${number(failed)} of ${number(passed + failed)} cells failed`);
    const strips = page.getByRole("slider"), shown = page.locator("#shown");
    const all = await strips.count();
    assert.equal(await page.locator("article").count(), all);

    // Filters: one verdict alone, then a fault by its name.
    const undetected = page.getByRole("checkbox", { name: /^undetected/ });
    for (const box of await page.getByRole("checkbox").all()) await box.uncheck();
    assert.equal(await strips.count(), 0);
    await undetected.check();
    const some = await strips.count();
    assert(some > 0 && some < all, `${some} of ${all}`);
    for (const box of await page.getByRole("checkbox").all()) await box.check();
    const name = await page.locator("article h3").first().textContent();
    await page.getByRole("searchbox").fill(name);
    assert.match(await shown.textContent(), /^1 fault, /);
    await page.getByRole("searchbox").fill("");
    await page.getByRole("combobox").selectOption("worst");

    // The worst cell: its trace, its command, and the verdict of its command.
    const card = page.locator("article").first();
    assert(!(await card.locator("details pre").isVisible()));
    await card.locator("summary").press("Enter");
    assert.match(await card.locator("details pre").textContent(), / ms {2}(<-|->) /);
    const command = await card.locator("pre").first().textContent();
    const verdict = await card.locator(".worst .verdict").textContent();
    const words = command.split(" ");
    assert.equal(words.shift(), "pve-sim");
    const alone = run(...words);
    assert.equal(alone.status, 1, alone.stdout + alone.stderr);
    assert.match(alone.stdout.trimEnd().split("\n").at(-1), new RegExp(`: ${verdict} at `));

    // The keyboard: along a strip, to the worst cell and back to a command.
    const strip = strips.first();
    await strip.focus();
    await page.keyboard.press("Home");
    const first = await page.locator("#command").textContent();
    await page.keyboard.press("ArrowRight");
    const second = await page.locator("#command").textContent();
    assert.notEqual(first, second);
    assert.match(await strip.getAttribute("aria-valuetext"), / ms: [a-z-]+/);
    await page.getByRole("button", { name: /worst instant of/ }).first().press("Enter");
    assert.equal(await page.locator("#command").textContent(), command);
    await strip.click({ position: { x: 0, y: 10 } });
    assert.equal(await page.locator("#command").textContent(), first);

    await page.evaluate(axe);
    const { violations } = await page.evaluate(() => window.axe.run());
    assert.deepEqual(violations.map(({ id, nodes }) => `${id}: ${nodes[0].html}`), []);

    // On paper every trace is open and the filters are gone.
    await page.emulateMedia({ media: "print" });
    await page.evaluate(() => window.dispatchEvent(new Event("beforeprint")));
    assert(await page.locator("article details pre").last().isVisible());
    assert(!(await page.getByRole("searchbox").isVisible()));
    const paper = await page.pdf({ format: "A4", printBackground: true });
    assert(paper.length > 10_000);
    await page.evaluate(() => window.dispatchEvent(new Event("afterprint")));
    await page.emulateMedia({ media: "screen" });

    // A narrow window scrolls one way only.
    await page.setViewportSize({ width: 400, height: 800 });
    assert(await page.evaluate(() => document.documentElement.scrollWidth <= 400));
    assert.deepEqual(trouble, []);
  });
}
rmSync(folder, { recursive: true });
