// A device at a different bit rate than the bus is named with the remedy, from the start and after a change, as long as that lasts.

import assert from "node:assert/strict";
import { simulate, until, withPage } from "./rig.mjs";

const REMEDY =
  "hat1000 runs at 500 kbit/s and the bus at 250 kbit/s: it cannot communicate and will disturb the bus; use hat1000,bit-rate=250k, or a bus at 500k";

const simulator = await simulate("--device", "pvea-canopen", "--device", "hat1000,bit-rate=500k");
await withPage({ url: simulator.url }, async (page) => {
  const line = page.locator("#unheard");
  await line.waitFor();
  assert.equal(await line.textContent(), REMEDY);
  // Its error frames were on the bus before the page was.
  await page.locator("#frames li", { hasText: "hat1000: error-passive" }).first().waitFor();
  await simulator.call("PATCH", "/bus", { bit_rate: 500000 });
  await until(page, () => document.getElementById("unheard").textContent.startsWith("pvea-canopen runs at 250"));
  assert.equal((await line.textContent()).split("\n").length, 1);
  await simulator.call("POST", "/devices/pvea-canopen/power", { on: false });
  await line.waitFor({ state: "hidden" });
});
await simulator.end();
