// The page of the report: one case at a time, its panels on one time axis.  Everything drawn comes from the page itself.
(() => {
  "use strict";
  const $ = (query, root = document) => root.querySelector(query);
  const all = (query, root = document) => [...root.querySelectorAll(query)];
  const pages = all("main > .page");
  const cases = pages.filter((page) => page.classList.contains("case"));
  const ROOM = 0.5, LEAST_BAND = 0.05, MARGIN = 0.05, RESIDUAL = 1.6;
  const DASH = { "run-0": [], "run-1": [1.5, 2.5], "run-2": [7, 3.5], "run-3": [9, 3, 2, 3], "run-4": [13, 4], "run-5": [9, 3, 2, 3, 2, 3] };
  const STEPS = [-4, -3, -2, -1, 0, 1, 2, 3, 4, 5].flatMap((n) => [1, 2, 5].map((m) => Number(`${m}e${n}`)));
  const AXIS = 58, RIGHT = 10;
  const WIDTH = { judged: 2.2, shown: 1.9, input: 1.4 };   // of the flight line: it shows on both sides of a model that lies on it
  const HEIGHT = { judged: 178, input: 84, shown: 92, strip: 46, time: 26 };
  let view = null;   // the case on the screen: plots, span of time, hidden runs

  // ---- numbers and colours -------------------------------------------------------------------------------------
  const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
  const fixed = (value, decimals) => {
    const text = value.toFixed(decimals);
    return (Number(text) === 0 ? text.replace("-", "") : text).replace("-", "\u2212");
  };
  const tickText = (_, splits, __, ___, increment) => {
    const decimals = Math.max(0, -Math.floor(Math.log10(increment) + 1e-9));
    return splits.map((value) => (value == null ? "" : fixed(value, decimals)));
  };
  const element = (tag, attributes = {}, ...children) => {
    const node = document.createElement(tag);
    for (const [key, value] of Object.entries(attributes)) {
      if (key === "class") node.className = value; else if (key.startsWith("on")) node[key] = value; else node.setAttribute(key, value);
    }
    node.append(...children);
    return node;
  };
  const sample = (style) => {
    const node = document.createElementNS("http://www.w3.org/2000/svg", "svg");
    node.setAttribute("class", "sample");
    node.setAttribute("aria-hidden", "true");
    const line = document.createElementNS("http://www.w3.org/2000/svg", "path");
    line.setAttribute("class", `trace ${style}`);
    line.setAttribute("d", "M1 4h32");
    node.append(line);
    return node;
  };

  // ---- data: integers of 8, 16 or 32 bits, differenced once or twice, gzipped ------------------------------------
  const KINDS = { int8: [Int8Array, 1, -(2 ** 7)], int16: [Int16Array, 2, -(2 ** 15)], int32: [Int32Array, 4, -(2 ** 31)] };
  function unpack(text) {
    const packed = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
    return new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip")));
  }
  function restore(entry, buffer) {
    const [Kind, bytes, missing] = KINDS[entry.type], differences = new Kind(buffer.slice(entry.at, entry.at + entry.count * bytes));
    const values = new Array(entry.count);
    let level = entry.first, slope = 0;
    for (let i = 0; i < entry.count; i++) {
      if (differences[i] === missing) { values[i] = null; continue; }
      if (entry.order === 2) level += slope += differences[i]; else level += differences[i];
      values[i] = level * entry.step;
    }
    return values;
  }
  async function load(page) {
    const head = JSON.parse($("script.head", page).textContent), buffer = await unpack($("script.pack", page).textContent).arrayBuffer();
    const time = restore(head.time, buffer);
    const panels = head.panels.map((panel) => ({
      ...panel,
      half: panel.half && restore(panel.half, buffer),
      traces: Object.fromEntries(Object.entries(panel.traces).map(([run, entry]) => [run, restore(entry, buffer)])),
    }));
    return { time, panels, runs: head.runs, events: head.events };
  }

  // ---- scales: flight and band always fit, an outlier of a model is clipped before it squeezes them -------------
  function extent(arrays, from, to) {
    let low = Infinity, high = -Infinity;
    for (const array of arrays) for (let i = from; i <= to; i++) {
      const value = array[i];
      if (value != null) { if (value < low) low = value; if (value > high) high = value; }
    }
    return [low, high];
  }
  function limits(panel, hidden, time, span) {
    const last = time.length - 1;
    if (!hidden.size && span[0] <= time[0] && span[1] >= time[last]) return panel.limits;
    let from = 0, to = last;
    while (from < last && time[from + 1] <= span[0]) from++;
    while (to > 0 && time[to - 1] >= span[1]) to--;
    const base = panel.traces.flight || Object.values(panel.traces)[0], half = panel.half;
    const edges = half ? [base.map((v, i) => (v == null ? null : v - (half[i] || 0))), base.map((v, i) => (v == null ? null : v + (half[i] || 0)))] : [base];
    let [low, high] = extent(edges, from, to);
    if (!(high >= low)) return panel.limits;
    if (high - low < panel.span) [low, high] = [(low + high - panel.span) / 2, (low + high + panel.span) / 2];
    const height = high - low || Math.max(Math.abs(high), 1) * 0.1;
    const models = Object.entries(panel.traces).filter(([run, values]) => values !== base && !hidden.has(run)).map(([, values]) => values);
    const [farLow, farHigh] = extent(models, from, to);
    const grow = (x) => (Number.isFinite(x) ? Math.min(Math.max(x, 0), ROOM * height) : 0);
    let below = grow(low - farLow), above = grow(farHigh - high);
    const widest = half ? extent([half], from, to)[1] : Infinity;
    const most = Math.max(height, Number.isFinite(widest) ? widest / LEAST_BAND : Infinity);
    const scale = below + above > 0 ? Math.min(1, (most - height) / (below + above)) : 1;
    low -= below * scale; high += above * scale;
    const pad = MARGIN * (high - low || height);
    return [low - pad, high + pad];
  }

  // ---- drawing beside the lines ----------------------------------------------------------------------------------
  function hatching(context, ratio) {
    const tile = document.createElement("canvas"), size = Math.round(6 * ratio);
    tile.width = tile.height = size;
    const pen = tile.getContext("2d");
    pen.strokeStyle = colour("exit");
    pen.lineWidth = ratio;
    pen.beginPath();
    for (const shift of [-size, 0, size]) { pen.moveTo(shift, size); pen.lineTo(shift + size, 0); }
    pen.stroke();
    return context.createPattern(tile, "repeat");
  }
  function drawExceedance(plot, panel, time) {
    const { ctx } = plot, box = plot.bbox, flight = panel.traces.flight, half = panel.half;
    if (!half || !flight) return;
    ctx.save();
    ctx.beginPath(); ctx.rect(box.left, box.top, box.width, box.height); ctx.clip();
    const area = new Path2D();
    for (const run of Object.keys(panel.exits)) {
      if (view.hidden.has(run)) continue;
      const values = panel.traces[run];
      for (const sign of [1, -1]) {
        const beyond = (i) => values[i] != null && half[i] != null && sign * (values[i] - flight[i]) > half[i];
        for (let i = 0; i < time.length; i++) {
          if (!beyond(i)) continue;
          const start = Math.max(i - 1, 0);
          while (i < time.length && beyond(i)) i++;
          const stop = Math.min(i, time.length - 1), upper = [], lower = [];
          for (let k = start; k <= stop; k++) {
            if (half[k] == null || values[k] == null) continue;
            const edge = flight[k] + sign * half[k], x = plot.valToPos(time[k], "x", true);
            upper.push([x, plot.valToPos(beyond(k) ? values[k] : edge, "y", true)]);
            lower.unshift([x, plot.valToPos(edge, "y", true)]);
          }
          [...upper, ...lower].forEach(([x, y], k) => (k ? area.lineTo(x, y) : area.moveTo(x, y)));
          area.closePath();
        }
      }
    }
    ctx.globalAlpha = 0.2; ctx.fillStyle = colour("exit"); ctx.fill(area);
    ctx.globalAlpha = 1; ctx.fillStyle = hatching(ctx, devicePixelRatio); ctx.fill(area);
    ctx.restore();
  }
  function drawMarks(plot, panel, time) {
    const { ctx } = plot, box = plot.bbox, ratio = devicePixelRatio, x = (t) => plot.valToPos(t, "x", true);
    const [from, to] = view.span, bottom = box.top + box.height;
    ctx.save();
    if (panel.window) {
      ctx.strokeStyle = colour("quiet"); ctx.lineWidth = ratio; ctx.setLineDash([2 * ratio, 2 * ratio]);
      for (const t of panel.window) if (t >= from && t <= to) { ctx.beginPath(); ctx.moveTo(x(t), box.top); ctx.lineTo(x(t), bottom); ctx.stroke(); }
      ctx.setLineDash([]);
    }
    ctx.strokeStyle = ctx.fillStyle = colour("quiet"); ctx.lineWidth = ratio; ctx.font = font(10.5 * ratio); ctx.setLineDash([]);
    for (const [i, [name, t]] of view.data.events.entries()) if (t >= from && t <= to) {
      ctx.beginPath(); ctx.moveTo(x(t), box.top); ctx.lineTo(x(t), bottom); ctx.stroke();
      if (panel === view.data.panels[0]) { ctx.textAlign = "left"; ctx.textBaseline = "top"; halo(ctx, name, x(t) + 4 * ratio, box.top + (3 + 12 * (i % 2)) * ratio, ratio); }
    }
    let lane = 0;
    for (const { name, style } of view.data.runs) {
      const exits = panel.exits[name] || [];
      if (!exits.length || view.hidden.has(name)) continue;
      const y = bottom - (3 + 4.5 * lane) * ratio;
      ctx.strokeStyle = colour(style); ctx.lineWidth = 2.6 * ratio;
      for (const [start, stop] of exits) {
        if (stop < from || start > to) continue;
        const a = x(Math.max(start, from)), b = Math.max(x(Math.min(stop, to)), a + ratio);
        ctx.beginPath(); ctx.moveTo(a, y); ctx.lineTo(b, y); ctx.stroke();
      }
      const first = exits[0][0];
      if (first >= from && first <= to) {
        ctx.strokeStyle = colour("exit"); ctx.lineWidth = 1.6 * ratio;
        ctx.beginPath(); ctx.moveTo(x(first), y - 5 * ratio); ctx.lineTo(x(first), bottom + 4 * ratio); ctx.stroke();
      }
      lane++;
    }
    for (const { name, style } of view.data.runs) if (name !== "flight" && !view.hidden.has(name) && panel.traces[name]) drawBeyond(plot, panel.traces[name], style, time, true, 4.5 * lane);
    ctx.restore();
  }
  function drawBeyond(plot, values, style, time, withValue, lift = 0) {
    const { ctx } = plot, box = plot.bbox, ratio = devicePixelRatio, { min, max } = plot.scales.y, [from, to] = view.span;
    let low = -1, high = -1;
    for (let i = 0; i < time.length; i++) {
      if (values[i] == null || time[i] < from || time[i] > to) continue;
      if (low < 0 || values[i] < values[low]) low = i;
      if (high < 0 || values[i] > values[high]) high = i;
    }
    for (const [i, up] of [[high, true], [low, false]]) {
      if (i < 0 || !(up ? values[i] > max : values[i] < min)) continue;
      const edge = up ? box.top : box.top + box.height - lift * ratio, inward = up ? 1 : -1;
      const x = Math.min(Math.max(plot.valToPos(time[i], "x", true), box.left + 6 * ratio), box.left + box.width - 6 * ratio);
      ctx.fillStyle = colour(style);
      ctx.beginPath();
      ctx.moveTo(x, edge + inward * ratio); ctx.lineTo(x - 4.5 * ratio, edge + inward * 8 * ratio); ctx.lineTo(x + 4.5 * ratio, edge + inward * 8 * ratio);
      ctx.fill();
      if (!withValue) continue;
      const right = x > box.left + box.width / 2;
      ctx.font = font(10.5 * ratio); ctx.textAlign = right ? "right" : "left"; ctx.textBaseline = up ? "top" : "bottom";
      const words = Number(values[i].toPrecision(3)).toString().replace("-", "\u2212"), place = [x + (right ? -8 : 8) * ratio, edge + inward * 2 * ratio];
      halo(ctx, words, ...place, ratio);
    }
  }
  function halo(ctx, words, x, y, ratio) {
    ctx.save();
    ctx.setLineDash([]); ctx.strokeStyle = colour("paper"); ctx.lineWidth = 3 * ratio; ctx.lineJoin = "round";
    ctx.strokeText(words, x, y);
    ctx.restore();
    ctx.fillText(words, x, y);
  }
  const font = (size) => `${size}px ${colour("sans")}`;

  // ---- plots -------------------------------------------------------------------------------------------------------
  function options(width, height, withTime, series, bands, range, splits) {
    const grid = { stroke: colour("grid"), width: 1 };
    const axis = { stroke: colour("quiet"), font: font(11), grid, ticks: { show: true, size: 4, stroke: colour("quiet"), width: 1 }, values: tickText, incrs: STEPS };
    return {
      width, height: height + (withTime ? HEIGHT.time : 0), padding: [3, RIGHT, withTime ? 0 : 3, 0],
      legend: { show: false },
      cursor: {
        y: false, points: { show: false }, sync: { key: "time", scales: ["x", null] }, drag: { x: true, y: false, setScale: false, dist: 4 },
        bind: { dblclick: () => () => { zoom(null); return null; } },
      },
      scales: { x: { time: false, range: () => view.span }, y: { range } },
      axes: [
        { ...axis, size: withTime ? HEIGHT.time : 0, ticks: { ...axis.ticks, show: withTime }, values: withTime ? tickText : () => [], gap: 3 },
        { ...axis, size: AXIS, gap: 4, space: 22, ...(splits ? { splits: () => splits } : {}) },
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
  function drawPanel(panel, host, width, withTime) {
    const { time, runs } = view.data, flight = panel.traces.flight, half = panel.half;
    const edge = { stroke: () => colour("edge"), width: 0.8, points: { show: false } };
    const series = [], data = [time], bands = [];
    if (half && flight) {
      data.push(flight.map((v, i) => (v == null || half[i] == null ? null : v + half[i])), flight.map((v, i) => (v == null || half[i] == null ? null : v - half[i])));
      series.push(edge, edge);
      bands.push({ series: [1, 2], fill: () => colour("band") });
    }
    const styles = Object.fromEntries(runs.map((run) => [run.name, run.style]));
    const reference = flight || panel.traces.applied;
    if (reference) { data.push(reference); series.push({ ...lineOf("run-0", WIDTH[panel.kind]), show: !flight || !view.hidden.has("flight") }); }
    for (const { name } of runs) if (name !== "flight" && panel.traces[name]) { data.push(panel.traces[name]); series.push({ ...lineOf(styles[name]), show: !view.hidden.has(name), run: name }); }
    const setting = options(width, HEIGHT[panel.kind], withTime && !half, series, bands, () => limits(panel, view.hidden, time, view.span));
    setting.hooks = { ...hooks, drawAxes: [...hooks.drawAxes, (plot) => drawExceedance(plot, panel, time)], draw: [(plot) => drawMarks(plot, panel, time)] };
    view.plots.push(new uPlot(setting, data, host));
    if (half && flight) view.plots.push(drawResidual(panel, host, width, withTime, styles));
  }
  function drawResidual(panel, host, width, withTime, styles) {
    const { time, runs } = view.data, flight = panel.traces.flight, half = panel.half;
    const unit = (sign) => half.map((h) => (h == null ? null : sign)), edge = { stroke: () => colour("edge"), width: 0.8, points: { show: false } };
    const data = [time, unit(1), unit(-1)], series = [edge, edge];
    for (const { name } of runs) if (name !== "flight" && panel.traces[name]) {
      data.push(panel.traces[name].map((v, i) => (v == null || flight[i] == null || !half[i] ? null : (v - flight[i]) / half[i])));
      series.push({ ...lineOf(styles[name], 1.3), show: !view.hidden.has(name), run: name });
    }
    const setting = options(width, HEIGHT.strip, withTime, series, [{ series: [1, 2], fill: () => colour("band") }], () => [-RESIDUAL, RESIDUAL], [-1, 0, 1]);
    const label = { label: "e / t", labelSize: 14, labelGap: 0, labelFont: font(11), size: AXIS - 14 };
    Object.assign(setting.axes[1], label, { values: (_, splits) => splits.map((v) => fixed(v, 0)) });
    const lines = series.map((line, i) => [line, data[i + 1]]).filter(([line]) => line.run && line.show);
    setting.hooks = { ...hooks, draw: [(plot) => lines.forEach(([line, values]) => drawBeyond(plot, values, styles[line.run], time, false))] };
    return new uPlot(setting, data, host);
  }

  // ---- one case ------------------------------------------------------------------------------------------------------
  async function show(page, span) {
    drop();
    const mine = (view = { page, plots: [], heads: [], hidden: new Set(), span: null, dragged: null });
    let data;
    try {
      data = await load(page);
    } catch (error) {   // a browser that cannot unpack shows the figures made for print
      console.error(error);
      layOutFigures();
      page.classList.add("static-only");
      return;
    }
    if (view !== mine) return;
    view.data = data;
    view.whole = [data.time[0], data.time[data.time.length - 1]];
    view.span = clean(span) || view.whole;
    drawLegend();
    draw();
  }
  function drop() {
    if (!view) return;
    view.plots.forEach((plot) => plot.destroy());
    $(".panels", view.page).replaceChildren();
    view = null;
  }
  function draw() {
    const host = $(".panels", view.page), width = host.clientWidth;
    view.plots.forEach((plot) => plot.destroy());
    view.plots = []; view.heads = []; view.width = width;
    host.replaceChildren();
    const kinds = { input: "Inputs", shown: "Further channels, without tolerance" };
    view.data.panels.forEach((panel, i, panels) => {
      if (kinds[panel.kind] && panels[i - 1]?.kind !== panel.kind) host.append(element("p", { class: "group" }, kinds[panel.kind]));
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
    const swatch = (words, classes) => {
      const node = element("span", { class: "swatch" }), box = document.createElementNS("http://www.w3.org/2000/svg", "svg");
      box.setAttribute("viewBox", "0 0 26 12");
      box.setAttribute("aria-hidden", "true");
      for (const css of classes) {
        const rect = document.createElementNS("http://www.w3.org/2000/svg", "rect");
        rect.setAttribute("class", css); rect.setAttribute("width", 26); rect.setAttribute("height", 12);
        box.append(rect);
      }
      node.append(box, words);
      return node;
    };
    if (view.data.panels.some((panel) => panel.half)) host.append(swatch("tolerance", ["band"]), swatch("outside", ["exit"]));
  }
  function toggle(name) {
    if (!view?.data || !view.data.runs.some((run) => run.name === name)) return;
    if (!view.hidden.delete(name)) view.hidden.add(name);
    all(".legend button", view.page).forEach((button) => button.setAttribute("aria-pressed", String(!view.hidden.has(button.dataset.run))));
    draw();
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
    for (const { panel, values } of view.heads) {
      const parts = index == null ? verdicts(panel) : readings(panel, index);
      values.replaceChildren(...parts);
    }
  }
  const verdicts = (panel) => panel.verdicts.filter((v) => !view.hidden.has(v.run)).map((v) => element("span", {}, `${v.run} `, element("span", { class: `verdict ${v.css}` }, `${v.symbol} ${v.ratio}`)));
  function readings(panel, index) {
    const parts = [element("span", { class: "quiet" }, `t ${fixed(view.data.time[index], 2)} s`)];
    for (const { name, style } of [...view.data.runs, { name: "applied", style: "run-0" }]) {
      const values = panel.traces[name];
      if (values && !view.hidden.has(name)) parts.push(element("span", {}, sample(style), values[index] == null ? "\u2013" : fixed(values[index], panel.decimals)));
    }
    return parts;
  }

  // ---- address, keys, overview -----------------------------------------------------------------------------------------
  const address = () => {
    const [id, ...rest] = decodeURIComponent(location.hash.slice(1)).split("&"), span = rest.find((part) => part.startsWith("t="));
    return { id: id || "overview", span: span ? span.slice(2).split(",").map(Number) : null };
  };
  function remember() {
    const whole = view.span === view.whole, span = whole ? "" : `&t=${view.span.map((t) => t.toFixed(2)).join(",")}`;
    history.replaceState(null, "", `#${view.page.id}${span}`);
  }
  const ready = () => document.documentElement.classList.contains("ready");
  function route() {
    const { id, span } = address(), open = pages.find((candidate) => !candidate.hidden);
    const target = document.getElementById(id), found = target?.closest("main > .page");   // a page, or a term on one
    const page = found || (ready() ? open : pages[0]);   // "#main" of the skip link opens no page
    if (view?.page === page && view.data) { if (page.id === id) zoom(span); return; }
    if (ready() && !found) return;
    pages.forEach((other) => { other.hidden = other !== page; });
    document.documentElement.classList.add("ready");
    document.documentElement.classList.toggle("print-all", page.id === "overview");
    all(".bar a").forEach((link) => (link.hash === `#${page.id}` ? link.setAttribute("aria-current", "page") : link.removeAttribute("aria-current")));
    const at = cases.indexOf(page);
    $("#previous").disabled = at === 0 || !cases.length;
    $("#next").disabled = at === cases.length - 1;
    if (found && target !== page) target.scrollIntoView(); else scrollTo(0, 0);
    if (at >= 0) show(page, span); else drop();
  }
  const go = (page) => { if (page) location.hash = page.id; };
  function step(by) {
    const at = cases.indexOf(pages.find((page) => !page.hidden));
    go(at < 0 ? cases[by > 0 ? 0 : cases.length - 1] : cases[at + by]);
  }
  function nextFailure() {
    const at = cases.indexOf(pages.find((page) => !page.hidden));
    const order = [...cases.slice(at + 1), ...cases.slice(0, at + 1)];
    go(order.find((page) => $(".outcome .is-fail", page)));
  }
  function openHelp() { const dialog = $("#keys"); if (!dialog.open) dialog.showModal(); }
  function jump(event) {
    const link = event.target.closest("a.jump");
    if (!link || !view?.data) return;
    event.preventDefault();
    const at = Number(link.dataset.at), wide = Math.max(2, (view.whole[1] - view.whole[0]) / 6);
    zoom([at - wide / 2, at + wide / 2]);
    $(".plots", view.page).scrollIntoView({ block: "start" });
  }
  const keys = {
    n: () => step(1), p: () => step(-1), f: nextFailure, r: () => zoom(null), o: () => go($("#overview")), "?": openHelp,
  };
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.closest?.("input, textarea, select, dialog[open]")) return;
    if (keys[event.key]) { event.preventDefault(); keys[event.key](); }
    else if (/^[1-9]$/.test(event.key) && view?.data) toggle(view.data.runs[Number(event.key) - 1]?.name);
  });
  $("#previous").onclick = () => step(-1);
  $("#next").onclick = () => step(1);
  $("#next-fail").onclick = nextFailure;
  $("#help").onclick = openHelp;
  document.addEventListener("click", jump);
  all(".reset").forEach((button) => { button.onclick = () => zoom(null); });
  all(".from, .to").forEach((field) => { field.onchange = () => zoom([Number($(".from", view.page).value), Number($(".to", view.page).value)]); });
  all("[data-filter]").forEach((button) => {
    button.onclick = () => {
      all("[data-filter]").forEach((other) => other.setAttribute("aria-pressed", String(other === button)));
      const { filter } = button.dataset;
      all("#matrix tbody tr").forEach((row) => { row.hidden = filter !== "all" && row.dataset[filter === "fail" ? "fail" : "notRun"] !== "1"; });
    };
  });
  const rows = all("#matrix tbody tr");
  $("#worst-first").onchange = (event) => {
    const sorted = event.target.checked ? [...rows].sort((a, b) => b.dataset.worst - a.dataset.worst) : rows;
    $("#matrix tbody").append(...sorted);
  };

  // ---- size and colours change -----------------------------------------------------------------------------------------
  const bar = () => document.documentElement.style.setProperty("--bar", getComputedStyle($(".bar")).position === "sticky" ? `${$(".bar").offsetHeight}px` : "0px");
  let pending = 0;
  new ResizeObserver(() => {
    bar();
    cancelAnimationFrame(pending);
    pending = requestAnimationFrame(() => { if (view?.data && $(".panels", view.page).clientWidth !== view.width) draw(); });
  }).observe($("main"));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { if (view?.data) draw(); });
  addEventListener("hashchange", route);

  // ---- print: the figures made for paper wait as compressed text; without them the plain ones of a reader without script -
  const figures = new Map();
  async function readFigures() {
    for (const page of cases) figures.set(page, await unpack($("script.figures", page).textContent).text());
  }
  function layOutFigures() {
    for (const page of cases) {
      const host = $(".static", page), plain = $("noscript", host);
      if (figures.has(page)) host.innerHTML = figures.get(page); else if (plain) host.innerHTML = plain.textContent;
    }
  }
  addEventListener("beforeprint", layOutFigures);
  matchMedia("print").addEventListener("change", (event) => { if (event.matches) layOutFigures(); });
  // for scripts that drive the page: scales as drawn, and a span of time
  window.report = {
    limits: () => (view?.plots || []).map(({ scales: { x } }) => [x.min, x.max]),
    scales: () => (view?.plots || []).map(({ scales: { y } }) => [y.min, y.max]),
    zoom,
  };
  bar();
  route();
  if (window.DecompressionStream) readFigures();
})();
