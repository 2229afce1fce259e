// ---- what every page of the workbench shares: server, elements, actions, work ---------------------------------------
export const $ = (query, root = document) => root.querySelector(query);
export const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
const DATA = new Set(["data", "list"]);

export function element(tag, attributes = {}, ...children) {
  const node = document.createElement(tag);
  for (const [key, value] of Object.entries(attributes)) {
    if (value == null || value === false) continue;
    if (key === "class") node.className = value;
    else if (key.startsWith("on")) node.addEventListener(key.slice(2), (event) => (redrawing ? undefined : value(event)));
    else if (key === "value" || key === "checked" || key === "disabled" || key === "selected") node[key] = value;
    else if (!DATA.has(key)) node.setAttribute(key, value === true ? "" : value);
  }
  node.append(...children.flat().filter((child) => child != null && child !== false));
  if (node.matches(FIELDS)) node.drawn = node.value;
  if (tag === "details") node.drawn = node.open;
  return node;
}
export const drawing = (tag, attributes = {}, ...children) => {
  const node = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  node.append(...children.flat().filter((child) => child != null));
  return node;
};
export const button = (text, onclick, more = {}) => element("button", { type: "button", onclick, ...more }, text);
export const labelled = (text, input) => element("label", { class: "row" }, element("span", {}, text), input);
export function select(items, chosen, onchange, more = {}) {
  return element("select", { onchange: onchange && ((event) => onchange(event.target.value)), ...more },
    items.map((item) => { const [value, text] = Array.isArray(item) ? item : [item, item]; return element("option", { value, selected: value === chosen }, text); }));
}
// columns: [[heading, key or function, {number: true, hidden: true}]]; a hidden heading is for screen readers
export function table(columns, rows, { label, chosen, onchoose } = {}) {
  const cell = (row, [, key, how = {}]) => {
    const found = typeof key === "function" ? key(row) : row[key];
    return element("td", { class: how.number ? "number" : null }, found == null ? "" : typeof found === "number" ? number(found, how.digits) : found);
  };
  return element("table", { "aria-label": label },
    element("thead", {}, element("tr", {}, columns.map(([heading, , how = {}]) => element("th", { scope: "col", class: how.number ? "number" : null }, how.hidden ? element("span", { class: "hidden" }, heading) : heading)))),
    element("tbody", {}, rows.map((row, i) => element("tr", onchoose ? {
      tabindex: "0", "aria-selected": chosen && chosen(row, i) ? "true" : null, onclick: () => onchoose(row, i),
      onkeydown: (event) => { if (event.key === "Enter" || event.key === " ") { event.preventDefault(); onchoose(row, i); } },
    } : {}, columns.map((column) => cell(row, column))))));
}
export function ticks(low, high, count = 6) {   // round numbers between two limits
  const raw = (high - low || 1) / count, power = 10 ** Math.floor(Math.log10(raw)), step = power * [1, 2, 2.5, 5, 10].find((one) => one * power >= raw * 0.999);
  const found = [];
  for (let i = Math.ceil(low / step - 1e-9); i * step <= high + 1e-9 * step; i++) found.push(i * step);
  return found;
}
export const number = (value, digits = 4) => (value == null || !Number.isFinite(value) ? "" : Number(value.toPrecision(digits)).toString().replace("-", "\u2212"));

// ---- forms -----------------------------------------------------------------------------------------------------------
// A form is drawn anew when any action has ended. What has been typed into it and is not written yet stays, with the cursor, as long as
// the form is about the same thing; what was opened stays open. A field has the value with which it was drawn as `drawn`.
const FIELDS = "input:not([type=checkbox], [type=range]), textarea, select", FOCUSED = `${FIELDS}, input, button, summary, [tabindex]`;
let redrawing = false;   // a browser may report that a field which is taken away has changed or lost the focus
function nameOf(node) {
  const label = node.matches("input, textarea, select") && node.closest("label");
  return node.getAttribute("aria-label") || (label || node.matches("details") ? (label || node).firstChild : node.cells ? node.cells[0] : node).textContent;
}
const named = (host, query) => new Map([...host.querySelectorAll(query)].reverse().map((node) => [nameOf(node), node]));
export function redraw(host, about, ...children) {
  const active = document.activeElement, focused = host.contains(active) ? active : null, cursor = focused && [focused.selectionStart, focused.selectionEnd];
  const before = host.about === about ? named(host, FIELDS) : new Map(), folds = host.about == null ? new Map() : named(host, "details");
  redrawing = true;
  try { host.replaceChildren(...children.flat().filter((child) => child != null && child !== false)); } finally { redrawing = false; }
  host.about = about;
  for (const [name, fold] of named(host, "details")) if (folds.has(name) && folds.get(name).open !== folds.get(name).drawn) fold.open = folds.get(name).open;
  for (const [name, field] of named(host, FIELDS)) {
    const old = before.get(name);
    if (!old || old.value === old.drawn || old.value === field.value || field.disabled) continue;
    if (field.matches("select") && ![...field.options].some((one) => one.value === old.value)) continue;
    field.value = old.value;
    if (field.matches("select")) field.dispatchEvent(new Event("change"));
    else field.addEventListener("blur", () => field.dispatchEvent(new Event("change")), { once: true });   // the browser reports only what is typed from now on
  }
  const again = focused && named(host, FOCUSED).get(nameOf(focused));
  if (!again) return;
  again.focus({ preventScroll: true });
  if (cursor && cursor[0] != null && again.setSelectionRange) again.setSelectionRange(...cursor);
}
// Called when fields are sent; what it returns is called when they are written: what was typed meanwhile still stays.
export function sent(host, fields = named(host, FIELDS).values()) {
  const values = new Map([...fields].map((field) => [nameOf(field), field.value]));
  return () => { for (const [name, field] of named(host, FIELDS)) if (values.get(name) === field.value) field.drawn = field.value; };
}
// Calls follow one another, so that an older answer never comes after a newer one; those that wait are one.
export function inTurn(work) {
  let last = Promise.resolve(), waiting = null;
  return () => (waiting ||= last = last.catch(() => {}).then(() => { waiting = null; return work(); }));
}

// ---- the server ------------------------------------------------------------------------------------------------------
function ownToken() {
  const given = /(?:^#|&)token=([\w-]+)/.exec(location.hash);
  if (given) {
    sessionStorage.setItem("token", given[1]);
    history.replaceState(null, "", location.pathname);
  }
  return sessionStorage.getItem("token") || "";
}
const token = ownToken();
const banner = (text) => { const node = $("#banner"); node.textContent = text; node.hidden = !text; };
let away = false;
async function request(path, options = {}) {
  let answer;
  try {
    answer = await fetch(path, { ...options, headers: { "x-aeromatch-token": token, ...(options.headers || {}) }, cache: "no-store", credentials: "omit" });
  } catch (error) {
    if (error.name === "AbortError") throw error;
    away = true;
    banner("The server does not answer. Start aeromatch view again with the same --port; the page then goes on.");
    throw new Error("the server does not answer");
  }
  if (away) { away = false; banner(""); document.dispatchEvent(new CustomEvent("changed")); }
  if (answer.status === 403) { banner("Refused: open the address that aeromatch view printed."); throw new Error("refused"); }
  return answer;
}
async function data(answer) {
  const found = await answer.json();
  if (!answer.ok) throw Object.assign(new Error(found.problems && found.problems.length ? found.problems.join("; ") : found.text), { kind: found.error });
  return found;
}
const address = (path, query) => (query ? `${path}?${new URLSearchParams(query)}` : path);
export const get = async (path, query, signal) => data(await request(address(path, query), { signal }));
export const post = async (path, body, signal) => data(await request(path, { method: "POST", body: JSON.stringify(body), headers: { "content-type": "application/json" }, signal }));
export const sendFile = async (file) => data(await request(address("/api/new/file", { name: file.name }), { method: "POST", body: file, headers: { "content-type": "application/octet-stream" } }));
export async function traces(query, signal, path = "/api/channels") {
  const answer = await request(address(path, query), { signal });
  if (!answer.ok) await data(answer);
  const bytes = await answer.arrayBuffer(), size = new DataView(bytes).getUint32(0, true);
  const head = JSON.parse(new TextDecoder().decode(new Uint8Array(bytes, 4, size)));
  let place = 4 + size;
  const next = (count) => { const found = new Float64Array(bytes, place, count); place += 8 * count; return found; };
  return head.map(({ samples, channels, ...about }) => ({ ...about, time: next(samples), values: Object.fromEntries(channels.map((name) => [name, next(samples)])) }));
}

// ---- actions: verbs of the command line, as work in child processes --------------------------------------------------
let watching = null, last = [], acting = 0;
export const jobs = () => last;
export async function act(words, { wait = 30 } = {}) {   // resolves when the command has ended; its error is thrown
  show({ state: "running", command: words.slice(0, 2).join(" "), progress: "" });
  acting += 1;
  let job;
  try {
    job = await post("/api/act", { words, wait: Math.min(wait, 2) });
    watch();
    while (job.state === "waiting" || job.state === "running") {
      await new Promise((done) => setTimeout(done, 400));
      job = await get("/api/output", { number: job.number });
    }
  } catch (error) {
    show({ state: "failed", command: words.slice(0, 2).join(" "), error: error.message });
    throw error;
  } finally { acting -= 1; }
  show(job);
  if (job.state !== "done") throw new Error(job.state === "cancelled" ? "cancelled" : job.error || "failed");   // nothing has changed: what was typed stays
  document.dispatchEvent(new CustomEvent("changed", { detail: job }));
  return job;
}
export async function attempt(work, host) {   // shows the error of an action where it was called
  if (host) host.replaceChildren();
  try { return await work(); } catch (error) {
    if (error.name === "AbortError") return undefined;
    if (host) host.replaceChildren(element("p", { class: "fail", role: "alert" }, error.message)); else notice(error.message);
    return undefined;
  }
}
export const notice = (text) => { $("#job").textContent = text; $("#job").classList.add("fail"); };
function show(job) {
  const node = $("#job"), running = job.state === "running" || job.state === "waiting";
  node.classList.toggle("fail", job.state === "failed");
  const words = { running: "Running", waiting: "Waiting", done: "Done", failed: "Failed", cancelled: "Cancelled" };
  node.textContent = `${words[job.state]}: ${job.command}${job.state === "failed" ? `. ${job.error}` : job.progress ? `. ${job.progress}` : ""}`;
  node.title = node.textContent;
  const cancel = $("#cancel");
  cancel.hidden = !(running && job.number);
  cancel.onclick = () => post("/api/cancel", { number: job.number }).catch((error) => notice(error.message));
}
export function watch() {
  if (watching) return;
  watching = setInterval(async () => {
    try {
      const found = await get("/api/jobs");
      last = found.jobs;
      const busy = last.find((job) => job.state === "running") || last.find((job) => job.state === "waiting");
      if (busy) show(busy);
      else if (!acting) { clearInterval(watching); watching = null; if (last.length) show(last[last.length - 1]); }   // an action shows its own end
    } catch { /* the banner shows it */ }
  }, 700);
}
export async function showLog() {
  const node = $("#log"), found = await get("/api/actions");
  node.replaceChildren(
    element("h2", {}, "Actions of this project"),
    element("p", { class: "quiet" }, "Replayed by ", element("code", {}, `aeromatch match PROJECT --actions ${found.log.replace("{work}/", "")} -o OUTPUT`), "."),
    found.actions.length ? element("ol", {}, found.actions.map((action) => element("li", {}, element("code", {}, action.command)))) : element("p", {}, "None yet."));
}

// ---- plots -----------------------------------------------------------------------------------------------------------
const nulls = (values) => Array.from(values, (value) => (Number.isFinite(value) ? value : null));
export const DASHES = [[], [1.5, 2.5], [7, 3.5], [9, 3, 2, 3], [13, 4], [2, 2]];
// lines: [{label, values, line: number of colour and dash, points}] over one x; several lines may have an x of their own (joined)
export function plot(host, { x, lines, width, height = 150, xLabel = "", yLabel = "", span = null, onzoom, oncursor, sync, marks, bands, timeAxis = true, rightLabel = "" }) {
  const style = (line) => ({
    label: line.label, scale: line.right ? "right" : "y", stroke: () => colour(`line-${line.line || 0}`), width: line.width ?? 1.3, dash: line.points ? undefined : DASHES[line.dash ?? line.line ?? 0].map((length) => length * devicePixelRatio),
    points: { show: Boolean(line.points), size: 4, fill: () => colour(`line-${line.line || 0}`) }, paths: line.points ? () => null : undefined, spanGaps: false,
  });
  const axis = { stroke: () => colour("quiet"), font: `11px ${colour("sans")}`, grid: { stroke: () => colour("grid"), width: 1 }, ticks: { stroke: () => colour("quiet"), width: 1, size: 4 } };
  const state = { span }, texts = (_, splits) => splits.map((value) => number(value, 8));
  const made = new uPlot({
    width: width || host.clientWidth || 600, height, padding: [6, 10, 0, 0], legend: { show: false },
    cursor: { y: false, points: { show: false }, sync: sync ? { key: sync, scales: ["x", null] } : undefined, drag: { x: true, y: false, setScale: false, dist: 4 }, bind: { dblclick: () => () => { if (onzoom) onzoom(null); return null; } } },
    scales: { x: { time: false, range: (_, low, high) => state.span || [low, high] } },
    axes: [{ ...axis, size: timeAxis ? 26 : 4, values: timeAxis ? texts : () => [], label: xLabel || undefined, labelSize: 16, labelFont: `11px ${colour("sans")}` }, { ...axis, values: texts, size: 58, gap: 4, space: 24, label: yLabel || undefined, labelSize: 14, labelFont: `11px ${colour("sans")}` },
      ...(rightLabel ? [{ ...axis, scale: "right", side: 1, values: texts, size: 52, gap: 4, space: 24, grid: { show: false }, label: rightLabel, labelSize: 14, labelFont: `11px ${colour("sans")}` }] : [])],
    series: [{}, ...lines.map(style)], bands,
    hooks: {
      setCursor: oncursor ? [(own) => oncursor(own.cursor.idx)] : [],
      drawClear: marks ? [(own) => marks(own)] : [],
      setSelect: [(own) => {
        if (own.select.width < 2 || !onzoom || !own.dragged) return;
        own.dragged = false;
        const limits = [own.posToVal(own.select.left, "x"), own.posToVal(own.select.left + own.select.width, "x")];
        own.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
        onzoom(limits);
      }],
      ready: [(own) => own.over.addEventListener("mousedown", () => { own.dragged = true; })],
    },
  }, [nulls(x), ...lines.map((line) => nulls(line.values))], host);
  made.setSpan = (limits) => { state.span = limits; made.setScale("x", { min: limits ? limits[0] : x[0], max: limits ? limits[1] : x[x.length - 1] }); };
  return made;
}

// ---- keys ------------------------------------------------------------------------------------------------------------
const keys = new Map();
export function key(name, text, call) { keys.set(name, { text, call }); }
export function clearKeys(kept = ["?"]) { for (const name of [...keys.keys()]) if (!kept.includes(name)) keys.delete(name); }
document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || /^(INPUT|TEXTAREA|SELECT)$/.test(event.target.tagName)) return;
  const found = keys.get(event.key);
  if (found) { event.preventDefault(); found.call(event); }
});
export function showKeys() {
  $("#keys-list").replaceChildren(...[...keys].flatMap(([name, { text }]) => [element("dt", {}, element("kbd", {}, name)), element("dd", {}, text)]));
  $("#keys").showModal();
}
