// What the tests of the panel stand on: simulators of their own, and a browser.
//
// Each script is run as `node SCRIPT PVE_SIM MODULES`: the binary, and the folder that has playwright-core.

import assert from "node:assert/strict";
import { spawn } from "node:child_process";
import { createRequire } from "node:module";
import { createInterface } from "node:readline";

const [binary, modules] = process.argv.slice(2);
const { chromium } = createRequire(`${modules}/`)("playwright-core");

/** The longest wait for anything, in milliseconds of the wall clock: a dead test ends with a sentence. No device is measured by it. */
export const PATIENCE = 120_000;
/** After this a script that hangs says so, and ends. */
const LIFE = 900_000;

setTimeout(() => {
  console.error(`${process.argv[1]} has not ended within ${LIFE / 1000} s`);
  process.exit(1);
}, LIFE).unref();

/** Starts a simulator; `url` is that of the control interface in its `ready` line. */
export async function simulate(...options) {
  const http = options.includes("--http") ? [] : ["--http", "127.0.0.1:0"];
  const child = spawn(binary, ["--bus", "socketcand://127.0.0.1:0/pve0", ...http, ...options], { stdio: ["ignore", "pipe", "ignore"] });
  const lines = createInterface({ input: child.stdout });
  const ended = new Promise((resolve) => child.on("exit", resolve));
  const first = await new Promise((resolve) => {
    lines.once("line", resolve);
    child.once("exit", () => resolve("it ended"));
  });
  const url = / http=(\S+)/.exec(first)?.[1];
  assert(url, `no ready line: ${first}`);
  return {
    url,
    ready: first,
    async call(method, path, body) {
      const response = await fetch(`${url}api/v1${path}`, {
        method,
        headers: body === undefined ? {} : { "content-type": "application/json" },
        body: body === undefined ? undefined : JSON.stringify(body),
      });
      const answer = await response.json();
      assert(response.ok, `${method} ${path}: ${answer.error}`);
      return answer;
    },
    signal: (name) => child.kill(name),
    async end() {
      child.kill("SIGTERM");
      await ended;
    },
  };
}

/** Opens an empty page in a browser, and ends both after the test. */
export async function withBrowser(viewing, test) {
  const browser = await chromium.launch({ executablePath: "/usr/bin/chromium", args: ["--no-sandbox"], timeout: PATIENCE });
  try {
    const page = await browser.newPage(viewing);
    page.setDefaultTimeout(PATIENCE);
    await test(page, browser);
  } finally {
    await browser.close();
  }
}

/**
 * Opens the page in a browser, and ends both after the test. An error that the browser tells of fails it, unless it is
 * `expected`, and so does a request to anybody else. The script `before` runs in the page before its own.
 */
export async function withPage(options, test) {
  const { url, expected, before, ...viewing } = options;
  await withBrowser(viewing, async (page, browser) => {
    const trouble = [];
    page.on("pageerror", (error) => trouble.push(error.message));
    page.on("console", (message) => message.type() === "error" && !expected?.test(message.text()) && trouble.push(message.text()));
    page.on("request", (request) => request.url().startsWith(url) || trouble.push(`asks for ${request.url()}`));
    if (before) await page.addInitScript(before);
    await page.goto(url);
    await page.locator("#link[data-link=there]").waitFor();
    await test(page, browser);
    assert.deepEqual(trouble, []);
  });
}

/** Waits until the page shows something; `show` is asked again and again, in the page. */
export const until = (page, show, argument) => page.waitForFunction(show, argument, { timeout: PATIENCE });
