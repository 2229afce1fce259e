// ---- scales: flight and band always fit, an outlier of a model is clipped before it squeezes them --------------------
const ROOM = 0.5, LEAST_BAND = 0.05, SQUEEZED = 2, MARGIN = 0.05, RESIDUAL = 1.6;
const STEPS = [-4, -3, -2, -1, 0, 1, 2, 3, 4, 5].flatMap((n) => [1, 2, 5].map((m) => Number(`${m}e${n}`)));

function extent(arrays, from, to) {
  let low = Infinity, high = -Infinity;
  for (const array of arrays) for (let i = from; i <= to; i++) {
    const value = array[i];
    if (value != null) { if (value < low) low = value; if (value > high) high = value; }
  }
  return [low, high];
}
const edges = (flight, half) => [1, -1].map((sign) => flight.map((v, i) => (v == null || half[i] == null ? null : v + sign * half[i])));
// The scale of a span of time: as it came with the data for the whole record, else of the span, or of the window in it where the rest would squeeze that.
function limits(panel, hidden, time, span) {
  if (!hidden.size && panel.half === panel.applied && span[0] <= time[0] && span[1] >= time[time.length - 1]) return panel.limits;
  const whole = limitsOver(panel, hidden, time, span);
  if (!panel.half || !panel.window) return whole;
  const inside = [Math.max(span[0], panel.window[0]), Math.min(span[1], panel.window[1])];
  if (!(inside[1] > inside[0])) return whole;
  const own = limitsOver(panel, hidden, time, inside);
  return whole[1] - whole[0] > SQUEEZED * (own[1] - own[0]) ? own : whole;
}
function limitsOver(panel, hidden, time, span) {
  const last = time.length - 1;
  let from = 0, to = last;
  while (from < last && time[from + 1] <= span[0]) from++;
  while (to > 0 && time[to - 1] >= span[1]) to--;
  const base = panel.traces.flight || Object.values(panel.traces)[0], half = panel.half;
  const wanted = half ? [base, ...edges(base, half)] : [base];
  let [low, high] = extent(wanted, from, to);
  if (!(high >= low)) return panel.limits;
  if (high - low < panel.span) [low, high] = [(low + high - panel.span) / 2, (low + high + panel.span) / 2];
  const height = high - low || Math.max(Math.abs(high), 1) * 0.1;
  const models = Object.entries(panel.traces).filter(([run, values]) => values !== base && !hidden.has(run)).map(([, values]) => values);
  const [farLow, farHigh] = extent(models, from, to);
  const grow = (x) => (Number.isFinite(x) ? Math.min(Math.max(x, 0), ROOM * height) : 0);
  const below = grow(low - farLow), above = grow(farHigh - high);
  const widest = half ? extent([half], from, to)[1] : Infinity;
  const most = Math.max(height, Number.isFinite(widest) ? widest / LEAST_BAND : Infinity);
  const scale = below + above > 0 ? Math.min(1, (most - height) / (below + above)) : 1;
  low -= below * scale; high += above * scale;
  const pad = MARGIN * (high - low || height);
  return [low - pad, high + pad];
}
// Round ticks, about `most` of them and never fewer than two.
function ticks(low, high, most) {
  for (let wanted = Math.max(most, 1); ; wanted++) {
    const raw = (high - low) / wanted, base = 10 ** Math.floor(Math.log10(raw)), step = [1, 2, 5, 10].map((m) => base * m).find((s) => s >= raw * 0.999);
    const found = [];
    for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) found.push(k * step);
    if (found.length > 1) return found;
  }
}
// Where a trace leaves the scale: index of its largest and of its least value, when they lie beyond.
function beyondScale(values, time, [min, max], [from, to]) {
  let low = -1, high = -1;
  for (let i = 0; i < time.length; i++) {
    if (values[i] == null || time[i] < from || time[i] > to) continue;
    if (low < 0 || values[i] < values[low]) low = i;
    if (high < 0 || values[i] > values[high]) high = i;
  }
  return [[high, true], [low, false]].filter(([i, up]) => i >= 0 && (up ? values[i] > max : values[i] < min));
}
// The areas between band and trace where the trace is outside, each as its two edges: [k, outer, inner] from neighbour to neighbour.
function* exceedances(values, flight, half) {
  for (const sign of [1, -1]) {
    const beyond = (i) => values[i] != null && half[i] != null && sign * (values[i] - flight[i]) > half[i];
    for (let i = 0; i < values.length; i++) {
      if (!beyond(i)) continue;
      const start = Math.max(i - 1, 0), area = [];
      while (i < values.length && beyond(i)) i++;
      for (let k = start; k <= Math.min(i, values.length - 1); k++) {
        if (half[k] == null || values[k] == null) continue;
        const edge = flight[k] + sign * half[k];
        area.push([k, beyond(k) ? values[k] : edge, edge]);
      }
      yield area;
    }
  }
}
// The lower and the upper envelope of the fitted mode of the flight, null outside its window.
function envelope({ start, stop, offset, slope, amplitude, sigma }, time) {
  const of = (sign) => time.map((t) => (t < start || t > stop ? null : offset + slope * (t - start) + sign * amplitude * Math.exp(-sigma * (t - start))));
  return [of(-1), of(1)];
}
// The base line of a text that meets no earlier one: it moves inward, at most eight lines, and its box joins `taken`.
function clearLine(left, width, y, inward, taken) {
  const line = Math.abs(inward);
  for (let i = 0; i < 8 && taken.some((box) => left < box[2] && box[0] < left + width && Math.abs(box[1] - y) < line); i++) y += inward;
  taken.push([left, y, left + width]);
  return y;
}
const ratios = (values, flight, half) => values.map((v, i) => (v == null || flight[i] == null || !half[i] ? null : (v - flight[i]) / half[i]));
