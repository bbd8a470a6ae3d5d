// The panel: follows the events of the simulator, and shows devices, bus and trace.

import { call, follow } from "./api.js";
import { Bus } from "./bus.js";
import { clock } from "./clock.js";
import { Device } from "./device.js";
import { byId, setText } from "./dom.js";
import { advancePlots } from "./plot.js";
import { Trace } from "./trace.js";

/** The maximum number of devices whose plants are shown unfolded. */
const UNFOLDED = 4;
/** The number of recorded frames with which the trace begins. */
const RECORD = 500;

const devices = new Map();
const bus = new Bus(showLink);
const trace = new Trace();
/** States that arrived before the cards of their devices; null once the cards exist. */
let unplaced = new Map();
/** Frames that arrived while the record was being loaded; null afterwards. */
let early = null;

function showLink(link, text) {
  const line = byId("link");
  line.dataset.link = link;
  setText(line, text);
  document.documentElement.dataset.link = link;
}

/** Loads everything after each connection, because the simulator may be a new one. */
async function open() {
  early = [];
  unplaced = new Map();
  await bus.open();
  place(await call("GET", "/devices"));
  const record = await call("GET", `/trace?limit=${RECORD}`);
  trace.reset(record);
  const last = record.at(-1)?.t_us ?? -1;
  for (const frame of early ?? []) if (frame.t_us > last) trace.add(frame);
  early = null;
  showLink("there", "connected");
  bus.isOpen = true;
  advancePlots();
}

/** Places a card for each device. An existing card stays, so that its controls keep the focus. */
function place(states) {
  const gone = new Map(devices);
  devices.clear();
  for (const state of states) {
    const known = gone.get(state.name);
    const isSame = known?.kind === state.kind;
    if (isSame) {
      known.restart(state);
      gone.delete(state.name);
    }
    const device = isSame ? known : new Device(state, states.length <= UNFOLDED);
    if (!isSame) byId("devices").append(device.element);
    devices.set(state.name, device);
  }
  for (const device of gone.values()) device.end();
  for (const state of unplaced?.values() ?? []) devices.get(state.name)?.update(state);
  unplaced = null;
}

function lose() {
  bus.close();
  early = null;
  showLink("lost", "Connection lost. Reconnecting…");
}

function hearDevice(state) {
  clock.hear(state.t_us);
  if (unplaced) unplaced.set(state.name, state);
  else devices.get(state.name)?.update(state);
}

/** Counts lost events, and loads the devices, because their events may be among them. */
function miss({ events }) {
  trace.miss(events);
  call("GET", "/devices").then((states) => states.forEach(hearDevice), () => {});
}

function hear(frame) {
  clock.hear(frame.t_us);
  if (early === null) trace.add(frame);
  else early.push(frame);
}

follow({
  open,
  lost: lose,
  device: hearDevice,
  frame: hear,
  error: hear,
  missed: miss,
});
