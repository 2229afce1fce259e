// ---- panels: lines over one time axis, alone or several in one, of one record or of two ------------------------------
import { DASHES, attempt, button, colour, element, number, plot, select, traces } from "./core.js";
import { channelList, leave } from "./records.js";
import { placeMarks } from "./record_marks.js";
import { allLines, chosenLines, lineText, place, shown, view } from "./record_state.js";
import { spanText, spanned, zoom } from "./record_time.js";
import { checkOther, keepExpressions, otherLine } from "./record_expressions.js";
import { cursorAt, drawCursors, readCursors } from "./record_tools.js";

const HEIGHT = 118, TALL = 168, MARGIN = 1;   // a span on either side is fetched with the one on the screen
const MOST_UNITS = 2;   // an axis on either side

export const drop = () => { view.plots.forEach(({ made }) => made.destroy()); view.plots = []; };
const panelOf = (line) => view.joined.get(place(line)) || line.panel || line.channel;
export function panels() {   // name of a panel to its lines; the difference of a panel stands below it
  const found = new Map();
  for (const line of chosenLines()) found.set(panelOf(line), [...(found.get(panelOf(line)) || []), line]);
  const ordered = new Map();
  for (const [name, lines] of found) {
    if (lines.every((line) => line.below && found.has(line.below))) continue;
    ordered.set(name, lines);
    for (const [below, others] of found) if (others.every((line) => line.below === name)) ordered.set(below, others);
  }
  return ordered;
}

// ---- what is fetched -------------------------------------------------------------------------------------------------
function query(record, lines, shift, from, to) {
  const channels = lines.filter((line) => line.source !== "expression").map(place), texts = lines.filter((line) => line.source === "expression").map(lineText);
  const width = to - from, points = Math.round((1 + 2 * MARGIN) * Math.max(view.parts.plots.clientWidth, 300));
  return { name: record, channels: channels.join(","), lines: JSON.stringify(texts), start: from - MARGIN * width + shift, stop: to + MARGIN * width + shift, points };
}
export async function fetchTraces() {
  const own = view, lines = chosenLines(), { other } = view;
  if (view.asking) view.asking.abort();
  view.asking = new AbortController();
  const [from, to] = shown(), width = to - from, asked = query(view.record.name, lines, 0, from, to);
  const requests = [lines.length ? traces(asked, view.asking.signal) : []];
  const matched = other ? lines.map((line) => otherLine(line)).filter(Boolean) : [];
  if (matched.length) requests.push(traces(query(other.name, matched, other.shift, from, to), view.asking.signal));
  const [groups, others = []] = await Promise.all(requests);
  if (own !== view) return;
  for (const group of others) for (let i = 0; i < group.time.length; i++) group.time[i] -= other.shift;
  const samples = Math.max(0, ...groups.map((group) => group.time.length));
  view.fetched = { start: asked.start, stop: asked.stop, width, coarse: samples > asked.points, groups, others };
  for (const entry of view.plots) entry.made.setData(joined(entry.lines), false);
  spanned();
}
function series(line) {
  const of = line.other ? line.other : line, groups = line.other ? view.fetched.others : view.fetched.groups;
  const group = groups.find((one) => one.source === of.source && one.leaf === of.leaf);
  return group && group.values[of.channel] ? [group.time, group.values[of.channel]] : [new Float64Array(), new Float64Array()];
}
const finite = (values) => Array.from(values, (value) => (Number.isFinite(value) ? value : null));
function joined(lines) {   // clocks differ: one table with all times
  const found = lines.map(series);
  if (found.every(([time]) => time === found[0][0])) return [Array.from(found[0][0]), ...found.map(([, values]) => finite(values))];
  return uPlot.join(found.map(([time, values]) => [Array.from(time), finite(values)]), found.map(() => [0, 2]));
}

// ---- what is drawn ---------------------------------------------------------------------------------------------------
export function drawSoon() { clearTimeout(view.soon); view.soon = setTimeout(() => attempt(draw), 20); }
export async function draw() {
  const own = view;
  own.drawing = (own.drawing || 0) + 1;
  try { await drawPanels(); } finally { own.drawing -= 1; }
}
async function drawPanels() {
  drop();
  const own = view, found = panels();
  await fetchTraces();
  if (own !== view) return;
  drop();   // another call may have drawn meanwhile
  view.width = view.parts.plots.clientWidth;
  view.parts.plots.replaceChildren();
  for (const [name, lines] of found) drawPanel(name, lines, found);
  if (!found.size) view.parts.plots.replaceChildren(element("p", {}, "Choose channels on the left."));
  for (const { made } of view.plots) made.setSpan(shown());
  placeMarks();
  spanText();
  readCursors();
}
function drawPanel(name, own, found) {
  const others = view.other ? own.map((line) => ({ line, other: otherLine(line) })).filter((one) => one.other).map(({ line, other }) => ({ ...line, other })) : [];
  const lines = [...own, ...others], units = [...new Set(lines.map((line) => line.unit))];
  const value = element("span", { class: "quiet", "aria-hidden": "true" }), several = lines.length > 1, merged = own.length > 1 && own.some((line) => view.joined.has(place(line)));
  const host = element("div", { class: "plot", role: "img", "aria-label": `${name}${units[0] ? `, ${units.join(" and ")}` : ""}, over time` });
  const words = (line, i) => {
    const what = line.other ? `${own.length > 1 ? `${line.channel}, ` : ""}${view.other.name}` : label(line, own);
    const axis = units.length > 1 ? `, ${line.unit || "1"}${line.unit === units[0] ? "" : ", right axis"}` : "";
    const remove = !line.other && merged && button("\u00d7", () => { leave(line); channelList(); drawSoon(); }, { class: "small", "aria-label": `Take ${line.channel} (${line.leaf}) out of the panel` });
    return element("span", { class: `line-${i % DASHES.length}` }, swatch(line.other), `${what}${what ? axis : ""}`, remove);
  };
  host.append(element("div", { class: "plot-title" }, element("b", {}, name), element("span", { class: "quiet" }, units.length === 1 ? units[0] : ""),
    several || own.some((line) => line.source !== "record") ? lines.map(words) : "", difference(name, own), joinForm(name, own, found), value));
  const data = joined(lines);
  const made = plot(host, {
    x: data[0], width: view.width, height: merged ? TALL : HEIGHT, span: shown(), sync: "records", onzoom: zoom, marks: shade,
    lines: lines.map((line, i) => ({ label: line.leaf, values: data[i + 1], line: i % DASHES.length, dash: line.other ? 2 : 0, right: units.length > 1 && line.unit !== units[0] })),
    rightLabel: units.length > 1 ? units[1] || "1" : "", yLabel: units.length > 1 ? units[0] || "1" : "",
    oncursor: (at) => { value.textContent = at == null ? "" : `${number(made.data[0][at], 6)} s: ${lines.map((_, i) => number(made.data[i + 1][at])).filter(Boolean).join(" / ")}`; },
  });
  made.over.addEventListener("click", (event) => cursorAt(made.posToVal(event.offsetX, "x")));
  view.parts.plots.append(host);
  view.plots.push({ made, lines });
}
const swatch = (other) => element("span", { class: other ? "swatch other" : "swatch", "aria-hidden": "true" });
function label(line, own) {
  if (line.source === "expression") return line.text || line.channel;
  const alike = own.every((one) => one.channel === line.channel);
  const kind = line.source === "path" ? "reconstructed" : own.length > 1 ? `recorded (${line.leaf})` : "";
  return alike ? kind : `${line.channel}${kind ? `, ${kind}` : ""}`;
}
function shade(made) {   // the chosen manoeuvre alone: where the others are, the boxes above show
  const row = view.record.manoeuvres.rows[view.row], { left, top, width, height } = made.bbox, context = made.ctx;
  if (row) {
    const a = Math.max(made.valToPos(row.start, "x", true), left), b = Math.min(made.valToPos(row.end, "x", true), left + width);
    if (b > a) {
      context.fillStyle = colour("chosen");
      context.globalAlpha = 0.55;
      context.fillRect(a, top, b - a, height);
      context.globalAlpha = 1;
    }
  }
  drawCursors(made);
}

// ---- several channels in a panel, and the difference of two of them --------------------------------------------------
function joinForm(name, own, found) {   // the other lines of the record; of more than two units one axis would be missing
  const units = new Set(own.map((line) => line.unit)), fits = (line) => units.has(line.unit) || units.size < MOST_UNITS;
  const items = allLines().filter((line) => !own.includes(line) && fits(line)).map((line) => [place(line), `${line.source === "expression" ? line.channel : `${line.channel} (${line.source === "path" ? "reconstructed" : line.leaf})`}${line.unit ? `, ${line.unit}` : ""}`]);
  const merged = own.some((line) => view.joined.has(place(line)));
  return [
    items.length ? select([["", "add a channel"], ...items], "", (key) => {
      if (!key) return;
      view.chosen.add(key);
      view.joined.set(key, name);
      for (const line of own) view.joined.set(place(line), name);
      channelList();
      drawSoon();
    }, { class: "small", "aria-label": `Add a channel to the panel ${name}` }) : "",
    merged ? button("split", () => { for (const line of own) view.joined.delete(place(line)); drawSoon(); }, { class: "small", title: "A panel for each channel" }) : "",
  ];
}
// Recorded less reconstructed. What the reconstruction leaves over of a reading comes before the difference of two states:
// it has the place, the bias and the delay of the instrument in it.
export function differenceOf(name, own) {
  const recorded = own.find((line) => line.source === "record"), path = own.find((line) => line.source === "path");
  if (recorded && (view.record.residuals || []).includes(recorded.channel)) return [`residual.${recorded.channel}`, "recorded \u2212 estimated reading"];
  if (recorded && path) return [`${recorded.leaf}.${recorded.channel} - path.${path.channel}`, "recorded \u2212 reconstructed"];
  return null;
}
function difference(name, own) {
  const found = differenceOf(name, own);
  if (!found) return "";
  const [text, words] = found, old = view.expressions.find((one) => one.channel === text && one.below);
  const on = Boolean(old && view.chosen.has(place(old)));
  return button("residual", () => attempt(async () => {
    if (on) leave(old);
    else {
      await checkOther(text);
      const line = old || { source: "expression", leaf: text, channel: text, unit: own[0].unit, meaning: words, below: name, panel: `${name} residual`, text: words };
      if (!old) view.expressions.push(line);
      view.chosen.add(place(line));
    }
    keepExpressions();
    drawSoon();
  }), { class: "small", "aria-pressed": String(on), title: `${words}, in a panel below` });
}
