// Events that the page misses, or that overtake an answer, and frames that look alike: the page shows what there is.

import assert from "node:assert/strict";
import { simulate, until, withPage } from "./rig.mjs";

/** Runs in the page: keeps the stream of events as `stream`, and is deaf to devices while `isDeaf`. */
function hold() {
  window.EventSource = class extends EventSource {
    constructor(url) {
      super(url);
      window.stream = this;
    }

    addEventListener(name, work) {
      super.addEventListener(name, (event) => {
        if (name === "device") window.latest = event.data;
        if (name !== "device" || !window.isDeaf) work(event);
      });
    }
  };
}

const simulator = await simulate("--speed", "step", "--device", "pvea-canopen,name=boom");
const advance = (advance_ms) => simulator.call("POST", "/time", { advance_ms });
const change = (plant) => simulator.call("PATCH", "/devices/boom/plant", plant);
await advance(100);

await withPage({ url: simulator.url, before: hold }, async (page) => {
  const boom = page.getByRole("article", { name: "boom" });
  const heard = (text) => until(page, (text) => window.latest.includes(text), text);
  const showsSupply = (volts) => until(page, (volts) => document.querySelector("[aria-label='Supply in V']").value === volts, volts);

  // The change of a device is among the lost events: the card shows it nevertheless.
  await page.evaluate(() => (window.isDeaf = true));
  await simulator.call("POST", "/devices/boom/power", { on: false });
  await heard('"powered":false');
  await page.evaluate(() => {
    window.isDeaf = false;
    window.stream.dispatchEvent(new MessageEvent("lost", { data: '{"events":7}' }));
  });
  await page.locator("#trace-note", { hasText: "7 events missed" }).waitFor();
  await boom.locator("[role=switch][aria-checked=false]").waitFor();
  await simulator.call("POST", "/devices/boom/power", { on: true });
  await boom.locator("[role=switch][aria-checked=true]").waitFor();

  // After a reconnection, an event overtakes the answer with all devices.
  await showsSupply("24");
  let asked, answer;
  const isAsked = new Promise((resolve) => (asked = resolve));
  const mayAnswer = new Promise((resolve) => (answer = resolve));
  await page.route("**/api/v1/devices", async (route) => {
    const response = await route.fetch();
    asked();
    await mayAnswer;
    await route.fulfill({ response });
  });
  await page.evaluate(() => {
    window.stream.dispatchEvent(new Event("error"));
    window.stream.dispatchEvent(new Event("open"));
  });
  await isAsked;
  await advance(10);
  await change({ supply_mv: 8000 });
  await heard('"supply_mv":8000');
  answer();
  await page.locator("#link[data-link=there]").waitFor();
  await showsSupply("8");

  // Remote frames without bytes differ in their length, and a data frame is none: no frame is a repeat.
  for (const data of ["R4", "R", ""]) await simulator.call("POST", "/bus/frames", { id: "321", data });
  await until(page, () => [...document.querySelectorAll("#frames .id")].filter((id) => id.textContent === "321").length === 3);
});
await simulator.end();
