// A control that keeps the focus shows the value of the device, except while its text is being written.

import assert from "node:assert/strict";
import { simulate, until, withPage } from "./rig.mjs";

const simulator = await simulate("--device", "pvea-canopen,name=boom");
const change = (plant) => simulator.call("PATCH", "/devices/boom/plant", plant);

await withPage({ url: simulator.url, expected: /status of 400/ }, async (page) => {
  const supply = page.getByRole("spinbutton", { name: "Supply in V" });
  const shows = (label, value) => until(page, ([label, value]) => document.querySelector(`[aria-label='${label}']`).value === value, [label, value]);
  const isFocused = async (control) => assert(await control.evaluate((element) => element === document.activeElement));

  // Changed by another client.
  await supply.fill("12");
  await supply.press("Enter");
  await shows("Supply", "12");
  await change({ supply_mv: 20_000 });
  await shows("Supply in V", "20");
  await shows("Supply", "20");

  // Refused.
  await supply.fill("500");
  await supply.press("Enter");
  await page.locator("#notice", { hasText: "accepted" }).waitFor();
  await shows("Supply in V", "20");

  // Emptied.
  await supply.fill("");
  await supply.press("Enter");
  await shows("Supply in V", "20");
  await supply.fill("");
  await isFocused(supply);
  await supply.press("Tab");
  await shows("Supply in V", "20");

  // A text that is being written stays.
  await supply.focus();
  await supply.fill("13");
  await change({ supply_mv: 21_000, temperature_c: 30 });
  await shows("Temperature in °C", "30");
  assert.equal(await supply.inputValue(), "13");
  await supply.press("Enter");
  await shows("Supply", "13");
  await isFocused(supply);

  // The bit rate of the bus.
  const rate = page.getByLabel("Bit rate");
  await rate.focus();
  await rate.selectOption("500000");
  await page.locator("#unheard", { hasText: "boom" }).waitFor();
  await simulator.call("PATCH", "/bus", { bit_rate: 250_000 });
  await until(page, () => document.getElementById("bit-rate").value === "250000");
  await isFocused(rate);
});
await simulator.end();
