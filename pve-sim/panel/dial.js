// The angle sensor's gauge: a dial.

import { setAttribute, svg } from "./dom.js";

const RADIUS = 78;

export class Dial {
  constructor() {
    const ticks = svg("g", { class: "ticks" });
    for (let degrees = 0; degrees < 360; degrees += 10) {
      const isMain = degrees % 30 === 0;
      ticks.append(svg("path", { d: `M0 ${-RADIUS}v${isMain ? 9 : 5}`, transform: `rotate(${degrees})` }));
      if (degrees % 90 === 0) {
        const turn = (degrees * Math.PI) / 180;
        const [x, y] = [Math.sin(turn) * 95, -Math.cos(turn) * 89 + 4];
        ticks.append(svg("text", { x, y }, `${degrees}°`));
      }
    }
    this.pointer = svg("path", { class: "pointer", d: "M0 -70L4.5 8h-9z" });
    this.element = svg(
      "svg",
      { class: "dial", viewBox: "-112 -100 224 200", "aria-hidden": "true" },
      svg("circle", { class: "bore", r: RADIUS }),
      ticks,
      this.pointer,
      svg("circle", { class: "hub", r: 7 }),
    );
  }

  show({ plant }) {
    setAttribute(this.pointer, "transform", `rotate(${plant.angle_cdeg / 100})`);
  }
}
