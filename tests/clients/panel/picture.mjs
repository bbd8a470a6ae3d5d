// Draws the picture of the documentation: node picture.mjs PVE_SIM MODULES FILE
//
// A master drives a boom to and fro, and an angle sensor measures it.

import { simulate, withPage } from "./rig.mjs";

const [, , , , file] = process.argv;
const simulator = await simulate(
  "--device", "pvea-canopen,name=boom", "--device", "hat1000,name=angle,bit-rate=250k", "--link", "boom=angle",
);
const frame = (id, data, every_ms) => simulator.call("POST", "/bus/frames", { id, data, every_ms });
/** Lets time pass: waits for a frame that does not come. */
const pass = (ms) => simulator.call("POST", "/wait", { frame: { id: 0x7ff }, within_ms: ms }).catch(() => {});

await withPage({ url: simulator.url, viewport: { width: 1280, height: 860 } }, async (page) => {
  await page.locator(".led[data-color=yellow]").waitFor();
  await frame(0x000, "0100");
  for (const word of ["03000000", "0B000000"]) await frame(0x220, word);
  for (const setPoint of ["0030", "0010", "00E0", "0000", "0020"]) {
    await frame(0x220, `0F00${setPoint}`, 100);
    await pass(3300);
  }
  await frame(0x220, "0F0000E0", 100);
  await pass(150);
  await page.locator("h1").click();
  await page.evaluate(() => new Promise((resolve) => requestAnimationFrame(() => requestAnimationFrame(resolve))));
  await page.screenshot({ path: file });
});
await simulator.end();
