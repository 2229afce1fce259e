// ---- identification: estimates, and their change against a reference ---------------------------------------------------
import { attempt, button, colour, drawing, element, number, redraw, table } from "./core.js";
import { show } from "./identification.js";
import { partial } from "./identification_figures.js";
import { constant, numbered, short, signed, view } from "./identification_state.js";

const before = (term) => (changed() && !numbered(term) ? view.reference.answer.terms.find((row) => row.term === term) : null);
const changed = () => view.reference && view.reference.answer !== view.answer && view.reference.answer.coefficient === view.answer.coefficient;
export function estimates() {
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
export function refer() {
  if (!view.answer) return;
  view.reference = { answer: view.answer, count: view.wanted.windows.length };
  show();
}
export function reference() {
  const { answer, count: windowsThen } = view.reference;
  view.parts.reference.replaceChildren(...(view.reference.answer === view.answer
    ? [element("span", { class: "quiet" }, "This fit is the reference: switch a term off above, or a window on the left, and the change is shown.")]
    : [element("span", {}, `Reference: ${answer.model}, ${windowsThen} ${windowsThen === 1 ? "window" : "windows"}, R\u00b2 ${number(answer.attributes.R2, 5)}, residual rms ${number(answer.attributes.residual_rms, 3)}.`), button("Take this fit as the reference", refer)]));
}
