// The supply falls to 8 V: after 2 s the LED is red and flashes, the valve is in fault-hold, and EMCY 3412 stands in the trace.

import assert from "node:assert/strict";
import { simulate, withPage } from "./rig.mjs";

const simulator = await simulate();
await withPage({ url: simulator.url }, async (page) => {
  const supply = page.getByRole("spinbutton", { name: "Supply in V" });
  await supply.fill("8");
  await supply.press("Enter");
  const led = page.locator(".led");
  await page.locator(".led[data-color=red][data-flashing]").waitFor();
  const animation = await led.evaluate((element) => {
    const { animationName, animationDuration, animationIterationCount } = getComputedStyle(element);
    return [animationName, animationDuration, animationIterationCount];
  });
  // 333 ms on, 333 ms off.
  assert.deepEqual(animation, ["flash", "0.667s", "infinite"]);
  await page.emulateMedia({ reducedMotion: "reduce" });
  assert.equal(await led.evaluate((element) => getComputedStyle(element).animationName), "none");
  await page.locator("dd[data-value=fault-hold]").waitFor();
  await page.locator("dd[data-value='red, flashing']").waitFor();
  await page.locator(".faults li[data-active]", { hasText: "supply low" }).waitFor();
  const emcy = page.locator("#frames li.fault", { hasText: "0x3412" });
  await emcy.waitFor();
  assert.equal(await emcy.locator(".id").textContent(), "0A0");
  assert.match(await emcy.locator(".data").textContent(), /^12 34/);
  assert.equal(await emcy.locator(".meaning").textContent(), "pvea-canopen: EMCY: supply too low (0x3412), register 0x05, count 1");
  assert.match(await page.locator("#notice").textContent(), /supply low/);
});
await simulator.end();
