// The plant of a device as controls.

import { call, devicePath } from "./api.js";
import { el } from "./dom.js";
import { attempt } from "./notice.js";
import { FULL } from "./words.js";

const SPOOL = [["", "free"], ["stuck", "stuck"], ["slow", "slow"], ["drifting", "drifting"], ["no-float", "no float"]];
const MEMORY = [["ok", "works"], ["write-fails", "writes fail"], ["damaged", "damaged"]];

/** The controls, by the fields of `plant`; `unit` is the number of the field's units in a displayed unit. */
const CONTROLS = {
  supply_mv: (send) => slider("Supply", "V", { min: 0, max: 40, limit: 100, step: 0.1, unit: 1000 }, send),
  temperature_c: (send) => slider("Temperature", "°C", { min: -40, max: 140, step: 1, unit: 1 }, send),
  lever: (send) => lever(send),
  angle_cdeg: (send) => slider("Angle", "°", { min: 0, max: 359.99, step: 0.01, unit: 100 }, send),
  speed_rpm: (send) => slider("Speed", "rpm", { min: -120, max: 120, step: 1, unit: 1 }, send),
  spool: (send) =>
    choice("Spool", SPOOL, ({ fault }) => fault ?? "", (value) => send({ fault: value || null })),
  memory: (send) => choice("Memory", MEMORY, (value) => value, send),
  measuring_error: (send) => check("Measuring error", send),
  internal_fault: (send) => check("Internal fault", send),
  bus_off: (send) => check("Bus-off", send),
};

export class PlantControls {
  /** Creates controls for the fields of a plant; `answered` receives the state after a change, or null to redraw the known state. */
  constructor(name, plant, answered) {
    Object.assign(this, { name, answered, waiting: {}, sent: null });
    this.controls = new Map();
    this.shown = {};
    // A control that has been changed or loses the focus shows the device's value again.
    const refresh = () => {
      this.shown = {};
      answered(null);
    };
    this.element = el("div", { class: "plant", onchange: refresh, onfocusout: refresh });
    for (const [field, make] of Object.entries(CONTROLS)) {
      if (!(field in plant)) continue;
      const control = make((value) => this.change(field, value));
      this.controls.set(field, control);
      this.element.append(control.element);
    }
  }

  /** Shows a plant. A control that the user is operating does not change. */
  show(plant) {
    for (const [field, control] of this.controls) {
      const key = JSON.stringify(plant[field]);
      const isAsked = field in this.waiting || (this.sent !== null && field in this.sent);
      if (this.shown[field] === key || isAsked || control.isHeld()) continue;
      this.shown[field] = key;
      control.show(plant[field]);
    }
  }

  /** Sends a change. While a request is pending, the last value of each changed field waits. */
  async change(field, value) {
    this.waiting[field] = value;
    if (this.sent !== null) return;
    while (Object.keys(this.waiting).length > 0) {
      this.sent = this.waiting;
      this.waiting = {};
      // After any answer, the controls show the values of the device.
      for (const each of Object.keys(this.sent)) delete this.shown[each];
      await attempt(async () => this.answered(await call("PATCH", devicePath(this.name, "/plant"), this.sent)));
    }
    this.sent = null;
    this.answered(null);
  }
}

const isPressed = (input) => input.matches(":active");

/** Creates a slider with a field for the exact number. */
function slider(label, symbol, { min, max, limit = max, step, unit }, send) {
  const range = el("input", { type: "range", min, max, step, "aria-label": label });
  const number = el("input", { type: "number", step: "any", "aria-label": `${label} in ${symbol}` });
  const set = (value) => send(Math.round(value * unit));
  let isTyping = false;
  range.addEventListener("input", () => {
    number.value = range.value;
    set(range.valueAsNumber);
  });
  number.addEventListener("input", () => (isTyping = true));
  number.addEventListener("blur", () => (isTyping = false));
  number.addEventListener("change", () => {
    isTyping = false;
    if (!Number.isNaN(number.valueAsNumber)) set(number.valueAsNumber);
  });
  if (limit > max) number.max = limit;
  return {
    element: el("div", { class: "control" }, el("span", { class: "label" }, label), range, el("span", { class: "unit" }, number, symbol)),
    isHeld: () => isPressed(range) || isTyping,
    show(value) {
      range.value = value / unit;
      number.value = String(value / unit);
    },
  };
}

/** Creates the hand lever: a slider in percent of the stroke, and a button that releases the lever. */
function lever(send) {
  const range = el("input", { type: "range", min: -100, max: 100, step: 1, value: 0, "aria-label": "Hand lever in percent" });
  const release = el("button", { type: "button", onclick: () => send(null) }, "Release");
  range.addEventListener("input", () => send(Math.round((range.valueAsNumber / 100) * FULL)));
  return {
    element: el("div", { class: "control" }, el("span", { class: "label" }, "Hand lever"), range, el("span", { class: "unit" }, release)),
    isHeld: () => isPressed(range),
    show(value) {
      range.value = ((value ?? 0) / FULL) * 100;
      release.disabled = value === null;
    },
  };
}

function choice(label, options, read, send) {
  const select = el("select", {}, ...options.map(([value, text]) => el("option", { value }, text)));
  select.addEventListener("change", () => send(select.value));
  return {
    element: el("label", { class: "control short" }, el("span", { class: "label" }, label), select),
    isHeld: () => false,
    show(value) {
      select.value = read(value);
    },
  };
}

function check(label, send) {
  const box = el("input", { type: "checkbox" });
  box.addEventListener("change", () => send(box.checked));
  return {
    element: el("label", { class: "check" }, box, label),
    isHeld: () => false,
    show(value) {
      box.checked = value;
    },
  };
}
