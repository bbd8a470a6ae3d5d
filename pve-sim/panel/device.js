// A device: a card with its state, gauge, plot, faults and plant.

import { call, devicePath } from "./api.js";
import { Dial } from "./dial.js";
import { el, setAttribute, setText } from "./dom.js";
import { Faults } from "./faults.js";
import { Gauge } from "./gauge.js";
import { attempt, notice } from "./notice.js";
import { paint } from "./paint.js";
import { PlantControls } from "./plant.js";
import { Plot } from "./plot.js";
import { FULL, hex, minus, percent } from "./words.js";

/** The step of the angle beyond which the angle has wrapped, in 1/100 degree; the plot then has a gap. */
const WRAP = 18000;

const VALVE_PLOT = { lines: { "Set-point": "target", Position: "position" }, min: -FULL, max: FULL, levels: [-FULL, 0, FULL], title: "±100 %, 20 s" };
const SENSOR_PLOT = { lines: { Angle: "position" }, min: 0, max: 36000, levels: [0, 9000, 18000, 27000, 36000], title: "0–360°, 20 s" };

export class Device {
  constructor(state, isOpen) {
    this.state = state;
    this.name = state.name;
    this.kind = state.kind;
    this.isValve = state.led !== null;
    this.gauge = this.isValve ? new Gauge() : new Dial();
    this.lines = (this.isValve ? VALVE_PLOT : SENSOR_PLOT).lines;
    this.plot = new Plot(this.isValve ? VALVE_PLOT : SENSOR_PLOT);
    this.faults = new Faults(state.faults);
    this.plant = new PlantControls(state.name, state.plant, (answer) => (answer ? this.update(answer) : paint(this)));
    this.values = new Map();
    this.power = el("button", { type: "button", role: "switch", class: "power", onclick: () => this.turn({ on: !this.state.powered }) }, "Power");
    this.watchdog = el("button", { type: "button", onclick: () => this.turn({ reset: "watchdog" }) }, "Watchdog reset");
    this.led = el("span", { class: "led", "aria-hidden": "true" });
    this.plate = el("p", { class: "plate" });
    this.plant.element.append(el("div", {}, this.watchdog));
    this.element = this.layOut(isOpen);
    this.update(state);
  }

  layOut(isOpen) {
    const title = `device-${this.name}`;
    const rows = this.isValve
      ? [...(this.kind.endsWith("isobus") ? ["Valve"] : ["NMT", "State"]), "Solenoids", "LED"]
      : ["NMT"];
    const values = this.isValve ? ["Set-point", "Position"] : ["Angle", "Position"];
    return el(
      "article",
      { class: "sheet device", "aria-labelledby": title },
      el(
        "div",
        { class: "bar" },
        ...(this.isValve ? [this.led] : []),
        el("div", { class: "name" }, el("h2", { id: title }, this.name), this.plate),
        this.power,
      ),
      el(
        "div",
        { class: "body" },
        el("div", { class: "view" }, this.gauge.element, this.list("values", values), this.plot.element),
        el("div", { class: "view" }, this.list("states", rows), this.faults.element),
      ),
      el("details", isOpen ? { open: true } : {}, el("summary", {}, "Plant"), this.plant.element),
    );
  }

  list(className, names) {
    const rows = names.map((name) => {
      const value = el("dd");
      this.values.set(name, value);
      return el("div", name in this.lines ? { "data-line": this.lines[name] } : {}, el("dt", {}, name), value);
    });
    return el("dl", { class: className }, ...rows);
  }

  /** Shows a state unless it is older than the shown state. */
  update(state) {
    if (state.t_us < this.state.t_us) return;
    this.tellChange(state);
    this.state = state;
    const { t_us, powered, position, set_point, plant } = state;
    if (this.isValve) {
      this.plot.add(t_us, [powered && set_point !== "float" ? set_point : NaN, powered ? position : NaN]);
    } else {
      if (Math.abs(plant.angle_cdeg - this.angle) > WRAP) this.plot.add(t_us, [NaN]);
      this.angle = plant.angle_cdeg;
      this.plot.add(t_us, [this.angle]);
    }
    paint(this);
  }

  /** Shows the first state after a reconnection; an earlier instant belongs to another simulator. */
  restart(state) {
    if (state.t_us < this.state.t_us) {
      this.plot.clear();
      this.state = state;
    }
    this.update(state);
  }

  /** Announces the faults that have become active. */
  tellChange(state) {
    const came = state.faults.filter(({ active }, i) => active && !this.state.faults[i].active);
    if (came.length > 0) notice(`${this.name}: ${came.map(({ fault }) => fault.replaceAll("-", " ")).join(", ")}`);
  }

  render() {
    const { kind, state } = this;
    const { powered, node_id, bit_rate, led } = state;
    const id = node_id === null ? "no ID" : `0x${hex(node_id, 2)}`;
    setText(this.plate, powered ? `${kind} · ${id} · ${bit_rate / 1000} kbit/s` : `${kind} · off`);
    setAttribute(this.element, "data-off", powered ? null : "");
    setAttribute(this.power, "aria-checked", powered);
    this.watchdog.disabled = !powered;
    this.gauge.show(state);
    this.show("NMT", state.nmt);
    this.show("State", state.dsm);
    this.show("Valve", state.command);
    if (this.isValve) {
      setAttribute(this.led, "data-color", led.color);
      setAttribute(this.led, "data-flashing", led.flashing ? "" : null);
      this.show("LED", led.flashing ? `${led.color}, flashing` : led.color);
      this.show("Solenoids", state.solenoids ? "on" : "off");
      this.show("Set-point", typeof state.set_point === "number" ? percent(state.set_point) : state.set_point);
      this.show("Position", percent(state.position));
    } else {
      this.show("Angle", `${(state.plant.angle_cdeg / 100).toFixed(2)}°`);
      this.show("Position", state.position === null ? null : minus(String(state.position)));
    }
    this.faults.show(state.faults);
    this.plant.show(state.plant);
  }

  show(name, value) {
    const element = this.values.get(name);
    if (element === undefined) return;
    setText(element, value ?? "–");
    setAttribute(element, "data-value", value);
  }

  turn(change) {
    attempt(async () => this.update(await call("POST", devicePath(this.name, "/power"), change)));
  }

  /** Removes the card of a device that no longer exists. */
  end() {
    this.plot.end();
    this.element.remove();
  }
}
