// The calls of the control interface.

const BASE = "/api/v1";

/** Calls the server; returns the answer, or throws an error with the server's message. */
export async function call(method, path, body) {
  let response;
  try {
    response = await fetch(BASE + path, {
      method,
      headers: body === undefined ? {} : { "content-type": "application/json" },
      body: body === undefined ? undefined : JSON.stringify(body),
    });
  } catch {
    throw new Error("no response from the simulator");
  }
  const answer = await response.json().catch(() => ({}));
  if (!response.ok) throw new Error(answer.error ?? `${response.status} ${response.statusText}`);
  return answer;
}

export const devicePath = (name, rest = "") => `/devices/${encodeURIComponent(name)}${rest}`;

/** The delay before the event stream is opened again, in milliseconds. */
const RETRY = 2000;

/**
 * Follows the events forever. `on.open` loads the state before the events, `on.lost` reports a lost connection, and `on.device`,
 * `on.frame`, `on.error` and `on.missed` receive the data of the events.
 */
export function follow(on) {
  const source = new EventSource(`${BASE}/events`);
  const tell = (name, to) => source.addEventListener(name, (event) => to(JSON.parse(event.data)));
  let isOver = false;
  const again = () => {
    if (isOver) return;
    isOver = true;
    source.close();
    setTimeout(() => follow(on), RETRY);
  };
  source.addEventListener("open", () => on.open().catch(again));
  tell("device", on.device);
  tell("frame", on.frame);
  tell("lost", on.missed);
  source.addEventListener("error", (event) => {
    // An error on the bus has data; an error of the connection has none.
    if (event.data !== undefined) {
      on.error(JSON.parse(event.data));
      return;
    }
    on.lost();
    if (source.readyState === EventSource.CLOSED) again();
  });
}
