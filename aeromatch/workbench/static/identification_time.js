// ---- identification: measured and fitted coefficient along the windows -------------------------------------------------
import { attempt, button, colour, element, number, plot, post } from "./core.js";
import { POINTS, view } from "./identification_state.js";

export const drop = () => { view.plots.forEach((made) => made.destroy()); view.plots = []; };
export function drawTime() {
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
export async function zoom(span) {
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
