// ---- records: channels over one time axis, manoeuvres, faults, coverage ----------------------------------------------
import { $, DASHES, act, attempt, button, colour, drawing, element, get, inTurn, key, labelled, number, plot, redraw, select, sent, table, ticks, traces } from "./core.js";

const FIRST = ["delta_e", "delta_a", "delta_r", "q", "p", "r", "alpha_vane", "V_cas", "h_baro", "az", "V", "alpha", "theta", "phi"];
const REACH = 6;   // pixels on either side of the edge of a mark
const MOST_FIRST = 7, HEIGHT = 118, MARGIN = 1;   // a span on either side is fetched with the one on the screen
let view = null;

export function open(host) {
  view = { host, parts: {}, chosen: null, plots: [], span: null, fetched: null, row: null, record: null, refresh: inTurn(refresh), changed: () => attempt(view.refresh) };
  const part = (name, node) => (view.parts[name] = node);
  host.replaceChildren(element("div", { class: "columns" },
    element("nav", { class: "column", "aria-label": "Records and channels" },
      element("h2", {}, "Records"), part("records", element("ul", { class: "list" })),
      element("h2", {}, "Channels"), part("filter", element("input", { type: "search", placeholder: "name", "aria-label": "Show channels with this text", oninput: channelList })),
      part("channels", element("div"))),
    element("div", { class: "column", id: "plots-column" },
      element("div", { class: "row" }, part("name", element("h2", {}, "")), part("error", element("div")),
        button("All", () => zoom(null), { title: "Whole record (r)" }), button("\u2212", () => scale(2), { "aria-label": "Zoom out" }), button("+", () => scale(0.5), { "aria-label": "Zoom in" }),
        button("\u2190", () => pan(-0.2), { "aria-label": "Earlier" }), button("\u2192", () => pan(0.2), { "aria-label": "Later" }), part("span", element("span", { class: "quiet" }))),
      part("marks", element("div", { class: "marks", role: "group", "aria-label": "Manoeuvres over time" })),
      part("plots", element("div", { class: "plots" }))),
    element("aside", { class: "column", "aria-label": "Manoeuvres, faults, coverage" },
      element("h2", {}, "Manoeuvres"), part("table", element("div")), part("form", element("div")),
      element("h2", {}, "Reconstruction"), part("path", element("div")),
      element("h2", {}, "Faults"), part("faults", element("div")),
      element("h2", {}, "Envelope"), part("coverage", element("div")))));
  view.parts.marks.addEventListener("pointerdown", grab);
  view.parts.marks.addEventListener("pointermove", (event) => view.parts.marks.classList.toggle("at-edge", Boolean(edgeAt(event))));
  view.parts.plots.parentNode.addEventListener("scroll", scrolled, { passive: true });
  view.parts.plots.addEventListener("wheel", wheel, { passive: false });
  view.resized = new ResizeObserver(() => { if (view && view.record && view.width !== view.parts.plots.clientWidth) attempt(draw); });
  view.resized.observe(view.parts.plots);
  document.addEventListener("changed", view.changed);
  key("r", "whole record", () => zoom(null));
  key("ArrowLeft", "earlier", () => pan(-0.2));
  key("ArrowRight", "later", () => pan(0.2));
  key("+", "zoom in", () => scale(0.5));
  key("-", "zoom out", () => scale(2));
  key("n", "next record", () => step(1));
  key("p", "record before", () => step(-1));
  key("m", "next manoeuvre", () => nextRow());
  return view.refresh();
}
export function close() {
  document.removeEventListener("changed", view.changed);
  view.resized.disconnect();
  drop();
  view = null;
}
const drop = () => { view.plots.forEach(({ made }) => made.destroy()); view.plots = []; };

async function refresh() {
  const own = view, project = await get("/api/project");
  if (own !== view) return;
  view.project = project;
  recordList();
  const kept = sessionStorage.getItem("record"), names = view.project.records.map((one) => one.name);
  await load([view.wanted, kept, names[0]].find((name) => names.includes(name)), true);
}
function recordList() {
  view.parts.records.replaceChildren(...view.project.records.map((one) => element("li", {},
    button(one.name, () => attempt(() => load(one.name)), { "aria-current": view.record && view.record.name === one.name ? "true" : null, title: one.reconstructed ? "reconstructed" : "" }))));
}
function step(by) {
  const names = view.project.records.map((one) => one.name), place = names.indexOf(view.record.name) + by;
  if (names[place]) attempt(() => load(names[place]));
}
async function load(name, again = false) {
  if (!name) { view.parts.plots.replaceChildren(element("p", {}, "The project has no records.")); return; }
  const own = view, turn = (own.loading = (own.loading || 0) + 1), before = view.record && view.record.name;
  view.wanted = name;
  if (before !== name) view.find = "0";
  const found = await get("/api/record", { name, find: view.find });
  if (own !== view || turn !== own.loading) return;
  const row = before === name && view.row != null ? view.record.manoeuvres.rows[view.row] : null, same = (one) => rowText(one) === rowText(row) && one.start === row.start && one.end === row.end;
  view.row = row && found.manoeuvres.rows.some(same) ? found.manoeuvres.rows.findIndex(same) : null;   // others may have come before it
  view.record = found;
  sessionStorage.setItem("record", name);
  if (before !== name) { view.span = null; view.findings = null; }
  const known = new Set(found.channels.map(place));
  if (view.chosen) {
    for (const one of [...view.chosen]) if (!known.has(one)) view.chosen.delete(one);
    if (!again || before !== name) pair();
  }
  if (!view.chosen || !view.chosen.size) first();
  view.parts.name.textContent = found.title || name;
  recordList();
  channelList();
  manoeuvres();
  path();
  faults();
  coverage();
  await draw();
}
const place = ({ source, leaf, channel }) => `${source}/${leaf}/${channel}`;
function first() {
  const raw = view.record.channels.filter((one) => one.source === "record");
  const names = FIRST.filter((name) => raw.some((one) => one.channel === name)).slice(0, MOST_FIRST);
  const taken = names.length ? raw.filter((one) => names.includes(one.channel)) : raw.slice(0, MOST_FIRST);
  view.chosen = new Set(taken.map(place));
  pair();
}
function pair() {   // the reconstructed channel stands in the panel of the recorded one
  const shown = new Set([...view.chosen].map((one) => one.split("/")[2]));
  for (const one of view.record.channels) if (one.source === "path" && shown.has(one.channel)) view.chosen.add(place(one));
}
function channelList() {
  const wanted = view.parts.filter.value.trim().toLowerCase(), leaves = new Map();
  for (const one of view.record.channels) if (!wanted || `${one.channel} ${one.meaning}`.toLowerCase().includes(wanted)) leaves.set(one.leaf, [...(leaves.get(one.leaf) || []), one]);
  const box = (one) => element("li", {}, element("label", { title: one.meaning }, element("input", {
    type: "checkbox", checked: view.chosen.has(place(one)),
    onchange: (event) => { if (event.target.checked) view.chosen.add(place(one)); else view.chosen.delete(place(one)); drawSoon(); },
  }), ` ${one.channel} `, element("span", { class: "quiet" }, one.unit)));
  view.parts.channels.replaceChildren(...[...leaves].map(([leaf, items]) => element("details", { open: "" }, element("summary", {}, leaf === "path" ? "reconstructed" : leaf), element("ul", { class: "list" }, items.map(box)))));
}

// ---- time ------------------------------------------------------------------------------------------------------------
const whole = () => [view.record.start, view.record.stop];
const shown = () => view.span || whole();
function zoom(span) {
  if (!view.record) return;
  const [low, high] = whole();
  if (span) {
    const width = Math.min(Math.max(span[1] - span[0], 0.02), high - low), start = Math.min(Math.max(span[0], low), high - width);
    span = width >= (high - low) * 0.999 ? null : [start, start + width];
  }
  view.span = span;
  if (view.frame) return;
  view.frame = requestAnimationFrame(() => {
    view.frame = null;
    spanned();
    placeMarks();
    spanText();
    const [from, to] = shown(), got = view.fetched;
    if (!got || from < got.start || to > got.stop || (got.coarse && (to - from) < 0.5 * got.width) || to - from > 2.1 * got.width) {
      fetchSoon();
    }
  });
}
function fetchSoon() {   // not while channels are drawn: that would abort their own request
  clearTimeout(view.later);
  view.later = setTimeout(() => (!view ? null : view.drawing ? fetchSoon() : attempt(fetchTraces)), 60);
}
function spanned() {   // panels on the screen now, the others when they are scrolled to
  for (const entry of view.plots) {
    const { top, bottom } = entry.made.root.getBoundingClientRect();
    entry.late = bottom < 0 || top > innerHeight;
    if (!entry.late) entry.made.setSpan(shown());
  }
}
function scrolled() {
  for (const entry of view.plots) {
    if (!entry.late) continue;
    const { top, bottom } = entry.made.root.getBoundingClientRect();
    if (bottom < 0 || top > innerHeight) continue;
    entry.late = false;
    entry.made.setSpan(shown());
  }
}
function scale(factor, centre = null) {
  const [from, to] = shown(), middle = centre ?? (from + to) / 2;
  zoom([middle - (middle - from) * factor, middle + (to - middle) * factor]);
}
function pan(by) { const [from, to] = shown(), shift = by * (to - from); zoom([from + shift, to + shift]); }
function wheel(event) {
  const over = event.target.closest(".u-over");
  if (!over || (!event.shiftKey && !event.ctrlKey)) return;
  event.preventDefault();
  const amount = event.deltaY || event.deltaX;
  if (event.shiftKey) return pan(0.1 * Math.sign(amount));
  const box = over.getBoundingClientRect(), [from, to] = shown();
  return scale(amount > 0 ? 1.25 : 0.8, from + (to - from) * (event.clientX - box.left) / box.width);
}
const spanText = () => { const [from, to] = shown(); view.parts.span.textContent = `${from.toFixed(2)} to ${to.toFixed(2)} s`; };

// ---- channels --------------------------------------------------------------------------------------------------------
async function fetchTraces() {
  const own = view;
  if (view.asking) view.asking.abort();
  view.asking = new AbortController();
  const [from, to] = shown(), width = to - from, start = from - MARGIN * width, stop = to + MARGIN * width;
  const points = Math.round((1 + 2 * MARGIN) * Math.max(view.parts.plots.clientWidth, 300));
  const groups = view.chosen.size ? await traces({ name: view.record.name, channels: [...view.chosen].join(","), start, stop, points }, view.asking.signal) : [];
  if (own !== view) return;
  const samples = Math.max(0, ...groups.map((group) => group.time.length));
  view.fetched = { start, stop, width, coarse: samples > points, groups };
  for (const entry of view.plots) {
    const data = joined(entry.lines);
    entry.made.setData(data, false);
  }
  spanned();
}
function series(line) {
  const group = view.fetched.groups.find((one) => one.source === line.source && one.leaf === line.leaf);
  return group ? [group.time, group.values[line.channel]] : [new Float64Array(), new Float64Array()];
}
const finite = (values) => Array.from(values, (value) => (Number.isFinite(value) ? value : null));
function joined(lines) {   // clocks differ: one table with all times
  const found = lines.map(series);
  if (found.every(([time]) => time === found[0][0])) return [Array.from(found[0][0]), ...found.map(([, values]) => finite(values))];
  return uPlot.join(found.map(([time, values]) => [Array.from(time), finite(values)]), found.map(() => [0, 2]));
}
function drawSoon() { clearTimeout(view.soon); view.soon = setTimeout(() => attempt(draw), 20); }
async function draw() {
  const own = view;
  own.drawing = (own.drawing || 0) + 1;
  try { await drawPanels(); } finally { own.drawing -= 1; }
}
async function drawPanels() {
  drop();
  const panels = new Map();
  for (const one of view.record.channels) if (view.chosen.has(place(one))) panels.set(one.channel, [...(panels.get(one.channel) || []), one]);
  const own = view;
  await fetchTraces();
  if (own !== view) return;
  view.width = view.parts.plots.clientWidth;
  view.parts.plots.replaceChildren();
  for (const [name, lines] of panels) {
    const value = element("span", { class: "quiet", "aria-hidden": "true" });
    const host = element("div", { class: "plot", role: "img", "aria-label": `${name}${lines[0].unit ? `, ${lines[0].unit}` : ""}, over time` },
      element("div", { class: "plot-title" }, element("b", {}, name), element("span", { class: "quiet" }, lines[0].unit),
        lines.map((line, i) => element("span", { class: `line-${i}` }, line.source === "path" ? "reconstructed" : lines.length > 1 ? `recorded (${line.leaf})` : "")), value));
    view.parts.plots.append(host);
    const data = joined(lines);
    const made = plot(host, {
      x: data[0], lines: lines.map((line, i) => ({ label: line.leaf, values: data[i + 1], line: i, dash: 0 })), width: view.width, height: HEIGHT, span: shown(),
      sync: "records", onzoom: zoom, marks: shade,
      oncursor: (at) => { value.textContent = at == null ? "" : `${number(made.data[0][at], 6)} s: ${lines.map((_, i) => number(made.data[i + 1][at])).filter(Boolean).join(" / ")}`; },
    });
    view.plots.push({ made, lines });
  }
  if (!panels.size) view.parts.plots.replaceChildren(element("p", {}, "Choose channels on the left."));
  for (const { made } of view.plots) made.setSpan(shown());
  placeMarks();
  spanText();
}
function shade(made) {
  const rows = view.record.manoeuvres.rows, { left, top, width, height } = made.bbox, context = made.ctx;
  rows.forEach((row, i) => {
    const a = Math.max(made.valToPos(row.start, "x", true), left), b = Math.min(made.valToPos(row.end, "x", true), left + width);
    if (b <= a) return;
    context.fillStyle = colour(i === view.row ? "chosen" : "mark");
    context.globalAlpha = 0.55;
    context.fillRect(a, top, b - a, height);
    context.globalAlpha = 1;
  });
}

// ---- manoeuvres ------------------------------------------------------------------------------------------------------
const SOURCES = { table: "from the project's table", record: "as the record carries them" };
const rowText = (row) => [row.manoeuvre, row.control].filter(Boolean).join(" ");
function manoeuvres() {
  const { source, rows } = view.record.manoeuvres, found = rows.filter((row) => row.found).length, searched = view.find === "1";
  redraw(view.parts.table, view.record.name, element("p", { class: "quiet" }, `${rows.length - found}, ${SOURCES[source]}.`, searched ? ` ${found} found in the movements of the controls${found ? ": accept or correct them" : " and not marked"}.` : ""),
    table([["number", (row) => String(rows.indexOf(row) + 1), { hidden: true }], ["manoeuvre", (row) => `${rowText(row)}${row.found ? " (found)" : ""}`], ["start", (row) => number(row.start, 6), { number: true }], ["end", (row) => number(row.end, 6), { number: true }]],
      rows, { label: "Manoeuvres", chosen: (_, i) => i === view.row, onchoose: (_, i) => choose(i) }),
    searched ? "" : button("Search the movements of the controls", () => { view.find = "1"; return change(() => load(view.record.name, true)); }),
    found ? button("Accept all", () => change(() => acceptAll())) : "");
  form();
}
function choose(i, zoomed = true) {
  view.row = i;
  manoeuvres();
  placeMarks();
  const row = view.record.manoeuvres.rows[i], margin = 0.15 * (row.end - row.start);
  if (zoomed) zoom([row.start - margin, row.end + margin]);
  for (const { made } of view.plots) made.redraw();
}
function nextRow() {
  const count = view.record.manoeuvres.rows.length;
  if (count) choose(((view.row ?? -1) + 1) % count);
}
function form() {
  const row = view.row == null ? null : view.record.manoeuvres.rows[view.row], [from, to] = shown();
  const field = (name, value, more = {}) => element("input", { value, "data-field": name, "aria-label": name, size: 12, ...more });
  const kind = field("kind", row ? row.manoeuvre : "", { placeholder: "doublet" }), control = field("control", row ? row.control : "", { placeholder: "elevator" });
  const start = field("start", row ? row.start : from.toFixed(2), { type: "number", step: "any" }), end = field("end", row ? row.end : to.toFixed(2), { type: "number", step: "any" });
  const note = field("note", row ? row.note : "");
  const given = () => ["--kind", kind.value, "--control", control.value, "--span", start.value, end.value, "--note", note.value];
  const at = view.row, send = (words) => change(async () => { const written = sent(view.parts.form); await write(words, at); written(); });
  redraw(view.parts.form, [view.record.name, ...(row ? [rowText(row), row.start, row.end] : [])].join(),
    element("h3", {}, row ? `Manoeuvre ${view.row + 1}` : "New manoeuvre"),
    element("div", { class: "wide-fields" }, labelled("kind", kind), labelled("control", control)), element("div", { class: "row" }, labelled("start", start), labelled("end", end)), element("div", { class: "wide-fields" }, labelled("note", note)),
    element("div", { class: "row" },
      row ? button(row.found ? "Accept" : "Change", () => send(given())) : button("Add", () => send(given()), { class: "first" }),
      row && !row.found && button("Remove", () => send(["--remove"])),
      row && button("New", () => { view.row = null; manoeuvres(); placeMarks(); }),
      button("Times of the screen", () => { const [a, b] = shown(); start.value = a.toFixed(2); end.value = b.toFixed(2); })));
}
const change = (work) => attempt(work, view.parts.error);
async function write(given, row) {   // the project's table gets the row; the project names the table
  const { project, record } = view, tableFile = project.manoeuvres || "{project}/manoeuvres.csv";
  const found = row != null && record.manoeuvres.rows[row].found;   // it is in no table yet
  const names = project.names ? ["--names", project.names] : [], start = ["--start-from", record.file, ...names];
  const values = given.filter((word, i) => !(word === "--note" && !given[i + 1]) && !(i && given[i - 1] === "--note" && !word));
  await act(["flight", "mark", tableFile, record.name, ...start, ...(row == null || found ? [] : ["--row", String(row + 1)]), ...values]);
  if (!project.manoeuvres) await act(["set", `{project}/${project.file}`, "manoeuvres", "manoeuvres.csv"]);
}
async function acceptAll() {
  for (const row of view.record.manoeuvres.rows.filter((one) => one.found)) await write(["--kind", row.manoeuvre, "--control", row.control, "--span", String(row.start), String(row.end), "--note", row.note], null);
}
function placeMarks() {
  const node = view.parts.marks, [from, to] = shown(), over = node.clientWidth;
  const at = (time) => ((time - from) / (to - from)) * over;
  node.replaceChildren(...view.record.manoeuvres.rows.map((row, i) => {
    if (row.end < from || row.start > to) return null;
    const box = element("button", { type: "button", class: `mark-box${row.found ? " found" : ""}`, "aria-pressed": i === view.row ? "true" : "false", title: `${rowText(row)}: ${row.start} to ${row.end} s. Drag to move, drag an edge to change it.`, "aria-label": `${rowText(row)}, ${number(row.start, 6)} to ${number(row.end, 6)} s` }, element("span", {}, rowText(row)));
    box.dataset.row = i;
    box.style.left = `${at(row.start)}px`;
    box.style.width = `${at(row.end) - at(row.start)}px`;
    box.onkeydown = (event) => { if (event.key === "Enter" || event.key === " ") { event.preventDefault(); choose(i); } };
    return box;
  }).filter(Boolean));
}
// The edge under the pointer: the nearest one in reach; between adjoining marks that of the side on which the pointer is.
// The middle third of the mark under the pointer always moves that mark.
function edgeAt(event) {
  const strip = view.parts.marks, x = event.clientX - strip.getBoundingClientRect().left - strip.clientLeft, under = event.target.closest(".mark-box");
  const near = [...strip.querySelectorAll(".mark-box")].flatMap((box) => {
    const a = box.offsetLeft, b = a + box.offsetWidth, inside = x >= a && x < b, reach = inside ? Math.min(REACH, (b - a) / 3) : REACH;
    return [["left", Math.abs(x - a)], ["right", Math.abs(x - b)]].map(([edge, distance]) => ({ box, edge, inside, distance, reached: distance <= reach }));
  });
  const own = near.filter((one) => one.box === under);
  if (own.length && !own.some((one) => one.reached)) return null;
  const reached = near.filter((one) => one.reached).sort((one, other) => one.distance - other.distance);
  const nearest = reached.filter((one) => one.distance < reached[0].distance + 1);   // boxes lie on whole pixels
  return nearest.find((one) => one.box === under) || nearest.find((one) => one.inside) || nearest[0] || null;
}
function grab(event) {
  if (event.button !== 0) return;
  const found = edgeAt(event), box = found ? found.box : event.target.closest(".mark-box");
  if (!box) return;
  const i = Number(box.dataset.row), row = view.record.manoeuvres.rows[i], edge = found ? found.edge : "both";
  const [from, to] = shown(), perPixel = (to - from) / view.parts.marks.clientWidth, origin = { start: row.start, end: row.end };
  let moved = false;
  const move = (now) => {
    const by = (now.clientX - event.clientX) * perPixel;
    if (Math.abs(now.clientX - event.clientX) > 3) moved = true;
    if (edge !== "right") row.start = origin.start + by;
    if (edge !== "left") row.end = origin.end + by;
    if (edge === "left") row.start = Math.min(row.start, row.end - 0.1);
    if (edge === "right") row.end = Math.max(row.end, row.start + 0.1);
    box.style.left = `${(row.start - from) / perPixel}px`;
    box.style.width = `${(row.end - row.start) / perPixel}px`;
    for (const { made } of view.plots) made.redraw();
  };
  const end = (last) => {
    removeEventListener("pointermove", move);
    removeEventListener("pointerup", end);
    removeEventListener("pointercancel", end);
    if (!moved || last.type === "pointercancel") { Object.assign(row, origin); choose(i, false); return; }
    const [start, stop] = [row.start.toFixed(2), row.end.toFixed(2)];
    if (row.found) { Object.assign(row, { start: Number(start), end: Number(stop) }); choose(i, false); return; }   // written when it is accepted
    change(async () => { try { await write(["--span", start, stop], i); } catch (error) { Object.assign(row, origin); placeMarks(); throw error; } });
  };
  event.preventDefault();
  addEventListener("pointermove", move);
  addEventListener("pointerup", end);
  addEventListener("pointercancel", end);
}

// ---- reconstruction, faults, coverage --------------------------------------------------------------------------------
function path() {
  const { record, project } = view, names = project.names ? ["--names", project.names] : [];
  const run = (words, output) => attempt(() => act(["flight", "reconstruct", ...words, "--aircraft", project.aircraft, ...names, "-o", output], { wait: 1 }), view.parts.error);
  const files = project.records.filter((one) => one.name !== record.name);
  view.parts.path.replaceChildren(
    element("p", {}, record.reconstructed ? "Reconstructed: its channels stand in the panels of the recorded ones." : "Not reconstructed."),
    element("div", { class: "row" },
      button(record.reconstructed ? "Reconstruct again" : "Reconstruct", () => run([record.file], `{work}/paths/${record.name}.nc`)),
      files.length ? button("All records as one programme", () => run(project.records.map((one) => one.file), "{work}/paths")) : ""));
}
async function check() {
  const own = view, node = view.parts.faults, name = view.record.name;
  node.replaceChildren(element("p", { class: "quiet" }, "checking ..."));
  const found = await attempt(() => get("/api/check", { name }), node);
  if (found && own === view && view.record.name === name) { view.findings = found; faults(); }
}
function faults() {
  const node = view.parts.faults;
  if (!view.findings) {
    node.replaceChildren(button("Check the record", check));
    return;
  }
  node.replaceChildren(element("p", {}, view.findings.verdict), ...view.findings.findings.map((one) => element("div", { class: `finding ${one.severity}` },
    element("p", {}, element("b", {}, one.severity), ` ${one.text}`),
    one.remedy && element("p", { class: "quiet" }, `Remedy: ${one.remedy}`),
    element("div", { class: "row" },
      one.start != null && button("Show", () => { show(one.channels); zoom([one.start - 2, (one.stop ?? one.start) + 2]); }),
      one.channels.length && one.start == null && button("Show channel", () => show(one.channels)),
      remedy(one)))));
}
function show(channels) {
  for (const one of view.record.channels) if (channels.includes(one.channel)) view.chosen.add(place(one));
  channelList();
  attempt(draw);
}
function remedy(one) {   // lines of the name map are put in the place of those that stand there; then the record is another one
  if (!one.entries.length || !view.project.names) return null;
  return button(`Write ${one.entries.map(({ key: line }) => line).join(", ")} into the name map`, () => change(async () => {
    for (const { key: line, value } of one.entries) await act(["set", view.project.names, line, value]);
    await check();
  }));
}
async function coverage() {
  const own = view, node = view.parts.coverage;
  if (!view.points) {
    node.replaceChildren(button("Test points of all records", async () => {
      node.replaceChildren(element("p", { class: "quiet" }, "reading ..."));
      const names = view.project.records.map((one) => one.name).join(","), found = await attempt(() => get("/api/coverage", { names }), node);
      if (!found || own !== view) return;
      view.points = found;
      view.axes = axesOf(found);
      coverage();
      const level = await attempt(() => get("/api/one_g", { names }), view.parts.error);
      if (level && own === view) { view.level = level; coverage(); }
    }));
    return;
  }
  const { points: all, units } = view.points, [across, up] = view.axes, settings = [...new Set(all.map((one) => one.configuration))].sort();
  if (view.setting == null) view.setting = settings.includes("clean") ? "clean" : "";   // as LR-743 Fig. 9
  const of = (one) => !view.setting || one.configuration === view.setting, points = all.filter(of), rows = points.filter((one) => one[across] != null && one[up] != null);
  const names = Object.keys(units).filter((name) => all.some((one) => one[name] != null)), choice = (i) => select(names, view.axes[i], (name) => { view.axes[i] = name; coverage(); }, { "aria-label": i ? "vertical" : "horizontal" });
  const lines = view.level && [across, up].includes("alpha") && [across, up].some((name) => name === "mach" || name === "V_cas") ? view.level.lines.filter(of) : [];
  node.replaceChildren(element("div", { class: "row" }, choice(1), "over", choice(0)),
    select([["", "all configurations"], ...settings], view.setting, (text) => { view.setting = text; coverage(); }, { "aria-label": "configuration of the test points" }), scatter(rows, across, up, units, lines), ...lineKey(lines));
}
const lineText = (line) => `${line.h}, ${line.mass} kg, ${line.configuration}`;
const dash = (i) => DASHES[i % DASHES.length].join(" ");
function lineKey(lines) {   // pattern and colour, and the number of the line at its end: never colour alone
  if (!view.level) return [element("p", { class: "quiet" }, "1 g lines are computed ...")];
  if (!view.level.model) return [element("p", { class: "quiet" }, "1 g lines are drawn after a match, by its database.")];
  if (!lines.length) return [element("p", { class: "quiet" }, "1 g lines stand over alpha and Mach number or airspeed.")];
  const swatch = (i) => drawing("svg", { width: 30, height: 10, "aria-hidden": "true" }, drawing("path", { d: "M1 5H29", stroke: colour(`line-${i % DASHES.length}`), "stroke-width": 1.6, "stroke-dasharray": dash(i) }));
  return [element("p", { class: "quiet" }, `1 g: level flight of ${view.level.model} at the mean mass of the points.`),
    element("ol", { class: "list keyed" }, lines.map((line, i) => element("li", {}, swatch(i), ` ${i + 1}: ${lineText(line)}`))),
    view.level.remarks.length ? element("details", {}, element("summary", {}, `${view.level.remarks.length} without a line`), view.level.remarks.map((text) => element("p", { class: "quiet" }, text))) : ""];
}
function axesOf({ points }) {
  const has = (name) => points.some((one) => one[name] != null);
  return [has("mach") ? "mach" : "V_cas", has("alpha") ? "alpha" : "h"];
}
function scatter(rows, across, up, units, lines) {
  const width = 300, height = 270, left = 46, bottom = 32, limits = (name) => { const all = rows.map((row) => row[name]), low = Math.min(...all), high = Math.max(...all), room = 0.06 * (high - low || 1); return [low - room, high + room]; };
  if (!rows.length) return element("p", {}, "No manoeuvre has both.");
  const [x0, x1] = limits(across), [y0, y1] = limits(up);
  const x = (value) => left + ((value - x0) / (x1 - x0)) * (width - left - 6), y = (value) => height - bottom - ((value - y0) / (y1 - y0)) * (height - bottom - 8);
  const words = (text, more) => { const node = drawing("text", more); node.textContent = text; return node; }, title = (text) => { const node = drawing("title"); node.textContent = text; return node; };
  const taken = [], apart = (at) => { while (taken.some((one) => Math.abs(one - at) < 11)) at -= 2; taken.push(at); return at; };   // numbers at the ends of lines
  const curve = (line, i) => {   // inside the limits only; its number stands at the end
    const inside = line[across].map((value, k) => [value, line[up][k]]).filter(([a, b]) => a >= x0 && a <= x1 && b >= y0 && b <= y1);
    if (inside.length < 2) return null;
    const [a, b] = inside[inside.length - 1];
    return drawing("g", { role: "img", "aria-label": `1 g line ${i + 1}: ${lineText(line)}` }, title(lineText(line)),
      drawing("path", { d: `M${inside.map(([one, other]) => `${x(one).toFixed(1)} ${y(other).toFixed(1)}`).join("L")}`, fill: "none", stroke: colour(`line-${i % DASHES.length}`), "stroke-width": 1.4, "stroke-dasharray": dash(i) }),
      words(String(i + 1), { x: Math.min(x(a) + 2, width - 8), y: apart(y(b) - 3), fill: colour(`line-${i % DASHES.length}`) }));
  };
  return drawing("svg", { viewBox: `0 0 ${width} ${height}`, width: "100%", role: "group", "aria-label": `${up} over ${across}, one point for each manoeuvre` },
    drawing("path", { d: `M${left} 4V${height - bottom}H${width - 4}`, fill: "none", stroke: "currentColor" }),
    ticks(x0, x1, 4).map((value) => words(number(value, 3), { x: x(value), y: height - bottom + 14, "text-anchor": "middle" })),
    ticks(y0, y1, 5).map((value) => words(number(value, 3), { x: left - 4, y: y(value) + 4, "text-anchor": "end" })),
    words(`${across} ${units[across]}, ${up} ${units[up]}`, { x: width - 6, y: height - 4, "text-anchor": "end" }),
    lines.map(curve),
    rows.map((row) => {
      const own = row.record === view.record.name, mark = drawing("circle", { cx: x(row[across]), cy: y(row[up]), r: own ? 4.5 : 3, fill: own ? colour("line-1") : "none", stroke: colour(own ? "line-1" : "line-5"), "pointer-events": "all", tabindex: 0, role: "button", "aria-label": `${row.record}, ${rowText(row)}` });
      mark.append(title(`${row.record}: ${rowText(row)}, ${row.configuration}, ${across} ${number(row[across])}, ${up} ${number(row[up])}`));
      const chosen = () => attempt(async () => { await load(row.record); zoom([row.start - 1, row.end + 1]); });
      mark.addEventListener("click", chosen);
      mark.addEventListener("keydown", (event) => { if (event.key === "Enter") chosen(); });
      return mark;
    }));
}
