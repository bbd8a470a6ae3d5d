// The simulator goes away and comes back, and is then another one: the page says so, and shows what there is.

import assert from "node:assert/strict";
import { simulate, until, withPage } from "./rig.mjs";

// The system gives no port of this range to whoever asks for any: the second simulator finds it free.
const http = `127.0.0.1:${10_000 + (process.pid % 10_000)}`;
const first = await simulate("--http", http, "--device", "pvea-canopen", "--device", "pveo-canopen@0x21");
await withPage({ url: first.url, expected: /ERR_/ }, async (page) => {
  assert.equal(await page.locator("article").count(), 2);
  await first.end();
  await page.locator("#link[data-link=lost]").waitFor();
  assert.match(await page.locator("#link").textContent(), /Connection lost/);

  const second = await simulate("--http", http, "--device", "pvea-canopen@0x22", "--device", "hat1000,bit-rate=250k");
  await page.locator("#link[data-link=there]").waitFor();
  assert.deepEqual(await page.locator("article h2").allTextContents(), ["pvea-canopen", "hat1000"]);
  await page.locator(".plate", { hasText: "0x22" }).waitFor();
  // The trace is that of the new one, and goes on.
  await second.call("POST", "/bus/frames", { id: 0x123, data: "C0FFEE" });
  await page.locator("#frames li", { hasText: "C0 FF EE" }).waitFor();
  await second.end();
});

// Another kind has the name, at the same instant: its card is a new one, with a dial.
const valve = await simulate("--http", http, "--speed", "step", "--device", "pvea-canopen,name=boom");
await withPage({ url: valve.url, expected: /ERR_/ }, async (page) => {
  await valve.end();
  await page.locator("#link[data-link=lost]").waitFor();
  const sensor = await simulate("--http", http, "--speed", "step", "--device", "hat1000,name=boom");
  await page.locator("#link[data-link=there]").waitFor();
  assert.deepEqual([await page.locator("svg.gauge").count(), await page.locator("svg.dial").count()], [0, 1]);
  assert.equal(await page.getByRole("article", { name: "boom" }).getByRole("slider", { name: "Angle" }).count(), 1);
  await sensor.end();
});

// A simulator stands still: the page says so, invents no time, and does not ask again and again.
const still = await simulate();
await withPage({ url: still.url }, async (page) => {
  const time = async () => parseFloat(await page.locator("#time").textContent());
  await until(page, () => parseFloat(document.getElementById("time").textContent) > 1);
  still.signal("SIGSTOP");
  const stopped = await time();
  let asked = 0;
  page.on("request", () => (asked += 1));
  await page.locator("#link[data-link=lost]").waitFor();
  assert((await time()) < stopped + 3, `from ${stopped} s to ${await time()} s`);
  assert(asked <= 2, `${asked} requests`);
  still.signal("SIGCONT");
  await page.locator("#link[data-link=there]").waitFor();
});
await still.end();
