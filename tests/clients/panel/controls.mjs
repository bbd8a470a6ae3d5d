// Every control is driven once, by the keyboard, and does what it says. Time moves only when told.

import assert from "node:assert/strict";
import { PATIENCE, simulate, until, withPage } from "./rig.mjs";

const simulator = await simulate(
  "--speed", "step", "--device", "pvea-canopen", "--device", "hat1000,bit-rate=250k", "--device", "pvea-isobus",
);

const state = (name) => simulator.call("GET", `/devices/${name}`);
const plant = async (name) => (await state(name)).plant;

await withPage({ url: simulator.url, expected: /status of 400/ }, async (page) => {
  const card = (name) => page.getByRole("article", { name, exact: true });

  /** Marks a control as driven, and gives it the keyboard. */
  async function hold(control) {
    const element = await control.evaluateHandle((element) => ((element.dataset.driven = ""), element));
    // The answer before, which the server has given, may still have to reach the page.
    await element.waitForElementState("enabled", { timeout: PATIENCE });
    await control.focus();
    return control;
  }

  /** Does something, and waits until the server has answered. */
  async function answered(work, status = 200) {
    const answer = page.waitForResponse((response) => response.request().method() !== "GET");
    await work();
    assert.equal((await answer).status(), status);
  }

  const press = async (control, key, status) => {
    await hold(control);
    await answered(() => page.keyboard.press(key), status);
  };

  const write = async (control, text) => {
    await hold(control);
    await control.fill(text);
    await answered(() => control.press("Enter"));
  };

  const choose = async (control, value) => {
    await hold(control);
    await answered(() => control.selectOption(value));
  };

  const advance = async (ms) => {
    await hold(page.getByLabel("Advance by")).then((field) => field.fill(String(ms)));
    await press(page.getByRole("button", { name: "Advance" }), "Enter");
  };

  await advance(1000);
  assert.equal((await simulator.call("GET", "/time")).now_us, 1e6);

  // Everything that can be reached is reached by Tab.
  const reachable = await page.evaluate(() =>
    [...document.querySelectorAll("a, button:enabled, input, select, summary, [tabindex='0']")].filter((element) => element.checkVisibility()).length,
  );
  await page.evaluate(() => document.activeElement.blur());
  const reached = new Set();
  for (let i = 0; i < reachable + 5; i += 1) {
    await page.keyboard.press("Tab");
    reached.add(await page.evaluate(() => {
      window.stops ??= [];
      const stop = document.activeElement;
      if (!window.stops.includes(stop)) window.stops.push(stop);
      return window.stops.indexOf(stop);
    }));
  }
  assert(reached.size >= reachable, `${reached.size} of ${reachable} controls by Tab`);

  for (const name of ["pvea-canopen", "pvea-isobus"]) {
    const valve = card(name);
    await press(valve.getByRole("slider", { name: "Supply" }), "End");
    assert.equal((await plant(name)).supply_mv, 40_000);
    await write(valve.getByRole("spinbutton", { name: "Supply in V" }), "24.5");
    assert.equal((await plant(name)).supply_mv, 24_500);
    await press(valve.getByRole("slider", { name: "Temperature" }), "Home");
    assert.equal((await plant(name)).temperature_c, -40);
    await write(valve.getByRole("spinbutton", { name: "Temperature in °C" }), "20");
    assert.equal((await plant(name)).temperature_c, 20);
    for (const fault of ["stuck", "slow", "drifting", "no-float", ""]) {
      await choose(valve.getByLabel("Spool"), fault);
      assert.equal((await plant(name)).spool.fault, fault || null);
    }
    await press(valve.getByRole("slider", { name: "Hand lever in percent" }), "End");
    assert.equal((await plant(name)).lever, 16384);
    await press(valve.getByRole("button", { name: "Release" }), "Enter");
    assert.equal((await plant(name)).lever, null);
  }

  const sensor = card("hat1000");
  await press(sensor.getByRole("slider", { name: "Angle" }), "ArrowRight");
  assert.equal((await plant("hat1000")).angle_cdeg, 1);
  await write(sensor.getByRole("spinbutton", { name: "Angle in °" }), "90");
  await until(page, () => document.querySelector(".pointer").getAttribute("transform") === "rotate(90)");
  await press(sensor.getByRole("slider", { name: "Speed" }), "ArrowRight");
  assert.equal((await plant("hat1000")).speed_rpm, 1);
  await write(sensor.getByRole("spinbutton", { name: "Speed in rpm" }), "0");
  await press(sensor.getByLabel("Measuring error"), "Space");
  assert.equal((await plant("hat1000")).measuring_error, true);

  for (const name of ["pvea-canopen", "hat1000", "pvea-isobus"]) {
    const device = card(name);
    await press(device.getByLabel("Internal fault"), "Space");
    assert.equal((await plant(name)).internal_fault, true);
    await press(device.getByLabel("Bus-off"), "Space");
    assert.equal((await plant(name)).bus_off, true);
    await press(device.getByLabel("Bus-off"), "Space");
    await press(device.getByLabel("Internal fault"), "Space");
    for (const memory of ["write-fails", "damaged", "ok"]) {
      await choose(device.getByLabel("Memory"), memory);
      assert.equal((await plant(name)).memory, memory);
    }
    await press(device.getByRole("button", { name: "Watchdog reset" }), "Enter");
    const power = device.getByRole("switch", { name: "Power" });
    await press(power, "Enter");
    assert.equal((await state(name)).powered, false);
    await device.locator("[role=switch][aria-checked=false]").waitFor();
    await press(power, "Space");
    assert.equal((await state(name)).powered, true);
    await (await hold(device.locator("summary"))).press("Enter");
    await device.locator("details:not([open])").waitFor({ state: "attached" });
  }

  await choose(page.getByLabel("Bit rate"), "500000");
  assert.equal((await simulator.call("GET", "/bus")).bit_rate, 500_000);
  await choose(page.getByLabel("Bit rate"), "250000");

  await (await hold(page.getByLabel("Next"))).fill("5");
  await (await hold(page.getByLabel("frames of"))).fill("0CFE3380");
  await press(page.getByRole("button", { name: "Destroy" }), "Enter");
  assert.deepEqual((await simulator.call("GET", "/bus")).disturb, { frames: 5, id: 0x0cfe3380, extended: true });
  await page.locator("#disturbed", { hasText: "5 left of 0CFE3380" }).waitFor();
  await press(page.getByRole("button", { name: "End", exact: true }), "Enter");
  assert.equal((await simulator.call("GET", "/bus")).disturb.frames, 0);
  await page.getByLabel("frames of").fill("0x1A0");
  await press(page.getByRole("button", { name: "Destroy" }), "Enter");
  assert.deepEqual((await simulator.call("GET", "/bus")).disturb, { frames: 5, id: 0x1a0, extended: false });
  await press(page.getByRole("button", { name: "End", exact: true }), "Enter");

  const faults = page.getByRole("list", { name: "Communication faults" });
  const addFault = async (kind, frames, count, parameters, status) => {
    await (await hold(page.getByRole("combobox", { name: "Fault" }))).selectOption(kind);
    await (await hold(page.getByLabel("Frames", { exact: true }))).fill(frames);
    await (await hold(page.getByLabel("Count"))).fill(count);
    await (await hold(page.getByLabel("Parameters"))).fill(parameters);
    await press(page.getByRole("button", { name: "Add" }), "Enter", status);
  };
  await addFault("lose", "000", "1", "receivers=hat1000,pvea-canopen name=gap");
  await addFault("corrupt", "", "", "data.toggle=01 dlc.set=8 probability=0.5 sender=hat1000");
  await addFault("delay", "5FC", "", "ms=5..20 overtake=true");
  await addFault("insert", "5FB#01", "", "from_ms=100");
  const told = (await simulator.call("GET", "/bus/faults")).map(({ name, fault }) => `${name}: ${fault}`);
  assert.deepEqual(told, [
    "gap: lose 000 for hat1000, pvea-canopen, count 1",
    "corrupt: corrupt all of hat1000, dlc set 8, data toggle 01, probability 0.5",
    "delay-5FC: delay 5FC by 5 ms to 20 ms, overtaken by later ones",
    "insert-5FB: insert 5FB: 01, from 100 ms",
  ]);
  for (const [at, text] of told.entries()) await faults.getByRole("listitem").nth(at).getByText(text).waitFor();
  await simulator.call("POST", "/bus/frames", { id: "000", data: "" });
  await faults.getByRole("listitem").filter({ hasText: "×1, over" }).waitFor();
  for (const name of ["gap", "corrupt", "delay-5FC"]) await press(faults.getByRole("button", { name: `End ${name}` }), "Enter");
  // The focus goes to the next fault, then to the form: a second Enter does not end all of them.
  const focusIsAt = (name) => until(page, (name) => (document.activeElement.ariaLabel ?? document.activeElement.id) === name, name);
  await focusIsAt("End insert-5FB");
  await addFault("delay", "5FC", "2", 'sender="the gateway" ms=007 probability=.5');
  const delay = (await simulator.call("GET", "/bus/faults")).map(({ fault }) => fault).at(-1);
  assert.equal(delay, "delay 5FC of the gateway by 7 ms, count 2, probability 0.5");
  await press(faults.getByRole("button", { name: "End delay-5FC" }), "Enter");
  await focusIsAt("kind");
  await press(page.getByRole("button", { name: "End all" }), "Enter");
  await until(page, () => document.querySelectorAll("#communication li").length === 0);
  await addFault("delay", "5FC", "", "ms=x", 400);
  await page.locator("#notice", { hasText: /^ms / }).waitFor();
  for (const [parameters, key] of [
    ["lose=221", "lose"], ["count=3", "count"], ["ms=1 ms=2", "ms"], ["data.set=01 data.set=02", "data.set"], ["data=1 data.set=01", "data.set"],
  ]) {
    await page.getByLabel("Parameters").fill(parameters);
    await page.getByRole("combobox", { name: "Fault" }).selectOption("lose");
    await page.getByLabel("Count").fill("1");
    await page.getByRole("button", { name: "Add" }).press("Enter");
    await page.locator("#notice", { hasText: `duplicate key '${key}'` }).waitFor();
  }
  await page.getByLabel("Parameters").fill('receivers="the gateway');
  await page.getByRole("button", { name: "Add" }).press("Enter");
  await page.locator("#notice", { hasText: "'gateway' is not valid" }).waitFor();
  assert.deepEqual(await simulator.call("GET", "/bus/faults"), []);

  // The notation of cansend, and blanks.
  const frame = await hold(page.getByLabel("Frame", { exact: true }));
  for (const [text, meaning] of [["5FD#01.0203", "01 02 03"], ["5FD#01 0204", "01 02 04"], ["5FD#R2", "remote"], ["5FD#R", "remote"]]) {
    await frame.fill(text);
    await press(page.getByRole("button", { name: "Send" }), "Enter");
    await page.locator("#frames li", { hasText: "5FD" }).last().getByText(meaning).first().waitFor();
  }
  await frame.fill("5FF#");
  await press(page.getByRole("button", { name: "Send" }), "Enter");
  await page.locator("#frames li", { hasText: "5FF" }).waitFor();
  await frame.fill("5FE#010203");
  await (await hold(page.getByLabel("every"))).fill("10");
  await press(page.getByRole("button", { name: "Send" }), "Enter");
  await advance(100);
  const lines = page.locator("#frames li", { hasText: "5FE" });
  await lines.first().waitFor();
  assert.equal(await lines.count(), 1, "repeats are hidden");
  await (await hold(page.getByLabel("Hide repeats"))).press("Space");
  const onTheBus = async () => (await simulator.call("GET", "/trace?limit=4096")).filter(({ id }) => id === 0x5fe).length;
  const sent = await onTheBus();
  assert(sent >= 10, `${sent} frames`);
  const shows = (count) => [...document.querySelectorAll("#frames li")].filter((row) => row.textContent.includes("5FE")).length === count;
  await until(page, shows, sent);

  // Paused, nothing is added; then it is all there.
  await (await hold(page.getByRole("button", { name: "Pause" }))).press("Enter");
  await advance(100);
  await page.locator("#trace-note", { hasText: "paused" }).waitFor();
  assert.equal(await lines.count(), sent);
  await page.getByRole("button", { name: "Pause" }).press("Enter");
  await until(page, shows, await onTheBus());
  await (await hold(page.getByRole("searchbox", { name: "Filter" }))).fill("http -5fe -5fd -000");
  await until(page, () => {
    const rows = [...document.querySelectorAll("#frames li")];
    return rows.length > 0 && rows.every((row) => row.textContent.includes("5FF"));
  });

  // Paused, filter and repeats choose among the lines from before, also after more frames than are kept.
  const filter = page.getByRole("searchbox", { name: "Filter" });
  await filter.fill("5fe");
  await until(page, shows, await onTheBus());
  const times = await page.locator("#frames time").allTextContents();
  const showsTimes = (times) => {
    const shown = [...document.querySelectorAll("#frames time")].map((time) => time.textContent);
    return shown.join() === times.join();
  };
  await page.getByRole("button", { name: "Pause" }).press("Enter");
  await advance(25_000);
  await page.locator("#trace-note", { hasText: "paused, 2000 frames kept" }).waitFor();
  await filter.fill("0x5fe");
  await until(page, showsTimes, times);
  await page.getByLabel("Hide repeats").press("Space");
  await until(page, showsTimes, times.slice(0, 1));
  await page.getByLabel("Hide repeats").press("Space");
  await until(page, showsTimes, times);
  await filter.fill("");
  await press(page.getByRole("button", { name: "Stop" }), "Enter");
  await page.locator("#notice", { hasText: "1 cyclic" }).waitFor();
  await (await hold(page.getByRole("button", { name: "Clear" }))).press("Enter");
  await page.getByText("No frames yet").waitFor();
  await page.getByRole("button", { name: "Pause" }).press("Enter");
  await until(page, () => document.querySelectorAll("#frames li").length === 0);
  await (await hold(page.locator(".skip"))).press("Enter");
  assert.equal(await page.evaluate(() => document.activeElement.id), "trace");

  const forgotten = await page.evaluate(() =>
    [...document.querySelectorAll("a, button, input, select, summary")]
      .filter((element) => !("driven" in element.dataset))
      .map((element) => element.outerHTML),
  );
  assert.deepEqual(forgotten, [], "controls that no test drives");

  // What is refused is said.
  await card("pvea-canopen").locator("summary").press("Enter");
  const supply = card("pvea-canopen").getByRole("spinbutton", { name: "Supply in V" });
  await supply.fill("200");
  const refused = page.waitForResponse((response) => response.status() === 400);
  await supply.press("Enter");
  await refused;
  await page.locator("#notice", { hasText: "accepted: a whole number from 0 to 100000" }).waitFor();
  await page.keyboard.press("Tab");
  await until(page, () => document.querySelector("[aria-label='Supply in V']").value === "24.5");
});
await simulator.end();
