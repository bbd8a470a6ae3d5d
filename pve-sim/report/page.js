"use strict";

const data = JSON.parse(document.getElementById("data").textContent);
const { manifest, limits, rows } = data;

// The verdicts from best to worst: letter in the data, word, height of the bar in percent.
const VERDICTS = [
  ["n", "no-effect", 16], ["s", "safe", 28], ["l", "late", 52], ["d", "safe-undetected", 64],
  ["u", "not-safe", 80], ["x", "undetected", 100], ["h", "hung", 100], ["i", "not-injected", 100],
].map(([letter, word, high], severity) => ({ letter, word, high, severity, passed: severity < 2 }));
const BY_LETTER = Object.fromEntries(VERDICTS.map((verdict) => [verdict.letter, verdict]));

const $ = (selector) => document.querySelector(selector);
const ms = (us) => (us === null ? "none" : `${(us / 1000).toLocaleString("en", { maximumFractionDigits: 3 })} ms`);
const count = (number, one, many = `${one}s`) => `${number.toLocaleString("en")} ${number === 1 ? one : many}`;
/** Makes an element. Text children are never parsed as HTML. */
function make(name, attributes = {}, ...children) {
  const element = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  element.append(...children);
  return element;
}
function drawing(name, attributes = {}, ...children) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  element.append(...children);
  return element;
}
const swatch = ({ word, high }) => make("span", { class: "swatch", style: `--tone: var(--${word}); --high: ${high}%` });
const named = (verdict) => make("span", { class: "verdict" }, swatch(verdict), verdict.word);
/** The smallest of 1, 2, 2.5 and 5 times a power of ten that is not below a number. */
function round(number) {
  const power = 10 ** Math.floor(Math.log10(number));
  return [1, 2, 2.5, 5, 10].map((n) => n * power).find((n) => n >= number);
}
/** Quotes a word for a shell if it needs quotes. */
const quoted = (word) => (/^[\w@%+=:,./-]+$/.test(word) ? word : `'${word.replaceAll("'", "'\\''")}'`);

/** The cells of a row, in the order of their instants. A grid cell has a number. */
function cellsOf(row) {
  const [from, step, length] = row.grid ?? [0, 0, row.at.length];
  const cells = [];
  for (let index = 0; index < length; index += 1) {
    cells.push({ row, number: row.first + index, at: row.grid ? from + index * step : row.at[index], verdict: BY_LETTER[row.verdicts[index]], detected: row.detected[index], safe: row.safe[index] });
  }
  for (const [at, letter, detected, safe] of row.refined) cells.push({ row, number: null, at, verdict: BY_LETTER[letter], detected, safe });
  return cells.sort((a, b) => a.at - b.at || (a.number === null) - (b.number === null));
}
for (const row of rows) {
  row.cells = cellsOf(row);
  row.counts = new Map();
  for (const { verdict } of row.cells) row.counts.set(verdict, (row.counts.get(verdict) ?? 0) + 1);
  row.worst = row.cells.find((cell) => cell.at === row.worst_us && (cell.number !== null) === (row.worst_number !== null)) ?? row.cells[0];
  row.label = manifest.seeds.length > 1 ? `${row.fault} (seed ${row.seed})` : row.fault;
}
/** Returns the least and the greatest number; 0 for none. */
const range = (numbers) => numbers.reduce(([least, most], number) => [Math.min(least, number), Math.max(most, number)], [numbers[0] ?? 0, numbers[0] ?? 0]);
const [first] = range(rows.map((row) => row.cells[0].at));
const last = Math.max(range(rows.map((row) => row.cells.at(-1).at))[1], first + 1);
const total = (verdict) => rows.reduce((sum, row) => sum + (row.counts.get(verdict) ?? 0), 0);
const span = last - first;

/** The command that runs a cell alone. */
function commandOf({ row, number, at }) {
  const seed = manifest.seed === null ? [] : ["--seed", String(manifest.seed)];
  const cell = number === null ? `${row.row}@${at}` : String(number);
  return ["pve-sim", "campaign", manifest.plan, ...seed, "--cell", cell].map(quoted).join(" ");
}
const reaction = ({ detected, safe }) => [
  ...(limits.detected_us === null ? [] : [["Detected", `${ms(detected)} (limit ${ms(limits.detected_us)})`]]),
  ...(limits.safe_us === null ? [] : [["Safe", `${ms(safe)} (limit ${ms(limits.safe_us)})`]]),
];

// The head.
$("h1").textContent = document.title = manifest.title || manifest.plan;
const failed = VERDICTS.filter(({ passed }) => !passed).reduce((sum, verdict) => sum + total(verdict), 0);
const cells = rows.reduce((sum, row) => sum + row.cells.length, 0);
const outcome = failed === 0 ? `All ${count(cells, "cell")} passed` : `${failed.toLocaleString("en")} of ${count(cells, "cell")} failed`;
$("#outcome").textContent = cells === 0 ? "No cells" : manifest.missing ? `${outcome}; rows are missing` : outcome;
$("#outcome").toggleAttribute("data-failed", failed > 0 || cells === 0 || manifest.missing !== undefined);
const injected = rows.flatMap((row) => row.cells.filter(({ number, verdict }) => number !== null && verdict !== BY_LETTER.i));
const noticed = injected.filter(({ detected }) => detected !== null).length;
const grid = rows.reduce((sum, { verdicts }) => sum + verdicts.length, 0);
for (const [term, value] of [
  ...(limits.detected_us === null ? [] : [["Detection", `${noticed.toLocaleString("en")} of ${count(injected.length, "injected fault")} detected`]]),
  ["Cells", `${grid.toLocaleString("en")} of the grid, ${(cells - grid).toLocaleString("en")} of the refinement`],
  ["Plan", manifest.plan], ["Hash of the plan", manifest.plan_hash], ["Seeds", manifest.seeds.join(", ")],
  ["Version", `pve-sim ${manifest.version}${manifest.commit ? ` (${manifest.commit})` : ""}`], ["Machine", manifest.machine],
  ...(manifest.missing ? [["Missing", manifest.missing]] : []), ...(manifest.forked ? [] : [["Runs", "each from 0 ms, not forked"]]),
]) $("#manifest").append(make("div", {}, make("dt", {}, term), make("dd", {}, value)));

// The filters.
for (const verdict of VERDICTS.filter((verdict) => total(verdict) > 0)) {
  const box = make("input", { type: "checkbox", name: "verdict", value: verdict.word, checked: "" });
  $("#verdicts").append(make("label", {}, box, swatch(verdict), make("span", {}, verdict.word), make("b", {}, total(verdict).toLocaleString("en"))));
}

// The axis.
{
  const step = round(span / 6);
  const scale = make("div");
  const tick = (at) => scale.append(make("span", { style: `left: ${((at - first) / span) * 100}%` }, ms(at)));
  tick(first);
  for (let at = Math.ceil((first + step / 2) / step) * step; at < last - step / 2; at += step) tick(at);
  tick(last);
  $("#axis").append(scale);
}

// The matrix.
let chosen = null;
function choose(row, cell, keep = true) {
  if (chosen) delete chosen.strip.dataset.chosen;
  chosen = row;
  row.current = cell;
  row.strip.dataset.chosen = "";
  row.strip.style.setProperty("--at", `${((cell.at - first) / span) * 100}%`);
  row.strip.setAttribute("aria-valuenow", row.cells.indexOf(cell));
  row.strip.setAttribute("aria-valuetext", `${ms(cell.at)}: ${cell.verdict.word}${reaction(cell).map(([term, value]) => `, ${term.toLowerCase()} ${value}`).join("")}`);
  const list = $("#cell dl");
  list.replaceChildren();
  for (const [term, value] of [
    ["Verdict", named(cell.verdict)], ["Fault", row.fault], ["Instant", ms(cell.at)], ...reaction(cell),
    ["Seed", String(row.seed)], ["Cell", cell.number === null ? "of the refinement" : `number ${cell.number}`], ...(row.reference ? [["Reference", row.reference]] : []),
  ]) list.append(make("dt", {}, term), make("dd", {}, value));
  $("#command").textContent = commandOf(cell);
  $("#copied").textContent = "";
  if (keep) history.replaceState(null, "", `#cell=${row.row}@${cell.at}`);
}
function nearest(row, at) {
  const shown = row.cells.filter(isShown);
  return (shown.length ? shown : row.cells).reduce((best, cell) => (Math.abs(cell.at - at) < Math.abs(best.at - at) ? cell : best));
}
const KEYS = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1, PageUp: 10, PageDown: -10, Home: -Infinity, End: Infinity };
for (const row of rows) {
  row.strip = make("div", { class: "strip", role: "slider", tabindex: "0", "aria-label": `Instants of ${row.label}`, "aria-valuemin": 0, "aria-valuemax": row.cells.length - 1, "aria-valuenow": 0, "aria-valuetext": "no cell chosen" });
  row.strip.append(make("canvas"));
  row.strip.addEventListener("pointerdown", (event) => {
    const { left, width } = row.strip.getBoundingClientRect();
    choose(row, nearest(row, first + ((event.clientX - left) / width) * span));
  });
  row.strip.addEventListener("focus", () => chosen === row || choose(row, row.current ?? row.worst));
  row.strip.addEventListener("keydown", (event) => {
    if (!(event.key in KEYS)) return;
    event.preventDefault();
    const shown = row.cells.filter(isShown);
    if (shown.length === 0) return;
    const here = shown.indexOf(row.current);
    const next = here < 0 ? shown.indexOf(nearest(row, row.current.at)) : here + KEYS[event.key];
    choose(row, shown[Math.max(0, Math.min(shown.length - 1, next))]);
  });
  const worst = make("button", { type: "button", "aria-label": `${row.worst.verdict.word} at ${ms(row.worst.at)}: worst instant of ${row.label}` }, named(row.worst.verdict), make("br"), `at ${ms(row.worst.at)}`);
  worst.addEventListener("click", () => choose(row, row.worst));
  row.line = make("div", { class: "row" }, make("span", { class: "name" }, row.label), row.strip, worst);
}
/** Draws the strip of a row. Each pixel shows the worst of its cells. */
function paint(row, tones) {
  const canvas = row.strip.firstChild;
  const ratio = Math.max(1, devicePixelRatio), width = Math.max(1, Math.round(row.strip.clientWidth * ratio)), height = Math.round(30 * ratio);
  canvas.width = width;
  canvas.height = height;
  const pen = canvas.getContext("2d");
  const worst = new Array(width).fill(null);
  const cells = row.cells.filter(isShown);
  cells.forEach((cell, index) => {
    // A cell extends halfway to each neighbour.
    const edge = (other, way) => (other ? (cell.at + other.at) / 2 : cell.at + way * Math.max(1000, span / 200));
    const place = (at) => ((at - first) / span) * (width - 1);
    const from = Math.max(0, Math.floor(place(edge(cells[index - 1], -1)))), to = Math.min(width, Math.max(from + 1, Math.floor(place(edge(cells[index + 1], 1)))));
    for (let x = from; x < to; x += 1) if (worst[x] === null || worst[x].severity < cell.verdict.severity) worst[x] = cell.verdict;
  });
  worst.forEach((verdict, x) => {
    if (verdict === null) return;
    const high = Math.round((verdict.high / 100) * height);
    pen.fillStyle = tones[verdict.word];
    pen.fillRect(x, height - high, 1, high);
  });
}
function repaint() {
  const probe = make("span");
  document.body.append(probe);
  const tones = Object.fromEntries(VERDICTS.map(({ word }) => {
    probe.style.color = `var(--${word})`;
    return [word, getComputedStyle(probe).color];
  }));
  probe.remove();
  for (const row of rows) if (row.line.isConnected) paint(row, tones);
}

// The faults.
const WIDE = 520, HIGH = 150, LEFT = 64, RIGHT = 8, TOP = 20, BOTTOM = 20;
function plot(row) {
  const times = row.cells.flatMap(({ detected, safe }) => [detected, safe]).filter((time) => time !== null);
  const step = round(Math.max(range(times)[1], limits.detected_us ?? 0, limits.safe_us ?? 0, 1) / 3), most = 3 * step * 1.04;
  const x = (at) => LEFT + ((at - first) / span) * (WIDE - LEFT - RIGHT), y = (time) => HIGH - BOTTOM - (time / most) * (HIGH - BOTTOM - TOP);
  const series = ["detected", "safe"].filter((name) => limits[`${name}_us`] !== null);
  const of = (name) => row.cells.map((cell) => cell[name]).filter((time) => time !== null);
  const told = series.map((name) => (of(name).length ? `${name} after ${range(of(name)).map(ms).join(" to ")}` : `never ${name}`));
  const picture = drawing("svg", { viewBox: `0 0 ${WIDE} ${HIGH}`, role: "img", "aria-label": `Reaction times of ${row.label}: ${told.join("; ")}` });
  for (let time = 0; time <= most; time += step) {
    picture.append(drawing("line", { class: "grid", x1: LEFT, x2: WIDE - RIGHT, y1: y(time), y2: y(time) }), drawing("text", { x: LEFT - 5, y: y(time) + 4, "text-anchor": "end" }, ms(time)));
  }
  for (const [at, anchor] of [[first, "start"], [(first + last) / 2, "middle"], [last, "end"]]) picture.append(drawing("text", { x: x(at), y: HIGH - 5, "text-anchor": anchor }, ms(Math.round(at / 1000) * 1000)));
  for (const name of series) {
    const limit = limits[`${name}_us`];
    picture.append(drawing("line", { class: `limit ${name}`, x1: LEFT, x2: WIDE - RIGHT, y1: y(limit), y2: y(limit) }));
    const dots = row.cells.filter((cell) => cell[name] !== null).map((cell) => `M${x(cell.at).toFixed(1)} ${y(cell[name]).toFixed(1)}h0`);
    picture.append(drawing("path", { class: `dots ${name}`, d: dots.join("") }));
  }
  const never = row.cells.filter((cell) => cell.verdict !== BY_LETTER.n && series.some((name) => cell[name] === null));
  if (never.length) picture.append(drawing("path", { class: "never", d: never.map((cell) => `M${(x(cell.at) - 2.5).toFixed(1)} ${TOP - 13}l5 5m0 -5l-5 5`).join("") }), drawing("text", { class: "never", x: LEFT - 5, y: TOP - 7, "text-anchor": "end" }, "none"));
  return picture;
}
function card(row) {
  const counts = VERDICTS.filter((verdict) => row.counts.has(verdict)).reverse().map((verdict) => `${row.counts.get(verdict).toLocaleString("en")} ${verdict.word}`);
  const key = (name, tone) => make("span", {}, make("span", { class: "key", style: `background: var(--${tone})` }), `${name} (limit dashed)`);
  const article = make("article", { class: "sheet" }, make("h3", {}, row.label), make("p", {}, `${count(row.cells.length, "cell")}: ${counts.join(", ")}`));
  if (row.reference) article.append(make("p", { class: "soft" }, `Reference: ${row.reference}`));
  article.append(plot(row), make("p", { class: "soft legend" }, ...(limits.detected_us === null ? [] : [key("detected", "detected")]), ...(limits.safe_us === null ? [] : [key("safe", "safe-line")]), make("span", {}, "× missing reaction")));
  const worst = make("p", { class: "worst" }, "Worst: ", named(row.worst.verdict), ` at ${ms(row.worst.at)}${reaction(row.worst).map(([term, value]) => `, ${term.toLowerCase()} ${value}`).join("")}`);
  article.append(worst, make("pre", { tabindex: "0", "aria-label": `Command of the worst cell of ${row.label}` }, commandOf(row.worst)));
  if (row.trace) article.append(make("details", {}, make("summary", {}, "Explained trace of the worst cell"), make("pre", { tabindex: "0", "aria-label": `Trace of the worst cell of ${row.label}` }, row.trace)));
  return article;
}

// What is shown.
function isShown({ verdict }) {
  return wanted.has(verdict.word);
}
let wanted = new Set(VERDICTS.map(({ word }) => word));
function show() {
  wanted = new Set([...document.querySelectorAll("#verdicts input:checked")].map((box) => box.value));
  const words = $("#find").value.trim().toLowerCase();
  const matching = rows.filter((row) => `${row.label} ${row.reference ?? ""}`.toLowerCase().includes(words) && row.cells.some(isShown));
  if ($("#order").value === "worst") {
    const never = (cell) => Math.max(cell.detected ?? Infinity, cell.safe ?? Infinity);
    matching.sort((a, b) => b.worst.verdict.severity - a.worst.verdict.severity || never(b.worst) - never(a.worst) || a.row - b.row);
  }
  for (const row of matching) row.card ??= card(row);
  $("#strips").replaceChildren(...matching.map((row) => row.line));
  $("#faults").replaceChildren(...matching.map((row) => row.card));
  const seen = matching.reduce((sum, row) => sum + row.cells.filter(isShown).length, 0);
  $("#shown").textContent = `${count(matching.length, "fault")}, ${count(seen, "cell")} shown`;
  repaint();
}
$("#filters").addEventListener("input", show);
$("#filters").addEventListener("submit", (event) => event.preventDefault());
$("#copy").addEventListener("click", async () => {
  try {
    await navigator.clipboard.writeText($("#command").textContent);
    $("#copied").textContent = "Copied";
  } catch {
    getSelection().selectAllChildren($("#command"));
    $("#copied").textContent = "Selected: copy it with the keyboard";
  }
});
addEventListener("resize", repaint);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", repaint);
addEventListener("beforeprint", () => {
  document.documentElement.style.colorScheme = "light";
  for (const details of document.querySelectorAll("details")) details.open = true;
  repaint();
});
addEventListener("afterprint", () => {
  document.documentElement.style.colorScheme = "";
  repaint();
});
show();
// The fragment of the URL chooses a cell; without a fragment, the worst cell is chosen.
const [, number, at] = /^#cell=(\d+)@(\d+)$/.exec(location.hash) ?? [];
const asked = rows.find((row) => String(row.row) === number);
if (rows.length > 0) {
  const worst = rows.reduce((a, b) => (b.worst.verdict.severity > a.worst.verdict.severity ? b : a));
  choose(asked ?? worst, asked ? nearest(asked, Number(at)) : worst.worst, false);
}
