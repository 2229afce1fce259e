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
  ctx.save();
  ctx.strokeStyle = ctx.fillStyle = colour("quiet"); ctx.lineWidth = ratio; ctx.font = font(10.5 * ratio);
  for (const t of panel.window || []) if (inSpan(t)) upright(t, [2, 2]);
  for (const [i, [name, t]] of view.data.events.entries()) if (inSpan(t)) {
    upright(t, []);
    if (panel === view.data.panels[0]) { ctx.textAlign = "left"; ctx.textBaseline = "top"; halo(ctx, name, x(t) + 4 * ratio, box.top + (3 + 12 * (i % 2)) * ratio, ratio); }
  }
  ctx.setLineDash([]);
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
  for (const { name, style } of view.data.runs) if (name !== "flight" && !view.hidden.has(name) && panel.traces[name]) drawBeyond(plot, panel.traces[name], style, time, true, 4.5 * lane);
  ctx.restore();
}
function drawBeyond(plot, values, style, time, withValue, lift = 0) {
  const { ctx } = plot, box = plot.bbox, ratio = devicePixelRatio, { min, max } = plot.scales.y;
  for (const [i, up] of beyondScale(values, time, [min, max], view.span)) {
    const edge = up ? box.top : box.top + box.height - lift * ratio, inward = up ? 1 : -1;
    const x = Math.min(Math.max(plot.valToPos(time[i], "x", true), box.left + 6 * ratio), box.left + box.width - 6 * ratio);
    ctx.fillStyle = colour(style);
    ctx.beginPath();
    ctx.moveTo(x, edge + inward * ratio); ctx.lineTo(x - 4.5 * ratio, edge + inward * 8 * ratio); ctx.lineTo(x + 4.5 * ratio, edge + inward * 8 * ratio);
    ctx.fill();
    if (!withValue) continue;
    const right = x > box.left + box.width / 2;
    ctx.font = font(10.5 * ratio); ctx.textAlign = right ? "right" : "left"; ctx.textBaseline = up ? "top" : "bottom";
    halo(ctx, rough(values[i]), x + (right ? -8 : 8) * ratio, edge + inward * 2 * ratio, ratio);
  }
}
function halo(ctx, words, x, y, ratio) {
  ctx.save();
  ctx.setLineDash([]); ctx.strokeStyle = colour("paper"); ctx.lineWidth = 3 * ratio; ctx.lineJoin = "round";
  ctx.strokeText(words, x, y);
  ctx.restore();
  ctx.fillText(words, x, y);
}
