// The faults of a device with their counters.

import { el, setAttribute, setText } from "./dom.js";

export class Faults {
  constructor(faults) {
    this.rows = faults.map(({ fault }) => {
      const state = el("span", { class: "hidden" });
      const count = el("span", { class: "count" });
      return { state, count, element: el("li", {}, el("span", {}, fault.replaceAll("-", " ")), state, count) };
    });
    this.element = el("ul", { class: "faults", "aria-label": "Faults" }, ...this.rows.map((row) => row.element));
  }

  /** Shows the active faults, and the number of occurrences of each fault. */
  show(faults) {
    faults.forEach(({ active, count }, i) => {
      const row = this.rows[i];
      setAttribute(row.element, "data-active", active ? "" : null);
      setAttribute(row.element, "data-known", count ? "" : null);
      setText(row.state, active ? ", active, " : ", ");
      setText(row.count, count === null ? "–" : `×${count}`);
    });
  }
}
