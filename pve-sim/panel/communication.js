// The communication faults on the bus: a form that adds them, and a list that ends them.

import { call } from "./api.js";
import { byId, el, onSubmit, setAttribute, setText } from "./dom.js";
import { attempt } from "./notice.js";

const KINDS = ["lose", "delay", "repeat", "swap", "corrupt", "insert", "masquerade", "destroy", "omit"];
/** Parameters whose values are texts, even if they look like numbers. */
const TEXTS = /^(name|sender|mask|data\..*|identifier\..*)$/;

export class Communication {
  constructor() {
    this.rows = new Map();
    byId("kind").append(...KINDS.map((kind) => el("option", {}, kind)));
    onSubmit(byId("fault"), ({ kind, frames, count, more }) =>
      this.ask("POST", "", () => add(more, { [kind]: frames || "all", ...(count && { count: Number(count) }) })),
    );
    byId("end-all").addEventListener("click", () => this.ask("DELETE", ""));
  }

  /** Adds or ends faults, and shows the list. */
  ask(method, path, body) {
    return attempt(async () => {
      await call(method, `/bus/faults${path}`, body?.());
      await this.read();
    });
  }

  /** Shows the faults. A known fault keeps its row, so that its button keeps the focus. */
  async read() {
    const records = await call("GET", "/bus/faults");
    const gone = new Map(this.rows);
    for (const { name, fault, struck, is_over } of records) {
      const key = `${name}: ${fault}`;
      if (!gone.delete(key)) this.add(key, name);
      const { row, count } = this.rows.get(key);
      setAttribute(row, "data-known", is_over ? null : "");
      setText(count, `×${struck}${is_over ? ", over" : ""}`);
    }
    for (const [key, { row }] of gone) {
      if (row.contains(document.activeElement)) (row.nextSibling?.lastChild ?? byId("kind")).focus();
      row.remove();
      this.rows.delete(key);
    }
  }

  add(key, name) {
    const count = el("span", { class: "count" });
    const end = () => this.ask("DELETE", `/${name}`);
    const row = el("li", {}, key, count, el("button", { "aria-label": `End ${name}`, onclick: end }, "End"));
    byId("communication").append(row);
    this.rows.set(key, { row, count });
  }
}

/** Adds parameters to a request, as in `ms=5..20 data.toggle=01 receivers="the gateway"`. */
function add(text, request) {
  for (const word of text.match(/("[^"]*"|\S)+/g) ?? []) {
    const [, path, key, part, value] = /^((\w+)(?:\.(\w+))?)=(.+)$/.exec(word.replaceAll('"', "")) ?? [];
    if (!path) throw new Error(`'${word}' is not valid; accepted: KEY=VALUE, as in ms=20`);
    const [into, name] = part ? [(request[key] ??= {}), part] : [request, key];
    if (typeof into !== "object" || name in into) throw new Error(`duplicate key '${path}'`);
    into[name] = read(path, value);
  }
  return request;
}

const number = (text) => (/^[-+.\de]+$/i.test(text) ? Number(text) : NaN);

function read(path, text) {
  if (path === "receivers") return text.split(",");
  if (TEXTS.test(path)) return text;
  if (text === "true" || text === "false") return text === "true";
  const numbers = text.split("..").map(number);
  if (numbers.some(Number.isNaN)) return text;
  return numbers.length > 1 ? numbers : numbers[0];
}
