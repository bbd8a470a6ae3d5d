// Bit rate, load and disturbances of the bus, frames to send, and time.

import { call } from "./api.js";
import { clock } from "./clock.js";
import { Communication } from "./communication.js";
import { byId, el, onSubmit, setText } from "./dom.js";
import { attempt, notice } from "./notice.js";
import { hex, identifier, seconds } from "./words.js";

const BIT_RATES = [1000, 800, 500, 250, 125, 50, 20, 10];
/** The interval between requests of the bus state, in milliseconds. */
const PERIOD = 1000;
/** The interval between updates of the time, in milliseconds. */
const TICK = 200;
/** The longest wait for an answer that the page does not report, in milliseconds. */
const PATIENCE = 5000;

export class Bus {
  constructor(showLink) {
    this.showLink = showLink;
    this.rate = byId("bit-rate");
    this.rate.append(...BIT_RATES.map((rate) => el("option", { value: rate * 1000 }, `${rate} kbit/s`)));
    this.rate.addEventListener("change", () => this.ask("PATCH", "/bus", { bit_rate: Number(this.rate.value) }));
    onSubmit(byId("disturb"), ({ frames, id }) =>
      this.ask("POST", "/bus/disturb", { frames: Number(frames), ...(id && identifier(id)) }),
    );
    byId("spare").addEventListener("click", () => this.ask("POST", "/bus/disturb", { frames: 0 }));
    this.faults = new Communication();
    onSubmit(byId("send"), ({ frame, every }) => this.send(frame, every));
    byId("stop").addEventListener("click", () =>
      attempt(async () => notice(`${(await call("DELETE", "/bus/frames")).stopped} cyclic frames stopped`)),
    );
    onSubmit(byId("step"), ({ ms }) => this.advance(Number(ms)));
    setInterval(() => this.showTime(), TICK);
    setInterval(() => this.poll(), PERIOD);
  }

  /** Reads time and bus after a connection. */
  async open() {
    const { now_us, speed } = await call("GET", "/time");
    clock.start(now_us, speed);
    byId("step").hidden = speed !== "step";
    setText(byId("speed"), speed === "step" ? "step" : `× ${speed}`);
    await this.read();
  }

  /** Stops the clock after a lost connection. */
  close() {
    this.isOpen = false;
    clock.stop();
  }

  async read() {
    this.show(await call("GET", "/bus"));
    await this.faults.read();
  }

  /** Reads the bus while the page is visible. A failure needs no notice, because the event stream ends, too. */
  async poll() {
    if (!this.isOpen || this.isReading || document.hidden) return;
    this.isReading = true;
    const late = setTimeout(() => this.showLink("lost", "No response. Waiting…"), PATIENCE);
    await this.read().then(() => this.isOpen && this.showLink("there", "connected"), () => {});
    clearTimeout(late);
    this.isReading = false;
  }

  /** Changes the bus, and shows its new state. */
  async ask(method, path, body) {
    const bus = await attempt(() => call(method, path, body));
    if (bus !== undefined) this.show(bus);
  }

  show({ t_us, bit_rate, load, disturb: { frames, id, extended }, not_heard }) {
    clock.hear(t_us);
    this.showTime();
    byId("load-bar").value = load;
    setText(byId("load-text"), `${load} %`);
    if (Number(this.rate.value) !== bit_rate) this.rate.value = bit_rate;
    const whose = id === null ? "" : ` of ${hex(id, extended ? 8 : 3)}`;
    setText(byId("disturbed"), frames > 0 ? `${frames} left${whose}` : "");
    byId("spare").disabled = frames === 0;
    const unheard = not_heard.filter((device) => !device.is_over).map((device) => device.reason);
    setText(byId("unheard"), unheard.join("\n"));
    byId("unheard").hidden = unheard.length === 0;
  }

  showTime() {
    setText(byId("time"), `${seconds(clock.now())} s`);
  }

  send(frame, every) {
    const [id, data] = frame.split("#");
    const period = every && { every_ms: Number(every) };
    return attempt(() => call("POST", "/bus/frames", { ...identifier(id), data: data.replaceAll(".", ""), ...period }));
  }

  advance(ms) {
    return attempt(async () => {
      await call("POST", "/time", { advance_ms: ms });
      await this.read();
    });
  }
}
