// ---- tools over the panels: two cursors, a channel over another, spectra --------------------------------------------
import { DASHES, attempt, button, colour, element, get, inTurn, number, table } from "./core.js";
import { curveGraph, densityGraph } from "./graphs.js";
import { otherLine } from "./record_expressions.js";
import { chosenLines, lineText, shown, view } from "./record_state.js";

const TOOLS = [["cursors", "Cursors"], ["curve", "XY plot"], ["spectrum", "Spectrum"]];
const MOST_LINES = 24, WAIT = 150;

export function toolBar() {
  view.parts.toolbar.replaceChildren(...TOOLS.map(([name, text]) => button(text, () => (name === "cursors" ? toggleCursors() : toggle(name)), { "aria-pressed": String(view.tools.has(name)), title: name === "cursors" ? "Two cursors; a click moves the nearer one (c)" : text })));
}
function toggle(name) {
  if (view.tools.has(name)) view.tools.delete(name); else view.tools.add(name);
  toolBar();
  tools();
}
export function toggleCursors() {
  const [from, to] = shown();
  view.cursors = view.tools.has("cursors") ? null : [from + (to - from) / 3, from + (2 * (to - from)) / 3];
  toggle("cursors");
  for (const { made } of view.plots) made.redraw();
}
export function tools() {   // the blocks of the tools that are on
  const blocks = TOOLS.filter(([name]) => view.tools.has(name)).map(([name, text]) => element("section", { class: "tool", "aria-label": text }, (view.parts[name] = element("div"))));
  view.parts.tools.replaceChildren(...blocks);
  if (view.tools.has("cursors")) readCursors();
  if (view.tools.has("curve")) curveForm();
  if (view.tools.has("spectrum")) spectrumForm();
}
export function spanChanged() {   // the span of the screen is the span of the figures
  clearTimeout(view.spanLater);
  if (view.tools.has("curve") || view.tools.has("spectrum")) view.spanLater = setTimeout(() => { if (view) { if (view.tools.has("curve")) attempt(curve); if (view.tools.has("spectrum")) attempt(spectrum); } }, WAIT);
}

// ---- cursors ---------------------------------------------------------------------------------------------------------
export function cursorAt(time) {   // the nearer cursor moves to the click
  if (!view.cursors || !Number.isFinite(time)) return;
  const [a, b] = view.cursors, i = Math.abs(time - a) <= Math.abs(time - b) ? 0 : 1;
  view.cursors = view.cursors.map((old, j) => (j === i ? time : old));
  for (const { made } of view.plots) made.redraw();
  readCursors();
}
export function drawCursors(made) {
  if (!view.cursors) return;
  const { left, top, width, height } = made.bbox, context = made.ctx;
  context.save();
  context.strokeStyle = colour("link");
  context.fillStyle = colour("link");
  context.font = `${11 * devicePixelRatio}px sans-serif`;
  view.cursors.forEach((time, i) => {
    const x = made.valToPos(time, "x", true);
    if (x < left || x > left + width) return;
    context.setLineDash(i ? [4 * devicePixelRatio, 3 * devicePixelRatio] : []);
    context.beginPath();
    context.moveTo(x, top);
    context.lineTo(x, top + height);
    context.stroke();
    context.fillText("AB"[i], x + 3 * devicePixelRatio, top + 11 * devicePixelRatio);
  });
  context.restore();
}
let reading = null;
export function readCursors() {
  if (!view.cursors || !view.parts.cursors) return;
  if (!reading || reading.view !== view) reading = { view, read: inTurn(() => attempt(cursorTable, view.parts.cursors)) };
  reading.read();
}
async function cursorTable() {   // of the samples of the record, not of the points of the screen
  const own = view, lines = chosenLines().slice(0, MOST_LINES), [a, b] = view.cursors, { other } = view;
  const of = (name, texts, shift) => get("/api/cursors", { name, lines: JSON.stringify(texts), start: a + shift, stop: b + shift });
  const answers = [await of(view.record.name, lines.map(lineText), 0)];
  const matched = other ? lines.map((line) => otherLine(line)).filter(Boolean) : [];
  if (matched.length) answers.push(await of(other.name, matched.map(lineText), other.shift));
  if (own !== view || !view.cursors) return;
  const rows = answers.flatMap((answer, i) => answer.rows.map((row) => ({ ...row, record: i ? other.name : "" })));
  const field = (i, name) => element("input", { type: "number", step: "any", value: Number(view.cursors[i].toFixed(3)), "aria-label": `Cursor ${name} [s]`, onchange: (event) => { if (event.target.value !== "") { view.cursors[i] = Number(event.target.value); for (const { made } of view.plots) made.redraw(); readCursors(); } } });
  const each = (row) => (row.unit ? `${row.unit}` : ""), fix = (key, digits = 5) => [key, (row) => number(row[key], digits), { number: true }];
  const named = ([, call, how], heading) => [heading, call, how];
  view.parts.cursors.replaceChildren(
    element("div", { class: "row" }, "A", field(0, "A"), "B", field(1, "B"), element("span", {}, `B \u2212 A: ${number(b - a, 6)} s${b !== a ? `, 1/(B \u2212 A): ${number(1 / (b - a), 4)} Hz` : ""}`), element("span", { class: "quiet" }, "click in a panel moves the nearer cursor")),
    element("div", { class: "scroll low" }, table([
      ["channel", (row) => `${row.line}${row.record ? `, ${row.record}` : ""}`], ["unit", each], named(fix("first"), "A"), named(fix("last"), "B"), named(fix("difference"), "B \u2212 A"),
      named(fix("chord", 4), "(B \u2212 A)/s"), named(fix("slope", 4), "slope of all/s"), named(fix("mean"), "mean"), named(fix("deviation", 4), "st. dev."), named(fix("low"), "least"), named(fix("high"), "greatest"), ["samples", "samples", { number: true, digits: 9 }],
    ], rows, { label: "Values at the cursors" })));
}

// ---- a channel over another ------------------------------------------------------------------------------------------
const field = (text, name, change) => element("input", { class: "expression", value: text, list: "expression-words", spellcheck: "false", "aria-label": name, onchange: (event) => change(event.target.value.trim()) });
function curveForm() {
  const lines = chosenLines().map(lineText);
  view.pair = view.pair || [lines.find((text) => /alpha/.test(text)) || lines[0] || "", lines.find((text) => /\.q$/.test(text)) || lines[1] || lines[0] || ""];
  const figure = (view.parts.curveFigure = element("div"));
  const change = (i) => (text) => { view.pair[i] = text; attempt(curve, figure); };
  view.parts.curve.replaceChildren(element("div", { class: "row" }, field(view.pair[1], "Vertical channel or expression", change(1)), "over", field(view.pair[0], "Horizontal channel or expression", change(0)), element("span", { class: "quiet" }, "of the span on the screen")), figure);
  attempt(curve, figure);
}
async function curve() {
  const own = view, figure = view.parts.curveFigure, [x, y] = view.pair, [start, stop] = shown(), { other } = view;
  if (!x || !y) { figure.replaceChildren(element("p", {}, "Name two channels.")); return; }
  try {
    const found = [await get("/api/curve", { name: view.record.name, x, y, start, stop })];
    if (other) { try { found.push(await get("/api/curve", { name: other.name, x, y, start: start + other.shift, stop: stop + other.shift })); } catch (error) { found[0].remarks.push(`${other.name}: ${error.message}`); } }
    if (own !== view) return;
    const [main] = found, lines = found.map((one, i) => ({ x: one.x, y: one.y, line: i, dash: i }));
    const row = view.record.manoeuvres.rows[view.row], inside = row ? main.time.map((time) => time >= row.start && time <= row.end) : [];
    if (row) lines.push({ x: main.x.filter((_, i) => inside[i]), y: main.y.filter((_, i) => inside[i]), line: 2 });
    if (!main.samples) { figure.replaceChildren(element("p", {}, "No sample on the screen has both.")); return; }
    figure.replaceChildren(element("div", { class: "figure" }, curveGraph(lines, { width: 640, height: 420, title: `${y} over ${x}`, xLabel: `${x} [${main.units[0] || "unit not known"}]`, yLabel: `${y} [${main.units[1] || "unit not known"}]` })),
      element("p", { class: "quiet" }, `${main.samples} samples${main.every > 1 ? `, every ${main.every}th is drawn` : ""}.${other && found[1] ? ` Dashed: ${other.name}.` : ""}${row ? ` Colour: manoeuvre ${view.row + 1}.` : ""}${main.remarks.map((text) => ` ${text}.`).join("")}`));
  } catch (error) { if (own === view) figure.replaceChildren(element("p", { class: "fail", role: "alert" }, error.message)); }
}

// ---- spectra ---------------------------------------------------------------------------------------------------------
function spectrumForm() {
  const lines = chosenLines().map(lineText);
  view.spectra = view.spectra || [lines.find((text) => /\.q$/.test(text)) || lines[0]].filter(Boolean);
  const figure = (view.parts.spectrumFigure = element("div")), text = field("", "Channel or expression of a spectrum", (given) => { if (given && !view.spectra.includes(given)) { view.spectra.push(given); spectrumForm(); } });
  view.parts.spectrum.replaceChildren(element("div", { class: "row" }, view.spectra.map((line, i) => element("span", { class: `line-${i % DASHES.length}` }, line, button("\u00d7", () => { view.spectra.splice(i, 1); spectrumForm(); }, { class: "small", "aria-label": `Take ${line} out of the spectrum` }))), text, element("span", { class: "quiet" }, "of the span on the screen")), figure);
  attempt(spectrum, figure);
}
async function spectrum() {
  const own = view, figure = view.parts.spectrumFigure, [start, stop] = shown(), { other } = view;
  if (!view.spectra.length) { figure.replaceChildren(element("p", {}, "Name a channel.")); return; }
  try {
    const of = (name, shift) => get("/api/spectrum", { name, lines: JSON.stringify(view.spectra), start: start + shift, stop: stop + shift });
    const found = (await of(view.record.name, 0)).lines;
    if (other) { try { found.push(...(await of(other.name, other.shift)).lines.map((one) => ({ ...one, record: other.name }))); } catch { /* it lacks the channel */ } }
    if (own !== view) return;
    const lines = found.map((one) => ({ x: one.frequency, y: one.density, line: view.spectra.indexOf(one.line) % DASHES.length, dash: one.record ? "4 3" : "" }));
    const units = [...new Set(found.map((one) => one.unit))], unit = units.length === 1 ? `(${units[0] || "unit not known"})\u00b2/Hz` : "unit\u00b2/Hz of each channel";
    figure.replaceChildren(element("div", { class: "figure" }, densityGraph(lines, { width: 640, height: 360, title: "Power spectral density over frequency, both logarithmic", xLabel: "frequency [Hz]", yLabel: unit })),
      element("div", { class: "scroll" }, table([["channel", (row) => `${row.line}${row.record ? `, ${row.record}` : ""}`], ["density in", (row) => (row.unit ? `(${row.unit})\u00b2/Hz` : "unit not known")], ["resolution, Hz", "resolution", { number: true, digits: 3 }], ["segments", "segments", { number: true }], ["left out", "left_out", { number: true }], ["rms of the density", "rms", { number: true }], ["st. dev. of the samples", "deviation", { number: true }]], found, { label: "Spectra" })),
      element("p", { class: "quiet" }, "Welch: Hann window, overlap of one half, one-sided; each segment about its mean. The rms of the density and the standard deviation agree for a steady signal; a larger deviation is motion slower than a segment."));
  } catch (error) { if (own === view) figure.replaceChildren(element("p", { class: "fail", role: "alert" }, error.message)); }
}
