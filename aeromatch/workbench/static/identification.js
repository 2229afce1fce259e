// ---- identification: windows, model, fit, and what changes without a term or a manoeuvre ------------------------------
import { act, attempt, button, colour, drawing, element, get, inTurn, key, labelled, number, plot, post, redraw, select, table, watch } from "./core.js";

const POINTS = 2000, WAIT = 120;   // samples on the screen; milliseconds from the last change to the fit
const WEIGHTS = [["equal", "equal"], ["manoeuvre", "by manoeuvre"], ["robust", "robust (Huber)"]];
let view = null;

export function open(host) {
  view = {
    host, parts: {}, rows: new Map(), own: new Map(), chosen: new Set(), off: new Set(), text: "", origin: null, intercepts: "common", weights: "equal",
    cutoff: null, prior: null, ridge: "", band: null, domain: "time", answer: null, reference: null, name: null, term: null, span: null, plots: [], refresh: inTurn(refresh), changed: () => attempt(view.refresh),
  };
  const part = (name, node) => (view.parts[name] = node);
  host.replaceChildren(element("div", { class: "columns fit" },
    element("nav", { class: "column", "aria-label": "Windows" },
      element("h2", {}, "Start from"), part("start", element("div")),
      element("h2", {}, "Windows"), part("count", element("p", { class: "quiet" })), part("records", element("div"))),
    element("div", { class: "column" },
      part("model", element("div")), part("error", element("div")), part("outcome", element("p", { role: "status", "aria-live": "polite" })),
      element("h2", {}, "Estimates"), part("estimates", element("div", { class: "estimates" })),
      part("reference", element("div", { class: "row" })),
      part("strip", element("div", { class: "marks", role: "group", "aria-label": "Windows one after another" })), part("plots", element("div", { class: "plots" })),
      element("h2", {}, "Left out in turn"), part("without", element("div"))),
    element("aside", { class: "column", "aria-label": "Residual, partial regression, correlation, save" },
      element("h2", {}, "Remarks"), part("remarks", element("div")),
      element("h2", {}, "Spectrum"), part("spectrum", element("div")),
      element("h2", {}, "Partial regression"), part("partial", element("div")),
      element("h2", {}, "Correlation of the estimates"), part("correlation", element("div")),
      element("h2", {}, "Save"), part("save", element("div")))));
  view.resized = new ResizeObserver(() => { if (view && view.samples && view.width !== view.parts.plots.clientWidth) drawTime(); });
  view.resized.observe(view.parts.plots);
  document.addEventListener("changed", view.changed);
  key("b", "take the fit as the reference", () => refer());
  key("r", "all windows over time", () => attempt(() => zoom(null)));
  return view.refresh();
}
export function close() {
  document.removeEventListener("changed", view.changed);
  view.resized.disconnect();
  clearTimeout(view.later);
  if (view.asking) view.asking.abort();
  drop();
  view = null;
}
const drop = () => { view.plots.forEach((made) => made.destroy()); view.plots = []; };

async function refresh() {
  const own = view, first = !view.about, about = await get("/api/identification");
  if (own !== view) return;
  view.about = about;
  if (!about.records.length) {
    view.host.replaceChildren(element("div", { class: "column" }, element("p", {}, "No record is reconstructed yet. Do so on the page of the records; the coefficients are formed along the reconstructed path.")));
    return;
  }
  if (first) {
    view.cutoff = about.cutoff;
    view.prior = about.priors[0] || null;
    const fit = about.fits.findIndex((one) => one.records.some((name) => about.records.includes(name)));
    if (fit >= 0) await start(fit, 0);
    else { view.text = "CL = 1 + alpha + qhat + delta_e"; await list(about.records[0]); }
    if (own !== view) return;
  } else if (view.prior && !about.priors.includes(view.prior)) view.prior = about.priors[0] || null;
  if (own !== view) return;
  starts();
  formed();
}
function formed() {   // the forms, as the fit is chosen; the fit itself may take its time
  records();
  model();
  saving();
  attempt(fit);
}

// ---- windows ---------------------------------------------------------------------------------------------------------
const place = (record, row) => `${record}|${row.start}|${row.end}`;
async function list(name) {
  if (!view.rows.has(name)) {
    const own = view, found = await get("/api/windows", { name });
    if (own === view) view.rows.set(name, found.rows);
  }
}
function starts() {
  const items = view.about.fits.flatMap((fit, i) => fit.models.map((text, j) => [`${i}.${j}`, `${fit.name}: ${text.split("=")[0].trim()}`]));
  const chosen = view.origin ? view.origin.join(".") : "";
  redraw(view.parts.start, "start", select([["", "own windows and model"], ...items], chosen, (value) => attempt(async () => {
    if (!value) { view.origin = null; saving(); return; }
    if (await start(...value.split(".").map(Number))) formed();
  }), { "aria-label": "Fit of the project to start from" }), element("p", { class: "quiet" }, "The match fits each record by itself: the first record of the fit is taken here; add others below."));
}
async function start(i, j) {   // true unless another fit has been chosen meanwhile
  const own = view, origin = [i, j], fit = view.about.fits[i], name = fit.records.find((one) => view.about.records.includes(one));
  view.origin = origin;
  view.text = fit.models[j];
  view.off.clear();
  view.chosen.clear();
  view.reference = view.span = view.shown = view.name = view.parts.records.about = null;
  if (!name) return true;
  await list(name);
  if (own !== view || view.origin !== origin) return false;
  for (const row of view.rows.get(name)) if (fit.manoeuvres.includes(row.label) || fit.manoeuvres.includes(row.manoeuvre)) view.chosen.add(place(name, row));
  for (const [from, to] of fit.windows || []) add(name, from, to);
  return true;
}
function add(name, from, to) {
  const row = { label: `${number(from, 6)} to ${number(to, 6)} s`, start: from, end: to, own: true }, known = [...(view.rows.get(name) || []), ...(view.own.get(name) || [])];
  if (!known.some((one) => one.start === from && one.end === to)) view.own.set(name, [...(view.own.get(name) || []), row]);
  view.chosen.add(place(name, row));
}
const rowsOf = (name) => [...(view.rows.get(name) || []), ...(view.own.get(name) || [])];
const windows = () => view.about.records.flatMap((name) => rowsOf(name).filter((row) => view.chosen.has(place(name, row))).map((row) => ({ record: name, start: row.start, end: row.end })));
function records() {
  const taken = new Set(windows().map((one) => one.record)), shown = view.shown || taken;
  view.shown = new Set([...shown, ...taken]);
  redraw(view.parts.records, "records", ...view.about.records.map((name) => record(name, taken)));
  count();
  const first = view.parts.records.querySelector("details[open]");
  if (first && shown === taken) first.firstChild.scrollIntoView({ block: "center" });
}
function count() {
  const found = windows(), names = new Set(found.map((one) => one.record));
  view.parts.count.textContent = `${found.length} ${found.length === 1 ? "window" : "windows"} of ${names.size} ${names.size === 1 ? "record" : "records"}, ${number(found.reduce((sum, one) => sum + one.end - one.start, 0), 4) || 0} s.`;
}
function record(name, taken) {
  const body = element("div"), host = element("details", { open: view.shown.has(name) },
    element("summary", { class: taken.has(name) ? "taken" : null }, name), body);
  const fill = () => {
    const ends = [0, 1].map((i) => element("input", { type: "number", step: "any", "aria-label": `${i ? "end" : "start"} of a window of ${name} [s]`, placeholder: i ? "end, s" : "start, s" }));
    body.replaceChildren(
      element("ul", { class: "list" }, rowsOf(name).map((row) => element("li", {}, element("label", { class: "window" },
        element("input", { type: "checkbox", checked: view.chosen.has(place(name, row)), onchange: (event) => {
          if (event.target.checked) view.chosen.add(place(name, row)); else view.chosen.delete(place(name, row));
          host.firstChild.className = rowsOf(name).some((one) => view.chosen.has(place(name, one))) ? "taken" : "";
          again();
        } }), element("span", {}, row.label), row.own ? "" : element("span", { class: "quiet number" }, `${number(row.start, 5)}\u2013${number(row.end, 5)}`))))),
      element("div", { class: "row" }, ends, button("Add", () => {
        const [from, to] = ends.map((one) => Number(one.value));
        if (!(to > from) || !ends[0].value) { view.parts.error.replaceChildren(element("p", { class: "fail", role: "alert" }, "Give start and end in seconds of the record, the end later.")); return; }
        add(name, from, to); fill(); again();
      }, { "aria-label": `Add a window of ${name}` })));
  };
  if (view.rows.has(name)) fill();
  host.addEventListener("toggle", () => {
    if (host.open) view.shown.add(name); else view.shown.delete(name);
    if (host.open && !view.rows.has(name)) attempt(async () => { body.replaceChildren(element("p", { class: "quiet" }, "reading ...")); await list(name); if (view) fill(); }, body);
  });
  return host;
}

// ---- model -----------------------------------------------------------------------------------------------------------
const left = () => view.text.split("=")[0].trim();
const terms = () => view.text.slice(view.text.indexOf("=") + 1).split("+").map((one) => one.trim()).filter(Boolean);
const effective = () => `${left()} = ${terms().filter((one) => !view.off.has(one)).join(" + ")}`;
function model() {
  const text = element("input", { class: "model", value: view.text, spellcheck: "false", "aria-label": "Model", onchange: (event) => { view.text = event.target.value; view.off.clear(); model(); again(); } });
  const chip = (term) => button(term, () => { if (view.off.has(term)) view.off.delete(term); else view.off.add(term); model(); again(); }, { class: "chip", "aria-pressed": String(!view.off.has(term)), title: view.off.has(term) ? "left out: take it in again" : "leave it out" });
  const cutoff = element("input", { type: "number", min: "0", step: "any", value: view.cutoff ?? "", placeholder: "none", onchange: (event) => { view.cutoff = event.target.value === "" ? null : Number(event.target.value); again(); } });
  const edge = (i, text) => element("input", { type: "number", min: "0", step: "any", value: view.band[i], "aria-label": `${text} edge of the band [Hz]`, onchange: (event) => { view.band = view.band.map((value, j) => (j === i ? Number(event.target.value) : value)); again(); } });
  const ridge = element("input", { size: 6, value: view.ridge, placeholder: "none", title: "Parameter on standardised regressors, or auto; the estimates are biased towards zero then", onchange: (event) => { view.ridge = event.target.value.trim(); again(); } });
  redraw(view.parts.model, String(view.origin),
    element("div", { class: "row fill" }, element("b", {}, "Model"), text),
    element("div", { class: "row", role: "group", "aria-label": "Terms; one that is switched off is left out" }, element("span", { class: "quiet" }, "Terms"), terms().map(chip), view.off.size ? button("All terms", () => { view.off.clear(); model(); again(); }) : null),
    element("div", { class: "row" },
      labelled("Intercepts", select([["common", "common"], ["separate", "one per window"]], view.intercepts, (value) => { view.intercepts = value; again(); })),
      labelled("Fit", select([["time", "in time"], ["frequency", "in frequency"]], view.domain, (value) => { view.domain = value; if (!view.band) view.band = [0.1, 2]; model(); again(); }, { "aria-label": "domain of the fit" })),
      view.domain === "time" ? labelled("Weights", select(WEIGHTS, view.weights, (value) => { view.weights = value; again(); })) : element("span", { class: "row" }, "Band, Hz", edge(0, "lower"), "to", edge(1, "upper")),
      labelled("Ridge", ridge),
      labelled("Cut-off, Hz", cutoff),
      labelled("Prior", select([["", "none"], ...view.about.priors.map((name) => [name, name.replace("{work}/", "")])], view.prior || "", (value) => { view.prior = value || null; again(); }))));
}
const wanted = () => ({
  windows: windows(), model: effective(), intercepts: view.intercepts, cutoff: view.cutoff, prior: view.prior, ridge: view.ridge === "auto" ? "auto" : Number(view.ridge || 0),
  ...(view.domain === "time" ? { weights: view.weights } : { band: view.band }),
});

// ---- fit -------------------------------------------------------------------------------------------------------------
function again() {
  count();
  clearTimeout(view.later);
  view.later = setTimeout(() => attempt(fit), WAIT);
}
async function fit() {
  const own = view, body = wanted();
  if (view.asking) view.asking.abort();
  if (Number.isNaN(body.ridge)) { empty(""); view.parts.error.replaceChildren(element("p", { class: "fail", role: "alert" }, "Ridge: give a number, or auto.")); return; }
  view.asking = new AbortController();
  const { signal } = view.asking, outcome = view.parts.outcome;
  if (!body.windows.length) { empty("Choose windows on the left."); return; }
  outcome.textContent = "fitting ...";
  const many = new Set(body.windows.map((one) => one.record)).size;
  const slow = setTimeout(() => { watch(); outcome.textContent = `Coefficients of ${many} ${many === 1 ? "record" : "records"} are formed; they are kept, so that the next fit is quick.`; }, 900);
  try {
    const answer = await post("/api/fit", body, signal);
    const samples = await post("/api/fit/samples", { fit: body, points: POINTS }, signal);
    if (own !== view) return;
    Object.assign(view, { answer, samples, wanted: body, span: null });
    view.parts.error.replaceChildren();
  } catch (error) {
    if (error.name === "AbortError" || own !== view) return;
    empty("");
    view.parts.error.replaceChildren(element("p", { class: "fail", role: "alert" }, error.message));
    return;
  } finally { clearTimeout(slow); }
  if (!view.reference) view.reference = { answer: view.answer, count: body.windows.length };
  show();
}
function empty(text) {
  drop();
  view.answer = view.samples = null;
  view.parts.outcome.textContent = text;
  for (const name of ["estimates", "reference", "strip", "plots", "without", "remarks", "spectrum", "partial", "correlation"]) view.parts[name].replaceChildren();
  saving();
}
function show() {
  const { answer } = view, about = answer.attributes, seconds = answer.seconds.coefficients + answer.seconds.fit;
  view.parts.outcome.replaceChildren(
    element("b", {}, `R\u00b2 ${number(about.R2, 5)}`), `, residual rms ${number(about.residual_rms, 3)}, ${about.samples} samples, ${about.manoeuvres} ${about.manoeuvres === 1 ? "window" : "windows"}${about.domain === "frequency" ? `, ${about.frequencies} frequencies in ${about.band} Hz, R\u00b2 in time ${number(about.R2_time, 5)}` : ""}${about.ridge ? `, ridge ${number(about.ridge, 3)}` : ""}; made in ${seconds < 1 ? `${Math.max(1, Math.round(1000 * seconds))} ms` : `${number(seconds, 2)} s`}.`,
    ...answer.tests.map((line) => element("span", { class: "quiet block" }, line)));
  const names = answer.terms.map((row) => row.term);
  if (!names.includes(view.term) || (about.domain === "frequency" && constant(view.term))) view.term = names.find((name) => name !== "1" && !numbered(name)) || names[0];
  estimates();
  reference();
  drawTime();
  remarks();
  spectrum();
  attempt(partial, view.parts.partial);
  correlation();
  leftOut();
  saving();
}

// ---- estimates -------------------------------------------------------------------------------------------------------
const before = (term) => (changed() && !numbered(term) ? view.reference.answer.terms.find((row) => row.term === term) : null);
const constant = (term) => term === "1" || numbered(term);
const numbered = (term) => /^1\[/.test(term);   // the constant of one window: its number changes with the windows
const changed = () => view.reference && view.reference.answer !== view.answer && view.reference.answer.coefficient === view.answer.coefficient;
function estimates() {
  const { answer } = view, dropped = changed() ? view.reference.answer.terms.filter((row) => !answer.terms.some((one) => one.term === row.term)).map((row) => row.term) : [];
  const columns = [
    ["term", "term"], ["estimate", (row) => short(row.estimate, 4), { number: true }], ["std. error", (row) => short(row.total, 2), { number: true }], ["t", "t", { number: true, digits: 3 }], ["VIF", "vif", { number: true, digits: 2 }],
    ["prior", (row) => (row.prior == null ? "" : `${short(row.prior, 3)} \u00b1 ${short(row.prior_stderr, 2)}`), { number: true }],
  ];
  if (answer.terms.some((row) => row.shrinkage)) columns.push(["bias of the ridge", (row) => (row.shrinkage ? short(row.shrinkage, 2) : ""), { number: true }]);
  if (changed()) columns.push(["reference", (row) => { const old = before(row.term); return old ? short(old.estimate, 4) : "\u2013"; }, { number: true }],
    ["change, s.e.", (row) => { const old = before(row.term); return old ? signed((row.estimate - old.estimate) / row.total) : ""; }, { number: true }]);
  columns.push(["error bars", figure, { hidden: true }]);
  redraw(view.parts.estimates, answer.coefficient,
    table(columns, answer.terms, { label: "Estimates; a row shows its partial regression", chosen: (row) => row.term === view.term, onchoose: (row) => { if (view.wanted.band && constant(row.term)) return; view.term = row.term; estimates(); attempt(partial, view.parts.partial); } }),
    element("p", { class: "quiet legend" },
      sample("estimate"), "estimate, thick: random error, thin: with the systematic one", view.answer.terms.some((row) => row.prior != null) && [sample("prior"), "prior"], changed() && [sample("reference"), "reference"], ". Bars: two standard errors."),
    dropped.length ? element("p", {}, `Not in this fit: ${dropped.map((name) => `${name} (${short(view.reference.answer.terms.find((row) => row.term === name).estimate, 4)})`).join(", ")}.`) : "",
    answer.without_prior ? element("p", { class: "quiet" }, `No prior: ${answer.without_prior}`) : "");
}
const short = (value, digits) => (value && Math.abs(value) < 1e-3 ? value.toExponential(digits - 1).replaceAll("-", "\u2212") : number(value, digits));
const signed = (value) => (Math.abs(value) < 0.05 ? "0" : `${value > 0 ? "+" : "\u2212"}${Math.abs(value).toFixed(1)}`);
const MARKS = {   // colour, and a shape: never colour alone
  estimate: (x, y) => drawing("circle", { cx: x, cy: y, r: 3.2, fill: colour("line-0") }),
  prior: (x, y) => drawing("path", { d: `M${x} ${y - 4}L${x + 4} ${y}L${x} ${y + 4}L${x - 4} ${y}Z`, fill: colour("paper"), stroke: colour("line-1"), "stroke-width": 1.4 }),
  reference: (x, y) => drawing("path", { d: `M${x - 3} ${y - 3}L${x + 3} ${y + 3}M${x - 3} ${y + 3}L${x + 3} ${y - 3}`, stroke: colour("line-2"), "stroke-width": 1.6 }),
};
const sample = (name) => drawing("svg", { width: 14, height: 12, "aria-hidden": "true" }, MARKS[name](7, 6));
function figure(row) {
  const width = 130, old = before(row.term), items = [[row.estimate, row.total], ...(row.prior != null ? [[row.prior, row.prior_stderr]] : []), ...(old ? [[old.estimate, old.total]] : [])];
  const low = Math.min(...items.map(([value, error]) => value - 2 * error)), high = Math.max(...items.map(([value, error]) => value + 2 * error)), wide = high - low || 1;
  const x = (value) => 6 + ((value - low) / wide) * (width - 12), bar = (value, error, y, name, thick) => drawing("path", { d: `M${x(value - 2 * error)} ${y}H${x(value + 2 * error)}`, stroke: colour(name), "stroke-width": thick });
  const rows = [6, 14, row.prior != null ? 22 : 14], height = 4 + 8 * (2 + Number(changed() && row.prior != null));
  return drawing("svg", { width, height, role: "img", "aria-label": `${row.term}: ${items.map(([value, error], i) => `${["estimate", row.prior != null ? "prior" : "reference", "reference"][i]} ${number(value)}, two standard errors ${number(2 * error, 2)}`).join("; ")}` },
    low < 0 && high > 0 ? drawing("path", { d: `M${x(0)} 0V${height}`, stroke: colour("quiet"), "stroke-dasharray": "2 2" }) : null,
    bar(row.estimate, row.total, rows[0], "line-0", 1), bar(row.estimate, row.stderr, rows[0], "line-0", 2.6), MARKS.estimate(x(row.estimate), rows[0]),
    row.prior != null ? [bar(row.prior, row.prior_stderr, rows[1], "line-1", 1.4), MARKS.prior(x(row.prior), rows[1])] : [],
    old ? [bar(old.estimate, old.total, rows[2], "line-2", 1.2), MARKS.reference(x(old.estimate), rows[2])] : []);
}
function refer() {
  if (!view.answer) return;
  view.reference = { answer: view.answer, count: view.wanted.windows.length };
  show();
}
function reference() {
  const { answer, count: windowsThen } = view.reference;
  view.parts.reference.replaceChildren(...(view.reference.answer === view.answer
    ? [element("span", { class: "quiet" }, "This fit is the reference: switch a term off above, or a window on the left, and the change is shown.")]
    : [element("span", {}, `Reference: ${answer.model}, ${windowsThen} ${windowsThen === 1 ? "window" : "windows"}, R\u00b2 ${number(answer.attributes.R2, 5)}, residual rms ${number(answer.attributes.residual_rms, 3)}.`), button("Take this fit as the reference", refer)]));
}

// ---- over time -------------------------------------------------------------------------------------------------------
function drawTime() {
  drop();
  const { samples, parts } = view, name = view.answer.coefficient;
  view.width = parts.plots.clientWidth;
  const shared = { x: samples.time, width: view.width, sync: "identification", onzoom: (span) => attempt(() => zoom(span)), marks: breaks, span: view.span || samples.whole };
  const panel = (title, lines, height, more) => {
    const host = element("div", { class: "plot", role: "img", "aria-label": `${title} over the time of the windows` },
      element("div", { class: "plot-title" }, element("b", {}, title), lines.length > 1 && lines.map((line) => element("span", { class: `line-${line.line}` }, line.label))));
    parts.plots.append(host);
    view.plots.push(plot(host, { ...shared, lines, height, ...more }));
  };
  parts.plots.replaceChildren();
  panel(name, [{ label: "measured", values: samples.measured, line: 5, dash: 0, width: 2.2 }, { label: "fitted", values: samples.fitted, line: 1, dash: 0, width: 1.1 }], 165, { timeAxis: false });
  panel("residual", [{ label: "residual", values: samples.residual, line: 0, dash: 0, width: 1 }], 130, { xLabel: "time along the windows, s" });
  strip();
}
async function zoom(span) {
  if (!view.samples) return;
  const [low, high] = view.samples.whole, own = view;
  view.span = span && [Math.max(span[0], low), Math.min(span[1], high)];
  const [start, stop] = view.span || [low, high], found = await post("/api/fit/samples", { fit: view.wanted, start, stop, points: POINTS });
  if (own !== view) return;
  view.samples = { ...found, whole: view.samples.whole };
  drawTime();
}
function strip() {
  const [low, high] = view.span || view.samples.whole, at = (value) => (100 * (value - low)) / (high - low);
  view.parts.strip.replaceChildren(...view.samples.windows.map((one) => {
    const from = Math.max(0, at(one.from)), to = Math.min(100, at(one.to)), text = one.label.startsWith(`${number(one.start, 6)}`) ? one.label : `${one.label}, ${number(one.start, 5)} to ${number(one.end, 5)} s`;
    const node = button(one.label, () => attempt(() => zoom(view.span ? null : [one.from, one.to])), { class: "mark-box step", title: `${one.record}: ${text}`, "aria-label": `${one.record}: ${text}, ${view.span ? "show all windows" : "show this window alone"}` });
    node.style.left = `${from}%`;
    node.style.width = `${Math.max(0, to - from)}%`;
    node.hidden = to <= from;
    return node;
  }));
}
function breaks(made) {
  const { left: x0, top, width, height } = made.bbox, context = made.ctx;
  context.save();
  context.strokeStyle = colour("quiet");
  context.setLineDash([2 * devicePixelRatio, 3 * devicePixelRatio]);
  for (const one of view.samples.windows.slice(1)) {
    const x = made.valToPos(one.from, "x", true);
    if (x <= x0 || x >= x0 + width) continue;
    context.beginPath();
    context.moveTo(x, top);
    context.lineTo(x, top + height);
    context.stroke();
  }
  context.restore();
}

// ---- remarks, spectrum, partial regression, correlation --------------------------------------------------------------
function remarks() {
  const found = view.answer.remarks;
  view.parts.remarks.replaceChildren(...(found.length ? found.map((one) => element("div", { class: `finding ${one.severity}` }, element("p", {}, element("b", {}, one.severity === "error" ? "do not use" : one.severity), ` ${one.text}`))) : [element("p", { class: "quiet" }, "None.")]));
}
const label = (x, y, text, more = {}) => { const node = drawing("text", { x, y, ...more }); node.textContent = text; return node; };
const decades = (low, high) => { const found = []; for (let i = Math.ceil(Math.log10(low)); i <= Math.floor(Math.log10(high)); i++) found.push(10 ** i); return found; };
const power = (value) => { const i = Math.round(Math.log10(value)); return i >= -2 && i <= 2 ? String(Number(value.toPrecision(1))) : `1e${i}`.replace("-", "\u2212"); };
function frame(width, height, x0, y1, title) {
  return [drawing("svg", { viewBox: `0 0 ${width} ${height}`, width: "100%", role: "img", "aria-label": title }), drawing("path", { d: `M${x0} 6V${y1}H${width - 4}`, fill: "none", stroke: "currentColor" })];
}
function spectrum() {
  const { frequency, measured, residual, white, segments, left_out: without } = view.answer.spectrum, width = 310, height = 210, x0 = 44, y1 = height - 34;
  const all = [...measured, ...residual].filter((value) => value > 0), top = Math.max(...all) * 1.5, floor = Math.max(Math.min(...all) / 1.5, top * 1e-9), [f0, f1] = [frequency[0], frequency[frequency.length - 1]];
  const x = (value) => x0 + (Math.log(value / f0) / Math.log(f1 / f0)) * (width - x0 - 8), y = (value) => y1 - (Math.log(Math.max(value, floor) / floor) / Math.log(top / floor)) * (y1 - 8);
  const line = (values) => values.map((value, i) => (value < floor ? "" : `${i && values[i - 1] >= floor ? "L" : "M"}${x(frequency[i]).toFixed(1)} ${y(value).toFixed(1)}`)).join("");
  const [svg, axes] = frame(width, height, x0, y1, "Power spectral density of coefficient and residual over frequency, both logarithmic");
  const rows = decades(floor, top), every = Math.ceil(rows.length / 5);
  svg.append(axes,
    ...decades(f0, f1).flatMap((value) => [drawing("path", { d: `M${x(value)} 6V${y1}`, stroke: colour("grid") }), label(x(value), y1 + 14, power(value), { "text-anchor": "middle" })]),
    ...rows.filter((_, i) => i % every === 0).flatMap((value) => [drawing("path", { d: `M${x0} ${y(value)}H${width - 4}`, stroke: colour("grid") }), label(x0 - 4, y(value) + 4, power(value), { "text-anchor": "end" })]),
    label(width - 4, height - 6, "frequency, Hz", { "text-anchor": "end" }), label(x0 - 38, height - 6, `${view.answer.coefficient}\u00b2/Hz`),
    drawing("path", { d: line(measured), fill: "none", stroke: colour("line-5"), "stroke-width": 2 }), drawing("path", { d: line(residual), fill: "none", stroke: colour("line-1"), "stroke-width": 1.2 }),
    white > floor ? drawing("path", { d: `M${x0} ${y(white)}H${width - 4}`, stroke: colour("line-1"), "stroke-dasharray": "5 3" }) : "",
    ...(view.wanted.band || []).filter((value) => value > f0 && value < f1).map((value, i) => [drawing("path", { d: `M${x(value)} 6V${y1}`, stroke: colour("line-3"), "stroke-dasharray": "6 3" }), i ? "" : label(x(value) + 3, 24, "band")]).flat(),
    ...(view.wanted.cutoff && view.wanted.cutoff > f0 && view.wanted.cutoff < f1 ? [drawing("path", { d: `M${x(view.wanted.cutoff)} 6V${y1}`, stroke: colour("line-2"), "stroke-dasharray": "2 3" }), label(x(view.wanted.cutoff) + 3, 14, "cut-off")] : []));
  view.parts.spectrum.replaceChildren(svg, element("p", { class: "quiet" }, element("span", { class: "line-5" }, "wide: coefficient"), ", ", element("span", { class: "line-1" }, "thin: residual"), `; dashed: a white residual of the same variance. ${segments} ${segments === 1 ? "segment" : "segments"}${without ? `; ${without} shorter ${without === 1 ? "stretch" : "stretches"} left out` : ""}.`));
}
async function partial() {
  const own = view, asked = view.answer, found = await post("/api/fit/partial", { fit: view.wanted, term: view.term });
  if (own !== view || asked !== view.answer) return;
  const width = 310, height = 210, x0 = 50, y1 = height - 34, most = (values) => Math.max(...values.map(Math.abs)) * 1.06 || 1, [mx, my] = [most(found.x), most(found.y)];
  const x = (value) => x0 + ((value + mx) / (2 * mx)) * (width - x0 - 8), y = (value) => y1 - ((value + my) / (2 * my)) * (y1 - 8);
  const end = Math.min(mx, my / Math.abs(found.slope || 1e-300)), [svg, axes] = frame(width, height, x0, y1, `Partial regression of ${view.answer.coefficient} on ${found.term}, slope ${number(found.slope)}`);
  const ticks = (m) => [-0.5, 0, 0.5].map((part) => Number((part * m).toPrecision(1)));
  svg.append(axes,
    ...ticks(mx).flatMap((value) => [drawing("path", { d: `M${x(value)} 6V${y1}`, stroke: colour("grid") }), label(x(value), y1 + 14, number(value, 1), { "text-anchor": "middle" })]),
    ...ticks(my).flatMap((value) => [drawing("path", { d: `M${x0} ${y(value)}H${width - 4}`, stroke: colour("grid") }), label(x0 - 4, y(value) + 4, number(value, 1), { "text-anchor": "end" })]),
    drawing("path", { d: found.x.map((value, i) => `M${x(value).toFixed(1)} ${y(found.y[i]).toFixed(1)}h0`).join(""), stroke: colour("line-5"), "stroke-width": 2.4, "stroke-linecap": "round", opacity: 0.7 }),
    drawing("path", { d: `M${x(-end)} ${y(-end * found.slope)}L${x(end)} ${y(end * found.slope)}`, stroke: colour("line-1"), "stroke-width": 1.6 }),
    label(width - 4, height - 6, `${found.term}, less the other terms`, { "text-anchor": "end" }), label(4, height - 6, view.answer.coefficient));
  view.parts.partial.replaceChildren(
    labelled("Term", select(view.answer.terms.map((row) => row.term).filter((term) => !view.wanted.band || !constant(term)), view.term, (value) => { view.term = value; estimates(); attempt(partial, view.parts.partial); })), svg,
    element("p", { class: "quiet" }, `Both less what the other terms explain${(view.wanted.weights || "equal") === "equal" ? "" : ", weighted"}${view.wanted.band ? ", transformed: real and imaginary parts at every frequency of the band" : ""}; the slope of the line is ${view.wanted.ridge ? `the estimate without the ridge, ${number(found.slope, 5)}; with it ${number(view.answer.terms.find((row) => row.term === found.term).estimate, 5)}` : `the estimate, ${number(found.slope, 5)}`}.${found.samples > found.x.length ? ` ${found.x.length} of ${found.samples} are drawn.` : ""}`));
}
function correlation() {
  const names = view.answer.terms.map((row) => row.term), rows = view.answer.correlation;
  const cell = (value, i, j) => {
    const node = element("td", { class: "number" }, value.toFixed(2).replace("-", "\u2212"));
    if (i !== j) node.style.background = `color-mix(in srgb, ${colour(value < 0 ? "exit" : "line-1")} ${Math.round(45 * Math.abs(value))}%, transparent)`;
    return node;
  };
  view.parts.correlation.replaceChildren(element("div", { class: "matrix" }, element("table", { "aria-label": "Correlation of the estimates" },
    element("thead", {}, element("tr", {}, element("th", { scope: "col" }, element("span", { class: "hidden" }, "term")), names.map((name) => element("th", { scope: "col", class: "number" }, name)))),
    element("tbody", {}, rows.map((row, i) => element("tr", {}, element("th", { scope: "row" }, names[i]), row.map((value, j) => cell(value, i, j))))))));
}
function leftOut() {
  const node = view.parts.without, own = view, asked = view.answer;
  node.replaceChildren(button("Leave out each window, then each term", () => attempt(async () => {
    node.replaceChildren(element("p", { class: "quiet" }, "fitting ..."));
    const { rows } = await post("/api/fit/without", view.wanted);
    if (own !== view || asked !== view.answer) return;
    const shift = (row) => {
      if (row.refused) return `no fit: ${row.refused}`;
      const found = asked.terms.filter((one) => row.estimates[one.term] != null && !numbered(one.term)).map((one) => [one.term, (row.estimates[one.term] - one.estimate) / one.total]).sort((a, b) => Math.abs(b[1]) - Math.abs(a[1]))[0];
      return found ? `${found[0]} ${signed(found[1])} s.e.` : "";
    };
    node.replaceChildren(rows.length ? table([["left out", (row) => `${row.left_out} ${row.name}`], ["R\u00b2", (row) => (row.R2 == null ? "" : row.R2.toFixed(4)), { number: true }], ["residual rms", "residual_rms", { number: true, digits: 3 }], ["largest change", shift]], rows, { label: "Fits with one window or one term left out" }) : element("p", {}, "One window and one term: nothing to leave out."));
  }, node)));
}

// ---- save ------------------------------------------------------------------------------------------------------------
function saving() {
  const node = view.parts.save, { about, answer, origin } = view;
  if (!answer) { node.replaceChildren(element("p", { class: "quiet" }, "No fit.")); return; }
  const from = origin && about.fits[origin[0]], proposed = (from ? `${from.name} ${answer.coefficient}` : answer.coefficient).replace(/[^\w]+/g, "_");
  const name = element("input", { value: view.name ?? proposed, oninput: () => { view.name = name.value; } });
  const error = view.parts.failed || element("div"), given = () => {
    const text = name.value.trim();
    if (!/^[\w\- ]+$/.test(text)) throw new Error("Give a name of letters, digits, spaces, _ and -.");
    return text;
  };
  const models = from && (from.models.some((text) => text.split("=")[0].trim() === answer.coefficient) ? from.models.map((text) => (text.split("=")[0].trim() === answer.coefficient ? answer.model : text)) : [...from.models, answer.model]);
  view.parts.failed = error;
  redraw(node, String(origin), labelled("Name", name), error,
    element("div", { class: "row" },
      button("Save the fit", () => attempt(() => act([...answer.command, "-o", `{work}/fits/${given()}.nc`]), error)),
      button("Add to the project as a new fit", () => attempt(async () => {
        const { entries } = await post("/api/fit/entry", { fit: view.wanted, name: given() });
        for (const text of entries) await act(["set", about.file, "fit.+", text]);
      }, error)),
      from ? button(`Write the model into \u201c${from.name}\u201d`, () => attempt(() => act(["set", about.file, `fit.${origin[0]}.models`, JSON.stringify(models)]), error), { disabled: JSON.stringify(models) === JSON.stringify(from.models) }) : null),
    view.wanted.band || view.wanted.ridge || view.intercepts !== "common" || (view.wanted.weights && view.wanted.weights !== "equal") ? element("p", { class: "quiet" }, "A fit of the project is made in time by equal weights, without ridge, with one constant; the saved fit is the one shown.") : "",
    element("p", { class: "quiet" }, about.saved.length ? `Saved: ${about.saved.map((file) => file.replace("{work}/fits/", "")).join(", ")}` : "None saved yet."));
}
