// ---- small figures: axes with ticks or decades, lines, points --------------------------------------------------------
import { colour, drawing, number, ticks } from "./core.js";

export const label = (x, y, text, more = {}) => { const node = drawing("text", { x, y, ...more }); node.textContent = text; return node; };
export const decades = (low, high) => { const found = []; for (let i = Math.ceil(Math.log10(low)); i <= Math.floor(Math.log10(high)); i++) found.push(10 ** i); return found; };
export const power = (value) => { const i = Math.round(Math.log10(value)); return i >= -2 && i <= 2 ? String(Number(value.toPrecision(1))) : `1e${i}`.replace("-", "\u2212"); };
export function frame(width, height, x0, y1, title) {
  return [drawing("svg", { viewBox: `0 0 ${width} ${height}`, width: "100%", role: "img", "aria-label": title }), drawing("path", { d: `M${x0} 6V${y1}H${width - 4}`, fill: "none", stroke: "currentColor" })];
}
const limits = (values) => {
  let low = Infinity, high = -Infinity;
  for (const value of values) if (Number.isFinite(value)) { low = Math.min(low, value); high = Math.max(high, value); }
  const room = 0.04 * (high - low) || Math.abs(high) * 0.1 || 1;
  return [low - room, high + room];
};
// lines: [{x, y, line}]; a curve over another channel, whose points follow one another in time
export function curveGraph(lines, { width, height, xLabel, yLabel, title }) {
  const x0 = 66, y1 = height - 36, [a0, a1] = limits(lines.flatMap((one) => one.x)), [b0, b1] = limits(lines.flatMap((one) => one.y));
  const x = (value) => x0 + ((value - a0) / (a1 - a0)) * (width - x0 - 10), y = (value) => y1 - ((value - b0) / (b1 - b0)) * (y1 - 10);
  const [svg, axes] = frame(width, height, x0, y1, title);
  svg.append(axes,
    ...ticks(a0, a1, 6).flatMap((value) => [drawing("path", { d: `M${x(value)} 6V${y1}`, stroke: colour("grid") }), label(x(value), y1 + 14, number(value), { "text-anchor": "middle" })]),
    ...ticks(b0, b1, 6).flatMap((value) => [drawing("path", { d: `M${x0} ${y(value)}H${width - 4}`, stroke: colour("grid") }), label(x0 - 4, y(value) + 4, number(value), { "text-anchor": "end" })]),
    label(width - 6, height - 4, xLabel, { "text-anchor": "end" }), label(4, height - 4, yLabel),
    ...lines.map(({ x: across, y: up, line, dash }) => drawing("path", { d: across.map((value, i) => `${i ? "L" : "M"}${x(value).toFixed(1)} ${y(up[i]).toFixed(1)}`).join(""), fill: "none", stroke: colour(`line-${line}`), "stroke-width": 1.1, ...(dash ? { "stroke-dasharray": "4 3" } : {}) })));
  return svg;
}
// lines: [{x, y, line}] with both axes logarithmic
export function densityGraph(lines, { width, height, xLabel, yLabel, title }) {
  const x0 = 54, y1 = height - 36, all = lines.flatMap((one) => [...one.y]).filter((value) => value > 0), places = lines.flatMap((one) => [one.x[0], one.x[one.x.length - 1]]);
  if (!all.length) return drawing("svg");
  const top = Math.max(...all) * 1.5, floor = Math.max(Math.min(...all) / 1.5, top * 1e-10), f0 = Math.min(...places), f1 = Math.max(...places);
  const x = (value) => x0 + (Math.log(value / f0) / Math.log(f1 / f0)) * (width - x0 - 10), y = (value) => y1 - (Math.log(Math.max(value, floor) / floor) / Math.log(top / floor)) * (y1 - 10);
  const [svg, axes] = frame(width, height, x0, y1, title), rows = decades(floor, top), every = Math.ceil(rows.length / 6);
  const path = ({ x: across, y: up }) => [...up].map((value, i) => (value < floor ? "" : `${i && up[i - 1] >= floor ? "L" : "M"}${x(across[i]).toFixed(1)} ${y(value).toFixed(1)}`)).join("");
  svg.append(axes,
    ...decades(f0, f1).flatMap((value) => [drawing("path", { d: `M${x(value)} 6V${y1}`, stroke: colour("grid") }), label(x(value), y1 + 14, power(value), { "text-anchor": "middle" })]),
    ...rows.filter((_, i) => i % every === 0).flatMap((value) => [drawing("path", { d: `M${x0} ${y(value)}H${width - 4}`, stroke: colour("grid") }), label(x0 - 4, y(value) + 4, power(value), { "text-anchor": "end" })]),
    label(width - 6, height - 4, xLabel, { "text-anchor": "end" }), label(4, height - 4, yLabel),
    ...lines.map((one) => drawing("path", { d: path(one), fill: "none", stroke: colour(`line-${one.line}`), "stroke-width": 1.3, ...(one.dash ? { "stroke-dasharray": one.dash } : {}) })));
  return svg;
}
