// ---- identification: windows, model, fit, and what changes without a term or a manoeuvre ------------------------------
import { act, attempt, button, element, get, inTurn, key, labelled, number, post, redraw, select, watch } from "./core.js";
import { estimates, refer, reference } from "./identification_estimates.js";
import { correlation, leftOut, partial, remarks, spectrum } from "./identification_figures.js";
import { boardForm, outputErrorForm, selectionForm, validateFit } from "./identification_models.js";
import { saving } from "./identification_save.js";
import { POINTS, constant, numbered, setView, view } from "./identification_state.js";
import { drawTime, drop, zoom } from "./identification_time.js";
import { count, list, records, start, starts, windows } from "./identification_windows.js";

const WAIT = 120;   // milliseconds from the last change to the fit
const WEIGHTS = [["equal", "equal"], ["manoeuvre", "by manoeuvre"], ["robust", "robust (Huber)"]];

export function open(host) {
  setView({
    host, parts: {}, rows: new Map(), own: new Map(), chosen: new Set(), validation: new Set(), off: new Set(), text: "", origin: null, intercepts: "common", weights: "equal",
    cutoff: null, prior: null, ridge: "", band: null, domain: "time", answer: null, reference: null, name: null, term: null, span: null, plots: [], refresh: inTurn(refresh), changed: () => attempt(view.refresh),
  });
  const part = (name, node) => (view.parts[name] = node);
  host.replaceChildren(part("none", element("div", { class: "none", hidden: true })), element("div", { class: "columns fit" },
    element("nav", { class: "column", "aria-label": "Windows" },
      element("h2", {}, "Start from"), part("start", element("div")),
      element("h2", {}, "Windows"), part("count", element("p", { class: "quiet" })), part("records", element("div"))),
    element("div", { class: "column" },
      part("model", element("div")), part("error", element("div")), part("outcome", element("p", { role: "status", "aria-live": "polite" })), part("validated", element("div")),
      part("selectionFold", element("details", {}, element("summary", {}, "Selection of terms"), part("selection", element("div")))),
      part("motionFold", element("details", {}, element("summary", {}, "Output error"), part("motion", element("div")))),
      part("boardFold", element("details", {}, element("summary", {}, "Board of models, on windows that they have not used"), part("board", element("div")))),
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
  setView(null);
}

async function refresh() {
  const own = view, first = !view.about || !view.about.records.length, about = await get("/api/identification");
  if (own !== view) return;
  view.about = about;
  const without = !about.records.length;
  view.host.querySelector(".columns").hidden = without;
  view.parts.none.hidden = !without && !about.older.length;
  if (without || about.take) { attempt(takePaths); if (without) return; }
  else if (about.older.length) view.parts.none.replaceChildren(element("p", { class: "fail" }, `Older than their recording, its name map or the aircraft: ${about.older.join(", ")}. Reconstruct them again.`));
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
// Paths of a match are in its store: they are written, not computed again; then the page is drawn.
async function takePaths() {
  const own = view, { about } = view, node = view.parts.none, error = element("div"), write = () => attempt(() => act(["match", about.project, "--paths", "-o", "{work}/paths"], { wait: 1 }), error);
  const texts = about.take
    ? [`The last match has reconstructed ${about.kept.length} records: they are taken from its store.`]
    : ["No record is reconstructed yet. Reconstruct one on the page of the records, or all of them here, as the match does; the coefficients are formed along the reconstructed path.", about.matched ? "The store does not have what the last match has reconstructed: the project, its files or the program have changed since, or nothing is stored." : ""];
  node.replaceChildren(...texts.map((text) => element("p", {}, text)), about.take ? "" : button("Reconstruct all records as the match does", write), error);
  if (about.take && !own.taken) { own.taken = true; await write(); }
}
export function formed() {   // the forms, as the fit is chosen; the fit itself may take its time
  records();
  model();
  saving();
  selectionForm();
  outputErrorForm();
  boardForm();
  attempt(fit);
}

// ---- model -------------------------------------------------------------------------------------------------------------
export const left = () => view.text.split("=")[0].trim();
export const terms = () => view.text.slice(view.text.indexOf("=") + 1).split("+").map((one) => one.trim()).filter(Boolean);
const effective = () => `${left()} = ${terms().filter((one) => !view.off.has(one)).join(" + ")}`;
export function model() {
  if (view.select && view.select.coefficient !== left()) selectionForm();
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
export const wanted = () => ({
  windows: windows(), model: effective(), intercepts: view.intercepts, cutoff: view.cutoff, prior: view.prior, ridge: view.ridge === "auto" ? "auto" : Number(view.ridge || 0),
  ...(view.domain === "time" ? { weights: view.weights } : { band: view.band }),
});

// ---- fit ---------------------------------------------------------------------------------------------------------------
export function again() {
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
  for (const name of ["estimates", "reference", "strip", "plots", "without", "remarks", "spectrum", "partial", "correlation", "validated"]) view.parts[name].replaceChildren();
  saving();
}
export function show() {
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
  attempt(validateFit);
}
