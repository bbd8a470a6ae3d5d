// A plot of the last 20 seconds. Each animation frame draws only a few plots, to limit its time.

import { clock } from "./clock.js";
import { el } from "./dom.js";
import { paint } from "./paint.js";

const SPAN_US = 20e6;
const GRID_US = 5e6;
/** The number of kept samples per line: 50 per second for 20 s, and as many changes between them. */
const CAPACITY = 2048;
/** The maximum number of plots drawn in an animation frame. */
const PER_FRAME = 4;
/** The interval between the movements of a plot with reduced motion, in microseconds. */
const CALM_US = 1e6;
const calm = matchMedia("(prefers-reduced-motion: reduce)");

/** The visible plots; the most recently drawn plot is the last. */
const seen = new Set();

const plots = {
  render() {
    const now = clock.now();
    let left = PER_FRAME;
    for (const plot of [...seen]) {
      if (left === 0) break;
      if (!plot.isDue(now)) continue;
      plot.draw(now);
      seen.delete(plot);
      seen.add(plot);
      left -= 1;
    }
    if (seen.size > 0 && (clock.isRunning || left === 0)) paint(plots);
  },
};

const visibility = new IntersectionObserver((entries) => {
  for (const { target, isIntersecting } of entries) {
    if (isIntersecting) seen.add(target.plot);
    else seen.delete(target.plot);
  }
  paint(plots);
});

const sizes = new ResizeObserver((entries) => {
  for (const { target } of entries) target.plot.resize();
});

/** The number of changes of the colour scheme. */
let scheme = 0;
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
  scheme += 1;
  advancePlots();
});

/** Redraws all visible plots, because time has begun to pass or the colours have changed. */
export function advancePlots() {
  for (const plot of seen) plot.isStale = true;
  paint(plots);
}

/** The samples of one line; each sample is valid until the next. */
class Series {
  constructor() {
    this.times = new Float64Array(CAPACITY);
    this.values = new Float32Array(CAPACITY);
    this.clear();
  }

  clear() {
    this.end = 0;
    this.count = 0;
  }

  /** Adds a sample if the value has changed; NaN is a gap. */
  add(t, value) {
    const last = (this.end + CAPACITY - 1) % CAPACITY;
    if (this.count > 0 && Object.is(this.values[last], value)) return;
    this.times[this.end] = t;
    this.values[this.end] = value;
    this.end = (this.end + 1) % CAPACITY;
    this.count = Math.min(this.count + 1, CAPACITY);
  }

  /** Draws the line as steps; `x` and `y` return the pixels of a sample. */
  trace(context, begin, x, y, right) {
    let index = this.end;
    let left = this.count;
    // Searches back for the sample that is valid at the left edge.
    while (left > 0) {
      index = (index + CAPACITY - 1) % CAPACITY;
      left -= 1;
      if (this.times[index] <= begin) break;
    }
    context.beginPath();
    let level = NaN;
    for (; index !== this.end; index = (index + 1) % CAPACITY) {
      const at = Math.max(x(this.times[index]), 0);
      const next = y(this.values[index]);
      if (!Number.isNaN(level)) context.lineTo(at, level);
      if (Number.isNaN(level) && !Number.isNaN(next)) context.moveTo(at, next);
      else if (!Number.isNaN(next)) context.lineTo(at, next);
      level = next;
    }
    if (!Number.isNaN(level)) context.lineTo(right, level);
    context.stroke();
  }
}

export class Plot {
  /** Creates a plot of `lines` (colours by labels) from `min` to `max`, with grid lines at `levels`. */
  constructor({ lines, min, max, levels, title }) {
    Object.assign(this, { min, max, levels, isStale: true, drawnAt: 0 });
    this.series = Object.keys(lines).map(() => new Series());
    this.canvas = el("canvas", { "aria-hidden": "true" });
    this.canvas.plot = this;
    this.context = this.canvas.getContext("2d");
    this.keys = Object.entries(lines).map(([label, line]) => el("span", { class: "key", "data-line": line }, label));
    this.element = el(
      "figure",
      { class: "plot" },
      this.canvas,
      el("figcaption", {}, ...this.keys, el("span", { class: "span" }, title)),
    );
    visibility.observe(this.canvas);
    sizes.observe(this.canvas);
  }

  add(t, values) {
    values.forEach((value, i) => this.series[i].add(t, value));
    // With reduced motion, only time moves a plot, or a step.
    if (!calm.matches || !clock.isRunning) this.isStale = true;
    if (seen.has(this)) paint(plots);
  }

  clear() {
    for (const series of this.series) series.clear();
  }

  /** Ends the observation and drawing of the plot. */
  end() {
    seen.delete(this);
    visibility.unobserve(this.canvas);
    sizes.unobserve(this.canvas);
  }

  resize() {
    const ratio = devicePixelRatio;
    this.canvas.width = Math.round(this.canvas.clientWidth * ratio);
    this.canvas.height = Math.round(this.canvas.clientHeight * ratio);
    this.isStale = true;
    paint(plots);
  }

  isDue(now) {
    const pixel = calm.matches ? CALM_US : SPAN_US / Math.max(this.canvas.width, 1);
    return this.isStale || Math.abs(now - this.drawnAt) >= pixel;
  }

  draw(now) {
    const { context, canvas, min, max } = this;
    const { width, height } = canvas;
    const ratio = devicePixelRatio;
    this.isStale = false;
    this.drawnAt = now;
    const begin = now - SPAN_US;
    const x = (t) => ((t - begin) / SPAN_US) * width;
    const margin = 4 * ratio;
    const y = (value) => margin + ((max - value) / (max - min)) * (height - 2 * margin);
    if (this.scheme !== scheme) {
      this.colors = this.readColors();
      this.scheme = scheme;
    }
    context.clearRect(0, 0, width, height);
    context.lineWidth = ratio;
    context.strokeStyle = this.colors.grid;
    context.beginPath();
    for (let t = Math.ceil(begin / GRID_US) * GRID_US; t <= now; t += GRID_US) {
      const at = Math.round(x(t)) + 0.5;
      context.moveTo(at, 0);
      context.lineTo(at, height);
    }
    for (const level of this.levels) {
      const at = Math.round(y(level)) + 0.5;
      context.moveTo(0, at);
      context.lineTo(width, at);
    }
    context.stroke();
    context.lineJoin = "round";
    this.series.forEach((series, i) => {
      context.strokeStyle = this.colors.lines[i];
      context.lineWidth = (i === 0 ? 1.5 : 2) * ratio;
      series.trace(context, begin, x, y, width);
    });
  }

  /** Returns the colours of the scheme, as the legend shows them. */
  readColors() {
    return {
      grid: getComputedStyle(this.canvas).borderTopColor,
      lines: this.keys.map((key) => getComputedStyle(key, "::before").backgroundColor),
    };
  }
}
