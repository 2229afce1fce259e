// ---- expressions of channels, and a second record over the first ----------------------------------------------------
import { attempt, button, element, get, number, select } from "./core.js";
import { draw, drawSoon } from "./record_panels.js";
import { leave } from "./records.js";
import { place, rowText, view } from "./record_state.js";

// ---- expressions -----------------------------------------------------------------------------------------------------
const KEPT = "expressions";
export function savedExpressions() {
  try { return JSON.parse(sessionStorage.getItem(KEPT) || "[]"); } catch { return []; }
}
export const keepExpressions = () => sessionStorage.setItem(KEPT, JSON.stringify(view.expressions.map(({ refused, ...line }) => line)));
const checked = async (name, lines) => (lines.length ? (await get("/api/expressions", { name, lines: JSON.stringify(lines) })).lines : []);
export async function checkExpressions(name) {   // another record may lack a channel: its expressions wait
  const found = await checked(name, view.expressions.map((one) => one.channel));
  for (const one of found) for (const line of view ? view.expressions : []) if (line.channel === one.line) Object.assign(line, { unit: one.unit, remarks: one.remarks, refused: one.refused });
}
export async function checkOther(text) {   // what the second record lacks is not fetched of it
  const { other } = view;
  if (other) for (const one of await checked(other.name, [text])) if (one.refused) other.refused.add(one.line);
}
export function expressionForm() {
  const own = view, text = element("input", { class: "expression", placeholder: "az + V*q", list: "expression-words", spellcheck: "false", "aria-label": "Expression of channels" }), error = element("div");
  const words = element("datalist", { id: "expression-words" }, view.record.channels.map((one) => element("option", { value: `${one.leaf}.${one.channel}` })));
  const add = () => attempt(async () => {
    const found = await get("/api/expression", { name: view.record.name, line: text.value });
    if (own !== view) return;
    const known = view.expressions.find((one) => one.channel === found.line);
    const line = known || { source: "expression", leaf: found.line, channel: found.line, unit: found.unit, meaning: "expression", remarks: found.remarks };
    if (!known) view.expressions.push(line);
    view.chosen.add(place(line));
    await checkOther(found.line);
    keepExpressions();
    expressionForm();
    await draw();
  }, error);
  text.addEventListener("keydown", (event) => { if (event.key === "Enter") { event.preventDefault(); add(); } });
  const row = (line) => element("li", {},
    element("label", {}, element("input", { type: "checkbox", disabled: Boolean(line.refused), checked: view.chosen.has(place(line)), onchange: (event) => { if (event.target.checked) view.chosen.add(place(line)); else leave(line); drawSoon(); } }),
      " ", element("code", {}, line.channel), " ", element("span", { class: "quiet" }, line.unit)),
    button("\u00d7", () => { leave(line); view.expressions = view.expressions.filter((one) => one !== line); keepExpressions(); expressionForm(); drawSoon(); }, { class: "small", "aria-label": `Remove the expression ${line.channel}` }),
    line.refused ? element("p", { class: "fail" }, line.refused) : (line.remarks || []).map((remark) => element("p", { class: "quiet" }, `${remark}.`)));
  view.parts.expressions.replaceChildren(
    element("ul", { class: "list" }, view.expressions.map(row)), element("div", { class: "row" }, text, words, button("Add", add, { "aria-label": "Add the expression" })), error,
    element("details", {}, element("summary", { class: "quiet" }, "What an expression may have"), element("p", { class: "quiet" },
      "Channels (q, imu.q, path.q for the reconstructed one, residual.alpha_vane), numbers, numbers with a unit (2 deg), + \u2212 * / **, abs sqrt exp log sin cos tan asin acos atan atan2 hypot sign minimum maximum mean, and over time deriv(q), integral(q), detrend(q), lowpass(q, 2 Hz). Computed in SI; what has another dimension is not added.")));
}

// ---- a second record -------------------------------------------------------------------------------------------------
export async function otherRecord(name) {   // its channels, and the manoeuvres to which it may be aligned
  const own = view;
  if (!name) { view.other = null; return; }
  const found = await get("/api/record", { name });
  if (own !== view) return;
  const lines = new Map(found.channels.map((line) => [place(line), line]));
  view.other = { name, record: found, lines, shift: 0, align: "time", refused: new Set() };
  const row = view.record.manoeuvres.rows[view.row ?? 0], same = row ? found.manoeuvres.rows.findIndex((one) => rowText(one) === rowText(row)) : -1;
  if (same >= 0) align(`${same}`);
  for (const one of await checked(name, view.expressions.map((line) => line.channel))) if (one.refused && view && view.other) view.other.refused.add(one.line);
}
function align(choice) {   // starts of two manoeuvres on one place: t + shift is the time of the other record
  const { other, record } = view, row = record.manoeuvres.rows[view.row ?? 0], to = other.record.manoeuvres.rows[Number(choice)];
  Object.assign(other, { align: choice, shift: 0, from: row });
  if (choice === "world") other.shift = (Date.parse(record.clock) - Date.parse(other.record.clock)) / 1000;
  else if (choice !== "time" && row && to) other.shift = to.start - row.start;
}
export function otherLine(line) {   // the same channel of the second record; null if it has none
  const { other } = view;
  if (line.source === "expression") return other.refused.has(line.channel) ? null : line;
  const own = other.lines.get(place(line)), alike = [...other.lines.values()].filter((one) => one.source === line.source && one.channel === line.channel);
  return own || (alike.length === 1 ? alike[0] : null);
}
export function compareForm() {
  const { other, record, project } = view, names = project.records.map((one) => one.name).filter((name) => name !== record.name), error = element("div");
  const again = (work) => attempt(async () => { await work(); compareForm(); await draw(); }, error);
  const first = record.manoeuvres.rows[view.row ?? 0], rows = other ? other.record.manoeuvres.rows : [];
  const clocks = other && record.clock && other.record.clock ? [["world", "time of day"]] : [];
  const starts = first ? rows.map((row, i) => [`${i}`, `start of ${i + 1}: ${rowText(row)}, ${number(row.start, 6)} s`]) : [];
  view.parts.compare.replaceChildren(
    select([["", "none"], ...names], other ? other.name : "", (name) => again(() => otherRecord(name)), { "aria-label": "Second record over the first" }),
    other ? element("div", { class: "row" }, element("span", {}, "aligned by"), select([["time", "time of the records"], ...clocks, ...starts], other.align, (choice) => again(() => align(choice)), { "aria-label": "Alignment of the second record" })) : "",
    other ? element("p", { class: "quiet" }, `Dashed: ${other.name}, moved by ${number(-other.shift, 7) || 0} s${other.align !== "time" && other.align !== "world" && other.from ? `, so that its manoeuvre begins with ${rowText(other.from)} at ${number(other.from.start, 6)} s` : ""}.`) : "", error);
}
