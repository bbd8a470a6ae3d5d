// A web page of somebody else sends text to the ports of the bus: its requests come there, and nothing of them reaches
// the bus. The same text from a client does.

import assert from "node:assert/strict";
import { once } from "node:events";
import { createServer as createSite } from "node:http";
import { connect, createServer } from "node:net";
import { PATIENCE, simulate, withBrowser } from "./rig.mjs";

const simulator = await simulate("--bus", "slcan://127.0.0.1:0", "--device", "pvea-canopen,blank");
const port = (scheme) => Number(new RegExp(` bus=${scheme}://127\\.0\\.0\\.1:(\\d+)`).exec(simulator.ready)[1]);
const BUSES = [
  { port: port("socketcand"), text: "< open pve0 >< rawmode >< send 101 1 1 >" },
  { port: port("slcan"), text: "\rC\rS5\rO\rt101101\r" },
];

/** The identifiers on the bus. */
const ids = async () => (await simulator.call("GET", "/trace?limit=4096")).map(({ id }) => id);

/** Listens at a free port. */
async function listening(server) {
  await once(server.listen(0, "127.0.0.1"), "listening");
  return server;
}

/** A port that leads to another one; `begins` has the first bytes of each connection. */
async function relay(port) {
  const begins = [];
  const server = await listening(
    createServer((browser) => {
      const gateway = connect(port, "127.0.0.1");
      browser.once("data", (bytes) => begins.push(bytes.toString("latin1")));
      browser.pipe(gateway).pipe(browser);
      for (const [one, other] of [[browser, gateway], [gateway, browser]]) {
        one.on("error", () => {}).on("close", () => other.destroy());
      }
    }),
  );
  return { begins, server, url: `http://127.0.0.1:${server.address().port}/` };
}

/** Runs in the page: every way from there to a port, with the text where it can be. */
async function attack({ url, text }) {
  const request = (url, options) => fetch(url, { mode: "no-cors", ...options }).catch(() => {});
  const plain = { method: "POST", headers: { "content-type": "text/plain" }, body: text };
  await request(url, plain);
  await request(url, { ...plain, keepalive: true });
  await request(url, { ...plain, body: text.repeat(1000) });
  await request(url + encodeURIComponent(text));
  await request(url.replace("http", "https"), plain);
  // A method of its own, which a preflight asks for.
  await request(url, { ...plain, mode: "cors", method: "t101101" });
  await new Promise((resolve) => (new WebSocket(url.replace("http", "ws")).onclose = resolve));
  const frame = document.body.appendChild(Object.assign(document.createElement("iframe"), { name: "answer" }));
  const form = document.createElement("form");
  Object.assign(form, { action: url, method: "post", enctype: "text/plain", target: "answer" });
  form.append(Object.assign(document.createElement("textarea"), { name: "text", value: text }));
  document.body.append(form);
  await new Promise((resolve) => {
    frame.onload = resolve;
    form.submit();
  });
}

const site = await listening(createSite((_, response) => response.setHeader("content-type", "text/html").end("<!doctype html><body>")));
await withBrowser({}, async (page) => {
  for (const { port, text } of BUSES) {
    const { begins, server, url } = await relay(port);
    await page.goto(`http://127.0.0.1:${site.address().port}/`);
    const attacked = page.evaluate(attack, { url, text }).then(() => true);
    const late = new Promise((resolve) => setTimeout(resolve, PATIENCE, false).unref());
    assert(await Promise.race([attacked, late]), `a connection is not closed; ${(await ids()).length} frames are on the bus`);
    server.close();
    for (const [begin, least] of [["POST / HTTP/1.1", 4], ["GET /", 2], ["OPTIONS / ", 1], ["\x16", 1]]) {
      const came = begins.filter((bytes) => bytes.startsWith(begin)).length;
      assert(came >= least, `${begin} came ${came} times: ${begins.join("\n")}`);
    }
  }
});
site.closeAllConnections();
site.close();

const begin = Date.now();
for (const [number, { port, text }] of BUSES.entries()) {
  const id = 0x102 + number;
  const client = connect(port, "127.0.0.1");
  client.write(text.replace("101", id.toString(16)));
  while (!(await ids()).includes(id)) {
    assert(Date.now() < begin + PATIENCE, "nothing of a client reaches the bus");
  }
  client.destroy();
}
assert.deepEqual(await ids(), [0x102, 0x103]);
await simulator.end();
