// ---- manoeuvres of a record: their table, their form, and their boxes over the time axis -----------------------------
import { act, attempt, button, element, labelled, number, redraw, sent, table } from "./core.js";
import { load } from "./records.js";
import { rowText, shown, view } from "./record_state.js";
import { zoom } from "./record_time.js";

const REACH = 6;   // pixels on either side of the edge of a mark
const SOURCES = { table: "from the project's table", record: "as the record carries them" };
export function manoeuvres() {
  const { source, rows } = view.record.manoeuvres, found = rows.filter((row) => row.found).length, searched = view.find === "1";
  redraw(view.parts.table, view.record.name, element("p", { class: "quiet" }, `${rows.length - found}, ${SOURCES[source]}.`, searched ? ` ${found} found in the movements of the controls${found ? ": accept or correct them" : " and not marked"}.` : ""),
    table([["number", (row) => String(rows.indexOf(row) + 1), { hidden: true }], ["manoeuvre", (row) => `${rowText(row)}${row.found ? " (found)" : ""}`], ["start", (row) => number(row.start, 6), { number: true }], ["end", (row) => number(row.end, 6), { number: true }]],
      rows, { label: "Manoeuvres", chosen: (_, i) => i === view.row, onchoose: (_, i) => choose(i) }),
    searched ? "" : button("Search the movements of the controls", () => { view.find = "1"; return change(() => load(view.record.name, true)); }),
    found ? button("Accept all", () => change(() => acceptAll())) : "");
  form();
}
export function choose(i, zoomed = true) {
  view.row = i;
  manoeuvres();
  placeMarks();
  const row = view.record.manoeuvres.rows[i], margin = 0.15 * (row.end - row.start);
  if (zoomed) zoom([row.start - margin, row.end + margin]);
  for (const { made } of view.plots) made.redraw();
}
export function nextRow() {
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
export const change = (work) => attempt(work, view.parts.error);
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
export function placeMarks() {
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
export function edgeAt(event) {
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
export function grab(event) {
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
