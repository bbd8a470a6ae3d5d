// One line for a refusal or a new fault: screen readers announce it, and it disappears after a while.

import { byId, setText } from "./dom.js";

const SHOWN = 8000;
let timer;

/** Shows a line. */
export function notice(text) {
  const line = byId("notice");
  setText(line, text);
  line.dataset.shown = "";
  clearTimeout(timer);
  timer = setTimeout(() => {
    delete line.dataset.shown;
    setText(line, "");
  }, SHOWN);
}

/** Does what a person asked for, and shows why it was refused. */
export async function attempt(work) {
  try {
    return await work();
  } catch (error) {
    notice(error.message);
  }
}
