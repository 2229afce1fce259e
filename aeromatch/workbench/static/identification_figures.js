// ---- identification: remarks, spectrum, partial regression, correlation, what changes without a part ----------------
import { attempt, button, colour, drawing, element, labelled, number, post, select, table, ticks as roundTicks } from "./core.js";
import { decades, frame, label, power } from "./graphs.js";
import { estimates } from "./identification_estimates.js";
import { constant, numbered, signed, view } from "./identification_state.js";

export function remarks() {
  const found = view.answer.remarks;
  view.parts.remarks.replaceChildren(...(found.length ? found.map((one) => element("div", { class: `finding ${one.severity}` }, element("p", {}, element("b", {}, one.severity === "error" ? "do not use" : one.severity), ` ${one.text}`))) : [element("p", { class: "quiet" }, "None.")]));
}
export function spectrum() {
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
export async function partial() {
  const own = view, asked = view.answer, found = await post("/api/fit/partial", { fit: view.wanted, term: view.term });
  if (own !== view || asked !== view.answer) return;
  const width = 310, height = 210, x0 = 50, y1 = height - 34, most = (values) => Math.max(...values.map(Math.abs)) * 1.06 || 1, [mx, my] = [most(found.x), most(found.y)];
  const x = (value) => x0 + ((value + mx) / (2 * mx)) * (width - x0 - 8), y = (value) => y1 - ((value + my) / (2 * my)) * (y1 - 8);
  const end = Math.min(mx, my / Math.abs(found.slope || 1e-300)), [svg, axes] = frame(width, height, x0, y1, `Partial regression of ${view.answer.coefficient} on ${found.term}, slope ${number(found.slope)}`);
  const ticks = (m) => roundTicks(-m, m, 4);
  svg.append(axes,
    ...ticks(mx).flatMap((value) => [drawing("path", { d: `M${x(value)} 6V${y1}`, stroke: colour("grid") }), label(x(value), y1 + 14, number(value, 3), { "text-anchor": "middle" })]),
    ...ticks(my).flatMap((value) => [drawing("path", { d: `M${x0} ${y(value)}H${width - 4}`, stroke: colour("grid") }), label(x0 - 4, y(value) + 4, number(value, 3), { "text-anchor": "end" })]),
    drawing("path", { d: found.x.map((value, i) => `M${x(value).toFixed(1)} ${y(found.y[i]).toFixed(1)}h0`).join(""), stroke: colour("line-5"), "stroke-width": 2.4, "stroke-linecap": "round", opacity: 0.7 }),
    drawing("path", { d: `M${x(-end)} ${y(-end * found.slope)}L${x(end)} ${y(end * found.slope)}`, stroke: colour("line-1"), "stroke-width": 1.6 }),
    label(width - 4, height - 6, `${found.term}, less the other terms`, { "text-anchor": "end" }), label(4, height - 6, view.answer.coefficient));
  view.parts.partial.replaceChildren(
    labelled("Term", select(view.answer.terms.map((row) => row.term).filter((term) => !view.wanted.band || !constant(term)), view.term, (value) => { view.term = value; estimates(); attempt(partial, view.parts.partial); })), svg,
    element("p", { class: "quiet" }, `Both less what the other terms explain${(view.wanted.weights || "equal") === "equal" ? "" : ", weighted"}${view.wanted.band ? ", transformed: real and imaginary parts at every frequency of the band" : ""}; the slope of the line is ${view.wanted.ridge ? `the estimate without the ridge, ${number(found.slope, 5)}; with it ${number(view.answer.terms.find((row) => row.term === found.term).estimate, 5)}` : `the estimate, ${number(found.slope, 5)}`}.${found.samples > found.x.length ? ` ${found.x.length} of ${found.samples} are drawn.` : ""}`));
}
export function correlation() {
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
export function leftOut() {
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
