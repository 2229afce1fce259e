// ---- records: channels over one time axis, manoeuvres, faults, coverage ----------------------------------------------
import { attempt, button, element, get, inTurn, key } from "./core.js";
import { faults, path } from "./record_checks.js";
import { coverage } from "./record_coverage.js";
import { choose, edgeAt, grab, manoeuvres, nextRow } from "./record_marks.js";
import { draw, drawSoon, drop } from "./record_panels.js";
import { allLines, place, rowText, setView, view } from "./record_state.js";
import { pan, scale, scrolled, wheel, zoom } from "./record_time.js";
import { checkExpressions, compareForm, expressionForm, otherRecord, savedExpressions } from "./record_expressions.js";
import { toggleCursors, toolBar, tools } from "./record_tools.js";

const FIRST = ["delta_e", "delta_a", "delta_r", "q", "p", "r", "alpha_vane", "V_cas", "h_baro", "az", "V", "alpha", "theta", "phi"];
const MOST_FIRST = 7;

export function open(host) {
  setView({
    host, parts: {}, chosen: null, joined: new Map(), expressions: savedExpressions(), other: null, cursors: null, tools: new Set(),
    plots: [], span: null, fetched: null, row: null, record: null, refresh: inTurn(refresh), changed: () => attempt(view.refresh),
  });
  const part = (name, node) => (view.parts[name] = node);
  host.replaceChildren(element("div", { class: "columns" },
    element("nav", { class: "column", "aria-label": "Records and channels" },
      element("h2", {}, "Records"), part("records", element("ul", { class: "list" })),
      element("h2", {}, "Second record"), part("compare", element("div")),
      element("h2", {}, "Expressions"), part("expressions", element("div")),
      element("h2", {}, "Channels"), part("filter", element("input", { type: "search", placeholder: "name", "aria-label": "Show channels with this text", oninput: channelList })),
      part("channels", element("div"))),
    element("div", { class: "column", id: "plots-column" },
      element("div", { class: "row" }, part("name", element("h2", {}, "")), part("error", element("div")),
        button("All", () => zoom(null), { title: "Whole record (r)" }), button("\u2212", () => scale(2), { "aria-label": "Zoom out" }), button("+", () => scale(0.5), { "aria-label": "Zoom in" }),
        button("\u2190", () => pan(-0.2), { "aria-label": "Earlier" }), button("\u2192", () => pan(0.2), { "aria-label": "Later" }), part("span", element("span", { class: "quiet" })), part("toolbar", element("span", { class: "row" }))),
      part("tools", element("div")),
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
  key("c", "two cursors", () => toggleCursors());
  return view.refresh();
}
export function close() {
  document.removeEventListener("changed", view.changed);
  view.resized.disconnect();
  drop();
  setView(null);
}

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
export async function load(name, again = false) {
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
  if (before !== name) { await checkExpressions(name); await otherRecord(view.other && view.other.name !== name ? view.other.name : ""); }
  if (own !== view || turn !== own.loading) return;
  const known = new Set(allLines().map(place));
  if (view.chosen) {
    for (const one of [...view.chosen]) if (!known.has(one)) view.chosen.delete(one);
    if (!again || before !== name) pair();
  }
  if (!view.chosen || !view.chosen.size) first();
  view.parts.name.textContent = found.title || name;
  recordList();
  channelList();
  toolBar();
  compareForm();
  tools();
  manoeuvres();
  path();
  faults();
  coverage();
  await draw();
}
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
export function channelList() {
  const wanted = view.parts.filter.value.trim().toLowerCase(), leaves = new Map();
  for (const one of view.record.channels) if (!wanted || `${one.channel} ${one.meaning}`.toLowerCase().includes(wanted)) leaves.set(one.leaf, [...(leaves.get(one.leaf) || []), one]);
  const box = (one) => element("li", {}, element("label", { title: one.meaning }, element("input", {
    type: "checkbox", checked: view.chosen.has(place(one)),
    onchange: (event) => { if (event.target.checked) view.chosen.add(place(one)); else leave(one); drawSoon(); },
  }), ` ${one.channel} `, element("span", { class: "quiet" }, one.unit)));
  view.parts.channels.replaceChildren(...[...leaves].map(([leaf, items]) => element("details", { open: "" }, element("summary", {}, leaf === "path" ? "reconstructed" : leaf), element("ul", { class: "list" }, items.map(box)))));
  expressionForm();
}
export function leave(line) {   // a line that is taken away has no panel of its own choice any more
  view.chosen.delete(place(line));
  view.joined.delete(place(line));
}
