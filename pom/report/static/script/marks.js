// ---- marks on the canvas next to the lines -------------------------------------------------------------------------------
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
  const { ctx } = plot, box = plot.bbox, { traces, half } = panel;
  if (!half || !traces.flight) return;
  ctx.save();
  ctx.beginPath(); ctx.rect(box.left, box.top, box.width, box.height); ctx.clip();
  const shape = new Path2D(), at = (k, y) => [plot.valToPos(time[k], "x", true), plot.valToPos(y, "y", true)];
  for (const run of Object.keys(panel.exits)) {
    if (view.hidden.has(run)) continue;
    for (const area of exceedances(traces[run], traces.flight, half)) {
      const outline = [...area.map(([k, outer]) => at(k, outer)), ...area.map(([k, , inner]) => at(k, inner)).reverse()];
      outline.forEach(([x, y], k) => (k ? shape.lineTo(x, y) : shape.moveTo(x, y)));
      shape.closePath();
    }
  }
  ctx.globalAlpha = 0.2; ctx.fillStyle = colour("exit"); ctx.fill(shape);
  ctx.globalAlpha = 1; ctx.fillStyle = hatching(ctx, devicePixelRatio); ctx.fill(shape);
  ctx.restore();
}
function drawMarks(plot, panel, time) {
  const { ctx } = plot, box = plot.bbox, ratio = devicePixelRatio, x = (t) => plot.valToPos(t, "x", true);
  const [from, to] = view.span, bottom = box.top + box.height, inSpan = (t) => t >= from && t <= to;
  const upright = (t, dash) => { ctx.setLineDash(dash.map((d) => d * ratio)); ctx.beginPath(); ctx.moveTo(x(t), box.top); ctx.lineTo(x(t), bottom); ctx.stroke(); };
  const taken = [];   // boxes of the texts in this panel
  ctx.save();
  ctx.strokeStyle = ctx.fillStyle = colour("quiet"); ctx.lineWidth = ratio; ctx.font = font(10.5 * ratio);
  for (const t of panel.window || []) if (inSpan(t)) upright(t, [2, 2]);
  for (const [name, t] of view.data.events) if (inSpan(t)) {
    upright(t, []);
    if (panel === view.data.panels[0]) { 
      const width = ctx.measureText(name).width, end = box.left + box.width, left = x(t) + 4 * ratio + width > end ? x(t) - 4 * ratio - width : x(t) + 4 * ratio;
      ctx.textAlign = "left"; ctx.textBaseline = "middle";
      halo(ctx, name, left, clearLine(left, width, box.top + 8 * ratio, 12 * ratio, taken), ratio);
    }
  }
  ctx.setLineDash([]);
  if (panel.mode) drawMode(plot, panel.mode, taken);
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
    if (inSpan(first)) {
      ctx.strokeStyle = colour("exit"); ctx.lineWidth = 1.6 * ratio;
      ctx.beginPath(); ctx.moveTo(x(first), y - 5 * ratio); ctx.lineTo(x(first), bottom + 4 * ratio); ctx.stroke();
    }
    lane++;
  }
  const models = view.data.runs.filter(({ name }) => name !== "flight" && !view.hidden.has(name) && panel.traces[name]);
  // all arrows before the numbers, which keep clear of them
  for (const withValue of [false, true]) for (const { name, style } of models) drawBeyond(plot, panel.traces[name], style, time, taken, withValue, 4.5 * lane);
  ctx.restore();
}
// The line of one period between two maxima of the fitted mode, and its numbers.
function drawMode(plot, { start, peaks, words }, taken) {
  const { ctx } = plot, ratio = devicePixelRatio, x = (t) => plot.valToPos(t, "x", true), y = plot.bbox.top + plot.bbox.height - 10 * ratio, [from, to] = view.span;
  if (start > to || start < from) return;
  const width = ctx.measureText(words).width, end = plot.bbox.left + plot.bbox.width;
  let left = x(start) + 4 * ratio, line = y;
  if (peaks.length && peaks[1] <= to) {
    const [first, second] = peaks.map(x);
    ctx.beginPath(); ctx.moveTo(first, y); ctx.lineTo(second, y);
    for (const end of [first, second]) { ctx.moveTo(end, y - 4 * ratio); ctx.lineTo(end, y + 4 * ratio); }
    ctx.stroke();
    left = second + 5 * ratio;
    if (left + width > end) [left, line] = [Math.max(first, plot.bbox.left) + 5 * ratio, y - 9 * ratio];   // above the line
  }
  ctx.textAlign = "left"; ctx.textBaseline = "middle";
  halo(ctx, words, left, clearLine(left, width, line, -12 * ratio, taken), ratio);
}
// The bar of the tolerance around every judged value of the flight, below the traces.
function drawValues(plot, panel) {
  const { ctx } = plot, box = plot.bbox, ratio = devicePixelRatio;
  if (!panel.values.length) return;
  ctx.save();
  ctx.beginPath(); ctx.rect(box.left, box.top, box.width, box.height); ctx.clip();
  ctx.fillStyle = colour("band"); ctx.strokeStyle = colour("edge"); ctx.lineWidth = 0.8 * ratio;
  for (const [start, stop, centre, half] of panel.values) {
    const first = plot.valToPos(start, "x", true), last = plot.valToPos(stop, "x", true);
    const a = Math.min(first, last - 5 * ratio), b = Math.max(last, first + 5 * ratio);
    const top = plot.valToPos(centre + half, "y", true), bottom = plot.valToPos(centre - half, "y", true);
    ctx.fillRect(a, top, b - a, bottom - top); ctx.strokeRect(a, top, b - a, bottom - top);
  }
  ctx.restore();
}
// Arrows, or with `withValue` the numbers, where a trace leaves the scale; `taken` has the boxes of what stands there.
function drawBeyond(plot, values, style, time, taken, withValue, lift = 0) {
  const { ctx } = plot, box = plot.bbox, ratio = devicePixelRatio, { min, max } = plot.scales.y;
  for (const [i, up] of beyondScale(values, time, [min, max], view.span)) {
    const edge = up ? box.top : box.top + box.height - lift * ratio, inward = up ? 1 : -1;
    const x = Math.min(Math.max(plot.valToPos(time[i], "x", true), box.left + 6 * ratio), box.left + box.width - 6 * ratio);
    ctx.fillStyle = colour(style);
    if (!withValue) {
      ctx.beginPath();
      ctx.moveTo(x, edge + inward * ratio); ctx.lineTo(x - 4.5 * ratio, edge + inward * 8 * ratio); ctx.lineTo(x + 4.5 * ratio, edge + inward * 8 * ratio);
      ctx.fill();
      taken.push([x - 4.5 * ratio, edge + inward * 6 * ratio, x + 4.5 * ratio]);
      continue;
    }
    const right = x > box.left + box.width / 2;
    ctx.font = font(10.5 * ratio); ctx.textAlign = right ? "right" : "left"; ctx.textBaseline = "middle";
    const words = rough(values[i]), at = x + (right ? -8 : 8) * ratio, width = ctx.measureText(words).width;
    halo(ctx, words, at, clearLine(right ? at - width : at, width, edge + inward * 7 * ratio, inward * 12 * ratio, taken), ratio);
  }
}
function halo(ctx, words, x, y, ratio) {
  ctx.save();
  ctx.setLineDash([]); ctx.strokeStyle = colour("paper"); ctx.lineWidth = 3 * ratio; ctx.lineJoin = "round";
  ctx.strokeText(words, x, y);
  ctx.restore();
  ctx.fillText(words, x, y);
}
