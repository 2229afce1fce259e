// ---- databases: terms as families and maps, nodes, edits with their history, two compared ----------------------------
import { act, attempt, button, colour, drawing, element, get, inTurn, labelled, number, redraw, select, sent, table, ticks } from "./core.js";

const MOST_CURVES = 6, MOST_NUMBERS = 240, FOLDER = "{work}/databases/";
const MARKERS = [(x, y) => `M${x - 3} ${y}a3 3 0 1 0 6 0a3 3 0 1 0 -6 0`, (x, y) => `M${x - 3} ${y - 3}h6v6h-6z`, (x, y) => `M${x} ${y - 4}l4 7h-8z`,
  (x, y) => `M${x} ${y - 4}l4 4l-4 4l-4 -4z`, (x, y) => `M${x - 3} ${y - 3}l6 6m0 -6l-6 6`, (x, y) => `M${x} ${y - 4}v8m-4 -4h8`];
let view = null;

export async function open(host) {
  const kept = JSON.parse(sessionStorage.getItem("database") || "{}");
  view = { host, parts: {}, file: kept.file, against: kept.against || null, name: kept.term, at: {}, drawn: "curves", below: "nodes", node: null, refresh: inTurn(refresh), changed: () => attempt(view.refresh) };
  const part = (name, node) => (view.parts[name] = node);
  host.replaceChildren(element("div", { class: "columns database" },
    element("nav", { class: "column", "aria-label": "Databases and terms" },
      element("h2", {}, "Database"), part("files", element("div")), part("about", element("details", {}, element("summary", {}, "Reference quantities"))),
      element("h2", {}, "Terms"), part("filter", element("input", { type: "search", placeholder: "name", "aria-label": "Show terms with this text", oninput: termList })),
      part("terms", element("div"))),
    element("div", { class: "column" },
      part("head", element("div", { class: "row" })), part("error", element("div")), part("controls", element("div", { class: "row" })),
      part("figure", element("div")), part("key", element("div", { class: "row quiet" })), part("tabs", element("div", { class: "row" })), part("below", element("div", { class: "scroll" }))),
    element("aside", { class: "column", "aria-label": "Edits and history" },
      part("edit", element("div")), element("h2", {}, "Fly it"), part("fly", element("div")), element("h2", {}, "History"), part("history", element("div")))));
  view.resized = new ResizeObserver(() => { if (view && view.term && view.width !== view.parts.figure.clientWidth) draw(); });
  view.resized.observe(view.parts.figure);
  document.addEventListener("changed", view.changed);
  await view.refresh();
}
export function close() {
  document.removeEventListener("changed", view.changed);
  view.resized.disconnect();
  view = null;
}

// ---- what is chosen --------------------------------------------------------------------------------------------------
async function refresh() {
  const own = view, { files } = await get("/api/databases");
  if (own !== view) return;
  view.files = files;
  if (!files.length) { view.parts.files.replaceChildren(element("p", {}, "No database yet; a match makes datcom, corrected and final.")); return; }
  if (!files.some((one) => one.file === view.file)) view.file = (files.find((one) => one.label === "final") || files[files.length - 1]).file;
  if (view.against === null) view.against = (files.find((one) => one.label === "datcom" && one.file !== view.file) || { file: "" }).file;
  if (view.against === view.file || !files.some((one) => one.file === view.against)) view.against = "";
  fileChoice();
  const found = await get("/api/database", { file: view.file });
  if (own !== view) return;
  view.database = found;
  view.comparison = null;
  if (!found.terms.some((one) => one.term === view.name)) view.name = found.terms[0].term;
  view.parts.about.replaceChildren(element("summary", {}, found.title), ...found.about.map((text) => element("p", { class: "quiet" }, text)));
  termList();
  historyList();
  flying();
  await load();
}
const labelOf = (file) => { const found = view.files.find((one) => one.file === file); return found ? found.label : file; };
function fileChoice() {
  const place = (one) => [one.file, `${one.label} (${one.file.replace("{work}/", "").replace(/\/[^/]*$/, "")})`];
  redraw(view.parts.files, "files",
    labelled("Show", select(view.files.map(place), view.file, (file) => { view.file = file; view.parts.edit.about = ""; if (view.against === file) view.against = ""; attempt(view.refresh, view.parts.error); })),
    labelled("Against", select([["", "none"], ...view.files.filter((one) => one.file !== view.file).map(place)], view.against, (file) => { view.against = file; view.comparison = null; attempt(load, view.parts.error); })));
}
function termList() {
  const text = view.parts.filter.value.trim().toLowerCase(), shown = view.database.terms.filter((one) => one.term.toLowerCase().includes(text)), groups = new Map();
  for (const one of shown) groups.set(one.coefficient, [...(groups.get(one.coefficient) || []), one]);
  const per = (one) => [one.regressors.length && `per ${one.regressors.join(" ")}`, one.power && `times ${one.power.replace(/\d+\.\d+/g, (digits) => number(Number(digits), 3))}`].filter(Boolean).join(", ");
  const axes = (one) => [one.axes.map((axis) => `${axis.name}\u00a0${axis.points.length}`).join(" \u00d7 ") || "one number", per(one)].filter(Boolean).join("; ");
  const source = (one) => Object.entries(one.source).map(([name, share]) => (share === 1 ? name : `${name} ${Math.round(100 * share)}\u00a0%`)).join(", ");
  view.parts.terms.replaceChildren(...[...groups].flatMap(([name, rows]) => [element("h3", {}, name),
    table([["term", (one) => one.term.split("/")[1]], ["axes; source", (one) => element("span", {}, axes(one), element("small", { class: "quiet" }, source(one)))], ["nodes", "size", { number: true }]], rows,
      { label: `Terms of ${name}`, chosen: (one) => one.term === view.name, onchoose: (one) => { view.name = one.term; view.node = null; attempt(load, view.parts.error); } })]));
}
async function load() {
  if (!view.name) return;   // the terms are on their way, and are loaded with what is chosen by then
  const own = view, turn = (own.loading = (own.loading || 0) + 1), wanted = view.name, files = [view.file, view.against].filter(Boolean).join(",");
  sessionStorage.setItem("database", JSON.stringify({ file: view.file, against: view.against, term: view.name }));
  const found = await get("/api/term", { term: wanted, files });
  if (own !== view || turn !== own.loading) return;
  if (!view.term || JSON.stringify(view.term.nodes.axes) !== JSON.stringify(found.nodes.axes)) view.node = null;   // its place is another one
  const fresh = !view.term || view.term.term !== found.term;
  view.term = found;
  if (fresh || found.axes.some((axis) => view.at[axis.name] == null) || view.over == null) {
    const names = found.axes.map((axis) => axis.name), own = found.nodes.axes.map((axis) => axis.name);
    view.over = ["alpha", "delta_e", "delta_a", "delta_r", "beta", "h_agl"].find((name) => own.includes(name)) || own[0] || names[0];
    view.by = names.find((name) => name !== view.over) || null;
    view.at = Object.fromEntries(found.axes.map((axis) => [axis.name, axis.name === view.by ? 0 : middle(axis.name)]));
    view.band = among();
  }
  for (const row of view.parts.terms.querySelectorAll("tbody tr")) row.removeAttribute("aria-selected");
  termList();
  show();
}
// breakpoints of an axis that can be chosen: those of the database shown, where it has the axis
const known = (name) => view.term.nodes.axes.find((axis) => axis.name === name) || view.term.axes.find((axis) => axis.name === name);
const middle = (name) => Math.floor((known(name).points.length - 1) / 2);
const joint = (name, value) => nearest(view.term.axes.find((axis) => axis.name === name).points, value);
const nearest = (points, value) => points.reduce((best, point, i) => (Math.abs(point - value) < Math.abs(points[best] - value) ? i : best), 0);
const read = (name, value) => `${number(value)}${unit(name)}`;
const unit = (name) => { const found = known(name).unit; return found ? ` ${found}` : ""; };
const place = (axes, at) => axes.reduce((sum, axis) => sum * axis.points.length + at[axis.name], 0);
const among = () => { const own = family(); return own[0] == null ? "" : String(own[Math.floor((own.length - 1) / 2)]); };   // one band stays readable where six lie over each other
const family = () => (view.by ? Array.from({ length: Math.min(MOST_CURVES, known(view.by).points.length) }, (_, i) => i + view.at[view.by]) : [null]);

function show() {
  const { term } = view, per = term.regressors.length ? `, per ${term.regressors.join(" \u00b7 ")} (SI)` : "", names = term.axes.map((axis) => axis.name);
  view.parts.head.replaceChildren(element("h2", {}, term.term), element("span", { class: "quiet" }, `${labelOf(term.file)}${per}${term.power ? `, times ${term.power}` : ""}${term.factors.length ? `, before its factors ${term.factors.join(", ")}` : ""}`),
    ...term.lacking.map((file) => element("span", { class: "fail" }, `not in ${labelOf(file)}`)));
  const controls = [];
  if (names.length) controls.push(labelled("Over", select(names, view.over, (name) => { if (view.by === name) view.by = view.over; view.over = name; if (view.by) fit(); show(); })));
  if (names.length > 1) {
    controls.push(labelled("Curves by", select(names.filter((name) => name !== view.over), view.by, (name) => { view.at[view.by] = middle(view.by); view.by = name; view.at[name] = 0; view.band = among(); show(); })));
    controls.push(button("Curves", () => { view.drawn = "curves"; show(); }, { "aria-pressed": String(view.drawn === "curves") }), button("Map", () => { view.drawn = "map"; show(); }, { "aria-pressed": String(view.drawn === "map") }));
    if (view.drawn === "curves") { controls.push(labelled("Band of", (view.parts.band = element("span")))); bandChoice(); }
  }
  const slider = (name, most, text) => {
    const words = element("span", { class: "quiet" }, text());
    return element("label", { class: "row" }, element("span", {}, name), element("input", { type: "range", min: 0, max: most, step: 1, value: view.at[name], "aria-label": name, "aria-valuetext": text(),
      oninput: (event) => { view.at[name] = Number(event.target.value); words.textContent = text(); event.target.setAttribute("aria-valuetext", text()); if (name === view.by) { view.band = among(); bandChoice(); } draw(); below(); } }), words);
  };
  const points = (name) => known(name).points;
  if (view.by && view.drawn === "curves" && points(view.by).length > MOST_CURVES)
    controls.push(slider(view.by, points(view.by).length - MOST_CURVES, () => `${read(view.by, points(view.by)[view.at[view.by]])} to ${read(view.by, points(view.by)[view.at[view.by] + MOST_CURVES - 1])}`));
  for (const name of names.filter((one) => one !== view.over && one !== view.by)) controls.push(slider(name, points(name).length - 1, () => read(name, points(name)[view.at[name]])));
  view.parts.controls.replaceChildren(...controls);
  draw();
  below();
  form();
}
function bandChoice() {
  view.parts.band.replaceChildren(select([["", "all"], ...family().map((i) => [String(i), read(view.by, known(view.by).points[i])])], view.band, (value) => { view.band = value; draw(); }, { "aria-label": "Band of" }));
}
function fit() { view.at[view.by] = 0; view.band = among(); }

// ---- figures ---------------------------------------------------------------------------------------------------------
function along(curve, i) {   // value and standard error of one curve over the axis, on the common breakpoints
  const { axes } = view.term, at = {};
  for (const axis of axes) at[axis.name] = axis.name === view.over ? 0 : joint(axis.name, known(axis.name).points[axis.name === view.by ? i : view.at[axis.name]]);
  return axes.find((axis) => axis.name === view.over).points.map((x, n) => { const where = place(axes, { ...at, [view.over]: n }); return { x, value: curve.value[where], stderr: curve.stderr ? curve.stderr[where] : 0 }; });
}
const text = (words, more) => { const node = drawing("text", more); node.textContent = words; return node; };
const title = (words) => { const node = drawing("title"); node.textContent = words; return node; };
function draw() {
  const host = view.parts.figure;
  view.width = host.clientWidth;
  view.parts.key.replaceChildren();
  if (!view.term.axes.length) { host.replaceChildren(single()); return; }
  host.replaceChildren(view.drawn === "map" && view.by ? map() : curves());
}
const pointsOf = (term) => (term.points.kind === "partial" ? `the measured ${term.points.of} less all other terms of ${labelOf(term.file)} (partial residuals), one for each manoeuvre that excites the term` : `local flight estimates of the whole ${term.points.of}`);
function single() {
  return table([["database", (one) => labelOf(one.file)], ["value", (one) => number(one.value[0], 6), { number: true }], ["standard error", (one) => (one.stderr ? number(one.stderr[0], 3) : "not stated"), { number: true }], ["source", (one) => (one.source ? one.source[0] : "")]],
    [...view.term.curves, ...view.term.points.rows.map((one) => ({ file: one.fit, value: [one.value], stderr: [one.stderr], source: [view.term.points.kind === "partial" ? "partial residual" : "local estimate"] }))], { label: `${view.term.term} in each database` });
}
function curves() {
  const { term } = view, width = Math.max(420, view.width - 4), height = 390, left = 62, right = 84, bottom = 40, top = 10, shown = family();
  const axis = known(view.over), [main] = term.curves.filter((one) => one.file === term.file), other = term.curves.find((one) => one.file !== term.file);
  const drawn = shown.map((i, n) => ({ i, n, line: n % 6, rows: along(main, i), other: other && along(other, i) }));
  const banded = (one) => main.stderr && (one.i == null || view.band === "" || String(one.i) === view.band);
  const all = drawn.flatMap((one) => [...one.rows.flatMap((row) => (banded(one) ? [row.value - 2 * row.stderr, row.value + 2 * row.stderr] : [row.value])), ...(one.other || []).map((row) => row.value)]);
  all.push(...term.points.rows.flatMap((one) => (view.over in one.at ? [one.value - 2 * one.stderr, one.value + 2 * one.stderr] : [])));
  const xs = drawn[0].rows.map((row) => row.x), x0 = xs[0], x1 = xs[xs.length - 1] === x0 ? x0 + 1 : xs[xs.length - 1], least = Math.min(...all), most = Math.max(...all), room = 0.04 * (most - least || Math.abs(most) || 1);
  const y0 = least - room, y1 = most + room, x = (value) => left + ((value - x0) / (x1 - x0)) * (width - left - right), y = (value) => height - bottom - ((value - y0) / (y1 - y0)) * (height - bottom - top);
  const line = (rows, key = (row) => row.value) => rows.map((row, i) => `${i ? "L" : "M"}${x(row.x).toFixed(1)} ${y(key(row)).toFixed(1)}`).join("");
  const parts = [];
  for (const value of ticks(y0, y1)) parts.push(drawing("path", { d: `M${left} ${y(value)}H${width - right}`, stroke: colour("grid") }), text(number(value, 4), { x: left - 6, y: y(value) + 4, "text-anchor": "end" }));
  for (const value of ticks(x0, x1, 8)) parts.push(drawing("path", { d: `M${x(value)} ${top}V${height - bottom}`, stroke: colour("grid") }), text(number(value, 4), { x: x(value), y: height - bottom + 15, "text-anchor": "middle" }));
  parts.push(text(`${axis.meaning} ${axis.name}${axis.unit ? ` [${axis.unit}]` : ""}`, { x: (left + width - right) / 2, y: height - 6, "text-anchor": "middle" }));
  for (const one of drawn) if (banded(one)) parts.push(drawing("path", { d: `${line(one.rows, (row) => row.value + 2 * row.stderr)}${line([...one.rows].reverse(), (row) => row.value - 2 * row.stderr).replace("M", "L")}Z`, fill: colour(`line-${one.line}`), "fill-opacity": 0.13, stroke: "none" }));
  for (const one of drawn) {
    const stroke = colour(`line-${one.line}`);
    if (one.other) parts.push(drawing("path", { d: line(one.other), fill: "none", stroke, "stroke-width": 1.2, "stroke-dasharray": "6 4" }));
    parts.push(drawing("path", { d: line(one.rows), fill: "none", stroke, "stroke-width": 1.7 }));
    const nodes = new Set(axis.points.map((value) => joint(view.over, value)));
    one.rows.forEach((row, i) => { if (nodes.has(i)) parts.push(drawing("path", { d: MARKERS[one.line](x(row.x), y(row.value)), fill: colour("paper"), stroke, "stroke-width": 1.2 }, title(`${read(view.over, row.x)}: ${number(row.value)}${main.stderr ? ` \u00b1 ${number(row.stderr, 2)}` : ""}`))); });
  }
  if (view.by) parts.push(text(`${view.by}${unit(view.by) && ` [${unit(view.by).trim()}]`}`, { x: width - right + 8, y: top + 2 }));
  const ends = drawn.map((one) => ({ one, y: y(one.rows[one.rows.length - 1].value) })).sort((a, b) => a.y - b.y);
  ends.forEach((end, i) => { if (i && end.y < ends[i - 1].y + 14) end.y = ends[i - 1].y + 14; });
  const over = Math.max(0, ends[ends.length - 1].y - (height - bottom));
  ends.forEach((end) => { if (view.by) parts.push(drawing("path", { d: MARKERS[end.one.line](width - right + 12, end.y - over), fill: colour("paper"), stroke: colour(`line-${end.one.line}`), "stroke-width": 1.2 }), text(number(known(view.by).points[end.one.i]), { x: width - right + 20, y: end.y - over + 4 })); });
  for (const one of term.points.rows) {
    const at = one.at[view.over];
    if (at == null || at < x0 || at > x1) continue;
    const where = Object.entries(one.at).map(([name, value]) => `${name} ${read(name, value)}`).join(", "), words = `${one.fit}: ${number(one.value)} \u00b1 ${number(one.stderr, 2)}, ${where}, ${one.configuration}`;
    parts.push(drawing("g", { tabindex: 0, role: "img", "aria-label": words }, title(words), drawing("path", { d: `M${x(at)} ${y(one.value - 2 * one.stderr)}V${y(one.value + 2 * one.stderr)}`, stroke: colour("quiet") }),
      drawing("circle", { cx: x(at), cy: y(one.value), r: 4, fill: one.clean ? colour("ink") : colour("paper"), stroke: colour("ink"), "stroke-width": 1.4 })));
  }
  parts.push(drawing("path", { d: `M${left} ${top}V${height - bottom}H${width - right}`, fill: "none", stroke: "currentColor" }));
  const swatch = (dash) => drawing("svg", { width: 34, height: 10, "aria-hidden": "true" }, drawing("path", { d: "M1 5H33", stroke: "currentColor", "stroke-width": 1.6, "stroke-dasharray": dash }));
  view.parts.key.replaceChildren(element("span", {}, swatch(""), ` ${labelOf(term.file)}${main.stderr ? " with two standard errors" : ""}`), other ? element("span", {}, swatch("6 4"), ` ${labelOf(other.file)}`) : "",
    view.by ? element("span", {}, `one curve for each ${known(view.by).meaning} (${view.by})`) : "",
    term.points.rows.length ? element("span", {}, `Points: ${pointsOf(term)}. Filled: clean; open: other configurations; bars of two standard errors.`) : "");
  return drawing("svg", { viewBox: `0 0 ${width} ${height}`, width, height, role: "group", "aria-label": `${term.term} over ${view.over}` }, parts);
}
function map() {
  const { term } = view, main = term.curves.find((one) => one.file === term.file), across = known(view.over), up = known(view.by), width = Math.max(420, view.width - 4), left = 70, bottom = 40;
  const rows = up.points.map((_, i) => { const all = along(main, i); return across.points.map((value) => all[joint(view.over, value)]); }), cell = { w: (width - left - 4) / across.points.length, h: Math.max(18, Math.min(34, 330 / up.points.length)) };
  const height = cell.h * up.points.length + bottom + 4, [low, high] = [Math.min, Math.max].map((end) => end(...rows.flat().map((row) => row.value))), signs = low < 0 && high > 0, largest = Math.max(-low, high) || 1, shade = (value) => (signs ? Math.abs(value) / largest : (value - low) / (high - low || 1)), numbers = rows.flat().length <= MOST_NUMBERS && cell.w > 36;
  const shown = 10 ** (Math.floor(Math.log10(Math.max(-low, high, 1e-300))) - (cell.w > 52 ? 2 : 1));   // of what the largest is, three digits, or two where cells are narrow
  const cells = rows.flatMap((line, i) => line.map((row, j) => {
    const words = `${view.over} ${read(view.over, row.x)}, ${view.by} ${read(view.by, up.points[i])}: ${number(row.value)}${main.stderr ? `, standard error ${number(row.stderr, 2)}` : ""}`, [cx, cy] = [left + j * cell.w, 4 + (up.points.length - 1 - i) * cell.h];
    return drawing("g", { tabindex: 0, role: "img", "aria-label": words }, title(words), drawing("rect", { x: cx, y: cy, width: cell.w - 1, height: cell.h - 1, fill: colour(signs && row.value < 0 ? "exit" : "line-1"), "fill-opacity": 0.04 + 0.46 * shade(row.value), stroke: colour("rule"), "stroke-width": 0.5 }),
      numbers ? text(number(Math.round(row.value / shown) * shown, cell.w > 52 ? 3 : 2), { x: cx + cell.w / 2, y: cy + cell.h / 2 + 4, "text-anchor": "middle" }) : null);
  }));
  const step = Math.ceil(34 / cell.w);
  view.parts.key.replaceChildren(element("span", {}, `Shading: ${signs ? "blue positive, orange negative, stronger with the size" : `pale ${number(low, 3)}, strong ${number(high, 3)}`}. Every cell is a node; the value stands in it or appears on focus.`));
  return drawing("svg", { viewBox: `0 0 ${width} ${height}`, width, height, role: "group", "aria-label": `Map of ${term.term}` }, cells,
    across.points.map((value, j) => (j % step ? null : text(number(value, 3), { x: left + (j + 0.5) * cell.w, y: height - bottom + 15, "text-anchor": "middle" }))),
    up.points.map((value, i) => text(number(value, 3), { x: left - 6, y: 4 + (up.points.length - 0.5 - i) * cell.h + 4, "text-anchor": "end" })),
    text(`${view.over}${across.unit ? ` [${across.unit}]` : ""} across, ${view.by}${up.unit ? ` [${up.unit}]` : ""} up`, { x: (left + width) / 2, y: height - 6, "text-anchor": "middle" }));
}

// ---- nodes, comparison -----------------------------------------------------------------------------------------------
function below() {
  const compared = view.against ? `Comparison with ${labelOf(view.against)}` : "Comparison (choose a database to show against)";
  view.parts.tabs.replaceChildren(button("Nodes", () => { view.below = "nodes"; below(); }, { "aria-pressed": String(view.below === "nodes") }),
    button(compared, () => { view.below = "comparison"; below(); }, { "aria-pressed": String(view.below === "comparison"), disabled: !view.against }));
  if (view.below === "comparison" && view.against) attempt(comparison, view.parts.below); else view.parts.below.replaceChildren(nodes());
}
function nodes() {
  const { axes, value, stderr, source } = view.term.nodes, over = axes.find((axis) => axis.name === view.over), by = axes.find((axis) => axis.name === view.by && axis !== over);
  const at = Object.fromEntries(axes.map((axis) => [axis.name, Math.min(view.at[axis.name] ?? 0, axis.points.length - 1)]));
  const cell = (i, j) => {
    const own = { ...at, ...(over ? { [over.name]: i } : {}), ...(by ? { [by.name]: j } : {}) }, where = place(axes, own);
    const words = axes.map((axis) => `${axis.name} ${read(axis.name, axis.points[own[axis.name]])}`).join(", ") || "its only node";
    const made = element("button", { type: "button", class: "node", "aria-pressed": String(Boolean(view.node) && view.node.where === where), "aria-label": `${words}: ${number(value[where])}${stderr ? ` \u00b1 ${number(stderr[where], 2)}` : ""}, ${source ? source[where] : ""}; edit`,
      onclick: () => { view.node = { where, at: own, words }; for (const one of view.parts.below.querySelectorAll(".node")) one.setAttribute("aria-pressed", one === made); form(); } },
      element("span", {}, number(value[where])), stderr ? element("small", { class: "quiet" }, ` \u00b1 ${number(stderr[where], 2)}`) : "");
    return made;
  };
  const further = axes.filter((axis) => axis !== over && axis !== by).map((axis) => `${axis.name} ${read(axis.name, axis.points[at[axis.name]])}`).join(", ");
  const columns = by ? by.points.map((point, j) => [`${by.name} ${read(by.name, point)}`, ([, i]) => cell(i, j), { number: true }]) : [["value", ([, i]) => cell(i, 0), { number: true }]];
  return element("div", {}, further ? element("p", { class: "quiet" }, `At ${further}.`) : "",
    table([...(over ? [[`${over.name}${over.unit ? ` [${over.unit}]` : ""}`, ([point]) => number(point), { number: true }]] : []), ...columns], over ? over.points.map((point, i) => [point, i]) : [[null, 0]], { label: `Nodes of ${view.term.term}, values and standard errors` }));
}
async function comparison() {
  const own = view, of = view.database, [a, b] = [view.against, view.file];
  if (!view.comparison) {
    view.parts.below.replaceChildren(element("p", { class: "quiet" }, "comparing ..."));
    const found = await get("/api/comparison", { a, b });
    if (own !== view || of !== view.database || found.a !== view.against || found.b !== view.file) return;
    view.comparison = found;
  }
  if (view.below !== "comparison") return;
  const { rows, remarks } = view.comparison, where = { both: "both", a: `${labelOf(a)} only`, b: `${labelOf(b)} only` }, terms = rows.filter((row) => row.term.includes("/")), whole = rows.filter((row) => !row.term.includes("/"));
  const columns = [["largest", "max_difference", { number: true, digits: 3 }], ["rms", "rms_difference", { number: true, digits: 3 }], [`std. errors of ${labelOf(a)}`, "max_in_stderr", { number: true, digits: 3 }], [`of ${labelOf(b)}`, "max_in_stderr_b", { number: true, digits: 3 }], ["where", "location"], ["in", (row) => where[row.found_in]]];
  view.parts.below.replaceChildren(element("p", { class: "quiet" }, `Differences ${labelOf(b)} \u2212 ${labelOf(a)}; a row shows the term of both in the figure.`), ...remarks.map((words) => element("p", { class: "fail" }, words)),
    table([["term", "term"], ...columns], terms, { label: "Differences by term", chosen: (row) => row.term === view.name, onchoose: (row) => { view.name = row.term; view.node = null; attempt(load, view.parts.error); } }),
    element("h3", {}, "Whole coefficients"), table([["coefficient", "term"], ...columns, ["conditions", "note"]], whole, { label: "Differences by coefficient" }));
}

// ---- edits: verbs of the command line --------------------------------------------------------------------------------
const editable = () => view.file.startsWith(FOLDER);
function form() {
  const field = (more) => element("input", { type: "text", ...more }), amount = (label, more) => field({ size: 8, inputmode: "decimal", "aria-label": label, ...more });
  const { term, node } = view, stem = editable() ? view.file.slice(FOLDER.length).replace(/\.nc$/, "") : `${labelOf(view.file)}_edited`, own = term.file === view.file;
  const note = field({ placeholder: "why", "aria-label": "Note for the history", value: view.note || "", oninput: (event) => { view.note = event.target.value; } }), name = field({ size: 16, "aria-label": "Name of the new database", value: stem });
  const source = select(["judgement", "flight", "datcom"], "judgement", null, { "aria-label": "Source of the number" }), error = element("div");
  const edit = (words, fields = []) => attempt(async () => {
    const output = `${FOLDER}${name.value.trim()}.nc`;
    if (!/^[\w-]+$/.test(name.value.trim())) throw new Error("the name of the new database has letters, digits, _ and -");
    if (output !== view.file && view.files.some((one) => one.file === output)) throw new Error(`${name.value.trim()} is there already; show it to edit it further, or give another name`);
    const why = note.value.trim() ? ["--note", note.value.trim()] : [];
    const before = view.file, written = sent(view.parts.edit, [...fields, source, note, name]);
    if (view.against === "" || view.against == null) view.against = output === before ? "" : before;
    const { number: job } = await act(["db", "edit", before, ...words, ...why, "-o", output], { wait: 2 });
    written();
    if (view.note === note.value) view.note = "";
    if (words[0] === "blend") view.agreement = { of: `${output} ${words[2]}`, text: (await get("/api/output", { number: job })).out };   // how well the two agree
    if (view.file === before) view.file = output;
    await view.refresh();
  }, error);
  const numeric = (input, what) => { const found = input.value.trim().replace("\u2212", "-"); if (found === "" || !Number.isFinite(Number(found))) throw new Error(`${what}: give a number`); return found; };
  const doubt = (input) => (input.value.trim() ? ["--stderr", numeric(input, "standard error")] : []);
  const checked = (make, ...fields) => attempt(async () => edit(make(), fields), error);
  const parts = [element("h2", {}, "Edit")];
  if (!own) parts.push(element("p", {}, `${labelOf(view.file)} has no ${term.term}.`));
  if (own && node) {
    const text = (values, digits) => String(Number(values[node.where].toPrecision(digits))), value = amount("New value of the node", { value: text(term.nodes.value, 6) });
    const stderr = amount("Its standard error", term.nodes.stderr ? { value: text(term.nodes.stderr, 4) } : { disabled: true });
    const kept = { value: value.value, stderr: stderr.value };   // what is not changed keeps all of its digits
    const places = () => term.nodes.axes.flatMap((axis) => ["--at", `${axis.name}=${axis.points[node.at[axis.name]]}${axis.unit ? ` ${axis.unit}` : ""}`]);
    parts.push(element("h3", {}, "Node"), element("p", {}, node.words), element("div", { class: "row" }, value, "\u00b1", stderr),
      button("Set the node", () => checked(() => ["set", term.term, ...places(), "--value", value.value === kept.value ? String(term.nodes.value[node.where]) : numeric(value, "value"), ...(stderr.value === kept.stderr ? [] : doubt(stderr)), "--source", source.value], value, stderr), { class: "first" }));
  } else if (own) parts.push(element("p", { class: "quiet" }, "A node of the table opens here for editing."));
  if (own) {
    const factor = amount("Factor"), factorDoubt = amount("Standard error of the factor"), more = amount("Amount"), moreDoubt = amount("Standard error of the amount");
    parts.push(element("h3", {}, "Whole term"),
      element("div", { class: "row" }, button("Scale", () => checked(() => ["scale", term.term, "--by", numeric(factor, "factor"), ...doubt(factorDoubt), "--source", source.value], factor, factorDoubt)), factor, "\u00b1", factorDoubt),
      element("div", { class: "row" }, button("Shift", () => checked(() => ["shift", term.term, "--by", numeric(more, "amount"), ...doubt(moreDoubt), "--source", source.value], more, moreDoubt)), more, "\u00b1", moreDoubt));
  }
  if (own && term.nodes.axes.length) parts.push(element("details", {}, element("summary", {}, "Breakpoints: regrid, extend"), ...shape(checked, numeric)));
  const other = view.against && !term.lacking.includes(view.against) ? labelOf(view.against) : "";
  const rule = select([["inverse_variance", "node by node"], ["correlated", "with the correlations of the nodes"]], "inverse_variance", null, { "aria-label": "How the two are weighted" });
  if (other) parts.push(element("h3", {}, `With ${other}`), button(`Take ${term.term} of ${other}`, () => edit(["replace", view.against, term.term])),
    own ? element("div", { class: "row" }, button(`Blend with that of ${other}`, () => edit(["blend", view.against, term.term, "--rule", rule.value])), rule) : "",
    own ? element("p", { class: "quiet" }, "A blend weights both by their standard errors and takes them as independent: the final database of a match holds its prior already.") : "",
    view.agreement && view.agreement.of === `${view.file} ${term.term}` ? agreement(view.agreement.text) : "");
  if (own) parts.push(element("details", {}, element("summary", {}, "Delete the term"), element("p", { class: "quiet" }, "It counts as zero then; it can be undone."), button(`Delete ${term.term}`, () => edit(["delete", term.term]))));
  parts.push(labelled("Source", source), labelled("Note", note), labelled("Save as", name), element("p", { class: "quiet" }, editable() ? "The same name keeps one chain of edits; every one can be undone." : "A database of a match stays as it is; the edit makes a new one."), error);
  redraw(view.parts.edit, `${term.term} ${node ? node.where : ""}`, ...parts);
}
function agreement(text) {   // the table that the command prints, one column a line: the column of the page is narrow
  const lines = text.split("\n"), at = lines.indexOf("how well they agree");
  if (at < 0) return element("pre", { class: "output" }, text);
  const [heads, ...rows] = lines.slice(at + 1).filter((line) => line.trim()).map((line) => line.trim().split(/\s{2,}/));
  return element("div", { role: "group", "aria-label": lines[at] }, element("p", {}, lines[at]),
    rows.map((cells) => element("dl", {}, cells.flatMap((cell, i) => [element("dt", { class: "quiet" }, heads[i]), element("dd", {}, cell)]))));
}
function shape(checked, numeric) {   // the table on other breakpoints, or beyond its ends
  const { axes } = view.term.nodes, chosen = () => axes.find((axis) => axis.name === view.axis) || axes[0], wide = (more) => element("input", { type: "text", class: "wide", ...more });
  const digits = (value) => String(Number(value.toPrecision(9))), [points, further, values, stderr] = [{}, { placeholder: "24 28" }, { "aria-label": "Values beyond the table", placeholder: "values" }, { "aria-label": "Standard errors beyond the table", placeholder: "standard errors, else by rule" }].map(wide);
  const most = element("input", { type: "text", size: 8, inputmode: "decimal", "aria-label": "Largest difference that is allowed", placeholder: "any" }), units = element("span", { class: "quiet" });
  const fill = () => { points.value = points.drawn = chosen().points.map(digits).join(" "); units.textContent = chosen().unit || "without a unit"; };
  const how = select([["hold", "hold the end value"], ["linear", "go on straight"], ["values", "values"]], "hold", (value) => { values.hidden = value !== "values"; }, { "aria-label": "Which values beyond the table" });
  const list = (input, what) => { const found = input.value.replaceAll("\u2212", "-").split(/[\s,]+/).filter(Boolean); if (!found.length || !found.every((one) => Number.isFinite(Number(one)))) throw new Error(`${what}: give numbers with blanks between them`); return found.join(" "); };
  const at = (input, what) => ["--axis", `${chosen().name}=${list(input, what)}${chosen().unit ? ` ${chosen().unit}` : ""}`];
  values.hidden = true;
  fill();
  return [
    element("div", { class: "row" }, axes.length > 1 ? labelled("axis", select(axes.map((axis) => axis.name), chosen().name, (name) => { view.axis = name; fill(); }, { "aria-label": "Axis to change" })) : element("b", {}, chosen().name), units),
    element("label", { class: "block" }, "all breakpoints", points), element("div", { class: "row" }, button("Regrid", () => checked(() => ["regrid", view.term.term, ...at(points, "breakpoints"), ...(most.value.trim() ? ["--tolerance", numeric(most, "largest difference")] : [])], points, most)), labelled("difference at most", most)),
    element("label", { class: "block" }, "beyond the table", further), values, stderr, element("div", { class: "row" }, button("Extend", () => checked(() => ["extend", view.term.term, ...at(further, "breakpoints beyond the table"),
      ...(how.value === "values" ? ["--values", list(values, "values")] : ["--how", how.value]), ...(stderr.value.trim() ? ["--stderr", list(stderr, "standard errors")] : [])], further, values, stderr, how)), how)];
}
function historyList() {
  const { history, undo } = view.database, error = element("div"), short = (words) => (words.length > 130 ? element("details", {}, element("summary", {}, `${words.slice(0, 120)} ...`), words) : words);
  view.parts.history.replaceChildren(
    editable() && undo ? button("Undo the last edit", () => attempt(() => act(["db", "previous", view.file, "--steps", "1", "-o", view.file]), error)) : element("p", { class: "quiet" }, "Edits of a database in the folder databases can be undone here."), error,
    table([["number", (row) => (row.edit == null ? "" : String(row.edit)), { number: true, hidden: true }], ["what was done", (row) => short(row.text)]], [...history].reverse(), { label: "Edits, the last first" }));
}
function flying() {
  const own = view.files.find((one) => one.file === view.file), output = `${FOLDER}${own.label}.fmu`, error = element("div");
  view.parts.fly.replaceChildren(element("p", { class: "quiet" }, `Compiled with ${own.aircraft.replace(/^\{\w+\}\//, "")}; the page of the match flies its cases again with it.`),
    editable() ? button("Write the FMU", () => attempt(() => act(["fmu", "write", own.aircraft, view.file, "-o", output]), error)) : element("p", {}, "An edited database can be written as an FMU."), error);
}
