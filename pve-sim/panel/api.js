// The calls of the control interface.

const BASE = "/api/v1";

/** Calls; returns the answer, or throws an error with the server's words. */
export async function call(method, path, body) {
  let response;
  try {
    response = await fetch(BASE + path, {
      method,
      headers: body === undefined ? {} : { "content-type": "application/json" },
      body: body === undefined ? undefined : JSON.stringify(body),
    });
  } catch {
    throw new Error("the simulator does not answer");
  }
  const answer = await response.json().catch(() => ({}));
  if (!response.ok) throw new Error(answer.error ?? `${response.status} ${response.statusText}`);
  return answer;
}

/** Returns the path of a device. */
export const devicePath = (name, rest = "") => `/devices/${encodeURIComponent(name)}${rest}`;

/** The time in milliseconds after which a refused stream is tried again. */
const RETRY = 2000;

/**
 * Follows the events, for ever. `on` has `open`, which loads what the events go on from, `lost`, and `device`, `frame`, `error`
 * and `missed`, which get what the server tells.
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
