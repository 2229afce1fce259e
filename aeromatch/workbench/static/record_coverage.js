// ---- test points of all records, with the 1 g lines of the last database ---------------------------------------------
import { DASHES, attempt, button, colour, drawing, element, get, number, select, ticks } from "./core.js";
import { load } from "./records.js";
import { rowText, view } from "./record_state.js";
import { zoom } from "./record_time.js";

export async function coverage() {
  const own = view, node = view.parts.coverage;
  if (!view.points) {
    node.replaceChildren(button("Test points of all records", async () => {
      node.replaceChildren(element("p", { class: "quiet" }, "reading ..."));
      const names = view.project.records.map((one) => one.name).join(","), found = await attempt(() => get("/api/coverage", { names }), node);
      if (!found || own !== view) return;
      view.points = found;
      view.axes = axesOf(found);
      coverage();
      const level = await attempt(() => get("/api/one_g", { names }), view.parts.error);
      if (level && own === view) { view.level = level; coverage(); }
    }));
    return;
  }
  const { points: all, units } = view.points, [across, up] = view.axes, settings = [...new Set(all.map((one) => one.configuration))].sort();
  if (view.setting == null) view.setting = settings.includes("clean") ? "clean" : "";   // as LR-743 Fig. 9
  const of = (one) => !view.setting || one.configuration === view.setting, points = all.filter(of), rows = points.filter((one) => one[across] != null && one[up] != null);
  const names = Object.keys(units).filter((name) => all.some((one) => one[name] != null)), choice = (i) => select(names, view.axes[i], (name) => { view.axes[i] = name; coverage(); }, { "aria-label": i ? "vertical" : "horizontal" });
  const lines = view.level && [across, up].includes("alpha") && [across, up].some((name) => name === "mach" || name === "V_cas") ? view.level.lines.filter(of) : [];
  node.replaceChildren(element("div", { class: "row" }, choice(1), "over", choice(0)),
    select([["", "all configurations"], ...settings], view.setting, (text) => { view.setting = text; coverage(); }, { "aria-label": "configuration of the test points" }), scatter(rows, across, up, units, lines), ...lineKey(lines));
}
const lineText = (line) => `${line.h}, ${line.mass} kg, ${line.configuration}`;
const dash = (i) => DASHES[i % DASHES.length].join(" ");
function lineKey(lines) {   // pattern and colour, and the number of the line at its end: never colour alone
  if (!view.level) return [element("p", { class: "quiet" }, "1 g lines are computed ...")];
  if (!view.level.model) return [element("p", { class: "quiet" }, "1 g lines are drawn after a match, by its database.")];
  if (!lines.length) return [element("p", { class: "quiet" }, "1 g lines stand over alpha and Mach number or airspeed.")];
  const swatch = (i) => drawing("svg", { width: 30, height: 10, "aria-hidden": "true" }, drawing("path", { d: "M1 5H29", stroke: colour(`line-${i % DASHES.length}`), "stroke-width": 1.6, "stroke-dasharray": dash(i) }));
  return [element("p", { class: "quiet" }, `1 g: level flight of ${view.level.model} at the mean mass of the points.`),
    element("ol", { class: "list keyed" }, lines.map((line, i) => element("li", {}, swatch(i), ` ${i + 1}: ${lineText(line)}`))),
    view.level.remarks.length ? element("details", {}, element("summary", {}, `${view.level.remarks.length} without a line`), view.level.remarks.map((text) => element("p", { class: "quiet" }, text))) : ""];
}
function axesOf({ points }) {
  const has = (name) => points.some((one) => one[name] != null);
  return [has("mach") ? "mach" : "V_cas", has("alpha") ? "alpha" : "h"];
}
function scatter(rows, across, up, units, lines) {
  const width = 300, height = 270, left = 46, bottom = 32, limits = (name) => { const all = rows.map((row) => row[name]), low = Math.min(...all), high = Math.max(...all), room = 0.06 * (high - low || 1); return [low - room, high + room]; };
  if (!rows.length) return element("p", {}, "No manoeuvre has both.");
  const [x0, x1] = limits(across), [y0, y1] = limits(up);
  const x = (value) => left + ((value - x0) / (x1 - x0)) * (width - left - 6), y = (value) => height - bottom - ((value - y0) / (y1 - y0)) * (height - bottom - 8);
  const words = (text, more) => { const node = drawing("text", more); node.textContent = text; return node; }, title = (text) => { const node = drawing("title"); node.textContent = text; return node; };
  const taken = [], apart = (at) => { while (taken.some((one) => Math.abs(one - at) < 11)) at -= 2; taken.push(at); return at; };   // numbers at the ends of lines
  const curve = (line, i) => {   // inside the limits only; its number stands at the end
    const inside = line[across].map((value, k) => [value, line[up][k]]).filter(([a, b]) => a >= x0 && a <= x1 && b >= y0 && b <= y1);
    if (inside.length < 2) return null;
    const [a, b] = inside[inside.length - 1];
    return drawing("g", { role: "img", "aria-label": `1 g line ${i + 1}: ${lineText(line)}` }, title(lineText(line)),
      drawing("path", { d: `M${inside.map(([one, other]) => `${x(one).toFixed(1)} ${y(other).toFixed(1)}`).join("L")}`, fill: "none", stroke: colour(`line-${i % DASHES.length}`), "stroke-width": 1.4, "stroke-dasharray": dash(i) }),
      words(String(i + 1), { x: Math.min(x(a) + 2, width - 8), y: apart(y(b) - 3), fill: colour(`line-${i % DASHES.length}`) }));
  };
  return drawing("svg", { viewBox: `0 0 ${width} ${height}`, width: "100%", role: "group", "aria-label": `${up} over ${across}, one point for each manoeuvre` },
    drawing("path", { d: `M${left} 4V${height - bottom}H${width - 4}`, fill: "none", stroke: "currentColor" }),
    ticks(x0, x1, 4).map((value) => words(number(value, 3), { x: x(value), y: height - bottom + 14, "text-anchor": "middle" })),
    ticks(y0, y1, 5).map((value) => words(number(value, 3), { x: left - 4, y: y(value) + 4, "text-anchor": "end" })),
    words(`${across} ${units[across]}, ${up} ${units[up]}`, { x: width - 6, y: height - 4, "text-anchor": "end" }),
    lines.map(curve),
    rows.map((row) => {
      const own = row.record === view.record.name, mark = drawing("circle", { cx: x(row[across]), cy: y(row[up]), r: own ? 4.5 : 3, fill: own ? colour("line-1") : "none", stroke: colour(own ? "line-1" : "line-5"), "pointer-events": "all", tabindex: 0, role: "button", "aria-label": `${row.record}, ${rowText(row)}` });
      mark.append(title(`${row.record}: ${rowText(row)}, ${row.configuration}, ${across} ${number(row[across])}, ${up} ${number(row[up])}`));
      const chosen = () => attempt(async () => { await load(row.record); zoom([row.start - 1, row.end + 1]); });
      mark.addEventListener("click", chosen);
      mark.addEventListener("keydown", (event) => { if (event.key === "Enter") chosen(); });
      return mark;
    }));
}
