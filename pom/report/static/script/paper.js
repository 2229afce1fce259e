// ---- figures for paper and cross plots: SVG in the classes of the style sheet, from the data of the screen ---------------
const SHEET = { width: 720, left: 54, right: 12, head: 17, foot: 30, top: 24, gap: 5, page: 960, case: 250, judged: 170, strip: 38, small: 66, lane: 4 };
const CHARACTER = 5.6;   // width of a character of the numbers at the edges
const SLACK = 0.35;   // a point is left out where the line stays this close to it

const escaped = (text) => String(text).replace(/[&<>"]/g, (c) => `&#${c.charCodeAt(0)};`);
const tenth = (v) => `${Math.round(v * 10) / 10}`;
const textAt = (x, y, words, css = "", anchor = "start") => `<text x="${tenth(x)}" y="${tenth(y)}" class="${css}" text-anchor="${anchor}">${escaped(words)}</text>`;
const straight = (x1, y1, x2, y2, css) => `<line class="${css}" x1="${tenth(x1)}" y1="${tenth(y1)}" x2="${tenth(x2)}" y2="${tenth(y2)}"/>`;
const rectangle = (x, y, width, height, css) => `<rect class="${css}" x="${tenth(x)}" y="${tenth(y)}" width="${tenth(width)}" height="${tenth(height)}"/>`;
const svg = (height, body, words) => `<svg class="figure" viewBox="0 0 ${SHEET.width} ${Math.round(height)}" role="img" aria-label="${escaped(words)}">${body}</svg>`;

function frameOf(left, top, width, height, x, y) {
  const bottom = top + height, right = left + width;
  const px = (v) => left + ((v - x[0]) / (x[1] - x[0])) * width;
  const py = (v) => Math.min(Math.max(bottom - ((v - y[0]) / (y[1] - y[0])) * height, top - 3), bottom + 3);
  return { left, top, width, height, right, bottom, x, y, px, py };
}
// Keep the points that the straight line from the last kept one cannot stand for (the cone of slopes is empty).
function thinned(points) {
  const kept = [];
  let low = -Infinity, high = Infinity;
  points.forEach((point, i) => {
    const last = kept[kept.length - 1], previous = points[i - 1];
    if (!last) { kept.push(point); return; }
    const dx = point[0] - last[0], slope = (point[1] - last[1]) / dx;
    if (!(dx > 0) || slope < low || slope > high) {
      if (previous !== last) kept.push(previous);
      const from = kept[kept.length - 1], step = point[0] - from[0];
      [low, high] = step > 0 ? [(point[1] - SLACK - from[1]) / step, (point[1] + SLACK - from[1]) / step] : [-Infinity, Infinity];
      return;
    }
    low = Math.max(low, (point[1] - SLACK - last[1]) / dx);
    high = Math.min(high, (point[1] + SLACK - last[1]) / dx);
  });
  if (points.length > 1 && kept[kept.length - 1] !== points[points.length - 1]) kept.push(points[points.length - 1]);
  return kept;
}
const outline = (points) => points.map(([x, y], i) => `${i ? "L" : "M"}${tenth(x)} ${tenth(y)}`).join("");
function stretches(frame, x, y) {
  const found = [[]];
  for (let i = 0; i < x.length; i++) {
    if (x[i] == null || y[i] == null) { if (found[found.length - 1].length) found.push([]); } else found[found.length - 1].push([frame.px(x[i]), frame.py(y[i])]);
  }
  return found.filter((points) => points.length);
}
const curve = (frame, x, y, css) => `<path class="${css}" d="${stretches(frame, x, y).map((points) => outline(thinned(points))).join("")}"/>`;
function areaBetween(frame, x, upper, lower, css) {
  const tops = stretches(frame, x, upper), feet = stretches(frame, x, lower);
  return `<path class="${css}" d="${tops.map((points, i) => `${outline([...thinned(points), ...thinned(feet[i]).reverse()])}Z`).join("")}"/>`;
}
function axesOf(frame, xLabels, yTicks) {
  const xs = ticks(...frame.x, 8), ys = yTicks || ticks(...frame.y, Math.max(2, Math.floor(frame.height / 26)));
  const grid = [...xs.map((v) => `M${tenth(frame.px(v))} ${tenth(frame.top)}v${tenth(frame.height)}`), ...ys.map((v) => `M${tenth(frame.left)} ${tenth(frame.py(v))}h${tenth(frame.width)}`)];
  const words = tickText(ys, ys[1] - ys[0]).map((word, i) => textAt(frame.left - 5, frame.py(ys[i]) + 3.5, word, "tick", "end"));
  if (xLabels) words.push(...tickText(xs, xs[1] - xs[0]).map((word, i) => textAt(frame.px(xs[i]), frame.bottom + 12, word, "tick", "middle")));
  return `<path class="grid" d="${grid.join("")}"/>${rectangle(frame.left, frame.top, frame.width, frame.height, "frame")}${words.join("")}`;
}
let clips = 0;
function clipped(frame, body) {
  const name = `clip-${clips++}`;
  return `<clipPath id="${name}">${rectangle(frame.left, frame.top, frame.width, frame.height, "")}</clipPath><g clip-path="url(#${name})">${body}</g>`;
}
function quantity(x, y, { base, sub, words, channel, unit }, css = "title", anchor = "start") {
  const symbol = base ? `<tspan class="symbol">${escaped(base)}</tspan>${sub ? `<tspan class="sub" dy="3">${escaped(sub)}</tspan><tspan dy="-3">\u2002</tspan>` : "<tspan>\u2002</tspan>"}` : "";
  return `<text x="${tenth(x)}" y="${tenth(y)}" text-anchor="${anchor}">${symbol}<tspan class="${css}">${escaped(`${words || channel}${unit ? `, ${unit}` : ""}`)}</tspan></text>`;
}
function keyOf(runs, withBand, withOutside = withBand) {
  let x = SHEET.left, body = "";
  for (const { name, style } of runs) {
    body += straight(x, 9, x + 30, 9, `trace ${style}`) + textAt(x + 35, 12.5, name, "caption");
    x += 52 + 6.4 * name.length;
  }
  if (withBand) body += rectangle(x, 4, 26, 10, "band") + textAt(x + 31, 12.5, "tolerance", "caption");
  if (withOutside) body += rectangle(x + 96, 4, 26, 10, "exit") + textAt(x + 127, 12.5, "outside", "caption");
  return body;
}
// Arrows, or with `withValue` the numbers, where a trace leaves the scale; `taken` has the boxes of what stands there.
function arrows(frame, time, values, style, lift, taken, withValue) {
  const bottom = frame.bottom - lift;
  return beyondScale(values, time, frame.y, frame.x).map(([i, up]) => {
    const x = Math.min(Math.max(frame.px(time[i]), frame.left + 6), frame.right - 6), [tip, foot] = up ? [frame.top + 1, frame.top + 7] : [bottom - 1, bottom - 7];
    const right = x > frame.left + frame.width / 2;
    if (!withValue) {
      taken.push([x - 4, up ? frame.top + 9 : bottom - 3, x + 4]);
      return `<path class="${style} arrow" d="M${tenth(x)} ${tenth(tip)}L${tenth(x - 4)} ${tenth(foot)}L${tenth(x + 4)} ${tenth(foot)}Z"/>`;
    }
    const words = rough(values[i]), edge = x + (right ? -7 : 7), width = CHARACTER * words.length;
    return textAt(edge, clearLine(right ? edge - width : edge, width, up ? frame.top + 9 : bottom - 3, up ? 10.5 : -10.5, taken), words, "tick halo", right ? "end" : "start");
  }).join("");
}
function exitArea(frame, time, values, flight, half) {
  const shapes = [...exceedances(values, flight, half)].map((area) => {
    const at = (k, y) => [frame.px(time[k]), frame.py(y)];
    return `${outline([...area.map(([k, outer]) => at(k, outer)), ...area.map(([k, , inner]) => at(k, inner)).reverse()])}Z`;
  });
  return shapes.length ? `<path class="exit" d="${shapes.join("")}"/>` : "";
}
// Line of one period between two maxima of the fitted mode, and its numbers.
function modeOf(frame, { start, peaks, words }, taken) {
  const y = frame.bottom - 10;
  const width = CHARACTER * words.length;
  let body = "", left = frame.px(start) + 4, line = y + 3.5;
  if (peaks.length) {
    const [first, second] = peaks.map(frame.px);
    body = straight(first, y, second, y, "event") + [first, second].map((end) => straight(end, y - 4, end, y + 4, "event")).join("");
    left = second + 5;
    if (left + width > frame.right) [left, line] = [first + 5, y - 5];   // above the line
  }
  return body + textAt(left, clearLine(left, width, line, -10.5, taken), words, "tick halo");
}
function valueBar(frame, [start, stop, centre, half]) {
  const a = frame.px(start), b = frame.px(stop), left = Math.min(a, b - 5), top = frame.py(centre + half);
  return rectangle(left, top, Math.max(b, a + 5) - left, frame.py(centre - half) - top, "band");
}
function sheetPanel(data, panel, top, scale, last, taken) {
  const { time, runs } = data, { traces, half } = panel, flight = traces.flight, x = [time[0], time[time.length - 1]];
  const lines = [...runs, { name: "applied", style: "run-0" }].filter(({ name }) => traces[name]), models = lines.filter(({ name }) => name !== "flight" && name !== "applied");
  const height = (panel.kind === "judged" ? SHEET.judged : SHEET.small) * scale, banded = half && flight;
  const frame = frameOf(SHEET.left, top + SHEET.head, SHEET.width - SHEET.left - SHEET.right, height, x, limits(panel, new Set(), time, x));
  let inside = panel.values.map((mark) => valueBar(frame, mark)).join(""), marks = "", lane = 0;
  if (banded) inside += areaBetween(frame, time, ...edges(flight, half), "band") + models.filter(({ name }) => panel.exits[name]).map(({ name }) => exitArea(frame, time, traces[name], flight, half)).join("");
  for (const { name, style } of models) if (`${name} 0` in panel.fans) inside += [[0, 4], [1, 3]].map(([low, high]) => areaBetween(frame, time, panel.fans[`${name} ${low}`], panel.fans[`${name} ${high}`], `fan ${style}-area`)).join("");
  const uprights = (host) => data.events.map(([, t]) => straight(host.px(t), host.top, host.px(t), host.bottom, "event")).join("");
  for (const t of panel.window || []) inside += straight(frame.px(t), frame.top, frame.px(t), frame.bottom, "window");
  inside += lines.map(({ name, style }) => curve(frame, time, traces[name], `trace ${style}`)).join("");
  if (flight && models.length) inside += curve(frame, time, flight, "hair");
  if (panel.mode) inside += envelope(panel.mode, time).map((edge) => curve(frame, time, edge, "envelope")).join("") + modeOf(frame, panel.mode, taken);
  for (const { name, style } of models) {
    const exits = panel.exits[name] || [];
    if (!exits.length) continue;
    const y = frame.bottom - 2.5 - SHEET.lane * lane, first = frame.px(exits[0][0]);
    for (const [start, stop] of exits) marks += straight(frame.px(start), y, Math.max(frame.px(stop), frame.px(start) + 1), y, `lane ${style}`);
    marks += straight(first, y - 6.5, first, frame.bottom + 4, "tickmark");
    lane++;
  }
  const verdicts = panel.verdicts.map(atFraction).map(({ run, verdict, ratio }) => `${run} ${SYMBOLS[verdict]} ${ratio == null ? WORDS[verdict] : fixed(ratio, 2)}`).join("\u2003");
  let body = quantity(SHEET.left, top + 12, panel) + textAt(frame.right, top + 12, verdicts, "caption", "end") + axesOf(frame, last && !banded) + clipped(frame, inside + uprights(frame)) + marks;
  for (const withValue of [false, true]) body += models.map(({ name, style }) => arrows(frame, time, traces[name], style, SHEET.lane * lane, taken, withValue)).join("");
  if (!banded) return [body, frame.bottom + SHEET.gap];
  const strip = frameOf(SHEET.left, frame.bottom + SHEET.gap, frame.width, SHEET.strip * scale, x, [-RESIDUAL, RESIDUAL]);
  const found = models.map(({ name, style }) => [style, ratios(traces[name], flight, half)]), ones = (sign) => half.map((h) => (h == null ? null : sign));
  body += axesOf(strip, last, [-1, 0, 1]) + textAt(6, strip.top + strip.height / 2 + 3.5, "e/t", "caption");
  body += clipped(strip, areaBetween(strip, time, ones(1), ones(-1), "band") + found.map(([style, values]) => curve(strip, time, values, `trace ${style}`)).join("") + uprights(strip));
  body += found.map(([style, values]) => arrows(strip, time, values, style, 0, [], false)).join("");
  return [body, strip.bottom + SHEET.gap];
}
const heightOf = (panel) => SHEET.head + SHEET.gap + (panel.kind === "judged" ? SHEET.judged : SHEET.small) + (panel.half ? SHEET.strip + SHEET.gap : 0);
function sheet(data, panels, room) {
  const heads = panels.length * (SHEET.head + SHEET.gap) + SHEET.foot + SHEET.top, bodies = panels.reduce((sum, panel) => sum + heightOf(panel) - SHEET.head - SHEET.gap, 0);
  const scale = Math.min(1, (room - heads) / bodies);
  let body = keyOf(data.runs.filter(({ name }) => panels.some((panel) => panel.traces[name])), panels.some((panel) => panel.half || panel.values.length), panels.some((panel) => panel.half)), top = SHEET.top;
  const { time } = data, shown = data.events.filter(([, t]) => t > time[0] && t < time[time.length - 1]);
  // the names of the events stand in the first panel; the numbers there keep clear of them
  const across = frameOf(SHEET.left, SHEET.top + SHEET.head, SHEET.width - SHEET.left - SHEET.right, 1, [time[0], time[time.length - 1]], [0, 1]), taken = [];
  const names = shown.map(([name, t]) => {
    const width = CHARACTER * name.length, x = across.px(t) + 3 + width > across.right ? across.px(t) - 3 - width : across.px(t) + 3;
    return textAt(x, clearLine(x, width, across.top + 9, 11, taken), name, "tick halo");
  }).join("");
  panels.forEach((panel, i) => {
    const [drawn, next] = sheetPanel(data, panel, top, scale, i === panels.length - 1, i ? [] : taken);
    body += drawn;
    top = next;
  });
  body += names + textAt(across.left + across.width / 2, top + 22, "time, s (clock of the record)", "caption", "middle");
  return svg(top + SHEET.foot, body, panels.map((panel) => `${panel.alt}.`).join(" "));
}
// What is judged and the inputs, below the head of the case, then the rest; a part that overfills one sheet by little is pressed onto it.
function sheets(data) {
  const found = [];
  for (const wanted of [(panel) => panel.kind !== "shown", (panel) => panel.kind === "shown"]) {
    let room = -1;
    for (const panel of data.panels.filter(wanted)) {
      if (heightOf(panel) > room) { found.push([]); room = 1.35 * (SHEET.page - SHEET.foot); }
      found[found.length - 1].push(panel);
      room -= heightOf(panel);
    }
  }
  return found.map((panels, i) => sheet(data, panels, i ? SHEET.page : SHEET.page - SHEET.case));
}

// ---- cross plots: one quantity against another, band about the flight ------------------------------------------------------
function crossPlot(cross, runs, hidden) {
  const shown = runs.filter(({ name }) => cross.x[name] && !hidden.has(name)), flight = "flight";
  const all = (field) => shown.flatMap(({ name }) => cross[field][name]).filter((v) => v != null);
  const near = (values) => { const [low, high] = extent([values], 0, values.length - 1), pad = 0.05 * (high - low || 1); return [low - pad, high + pad]; };
  const [upper, lower] = edges(cross.y.flight, cross.half);
  const frame = frameOf(SHEET.left + 10, 40, SHEET.width - SHEET.left - SHEET.right - 10, 300, near(all("x")), near([...all("y"), ...upper, ...lower].filter((v) => v != null)));
  // a sweep goes and comes, so the band is drawn as an upright at every sample of the flight
  const bars = cross.x.flight.map((x, i) => (x == null || upper[i] == null ? "" : `M${tenth(frame.px(x))} ${tenth(frame.py(upper[i]))}V${tenth(frame.py(lower[i]))}`)).join("");
  const lines = shown.map(({ name, style }) => curve(frame, cross.x[name], cross.y[name], `trace ${style}`)).join("");
  const verdicts = cross.verdicts.map(atFraction).map(({ run, verdict, ratio }) => `${run} ${SYMBOLS[verdict]} ${ratio == null ? WORDS[verdict] : fixed(ratio, 2)}`).join("\u2003");
  const body = keyOf(shown, true, false) + quantity(frame.left, 34, cross.ordinate) + textAt(frame.right, 34, verdicts, "caption", "end")
    + axesOf(frame, true) + clipped(frame, `<path class="bars-of-band" d="${bars}"/>${lines}`) + quantity(frame.left + frame.width / 2, frame.bottom + 28, cross.abscissa, "caption", "middle");
  return svg(frame.bottom + 40, body, cross.alt);
}
function drawCrosses() {
  const host = $(".crosses", view.page);
  host.innerHTML = view.data.crosses.map((cross) => `<figure>${crossPlot(cross, view.data.runs, view.hidden)}</figure>`).join("");
}

// ---- print: the text and the figures of every page that goes to paper ------------------------------------------------------
function layOutPaper() {
  const everything = root.classList.contains("print-all");
  for (const page of pages.filter((candidate) => everything || !candidate.hidden)) {
    if (!opened.has(page)) { if ($(".body", page)) layOutPlain(page); continue; }
    layOut(page);
    const host = $(".paper", page);
    if (host) host.innerHTML = sheets(view?.page === page && view.data ? view.data : dataOf(page)).map((figure) => `<figure>${figure}</figure>`).join("");
  }
}
async function unpackAll() {
  for (const page of pages) if ($("script.parcel:not([data-file])", page)) await unpack(page);
}
