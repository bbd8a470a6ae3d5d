// The line for refusals and new faults, which screen readers announce and which disappears after a while.

import { byId, setText } from "./dom.js";

const SHOWN = 8000;
let timer;

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

/** Performs the user's action, and shows the message of its error. */
export async function attempt(work) {
  try {
    return await work();
  } catch (error) {
    notice(error.message);
  }
}
