// What eyes see on a wide screen: colours that can be told apart and agree, controls wide enough, a filter that answers.

import assert from "node:assert/strict";
import { simulate, until, withPage } from "./rig.mjs";

const simulator = await simulate("--device", "pvea-canopen", "--device", "hat1000,bit-rate=250k");

await withPage({ url: simulator.url, viewport: { width: 1920, height: 1080 } }, async (page) => {
  const look = (selector, property, pseudo) =>
    page.locator(selector).first().evaluate((element, [property, pseudo]) => getComputedStyle(element, pseudo)[property], [property, pseudo]);

  // A pressed button can be read, hovered or not.
  await page.getByRole("button", { name: "Pause" }).click();
  await page.getByRole("button", { name: "Pause" }).hover();
  assert.notEqual(await look("#pause", "color"), await look("#pause", "backgroundColor"));
  await page.getByRole("button", { name: "Pause" }).click();

  // A number has the colour of its line.
  for (const [device, label] of [["pvea-canopen", "Set-point"], ["pvea-canopen", "Position"], ["hat1000", "Angle"]]) {
    const card = `article[aria-labelledby=device-${device}]`;
    const line = await look(`${card} .key:text-is("${label}")`, "backgroundColor", "::before");
    assert.equal(await look(`${card} .values div:has(dt:text-is("${label}")) dd`, "color"), line, `${device}: ${label}`);
  }
  const line = (label) => look(`.key:text-is("${label}")`, "backgroundColor", "::before");
  assert.notEqual(await line("Set-point"), await line("Position"));

  // Sliders can be moved, and nothing overlaps.
  for (const summary of await page.locator("summary").all()) {
    if (!(await summary.evaluate((element) => element.parentElement.open))) await summary.click();
  }
  const controls = await page.locator(".plant").evaluateAll((plants) =>
    plants.flatMap((plant) =>
      [...plant.children].map((control) => {
        const { left, right, top, bottom } = control.getBoundingClientRect();
        return { left, right, top, bottom, inner: control.scrollWidth - control.clientWidth, text: control.textContent,
          slider: control.querySelector("input[type=range]")?.clientWidth };
      }),
    ),
  );
  assert(controls.length > 10);
  for (const [at, control] of controls.entries()) {
    assert(control.slider === undefined || control.slider >= 110, `the slider of ${control.text} has ${control.slider} pixels`);
    assert.equal(control.inner, 0, `${control.text} overflows`);
    for (const other of controls.slice(at + 1)) {
      const apart = control.right <= other.left || other.right <= control.left || control.bottom <= other.top || other.bottom <= control.top;
      assert(apart, `${control.text} overlaps ${other.text}`);
    }
  }

  // An identifier is found as programs write it; a filter without a hit says so.
  const filter = page.getByRole("searchbox", { name: "Filter" });
  await filter.fill("0x0A0");
  await until(page, () => [...document.querySelectorAll("#frames .id")].some((id) => id.textContent === "0A0"));
  assert(await page.locator("#trace-empty").isHidden());
  await filter.fill("0x0A0 nothing-of-this-name");
  await page.getByText("No recorded frame matches the filter").waitFor();
  await filter.fill("");
  await until(page, () => document.querySelector("#trace-empty").hidden);

  // Everything that screen readers announce by itself.
  const announced = page.locator("output, [role=status], [role=alert], [role=log], [aria-live]");
  assert.deepEqual(await announced.evaluateAll((elements) => elements.map(({ id }) => id)), ["link", "unheard", "notice"]);
});

// With reduced motion a plot moves once a second, also while the shaft turns.
function countDrawings() {
  window.drawings = 0;
  const { clearRect } = CanvasRenderingContext2D.prototype;
  CanvasRenderingContext2D.prototype.clearRect = function (...area) {
    if (this.canvas.closest("article").ariaLabelledByElements?.[0].textContent === "hat1000") window.drawings += 1;
    clearRect.apply(this, area);
  };
}

await simulator.call("PATCH", "/devices/hat1000/plant", { speed_rpm: 5 });
await withPage({ url: simulator.url, viewport: { width: 1920, height: 1080 }, reducedMotion: "reduce", before: countDrawings }, async (page) => {
  const time = () => page.evaluate(() => [parseFloat(document.getElementById("time").textContent), window.drawings]);
  await until(page, () => window.drawings > 0);
  const [begin, before] = await time();
  await until(page, (end) => parseFloat(document.getElementById("time").textContent) > end, begin + 4);
  const [end, after] = await time();
  assert(after > before && after - before <= end - begin + 3, `${after - before} drawings in ${end - begin} s`);
});
await simulator.end();
