// ---- new project: dropped files, what every column is taken for, aircraft data, plan, match ----------------------------
import { $, act, attempt, button, drawing, element, get, inTurn, number, plot, redraw, select, sendFile, sent, table, traces } from "./core.js";

const SPARK = { width: 96, height: 22, points: 60 }, TRACE = { height: 170, points: 900 };
// A rate shows the sign of a surface: a positive deflection lowers it.
const RATE_OF = { delta_e: "q", delta_a: "p", delta_a_left: "p", delta_a_right: "p", delta_r: "r" };
const NOT_TAKEN = "-", INIT = ["init", "{project}"];
const SIGN_TEXT = { "+": "+ as recorded", "-": "\u2212 opposite" };
let view = null;

export function open(host) {
  view = {
    host, parts: {}, plots: [], edits: new Map(), errors: new Map(), plan: null, planned: "", record: sessionStorage.getItem("new-record"), column: null,
    refresh: inTurn(refresh), check: inTurn(() => act([...INIT, "--json"], { wait: 1 })), changed: () => attempt(() => view && view.refresh()),
  };
  const part = (name, node) => (view.parts[name] = node);
  const section = (name, title) => element("section", { id: `new-${name}`, "aria-label": title }, element("h2", {}, title), part(name, element("div")));
  host.replaceChildren(element("div", { class: "columns new" },
    element("nav", { class: "column", "aria-label": "Steps" }, element("h2", {}, "Steps"), part("steps", element("ol", { class: "steps" }))),
    element("div", { class: "column", id: "new-column" },
      part("error", element("div")),
      section("files", "Files"), section("columns", "Columns"), section("listings", "Listings"), section("aircraft", "Aircraft"),
      section("records", "Records"), section("remarks", "Open points"), section("plan", "Plan and match")),
    element("aside", { class: "column", "aria-label": "Trace of the column" }, element("h2", {}, "Trace"), part("trace", element("div")))));
  listenForFiles();
  view.resized = new ResizeObserver(() => { if (view && view.width !== view.parts.trace.clientWidth) attempt(showTrace); });
  view.resized.observe(view.parts.trace);
  document.addEventListener("changed", view.changed);
  return view.refresh();
}
export function close() {
  document.removeEventListener("changed", view.changed);
  view.resized.disconnect();
  drop();
  view = null;
}
const drop = () => { view.plots.forEach((made) => made.destroy()); view.plots = []; };

async function refresh() {
  const own = view, found = await get("/api/new");
  if (own !== view) return;
  view.found = found;
  view.foreign = found.exists && !found.draft_folder;   // a project that init did not draft: init would add to it
  const names = recordings();
  if (!names.includes(view.record)) view.record = names[0] || null;
  if (!found.columns.some((row) => row.column === view.column)) view.column = found.columns.length ? found.columns[0].column : null;
  files();
  await fetchSparks();
  if (own !== view) return;
  columns();
  listings();
  aircraft();
  records();
  remarks();
  plan();
  steps();
  await showTrace();
}
const recordings = () => view.found.files.filter((one) => one.kind === "recording").map((one) => one.name.split("/").pop().replace(/\.[^.]*$/, ""));
const openRows = () => view.found.aircraft.filter((row) => row.open);
// Remarks of a draft on quantities without a column, and on columns that may be one of them.
const missing = () => view.found.remarks.filter((text) => /^no .* is recorded or recognised|^no column was recognised|^column .* moves with/.test(text));
// Remarks of a draft on records whose thrust is neither recorded nor that of a propeller.
const powerless = () => view.found.remarks.filter((text) => /^no thrust and no propeller/.test(text));
const doubtful = () => view.found.columns.filter((row) => row.confidence === "CONFIRM" || row.confidence === "contradicts");

function steps() {
  const { found } = view, left = found.columns.filter((row) => row.quantity === NOT_TAKEN).length, sources = found.files.filter((one) => ["recording", "listing", "deck"].includes(one.kind)).length;
  const state = (text, good) => element("span", { class: good ? "pass block" : "quiet block" }, `${good ? "\u2713 " : ""}${text}`);
  const step = (name, title, text, good) => element("li", {}, button(title, () => goTo(name)), state(text, good));
  view.parts.steps.replaceChildren(
    step("files", "Files", `${sources} sources`, sources > 0),
    step("columns", "Columns", found.drafted ? `${doubtful().length} to confirm, ${left} of ${found.columns.length} not taken` : "not drafted yet", found.drafted && !doubtful().length && !missing().length),
    step("aircraft", "Aircraft", found.drafted ? `${openRows().length} values to give or confirm${powerless().length ? ", engine without thrust" : ""}` : "not drafted yet", found.drafted && !openRows().length && !powerless().length),
    step("records", "Records", `${Object.keys(found.records).length} records`, Object.keys(found.records).length > 0),
    step("remarks", "Open points", `${found.remarks.length + found.refusals.length} points`, found.drafted && !found.remarks.length && !found.refusals.length),
    step("plan", "Plan and match", planned(), Boolean(view.plan && !view.plan.problems.length && !view.plan.gaps.length)));
}

function planned() {   // a match that identifies or proves nothing runs, but is not a success
  if (!view.plan) return "not planned yet";
  const { problems, gaps } = view.plan;
  return problems.length ? `${problems.length} problems` : gaps.length ? gaps.map((text) => text.split(":")[0]).join(", ") : "accepted";
}

function goTo(name) {   // `scrollIntoView` would also move the page around the column
  const column = $("#new-column", view.host);
  column.scrollTop += $(`#new-${name}`, view.host).getBoundingClientRect().top - column.getBoundingClientRect().top;
}

// ---- files -----------------------------------------------------------------------------------------------------------
const size = (bytes) => (bytes < 1e6 ? `${number(bytes / 1e3, 3)} kB` : `${number(bytes / 1e6, 3)} MB`);
function files() {
  const { found } = view, input = element("input", { type: "file", multiple: true, class: "hidden", "aria-label": "Files of the project", onchange: (event) => attempt(() => take([...event.target.files]), view.parts.sent) });
  view.parts.sent = view.parts.sent || element("div", { role: "status" });
  view.parts.files.replaceChildren(
    element("p", { class: "quiet" }, "Folder ", element("code", {}, found.folder), ". Dropped files are copied into it; an older file with another content is kept as a copy."),
    view.foreign ? "" : element("div", { class: "drop" }, "Drop recordings, listings, decks and an aircraft file here, or ", button("Choose files", () => input.click()), input),
    view.parts.sent,
    found.files.length ? element("details", { open: view.shown ?? !found.exists, ontoggle: (event) => { view.shown = event.target.open; } }, element("summary", {}, `${found.files.length} files`),
      element("div", { class: "scroll" }, table([["file", "name"], ["size", (one) => size(one.bytes), { number: true }], ["kind", "kind"]], found.files, { label: "Files of the folder" }))) : "",
    view.foreign ? element("p", {}, "This project was not drafted here. Its files are changed on the other pages, or with an editor; only the plan and the match are offered below.")
      : element("div", { class: "row" }, button(found.drafted ? "Check all again" : "Draft the project", () => attempt(view.check, view.parts.error), { class: "first", disabled: !found.files.some((one) => ["recording", "listing", "deck"].includes(one.kind)) }),
        element("span", { class: "quiet" }, found.stale ? "Files have changed since the table below was made." : "Your changes stay; the rest is drafted anew.")));
}
function listenForFiles() {
  const column = $("#new-column", view.host), over = (on) => column.classList.toggle("over", on);
  column.addEventListener("dragover", (event) => { event.preventDefault(); over(true); });
  column.addEventListener("dragleave", (event) => { if (!column.contains(event.relatedTarget)) over(false); });
  column.addEventListener("drop", (event) => {
    event.preventDefault();
    over(false);
    const entries = [...event.dataTransfer.items].map((item) => item.webkitGetAsEntry && item.webkitGetAsEntry()).filter(Boolean), plain = [...event.dataTransfer.files];
    attempt(async () => take(entries.length ? (await Promise.all(entries.map(filesOf))).flat() : plain), view.parts.sent);
  });
}
function filesOf(entry) {   // the files of a dropped folder and of the folders in it
  if (entry.isFile) return new Promise((done, failed) => entry.file((file) => done([file]), failed));
  const reader = entry.createReader(), read = () => new Promise((done, failed) => reader.readEntries(done, failed));
  return (async () => {
    const all = [];
    for (let some = await read(); some.length; some = await read()) all.push(...some);   // a browser gives a hundred at a time
    return (await Promise.all(all.filter((one) => !one.name.startsWith(".")).map(filesOf))).flat();
  })();
}
async function take(chosen) {
  const host = view.parts.sent, names = chosen.map((file) => file.name), twice = names.filter((name, i) => names.indexOf(name) !== i), notes = [];
  if (twice.length) throw new Error(`Two files have the name ${twice[0]}; rename one of them.`);
  for (const file of chosen) {
    host.replaceChildren(element("p", { class: "quiet" }, `Copying ${file.name}, ${size(file.size)} ...`));
    try {
      if (file.size > view.found.most_bytes) throw new Error(`more than ${number(view.found.most_bytes / 1e9, 3)} GB; copy it into the folder by hand`);
      const done = await sendFile(file);
      if (done.name !== file.name) notes.push(["quiet", `${file.name}: written as ${done.name}`]);
      if (done.copy) notes.push(["quiet", `${done.name}: the older file is kept as ${done.copy}`]);
    } catch (error) { notes.push(["fail", `${file.name}: ${error.message}`]); }
    if (!view) return;
  }
  const failed = notes.filter(([kind]) => kind === "fail").length;
  host.replaceChildren(element("p", {}, `${chosen.length - failed} of ${chosen.length} files copied.`), ...notes.map(([kind, text]) => element("p", { class: kind, role: kind === "fail" ? "alert" : null }, text)));
  await view.refresh();
}

// ---- columns ---------------------------------------------------------------------------------------------------------
async function fetchSparks() {
  const { record, found } = view, key = `${record} ${found.files.map((one) => one.bytes).join()}`;
  if (!record || view.sparkKey === key) return;
  view.groups = [];
  view.groups = await traces({ name: record, points: SPARK.points }, undefined, "/api/new/traces");
  view.sparkKey = key;
}
// A column is named TABLE/COLUMN where there are several tables; of several columns the recording has one.
function groupOf(groups, column) {
  for (const one of column.split(", ")) {
    for (const group of groups || []) {
      const name = [one, one.startsWith(`${group.leaf}/`) ? one.slice(group.leaf.length + 1) : one].find((text) => text in group.values);
      if (name) return { group, name, time: group.time, values: group.values[name], unit: group.units[name] || "" };
    }
  }
  return null;
}
function spark(column) {
  const found = groupOf(view.groups, column), { width, height } = SPARK;
  if (!found) return "";
  const finite = [...found.values].filter(Number.isFinite), low = Math.min(...finite), high = Math.max(...finite), end = found.time[found.time.length - 1] || 1;
  const x = (time) => (1 + (width - 2) * time / end).toFixed(1), y = (value) => (high > low ? height - 2 - (height - 4) * (value - low) / (high - low) : height / 2).toFixed(1);
  const points = [...found.values].map((value, i) => (Number.isFinite(value) ? `${x(found.time[i])},${y(value)}` : "")).filter(Boolean).join(" ");
  return drawing("svg", { width, height, class: "spark", role: "img", "aria-label": `${column} in the record, ${number(low, 4)} to ${number(high, 4)}` }, drawing("polyline", { points, fill: "none" }));
}
const quantityOf = (name) => Object.values(view.found.quantities).flat().find((one) => one.name === name);
function quantitySelect(row, edit) {   // short names while it is closed; all choices with their meaning once it is opened
  const own = edit.quantity, short = (name) => (name === NOT_TAKEN ? "not taken" : name);
  const node = select([[own, short(own)]], own, (value) => change(row, { quantity: value, unit: "" }), { "aria-label": `${row.column} is taken as`, class: "quantity" });
  const fill = () => {
    if (node.full) return;
    node.full = true;
    const item = (value, text) => element("option", { value, selected: value === node.value }, text), chosen = node.value;
    node.replaceChildren(item(NOT_TAKEN, "not taken"), ...Object.entries(view.found.quantities).map(([group, members]) => element("optgroup", { label: group }, members.map((one) => item(one.name, `${one.name}: ${one.meaning}`)))));
    node.value = chosen;
  };
  const shorten = () => {
    if (!node.full) return;
    node.full = false;
    node.replaceChildren(element("option", { value: node.value, selected: true }, short(node.value)));
  };
  for (const name of ["keydown", "pointerdown"]) node.addEventListener(name, fill);
  node.addEventListener("blur", shorten);
  return node;
}
const same = (unit) => unit.replace(/\s|\^/g, "").replace("ft/s2", "ft/s2");
function columnRow(row) {
  const edit = view.edits.get(row.column) || { quantity: row.quantity, unit: row.unit, sign: row.sign || "+" }, quantity = quantityOf(edit.quantity), error = view.errors.get(row.column), locked = row.column.includes(", ") || view.foreign;
  const units = quantity ? [...new Set([...(edit.unit ? [edit.unit] : []), ...quantity.units])].filter((unit, i, all) => all.findIndex((one) => same(one) === same(unit)) === i) : [];
  const unit = quantity ? select([...(edit.unit ? [] : [["", "unit?"]]), ...units], edit.unit, (value) => change(row, { unit: value }), { "aria-label": `unit of ${row.column}`, class: edit.unit ? null : "wanted" }) : "";
  const sign = quantity ? select(Object.keys(SIGN_TEXT).map((key) => [key, key === "-" ? "\u2212" : "+"]), edit.sign, (value) => change(row, { sign: value }), { "aria-label": `sign of ${row.column}`, title: quantity.sign ? `+ is ${quantity.sign}` : "" }) : "";
  const kind = { contradicts: "fail", CONFIRM: "wanted", "not taken": "quiet" }[row.confidence] || null, cell = (...children) => element("td", {}, ...children);
  const chosen = row.column === view.column;
  return element("tr", { "aria-selected": chosen ? "true" : null, tabindex: "0", onclick: () => choose(row.column), onkeydown: (event) => { if (event.target === event.currentTarget && event.key === "Enter") choose(row.column); } },
    cell(element("span", { class: "name" }, row.column)), cell(spark(row.column)),
    cell(locked ? edit.quantity : quantitySelect(row, edit)), cell(locked ? edit.unit : unit), cell(locked ? edit.sign : sign),
    cell(element("span", { class: kind }, `${row.confidence === "contradicts" ? "\u2717 " : ""}${row.confidence}`)),
    cell(error ? element("span", { class: "fail", role: "alert" }, error) : "", element("span", { class: error ? "quiet block" : null }, row.reason)));
}
function columns() {
  const { found } = view, host = view.parts.columns, active = document.activeElement, kept = host.contains(active) && active.getAttribute("aria-label");
  if (!found.columns.length) {
    host.replaceChildren(element("p", { class: "quiet" }, found.drafted ? "The recordings have the names of the nomenclature, or a shipped name map: no column waits for a choice." : "After the draft: what every column is taken for, with its unit and its sign."));
    return;
  }
  const heads = ["column", "trace", "taken as", "unit", "sign", "confidence", "because"];
  host.replaceChildren(
    missing().length ? element("ul", { class: "missing" }, missing().map((text) => element("li", {}, text))) : "",
    element("p", { class: "quiet" }, "Change a choice, and all records are checked again. A choice of yours stays in each new draft. The sign is + where the recorder's positive sense is that of the quantity."),
    element("div", { class: "scroll" }, element("table", { "aria-label": "Columns of the recordings", class: "choices" },
      element("thead", {}, element("tr", {}, heads.map((text) => element("th", { scope: "col" }, text)))), element("tbody", {}, found.columns.map(columnRow)))));
  const again = kept && [...host.querySelectorAll("[aria-label]")].find((node) => node.getAttribute("aria-label") === kept);
  if (again) again.focus({ preventScroll: true });
}
async function change(row, part) {
  const before = view.edits.get(row.column) || { quantity: row.quantity, unit: row.unit, sign: row.sign || "+" }, edit = { ...before, ...part };
  view.edits.set(row.column, edit);
  view.errors.delete(row.column);
  view.column = row.column;
  let found;
  try { found = await get("/api/new/column", { column: row.column, ...edit }); } catch (error) { found = { problem: error.message }; }
  if (found.problem) {
    view.errors.set(row.column, found.problem);
    columns();
    return;
  }
  edit.unit = found.unit;
  columns();
  await attempt(async () => {
    try {
      for (const words of found.commands) await act(words, { wait: 1 });
      await view.check();
    } finally { if (view && view.edits.get(row.column) === edit) view.edits.delete(row.column); }
    if (view) await view.refresh();
  }, view.parts.error);
}
function choose(column) {
  if (view.column === column) return;
  view.column = column;
  for (const row of view.parts.columns.querySelectorAll("tbody tr")) {
    const own = $(".name", row).textContent === column;
    if (own) row.setAttribute("aria-selected", "true"); else row.removeAttribute("aria-selected");
  }
  attempt(showTrace);
}
async function showTrace() {
  const own = view, { record, column, found } = view, row = found && found.columns.find((one) => one.column === column), host = view.parts.trace;
  drop();
  if (!row || !record) { host.replaceChildren(element("p", { class: "quiet" }, "After the draft: the chosen column over time.")); return; }
  const rate = RATE_OF[row.quantity] && found.columns.find((one) => one.quantity === RATE_OF[row.quantity]), wanted = [row, ...(rate ? [rate] : [])];
  const names = wanted.flatMap((one) => one.column.split(", "));
  const groups = await traces({ name: record, points: TRACE.points, columns: JSON.stringify(names) }, undefined, "/api/new/traces");
  if (own !== view || view.column !== column || view.record !== record) return;
  drop();
  view.width = host.clientWidth;
  const quantity = quantityOf(row.quantity), names_ = recordings();
  host.replaceChildren(
    select(names_.map((name) => [name, name]), record, (name) => { view.record = name; sessionStorage.setItem("new-record", name); attempt(view.refresh); }, { "aria-label": "Recording of the trace" }));
  for (const one of wanted) {
    const trace = groupOf(groups, one.column);
    if (!trace) { host.append(element("p", { class: "quiet" }, `${one.column}: not in this recording, or no numbers.`)); continue; }
    const unit = one.unit || trace.unit, box = element("div", { class: "plot" });
    host.append(element("h3", {}, `${one.column}${unit ? `, ${unit}` : ", no unit stated"}`), element("p", { class: "quiet" }, one.quantity === NOT_TAKEN ? "not taken" : `taken as ${one.quantity}${one.sign === "-" ? ", opposite sign" : ""}`), box);
    view.plots.push(plot(box, { x: trace.time, lines: [{ label: one.column, values: trace.values, line: 0 }], width: view.width || 300, height: TRACE.height, xLabel: trace.group.clock ? "time from the first sample, s" : "number of the sample", yLabel: unit || "as recorded" }));
  }
  if (quantity) host.append(element("p", {}, `${quantity.name}: ${quantity.meaning}.`, quantity.sign ? ` Positive: ${quantity.sign}.` : ""));
  if (rate && quantity) host.append(element("p", { class: "quiet" }, `A positive ${quantity.name} lowers ${rate.quantity}: compare the first movement of both, after the signs of the table.`));
}

// ---- listings and aircraft data --------------------------------------------------------------------------------------
function listings() {
  const rows = view.found.listings;
  view.parts.listings.replaceChildren(rows.length
    ? element("div", { class: "scroll" }, table([["listing", (row) => row.file.split("/").pop()], ["case", "case"], ["name", "name"], ["taken for", "roles"], ["because", "reason"]], rows, { label: "Cases of the listings" }))
    : element("p", { class: "quiet" }, "After the draft: what each case of a listing is taken for."));
}
function valueTable(host, rows, label) {
  const error = element("div"), input = new Map(rows.map((row) => [row.key, element("input", {
    value: row.text, class: row.size > 1 ? "three" : row.unit ? null : "wide-text", "aria-label": row.label, placeholder: row.open ? "to be given" : "",
    onkeydown: (event) => { if (event.key === "Enter") write(); },
  })]));
  const give = (keys) => attempt(async () => {
    const fields = keys.map((key) => input.get(key));
    if (!keys.length) throw new Error("No value has been changed.");
    const { commands, problem } = await get("/api/new/values", { values: JSON.stringify(Object.fromEntries(keys.map((key) => [key, input.get(key).value]))) });
    if (problem) throw new Error(problem);
    const written = sent(host, fields);
    for (const words of commands) await act(words, { wait: 1 });
    written();
  }, error);
  const write = () => give(rows.map((row) => row.key).filter((key) => input.get(key).value !== input.get(key).drawn));
  const state = (row) => element("span", {}, row.open ? element("span", { class: "wanted" }, row.text ? "to be confirmed" : "to be given") : "", row.open ? " " : "", row.source.replace(/[;,]?\s*CONFIRM:?/, row.source.startsWith("CONFIRM") ? "" : ";"));
  redraw(host, label,
    element("div", { class: "scroll" }, table([
      ["value", "label"], ["number or text with unit", (row) => input.get(row.key)], ["unit of a number", (row) => (row.size > 1 ? `${row.unit}: forward, right, down` : row.unit)], ["state and source", state],
      ["confirm", (row) => (row.open && row.text ? button("Confirm", () => give([row.key]), { "aria-label": `Confirm: ${row.label}`, disabled: view.foreign }) : ""), { hidden: true }]], rows, { label })),
    element("div", { class: "row" }, button("Write the values", write, { "aria-label": `Write: ${label}`, disabled: view.foreign }), error));
}
function aircraft() {
  const rows = view.found.aircraft;
  if (!rows.length) { view.parts.aircraft.replaceChildren(element("p", { class: "quiet" }, "After the draft: reference values of the cards, mass, moments of inertia, centre of gravity.")); return; }
  const host = view.parts.aircraftTable = view.parts.aircraftTable || element("div"), power = view.parts.power = view.parts.power || element("div", { role: "status", "aria-label": "Thrust of the engines" });
  if (!host.isConnected) view.parts.aircraft.replaceChildren(element("p", { class: "quiet" }, "A number is in the unit of its row; a text has its own unit: 2280 lb."), host, power);
  valueTable(host, rows, "Values of the aircraft");
  power.replaceChildren(...powerless().map((text) => element("p", { class: "wanted" }, `${text}. To do so here: edit aircraft.toml in the folder above and press Check all again, or drop an aircraft file that has it.`)));
}

// ---- records, remarks ------------------------------------------------------------------------------------------------
function records() {
  const { found } = view, rows = Object.entries(found.records).map(([name, about]) => ({ name, ...about }));
  if (!rows.length) { view.parts.records.replaceChildren(element("p", { class: "quiet" }, "After the draft: the manoeuvres of every record.")); return; }
  const boxes = new Map(rows.map((row) => [row.name, element("input", { type: "checkbox", checked: found.prove.includes(row.name), disabled: view.foreign, "aria-label": `${row.name} proves the model`, onchange: () => attempt(prove, view.parts.error) })]));
  const prove = async () => {
    const chosen = [...boxes].filter(([, box]) => box.checked).map(([name]) => name);
    if (!chosen.length) throw new Error("Keep at least one record for the proof, or edit .draft/answers.json.");
    await act([...INIT, ...chosen.flatMap((name) => ["--prove", name]), "--json"], { wait: 1 });
  };
  const facts = view.parts.facts = view.parts.facts || element("div");
  view.parts.records.replaceChildren(
    element("div", { class: "scroll" }, table([["record", "name"], ["channels", "channels", { number: true }], ["manoeuvres", (row) => row.manoeuvres.join(", ") || "none"], ["proves", (row) => boxes.get(row.name)]], rows, { label: "Records and manoeuvres" })),
    element("p", { class: "quiet" }, "A record that proves the model identifies nothing. Without a choice, the last of several manoeuvres of a test proves it."),
    element("h3", {}, "Conditions that the recordings do not state"), facts);
  valueTable(facts, found.facts, "Conditions of the recordings");
}
function remarks() {
  const { remarks: rows, refusals, drafted, problems } = view.found, all = [...refusals.map((text) => ["fail", text]), ...(drafted ? [] : problems.map((text) => ["fail", text])), ...rows.filter((text) => ![...missing(), ...powerless()].includes(text)).map((text) => [null, text])];
  view.parts.remarks.replaceChildren(all.length ? element("ul", {}, all.map(([kind, text]) => element("li", { class: kind }, text))) : element("p", { class: "quiet" }, drafted ? "None." : "After the draft: what is missing, and what to do."));
}

// ---- plan and match --------------------------------------------------------------------------------------------------
const MATCH = ["match", "{project}/aeromatch.toml", "-o", "{work}/match"];
async function makePlan() {
  const own = view;
  let job, failure;
  try { job = await act([...MATCH, "--plan", "--json"], { wait: 1 }); } catch (error) { failure = error; }
  if (own !== view) return;
  if (failure) { view.plan = { problems: failure.message.replace(/^error: /, "").split(/; - /).filter(Boolean), gaps: [] }; } else { view.plan = JSON.parse((await get("/api/output", { number: job.number })).out); }
  plan();
  steps();
}
function plan() {
  const lines = (title, texts) => (texts.length ? [element("h3", {}, title), element("ul", { "aria-label": title }, texts.map((text) => element("li", {}, text)))] : []);
  const found = view.plan, span = (row) => `${number(row.start, 5)} to ${number(row.end, 5)} s`, exists = view.found.exists;
  const made = found && found.steps ? [
    element("h3", {}, "Steps"), element("ol", {}, found.steps.map((text) => element("li", {}, text))),
    element("h3", {}, "Fits"), element("div", { class: "scroll" }, table([["fit", "fit"], ["records", "records", { number: true }], ["windows", "windows", { number: true }], ["time, s", (row) => row.seconds.toFixed(0), { number: true }], ["models", (row) => element("span", {}, row.models.map((text) => element("code", { class: "block" }, text)))]], found.fits, { label: "Fits of the plan" })),
    element("h3", {}, "Cases"), element("div", { class: "scroll" }, table([["row", "id"], ["case", "title"], ["record", "record"], ["window", span], ["drive", "drive"], ["criteria", "criteria", { number: true }]], found.cases, { label: "Cases of the plan" })),
    ...lines("Departures, which the verdicts state", found.departures), ...lines("Remarks: unusual, correct what is a mistake", found.remarks),
  ] : [];
  view.parts.plan.replaceChildren(
    element("div", { class: "row" },
      button("Plan the match", () => attempt(makePlan, view.parts.error), { disabled: !exists }),
      button("Match the project", () => attempt(async () => { await act(MATCH, { wait: 1 }); document.dispatchEvent(new CustomEvent("open-page", { detail: "match" })); }, view.parts.error), { class: "first", disabled: !exists || view.found.problems.length > 0 }),
      view.found.problems.length ? element("span", { class: "fail" }, "Values of the project are open; see the points above.") : ""),
    found ? (found.problems.length ? element("div", {}, element("p", { class: "fail" }, `The match refuses the project for ${found.problems.length === 1 ? "a reason" : `${found.problems.length} reasons`}:`), element("ul", {}, found.problems.map((text) => element("li", {}, text)))) : found.gaps.length ? element("div", {}, element("p", { class: "wanted" }, "The match would run, but a part of it has nothing to do:"), element("ul", {}, found.gaps.map((text) => element("li", {}, text)))) : element("p", { class: "pass" }, "\u2713 The match accepts the project.")) : element("p", { class: "quiet" }, "The plan lists steps, fits, cases and all problems; nothing is computed."),
    ...made);
}
