// The trace of the bus: decoded, filterable, pausable, bounded.

import { byId, el, setText } from "./dom.js";
import { paint } from "./paint.js";
import { hex, seconds } from "./words.js";

/** The numbers of kept and of shown lines. */
const KEPT = 2000;
const SHOWN = 120;
/** The interval at which lines are added, in milliseconds, and the maximum number of lines added at once. */
const PERIOD = 50;
const PORTION = 25;
/** The distance to its end within which the list follows the latest line, in pixels. */
const CLOSE = 24;
/** The time within which an equal frame is a repeat, in microseconds of virtual time. */
const REPEAT_US = 2e6;
/** The maximum number of identifiers whose last frame is kept: more than any real bus has. */
const IDENTIFIERS = 4096;
/** The pattern of meanings that report a fault. */
const FAULT = /EMCY: (?!no error)|: DM1 (?!no )/;

/** Returns the line of a frame or an error. */
function lineOf({ t_us, id, extended, data, from, meaning }) {
  if (id === undefined) return { t_us, id: "error", data: "", from, meaning, isTrouble: true };
  const bytes = data.match(/../g)?.join(" ") ?? "";
  return { t_us, id: hex(id, extended ? 8 : 3), data: bytes, from, meaning, isTrouble: false };
}

/** Returns the text that the filter searches. */
function textOf(line) {
  line.text ??= `${line.id} ${line.data} ${line.data.replaceAll(" ", "")} ${line.from} ${line.meaning}`.toLowerCase();
  return line.text;
}

export class Trace {
  constructor() {
    this.lines = [];
    this.fresh = [];
    this.words = [];
    /** The lines at the time of the pause; null without a pause. */
    this.frozen = null;
    this.hidesRepeats = true;
    /** The last frame of each identifier. */
    this.latest = new Map();
    this.missed = 0;
    this.drawnAt = 0;
    this.list = byId("frames");
    this.roll = byId("roll");
    this.roll.addEventListener("scroll", () => {
      const { scrollTop, clientHeight, scrollHeight } = this.roll;
      this.stayAtEnd(scrollTop + clientHeight >= scrollHeight - CLOSE);
    });
    // The observer runs after the layout, so that reading the height forces no second layout.
    new ResizeObserver(() => {
      if (this.isAtEnd) this.roll.scrollTop = this.roll.scrollHeight;
    }).observe(this.list);
    this.stayAtEnd(true);
    byId("filter").addEventListener("input", (event) => this.filter(event.target.value));
    byId("repeats").addEventListener("change", (event) => {
      this.hidesRepeats = event.target.checked;
      this.redraw();
    });
    byId("clear").addEventListener("click", () => this.clear());
    byId("pause").addEventListener("click", () => this.pause(this.frozen === null));
  }

  /** Sets whether the list follows the latest line. */
  stayAtEnd(isAtEnd) {
    this.isAtEnd = isAtEnd;
    this.roll.toggleAttribute("data-end", isAtEnd);
  }

  /** Replaces all lines by the frames of the server's record. */
  reset(frames) {
    this.latest.clear();
    this.lines = frames.map((frame) => this.read(frame));
    this.missed = 0;
    this.redraw();
  }

  /** Returns the line of the next frame, and marks a repeat. */
  read(frame) {
    const line = lineOf(frame);
    if (line.isTrouble) return line;
    const before = this.latest.get(line.id);
    const isEqual = before?.data === line.data && before.from === line.from && before.meaning === line.meaning;
    line.isRepeat = isEqual && line.t_us - before.t_us < REPEAT_US;
    if (this.latest.size >= IDENTIFIERS) this.latest.clear();
    this.latest.set(line.id, line);
    return line;
  }

  /** Adds a frame or an error. */
  add(frame) {
    const line = this.read(frame);
    this.lines.push(line);
    // Lines are deleted in portions, because each deletion copies the array.
    if (this.lines.length > KEPT + SHOWN) this.lines.splice(0, SHOWN);
    if (this.frozen === null && this.passes(line)) {
      this.fresh.push(line);
      if (this.fresh.length > SHOWN) this.fresh.shift();
    }
    paint(this);
  }

  /** Counts events that the server dropped because the page was too slow. */
  miss(events) {
    this.missed += events;
    paint(this);
  }

  clear() {
    this.lines = [];
    if (this.frozen !== null) this.frozen = [];
    this.missed = 0;
    this.redraw();
  }

  pause(isPaused) {
    this.frozen = isPaused ? [...this.lines] : null;
    byId("pause").setAttribute("aria-pressed", isPaused);
    if (!isPaused) this.redraw();
  }

  filter(text) {
    const words = text.toLowerCase().split(/\s+/).filter((word) => word !== "" && word !== "-");
    // An identifier may begin with 0x.
    this.words = words.map((word) => word.replace(/^(-?)0x/, "$1"));
    this.redraw();
  }

  /** Returns the lines among which the filter chooses. */
  choice() {
    return this.frozen ?? this.lines;
  }

  passes(line) {
    if (this.hidesRepeats && line.isRepeat) return false;
    return this.words.every((word) =>
      word.startsWith("-") ? !textOf(line).includes(word.slice(1)) : textOf(line).includes(word),
    );
  }

  redraw() {
    this.list.replaceChildren();
    this.fresh = this.choice().filter((line) => this.passes(line)).slice(-SHOWN);
    this.stayAtEnd(true);
    this.drawnAt = 0;
    paint(this);
  }

  render(at) {
    if (at - this.drawnAt < PERIOD) {
      paint(this);
      return;
    }
    this.drawnAt = at;
    for (const line of this.fresh.splice(0, PORTION)) this.append(line);
    if (this.fresh.length > 0) paint(this);
    setText(byId("trace-note"), this.note());
    const isEmpty = this.list.childElementCount === 0;
    byId("trace-empty").hidden = !isEmpty;
    if (isEmpty) setText(byId("trace-empty"), this.choice().length === 0 ? "No frames yet" : "No recorded frame matches the filter");
  }

  /** Shows a line in a row: a new row, or the oldest one if the list is full. */
  append(line) {
    const row = this.list.childElementCount < SHOWN ? newRow() : this.list.firstElementChild;
    const [time, id, data, meaning] = row.children;
    time.textContent = seconds(line.t_us);
    id.textContent = line.id;
    data.textContent = line.data;
    meaning.textContent = line.meaning;
    row.title = `from ${line.from}`;
    row.className = line.isTrouble ? "trouble" : FAULT.test(line.meaning) ? "fault" : "";
    this.list.append(row);
  }

  note() {
    const kept = `${Math.min(this.lines.length, KEPT)} frames kept`;
    const missed = this.missed > 0 ? `, ${this.missed} events missed: this page is too slow` : "";
    return `${this.frozen === null ? "" : "paused, "}${kept}${missed}`;
  }
}

function newRow() {
  return el("li", {}, el("time"), el("span", { class: "id" }), el("span", { class: "data" }), el("span", { class: "meaning" }));
}
