// The valve's gauge: a spool in its bore, with the set-point below.

import { setAttribute, svg } from "./dom.js";
import { FULL, minus } from "./words.js";

const WIDTH = 360;
const MIDDLE = WIDTH / 2;
/** The distance of ±100 % from the middle. */
const STROKE = 96;
/** Half the length of the spool. */
const HALF = 62;
const BORE = { left: 10, right: WIDTH - 10, top: 34, bottom: 66 };
/** The ports and their distances from the middle. In neutral, the lands close them. */
const PORTS = [["A", -42], ["P", 0], ["B", 42]];

const x = (raw) => (raw / FULL) * STROKE;

function scale() {
  const ticks = svg("g", { class: "ticks" });
  for (let step = -100; step <= 100; step += 10) {
    const at = MIDDLE + (step / 100) * STROKE;
    const isMain = step % 50 === 0;
    ticks.append(svg("path", { d: `M${at} 84v${isMain ? 7 : 4}` }));
    if (isMain) ticks.append(svg("text", { x: at, y: 103 }, step === 0 ? "0" : minus(String(step))));
  }
  return ticks;
}

function spring(className) {
  const zigzag = Array.from({ length: 9 }, (_, i) => `L${(i + 0.5) / 9} ${i % 2 ? 60 : 40}`).join("");
  return svg("path", { class: className, d: `M0 50${zigzag}L1 50`, "vector-effect": "non-scaling-stroke" });
}

export class Gauge {
  constructor() {
    const { left, right, top, bottom } = BORE;
    const land = (at) => svg("rect", { x: at - 15, y: top + 1, width: 30, height: bottom - top - 2, rx: 2 });
    this.left = spring("spring");
    this.right = spring("spring");
    this.spool = svg(
      "g",
      { class: "spool" },
      svg("rect", { x: -HALF, y: 45, width: 2 * HALF, height: 10 }),
      ...PORTS.map(([, at]) => land(at)),
      svg("path", { class: "needle", d: `M0 ${top + 4}V${bottom - 4}M0 ${bottom + 2}V84` }),
    );
    this.target = svg("path", { class: "target", d: "M-7 68h14l-7 14z" });
    this.coils = [svg("rect", { x: 1, y: 38, width: 9, height: 24, rx: 2 }), svg("rect", { x: WIDTH - 10, y: 38, width: 9, height: 24, rx: 2 })];
    const ports = PORTS.map(([name, at]) => svg("text", { class: "port", x: MIDDLE + at, y: 22 }, name));
    const openings = PORTS.map(([, at]) => svg("path", { class: "bore", d: `M${MIDDLE + at - 9} 27v${top - 27}M${MIDDLE + at + 9} 27v${top - 27}` }));
    this.element = svg(
      "svg",
      { class: "gauge", viewBox: `0 8 ${WIDTH} 98`, "aria-hidden": "true" },
      ...openings,
      svg("rect", { class: "bore", x: left, y: top, width: right - left, height: bottom - top, rx: 3 }),
      this.left,
      this.right,
      svg("g", { class: "coils" }, ...this.coils),
      this.target,
      this.spool,
      scale(),
      ...ports,
    );
  }

  show({ position, set_point, solenoids }) {
    const at = MIDDLE + x(position ?? 0);
    setAttribute(this.spool, "transform", `translate(${at.toFixed(1)})`);
    const { left, right } = BORE;
    setAttribute(this.left, "transform", `translate(${left})scale(${(at - HALF - left).toFixed(1)} 1)`);
    setAttribute(this.right, "transform", `translate(${(at + HALF).toFixed(1)})scale(${(right - at - HALF).toFixed(1)} 1)`);
    const isPosition = typeof set_point === "number";
    setAttribute(this.target, "visibility", isPosition ? null : "hidden");
    if (isPosition) setAttribute(this.target, "transform", `translate(${(MIDDLE + x(set_point)).toFixed(1)})`);
    for (const coil of this.coils) setAttribute(coil, "data-on", solenoids ? "" : null);
  }
}
