// ---- the plots of the case on the screen: one time axis, one cursor ----------------------------------------------------
const DASH = { "run-0": [], "run-1": [1.5, 2.5], "run-2": [7, 3.5], "run-3": [9, 3, 2, 3], "run-4": [13, 4], "run-5": [9, 3, 2, 3, 2, 3] };
const AXIS = 58, RIGHT = 18;
const WIDTH = { judged: 2.2, shown: 1.9, input: 1.4 };   // of the flight line: it shows on both sides of a model that lies on it
const HEIGHT = { judged: 178, input: 84, shown: 92, strip: 46, time: 26 };
const GROUPS = { input: "Inputs", shown: "Further channels, without tolerance" };
let view = null;   // the case on the screen: page, data, plots, span of time, hidden runs

function options(width, height, withTime, series, bands, range, splits) {
  const grid = { stroke: colour("grid"), width: 1 }, values = (_, found, __, ___, increment) => tickText(found, found.length > 1 ? found[1] - found[0] : increment);
  const axis = { stroke: colour("quiet"), font: font(11), grid, ticks: { show: true, size: 4, stroke: colour("quiet"), width: 1 }, values, incrs: STEPS };
  return {
    width, height: height + (withTime ? HEIGHT.time : 0), padding: [6, RIGHT, withTime ? 0 : 5, 0],
    legend: { show: false },
    cursor: {
      y: false, points: { show: false }, sync: { key: "time", scales: ["x", null] }, drag: { x: true, y: false, setScale: false, dist: 4 },
      bind: { dblclick: () => () => { zoom(null); return null; } },
    },
    scales: { x: { time: false, range: () => view.span }, y: { range } },
    axes: [
      { ...axis, size: withTime ? HEIGHT.time : 0, ticks: { ...axis.ticks, show: withTime }, values: withTime ? values : () => [], gap: 3 },
      { ...axis, size: AXIS, gap: 4, splits: (_, __, low, high) => splits || ticks(low, high, Math.max(2, Math.floor(height / 26))) },
    ],
    series: [{}, ...series], bands,
  };
}
const lineOf = (style, width = 1.4) => ({ stroke: () => colour(style), width: style === "run-1" ? width + 0.3 : width, dash: DASH[style].map((length) => length * devicePixelRatio), points: { show: false }, spanGaps: false });
const hooks = {
  setCursor: [(plot) => readOut(plot.cursor.idx)],
  setSelect: [(plot) => {
    if (plot !== view.dragged || plot.select.width < 1) return;
    view.dragged = null;
    const from = plot.posToVal(plot.select.left, "x"), to = plot.posToVal(plot.select.left + plot.select.width, "x");
    view.plots.forEach((other) => other.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false));
    zoom([from, to]);
  }],
  ready: [(plot) => plot.over.addEventListener("mousedown", () => { view.dragged = plot; })],
  drawAxes: [(plot) => {
    plot.ctx.strokeStyle = colour("quiet"); plot.ctx.lineWidth = devicePixelRatio;
    plot.ctx.strokeRect(plot.bbox.left, plot.bbox.top, plot.bbox.width, plot.bbox.height);
  }],
};
const band = () => ({ series: [1, 2], fill: () => colour("band") });
const edgeLine = () => ({ stroke: () => colour("edge"), width: 0.8, points: { show: false } });

function drawPanel(panel, host, width, withTime) {
  const { time, runs } = view.data, { flight, applied } = panel.traces, half = flight && panel.half;
  const series = [], data = [time], bands = [];
  if (half) { data.push(...edges(flight, half)); series.push(edgeLine(), edgeLine()); bands.push(band()); }
  const styles = Object.fromEntries(runs.map((run) => [run.name, run.style]));
  for (const { name } of runs) if (`${name} 0` in panel.fans) drawFan(panel.fans, name, styles[name], data, series, bands);
  if (flight || applied) { data.push(flight || applied); series.push({ ...lineOf("run-0", WIDTH[panel.kind]), show: !flight || !view.hidden.has("flight") }); }
  for (const { name } of runs) if (name !== "flight" && panel.traces[name]) { data.push(panel.traces[name]); series.push({ ...lineOf(styles[name]), show: !view.hidden.has(name), run: name }); }
  // a hair line of the flight on top, so that no model hides it
  if (flight) { data.push(flight); series.push({ ...lineOf("run-0", 0.8), show: !view.hidden.has("flight") }); }
  if (panel.mode) for (const edge of envelope(panel.mode, time)) { data.push(edge); series.push({ ...edgeLine(), stroke: () => colour("quiet"), dash: [3 * devicePixelRatio, 2 * devicePixelRatio] }); }
  const setting = options(width, HEIGHT[panel.kind], withTime && !half, series, bands, () => limits(panel, view.hidden, time, view.span));
  setting.hooks = { ...hooks, drawAxes: [...hooks.drawAxes, (plot) => { drawValues(plot, panel); drawExceedance(plot, panel, time); }], draw: [(plot) => drawMarks(plot, panel, time)] };
  view.plots.push(new uPlot(setting, data, host));
  if (half) view.plots.push(drawResidual(panel, host, width, withTime, styles));
}
function drawFan(fans, name, style, data, series, bands) {   // quantiles 5, 25, 50, 75, 95 %: two nested areas
  for (const [high, low] of [[4, 0], [3, 1]]) {
    data.push(fans[`${name} ${high}`], fans[`${name} ${low}`]);
    for (const _ of [high, low]) series.push({ width: 0, points: { show: false }, show: !view.hidden.has(name) });
    bands.push({ series: [series.length - 1, series.length], fill: () => `color-mix(in srgb, ${colour(style)} 24%, transparent)` });
  }
}
function drawResidual(panel, host, width, withTime, styles) {
  const { time, runs } = view.data, { traces, half } = panel;
  const unit = (sign) => half.map((h) => (h == null ? null : sign));
  const data = [time, unit(1), unit(-1)], series = [edgeLine(), edgeLine()];
  for (const { name } of runs) if (name !== "flight" && traces[name]) {
    data.push(ratios(traces[name], traces.flight, half));
    series.push({ ...lineOf(styles[name], 1.3), show: !view.hidden.has(name), run: name });
  }
  const setting = options(width, HEIGHT.strip, withTime, series, [band()], () => [-RESIDUAL, RESIDUAL], [-1, 0, 1]);
  const label = { label: "e / t", labelSize: 14, labelGap: 0, labelFont: font(11), size: AXIS - 14 };
  Object.assign(setting.axes[1], label, { values: (_, splits) => splits.map((v) => fixed(v, 0)) });
  const lines = series.map((line, i) => [line, data[i + 1]]).filter(([line]) => line.run && line.show);
  setting.hooks = { ...hooks, draw: [(plot) => lines.forEach(([line, values]) => drawBeyond(plot, values, styles[line.run], time, [], false))] };
  return new uPlot(setting, data, host);
}

// ---- one case ----------------------------------------------------------------------------------------------------------
async function show(page, span) {
  drop();
  const mine = (view = { page, plots: [], heads: [], hidden: new Set(), span: null, dragged: null });
  try {
    await unpack(page);
  } catch (error) {
    console.error(error);
    layOutPlain(page);
    return;
  }
  if (view !== mine) return;
  layOut(page);
  view.data = dataOf(page);
  const { time } = view.data;
  view.whole = [time[0], time[time.length - 1]];
  view.span = clean(span) || view.whole;
  drawLegend();
  drawFractions();
  applyFraction();
}
function drop() {
  if (!view) return;
  view.plots.forEach((plot) => plot.destroy());
  $(".panels", view.page)?.replaceChildren();
  view = null;
}
function draw() {
  const host = $(".panels", view.page), width = host.clientWidth;
  view.plots.forEach((plot) => plot.destroy());
  view.plots = []; view.heads = []; view.width = width;
  host.replaceChildren();
  view.data.panels.forEach((panel, i, panels) => {
    if (GROUPS[panel.kind] && panels[i - 1]?.kind !== panel.kind) host.append(element("p", { class: "group" }, GROUPS[panel.kind]));
    const last = panels[i + 1]?.kind !== panel.kind;
    const values = element("span", { class: "panel-values" }), box = element("div", { class: "panel", role: "img", "aria-label": panel.alt, "data-channel": panel.channel });
    box.append(element("div", { class: "panel-head" }, title(panel), values));
    host.append(box);
    view.heads.push({ panel, values });
    drawPanel(panel, box, width, last);
  });
  host.append(element("p", { class: "time" }, "time, s (clock of the record)"));
  readOut(null);
  setSpanFields();
}
function title(panel) {
  const node = element("span", { class: "panel-title" });
  if (panel.base) node.append(element("span", { class: "symbol" }, element("i", {}, panel.base), ...(panel.sub ? [element("sub", {}, panel.sub)] : [])));
  node.append(`${panel.words || panel.channel}${panel.unit ? `, ${panel.unit}` : ""}`);
  if (panel.sign) node.append(element("span", { class: "quiet" }, `  + ${panel.sign}`));
  return node;
}
function drawLegend() {
  const host = $(".legend", view.page);
  host.replaceChildren();
  view.data.runs.forEach(({ name, style }, i) => {
    const button = element("button", { type: "button", "aria-pressed": "true", title: `show or hide (${i + 1})`, onclick: () => toggle(name) }, sample(style), name);
    button.dataset.run = name;
    host.append(button);
  });
  const box = { width: 26, height: 12 };
  const swatch = (words, css) => element("span", { class: "swatch" }, drawing({ viewBox: "0 0 26 12" }, ["rect", { class: css, ...box }]), words);
  if (view.data.panels.some((panel) => panel.half || panel.values.length)) host.append(swatch("tolerance", "band"));
  if (view.data.panels.some((panel) => panel.half)) host.append(swatch("outside", "exit"));
  const drawn = view.data.runs.find(({ name }) => view.data.panels.some((panel) => `${name} 0` in panel.fans));
  if (drawn) host.append(swatch("draws, 5 to 95 %", `fan ${drawn.style}-area`));
}
function toggle(name) {
  if (!view?.data || !view.data.runs.some((run) => run.name === name)) return;
  if (!view.hidden.delete(name)) view.hidden.add(name);
  all(".legend button", view.page).forEach((button) => button.setAttribute("aria-pressed", String(!view.hidden.has(button.dataset.run))));
  draw();
  drawCrosses();
}
function clean(span) {
  if (!span || !span.every(Number.isFinite)) return null;
  const from = Math.max(Math.min(...span), view.whole[0]), to = Math.min(Math.max(...span), view.whole[1]);
  return to - from > 1e-3 * (view.whole[1] - view.whole[0]) ? [from, to] : null;
}
function zoom(span) {
  if (!view?.data) return;
  view.span = clean(span) || view.whole;
  view.plots.forEach((plot) => plot.setScale("x", { min: view.span[0], max: view.span[1] }));
  setSpanFields();
  remember();
}
function setSpanFields() {
  $(".from", view.page).value = view.span[0].toFixed(2);
  $(".to", view.page).value = view.span[1].toFixed(2);
}
function readOut(index) {
  if (!view?.data) return;
  for (const { panel, values } of view.heads) values.replaceChildren(...(index == null ? verdictsOf(panel) : readings(panel, index)));
}
function verdictsOf(panel) {
  return panel.verdicts.filter((v) => !view.hidden.has(v.run)).map((row) => {
    const { verdict, ratio } = atFraction(row);
    return element("span", {}, `${row.run} `, element("span", { class: `verdict is-${verdict}` }, `${SYMBOLS[verdict]} ${ratio == null ? WORDS[verdict] : fixed(ratio, 2)}`));
  });
}
function readings(panel, index) {
  const parts = [element("span", { class: "quiet" }, `t ${fixed(view.data.time[index], 2)} s`)];
  for (const { name, style } of [...view.data.runs, { name: "applied", style: "run-0" }]) {
    const values = panel.traces[name];
    if (values && !view.hidden.has(name)) parts.push(element("span", {}, sample(style), values[index] == null ? "\u2013" : fixed(values[index], panel.decimals)));
  }
  return parts;
}
function jump(event) {
  const link = event.target.closest("a.jump");
  if (!link || !view?.data) return;
  event.preventDefault();
  const at = Number(link.dataset.at), wide = Math.max(2, (view.whole[1] - view.whole[0]) / 6);
  zoom([at - wide / 2, at + wide / 2]);
  $(".plots", view.page).scrollIntoView({ block: "start" });
}
