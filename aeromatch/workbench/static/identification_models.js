// ---- identification: selection of terms, output error, and the board of saved models ----------------------------------
import { act, attempt, button, element, get, labelled, number, plot, post, redraw, select, table } from "./core.js";
import { again, left, model, terms, wanted } from "./identification.js";
import { short, view } from "./identification_state.js";
import { validationWindows, windows } from "./identification_windows.js";

const METHODS = [["stepwise", "stepwise"], ["orthogonal", "orthogonal functions"], ["prediction", "prediction of left-out parts"]];
const fileName = (text) => {
  if (!/^[\w\- ]+$/.test(text)) throw new Error("Give a name of letters, digits, spaces, _ and -.");
  return `{work}/fits/${text.trim()}.nc`;
};
const shortName = (place) => place.replace("{work}/fits/", "").replace(/\.nc$/, "");
const commandText = (words) => element("p", { class: "quiet" }, "The same by hand: ", element("code", {}, `aeromatch ${words.map((word) => (/[\s*()^]/.test(word) ? `'${word}'` : word)).join(" ")}`.replaceAll("{project}/", "").replaceAll("{work}/", "WORK/")));
const remarkList = (found) => found.map((one) => element("div", { class: `finding ${one.severity}` }, element("p", {}, element("b", {}, one.severity === "error" ? "do not use" : one.severity), ` ${one.text}`)));

// ---- selection -------------------------------------------------------------------------------------------------------
export function selectionForm() {
  const given = (view.select = view.select || { method: "stepwise", order: 2, variables: "", terms: "", free: false, coefficient: "", answer: null });
  const known = [...new Set(terms().filter((term) => term !== "1").flatMap((term) => term.split(/[*^]/)).map((one) => one.trim()).filter((one) => /^[a-z_]\w*$/i.test(one)))];
  if (given.coefficient !== left()) { Object.assign(given, { coefficient: left(), variables: known.join(" "), answer: null }); if (view.parts.chosenTerms) view.parts.chosenTerms.replaceChildren(); }
  const variables = element("input", { class: "model", value: given.variables, "aria-label": "Variables of the candidates", onchange: (event) => { given.variables = event.target.value; } });
  const more = element("input", { class: "model", value: given.terms, placeholder: "ramp(alpha,12 deg)", "aria-label": "Further candidates, by semicolons", onchange: (event) => { given.terms = event.target.value; } });
  const order = element("input", { type: "number", min: 1, max: 9, value: given.order, "aria-label": "Highest order of the products", onchange: (event) => { given.order = Number(event.target.value); } });
  const free = element("input", { type: "checkbox", checked: given.free, onchange: (event) => { given.free = event.target.checked; } });
  const found = (view.parts.chosenTerms = view.parts.chosenTerms || element("div"));
  const run = () => attempt(async () => {
    const own = view, body = { windows: windows(), coefficient: left(), variables: given.variables, order: given.order, terms: given.terms.split(";").map((one) => one.trim()).filter(Boolean), method: given.method, free: given.free, cutoff: view.cutoff };
    if (!body.windows.length) throw new Error("Choose windows on the left.");
    found.replaceChildren(element("p", { class: "quiet" }, "selecting ..."));
    const answer = await post("/api/select", body);
    if (own !== view) return;
    given.answer = answer;
    chosenTerms();
  }, found);
  view.parts.selection.replaceChildren(
    element("div", { class: "row fill" }, "Candidates: products of", variables), element("div", { class: "row fill" }, "and", more),
    element("div", { class: "row" }, labelled("up to order", order), labelled("by", select(METHODS, given.method, (value) => { given.method = value; }, { "aria-label": "method of the selection" })), element("label", { class: "row" }, free, "without hierarchy"), button(`Select the terms of ${left()}`, run, { class: "first" })),
    found);
}
function chosenTerms() {
  const { answer } = view.select, error = element("div"), name = element("input", { value: `${left()}_${view.select.method}`, "aria-label": "Name of the selection" }), fix = (key, digits) => (row) => number(row[key], digits);
  view.parts.chosenTerms.replaceChildren(
    element("p", {}, element("b", {}, answer.model), `, R\u00b2 ${number(answer.R2, 5)}, of ${answer.candidates} candidates${answer.allowed ? `; ${answer.allowed} models are allowed by the data` : ""}.`),
    element("div", { class: "scroll" }, table([["step", "action"], ["term", "term"], ["F", fix("F", 4), { number: true }], ["partial corr.", fix("partial_correlation", 3), { number: true }], ["R\u00b2", fix("R2", 5), { number: true }], ["PSE", fix("PSE", 3), { number: true }], ["PRESS", fix("PRESS", 3), { number: true }], ["terms", "terms", { number: true }]], answer.steps, { label: "Steps of the selection" })),
    answer.models.length ? element("div", { class: "scroll" }, table([["weight", (row) => number(row.weight, 3), { number: true }], ["worse by", (row) => number(row.difference, 3), { number: true }], ["model", "model"]], answer.models, { label: "Models that the data allow" })) : "",
    answer.idle.length ? element("p", { class: "quiet" }, `Candidates that do not move: ${answer.idle.join(" ")}.`) : "", ...remarkList(answer.remarks),
    element("div", { class: "row" }, button("Take this model", () => { view.text = answer.model; view.off.clear(); model(); again(); }), name, button("Save the selection", () => attempt(() => act([...answer.command, "-o", fileName(name.value)]), error))), error, commandText(answer.command));
}

// ---- output error ----------------------------------------------------------------------------------------------------
export function outputErrorForm() {
  const given = (view.motionGiven = view.motionGiven || { motion: "short-period", disturbance: "none" }), error = element("div"), found = (view.parts.motionFound = view.parts.motionFound || element("div"));
  const name = element("input", { value: given.name || `oe_${given.motion.replace("-", "_")}`, "aria-label": "Name of the fit by output error", oninput: (event) => { given.name = event.target.value; } });
  const run = () => attempt(async () => {
    const own = view, list = windows();
    if (!list.length) throw new Error("Choose windows on the left.");
    const { command } = await post("/api/motion", { windows: list, motion: given.motion, disturbance: given.disturbance }), file = fileName(name.value);
    let failed = null;
    try { await act([...command, "-o", file], { wait: 1 }); } catch (one) { failed = one; }
    if (own !== view) return;
    let answer;
    try { answer = await get("/api/model", { model: file }); } catch (one) { throw failed || one; }
    found.replaceChildren(element("p", {}, element("b", {}, shortName(file)), `: ${answer.method}; derivatives per second, angles in rad.`),
      table([["parameter", "name"], ["estimate", (row) => short(row.estimate, 4), { number: true }], ["std. error", (row) => short(row.stderr, 2), { number: true }]], answer.rows, { label: "Estimates by output error" }), ...remarkList(answer.remarks), commandText([...command, "-o", file]));
  }, error);
  view.parts.motion.replaceChildren(
    element("p", { class: "quiet" }, "The motion is simulated from the controls of the chosen windows; no coefficients and no database are needed."),
    element("div", { class: "row" }, labelled("Motion", select([["short-period", "short period"], ["lateral", "lateral"]], given.motion, (value) => { given.motion = value; given.name = ""; outputErrorForm(); })),
      labelled("Disturbance", select([["none", "none: output error"], ["process", "white process noise: filter error"]], given.disturbance, (value) => { given.disturbance = value; })), name, button("Estimate and save", run, { class: "first" })), error, found);
}

// ---- board -----------------------------------------------------------------------------------------------------------
const ORDER = { model: 1, method: 1, parameters: 1, R2: -1, theil: 1, remarks: 1 };
export function boardForm() {
  const board = (view.boardGiven = view.boardGiven || { off: new Set(), sort: "R2", up: false, answer: null, shown: null }), found = (view.parts.boardFound = view.parts.boardFound || element("div"));
  const models = view.about.saved, others = validationWindows();
  redraw(view.parts.board, "board",
    models.length ? element("div", { class: "row", role: "group", "aria-label": "Saved models" }, models.map((place) => button(shortName(place), (event) => { if (board.off.has(place)) board.off.delete(place); else board.off.add(place); event.target.setAttribute("aria-pressed", String(!board.off.has(place))); }, { class: "chip", "aria-pressed": String(!board.off.has(place)) }))) : element("p", {}, "No model is saved yet: save a fit, a selection or a fit by output error."),
    element("div", { class: "row" }, button("Compare the models", () => compare(), { class: "first", disabled: !models.length || !others.length }),
      element("span", { class: "quiet" }, others.length ? `on ${others.length} ${others.length === 1 ? "window" : "windows"} of ${new Set(others.map((one) => one.record)).size} records` : "Mark windows with \u201cval\u201d on the left: those that no model has used.")), found);
}
const chosenModels = () => view.about.saved.filter((place) => !view.boardGiven.off.has(place));
async function compare() {
  const own = view, board = view.boardGiven;
  await attempt(async () => {
    view.parts.boardFound.replaceChildren(element("p", { class: "quiet" }, "predicting ..."));
    const request = { models: chosenModels(), windows: validationWindows(), cutoff: view.cutoff }, answer = await post("/api/board", request);
    if (own !== view) return;
    Object.assign(board, { answer, request });
    boardTables();
  }, view.parts.boardFound);
}
function sorted(rows) {
  const { sort, up } = view.boardGiven, direction = (ORDER[sort] || 1) * (up ? -1 : 1), place = sort === "R2" ? "common" : sort, key = (row) => (row[place] == null ? Infinity * direction : row[place]);   // different windows do not rank models
  return [...rows].sort((a, b) => (key(a) < key(b) ? -1 : key(a) > key(b) ? 1 : 0) * direction);
}
function boardTables() {
  const board = view.boardGiven, { answer, request } = board, error = element("div"), figure = element("div"), name = element("input", { value: "board", "aria-label": "Name of the board" });
  const heads = [["model", "model"], ["method", "method"], ["channels", "channels"], ["parameters", "parameters"], ["windows", "windows"], ["common", "common R\u00b2"], ["R2", "R\u00b2"], ["theil", "Theil"], ["remarks", "rows with remarks"]], fix = { common: 5, R2: 5, theil: 4 };
  const node = table(heads.map(([key, text]) => [text, (row) => (fix[key] ? number(row[key], fix[key]) || "none" : String(row[key])), { number: !["model", "method", "channels", "windows"].includes(key) }]), sorted(answer.summary), { label: "Models on the windows that they have not used", chosen: (row) => row.model === board.shown, onchoose: (row) => { board.shown = row.model; boardTables(); } });
  [...node.tHead.rows[0].cells].forEach((cell, i) => {
    const [key, text] = heads[i];
    if (!(key in ORDER)) return;
    cell.setAttribute("aria-sort", board.sort === key ? ((ORDER[key] > 0) !== board.up ? "ascending" : "descending") : "none");
    cell.replaceChildren(button(`${text}${board.sort === key ? ((ORDER[key] > 0) !== board.up ? " \u2191" : " \u2193") : ""}`, () => { board.up = board.sort === key ? !board.up : false; board.sort = key; boardTables(); }, { class: "head" }));
  });
  const rows = board.shown ? answer.rows.filter((row) => row.model === board.shown) : [];
  view.parts.boardFound.replaceChildren(
    element("div", { class: "scroll" }, node),
    element("p", { class: "quiet" }, "R\u00b2 and Theil's coefficient over all windows that the model has not used, the worst of its channels. Common windows are those that no model has used: the order by R\u00b2 is that over them. A row shows its channels and windows. Below 0.3 Theil's coefficient counts as good."),
    rows.length ? element("div", { class: "scroll" }, table([["channel", "channel"], ["window", "window"], ["samples", "samples", { number: true, digits: 9 }], ["R\u00b2", (row) => number(row.R2, 5), { number: true }], ["Theil", (row) => number(row.theil, 4), { number: true }], ["bias", (row) => number(row.theil_bias, 2), { number: true }], ["variance", (row) => number(row.theil_variance, 2), { number: true }], ["covariance", (row) => number(row.theil_covariance, 2), { number: true }], ["rms", (row) => `${number(row.rms, 4)} ${row.rms == null ? "" : row.unit === "1" ? "" : row.unit}`, { number: true }], ["% of range", (row) => number(row.nrmse, 3), { number: true }], ["remarks", "remarks"]], rows, { label: `Channels and windows of ${board.shown}` })) : "",
    figure,
    element("div", { class: "row" }, name, button("Save the board", () => attempt(async () => { if (!/^[\w\- ]+$/.test(name.value)) throw new Error("Give a name of letters, digits, spaces, _ and -."); await act([...answer.command, "-o", `{work}/boards/${name.value.trim()}.csv`]); }, error))), error, commandText(answer.command));
  if (board.shown) attempt(() => predictions(board.shown, request, figure), figure);
}
async function predictions(name, request, host) {   // each window by the chosen model, measured and predicted
  const own = view, place = request.models.find((one) => shortName(one) === name);
  const answers = await Promise.all(request.windows.slice(0, 6).map((window) => post("/api/prediction", { models: [place], windows: [window], cutoff: request.cutoff }).catch((error) => ({ error: error.message, window: `${window.record} ${window.start}` }))));
  if (own !== view || !host.isConnected) return;
  for (const answer of answers) {
    host.append(element("h3", {}, answer.window));
    if (answer.error) { host.append(element("p", { class: "fail" }, answer.error)); continue; }
    for (const one of answer.channels) {
      const node = element("div", { class: "plot", role: "img", "aria-label": `${one.channel}, measured and predicted, ${answer.window}` }, element("div", { class: "plot-title" }, element("b", {}, one.channel), element("span", { class: "quiet" }, one.unit === "1" ? "" : one.unit), element("span", { class: "line-5" }, "wide: measured"), element("span", { class: "line-1" }, "thin: predicted")));
      host.append(node);
      plot(node, { x: one.time, width: host.clientWidth, height: 110, lines: [{ label: "measured", values: one.measured, line: 5, dash: 0, width: 2.2 }, { label: "predicted", values: one.predicted, line: 1, dash: 0, width: 1.1 }] });
    }
  }
}

// ---- the fit itself on the windows to validate -----------------------------------------------------------------------
export function validationChanged() {
  boardForm();
  clearTimeout(view.validateLater);
  view.validateLater = setTimeout(() => view && attempt(validateFit), 150);
}
export async function validateFit() {
  const own = view, node = view.parts.validated, list = validationWindows(), asked = view.answer;
  if (!list.length || !asked) { node.replaceChildren(); return; }
  const found = await attempt(() => post("/api/fit/validation", { fit: wanted(), windows: list }), node);
  if (!found || own !== view || asked !== view.answer) return;
  const [total] = found.summary, rows = found.rows.filter((row) => row.window !== "all"), remarked = rows.filter((row) => row.remarks);
  node.replaceChildren(element("p", { class: "validated" }, element("b", {}, `R\u00b2 ${number(total.R2, 5) || "none"} on other windows`), `, Theil ${number(total.theil, 4) || "none"}: ${rows.map((row) => `${row.window} ${number(row.R2, 4) || "no figure"}`).join("; ")}.`),
    ...remarked.map((row) => element("p", { class: "quiet" }, `${row.window}: ${row.remarks}.`)));
}
