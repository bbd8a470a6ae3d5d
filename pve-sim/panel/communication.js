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
      this.ask("POST", "", () => ({ [kind]: frames || "all", ...(count && { count: Number(count) }), ...parameters(more) })),
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
      if (row.contains(document.activeElement)) byId("end-all").focus();
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

/** Parses words as in `ms=5..20 data.toggle=01`. */
function parameters(text) {
  const body = {};
  for (const word of text.match(/\S+/g) ?? []) {
    const [, path, value] = /^([\w.]+)=(.+)$/.exec(word) ?? [];
    if (!path) throw new Error(`'${word}' is not valid; accepted: KEY=VALUE, as in ms=20`);
    const [key, part] = path.split(".");
    body[key] = part ? { ...body[key], [part]: read(path, value) } : read(path, value);
  }
  return body;
}

function read(key, text) {
  if (key === "receivers") return text.split(",");
  if (TEXTS.test(key)) return text;
  try {
    return JSON.parse(text.replace(/(.+)\.\.(.+)/, "[$1,$2]"));
  } catch {
    return text;
  }
}
