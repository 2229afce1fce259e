// ---- what the verdicts would be at another share of the tolerance; the verdict of record stays in the file --------------
// Every half width is proportional to the share, so a ratio is that of the verdict table times applied share over asked share.
const FRACTIONS = [1, 0.4, 0.2];
const ORDER = ["pass", "advisory", "demonstration", "fail", "not_tested", "invalid"];   // the best alternative of a group counts
let fraction = null;   // asked share; null: as applied

const share = () => fraction ?? view.data.fraction;
function atFraction(row) {
  if (fraction == null || row.ratio == null || !["pass", "fail"].includes(row.verdict)) return row;
  const ratio = row.ratio * row.fraction / fraction;
  const failsOtherwise = row.verdict === "fail" && row.ratio <= 1;
  return { ...row, ratio, verdict: ratio <= 1 && !failsOtherwise ? "pass" : "fail" };
}
function statusAt(rows) {
  const groups = {};
  for (const row of rows.filter((r) => r.applies)) {
    const { verdict } = atFraction(row), before = groups[row.group];
    if (!before || ORDER.indexOf(verdict) < ORDER.indexOf(before)) groups[row.group] = verdict;
  }
  const found = Object.values(groups);
  const passed = rows.map((r) => r.refused).find(Boolean) || (rows.some((r) => r.faulty) ? "record_error" : rows.some((r) => r.exceeds) ? "limits_exceeded" : rows.some((r) => r.departs) ? "pass_with_departures" : "pass");
  return ["invalid", "fail", "not_tested", "demonstration"].find((word) => found.includes(word)) || (found.includes("pass") ? passed : "not_tested");
}
// The row that decides: of the alternatives the best, of the groups the worst.
function worstAt(rows) {
  const best = {};
  for (const row of rows.map(atFraction)) {
    if (row.ratio == null || !["pass", "fail"].includes(row.verdict)) continue;
    if (!(best[row.group]?.ratio <= row.ratio)) best[row.group] = row;
  }
  return Object.values(best).reduce((worst, row) => (!worst || row.ratio > worst.ratio ? row : worst), null);
}
function drawFractions() {
  const host = $(".fraction", view.page);
  if (!view.data.rows.some((row) => row.ratio != null)) { host.hidden = true; return; }
  const offered = [...new Set([...FRACTIONS, view.data.fraction])].sort((a, b) => b - a);
  host.replaceChildren("tolerance ", ...offered.map((f) => element("button", { type: "button", "aria-pressed": "false", "data-fraction": f, onclick: () => setFraction(f) }, `${Math.round(100 * f)} %`)));
}
function setFraction(asked) {
  if (!view?.data) return;
  fraction = asked === view.data.fraction ? null : asked;
  applyFraction();
  remember();
}
function applyFraction() {
  const { page, data } = view, factor = share() / data.fraction, asked = fraction != null && fraction !== data.fraction;
  if (!asked) fraction = null;
  const scaled = (half) => (asked && half ? half.map((h) => (h == null ? null : h * factor)) : half);
  for (const cross of data.crosses) cross.half = scaled(cross.applied);
  for (const panel of data.panels) {
    panel.half = scaled(panel.applied);
    panel.values = panel.stated.map(([start, stop, centre, half]) => [start, stop, centre, asked ? half * factor : half]);
    panel.exits = asked && panel.applied ? exitsOf(panel, data.time) : panel.counted;
  }
  all(".fraction button", page).forEach((button) => button.setAttribute("aria-pressed", String(Number(button.dataset.fraction) === share())));
  page.classList.toggle("asked", asked);
  const note = $(".asked-note", page);
  note.hidden = !asked;
  if (asked) note.textContent = `Shown at ${Math.round(100 * share())} % of the tolerance, to see what would happen. The verdicts of this report are at ${Math.round(100 * data.fraction)} %.`;
  writeVerdicts();
  draw();
  drawCrosses();
}
function exitsOf({ traces, half }, time) {
  const found = {};
  for (const [run, values] of Object.entries(traces)) {
    if (run === "flight" || !traces.flight) continue;
    const out = (i) => half[i] != null && !(values[i] != null && Math.abs(values[i] - traces.flight[i]) <= half[i]), spans = [];
    for (let i = 0; i < time.length; i++) {
      if (!out(i)) continue;
      const start = i;
      while (i + 1 < time.length && out(i + 1)) i++;
      spans.push([time[start], time[i]]);
    }
    if (spans.length) found[run] = spans;
  }
  return found;
}
const ratioText = (ratio) => (ratio == null ? "\u2013" : fixed(ratio, 2));
const record = new Map();   // cells with what the file holds in them
function write(cell, node) {
  if (!record.has(cell)) record.set(cell, [...cell.childNodes]);
  cell.replaceChildren(...(fraction == null ? record.get(cell) : [node]));
}
function writeVerdicts() {
  const { page, data } = view;
  all(".verdicts tr[data-row]", page).forEach((line) => {
    const row = atFraction(data.rows[Number(line.dataset.row)]);
    write($(".ratio", line), ratioText(row.ratio));
    write($(".state", line), verdictWord(row.verdict));
  });
  all(".outcome tr[data-run]", page).forEach((line) => {
    const rows = data.rows.filter((row) => row.run === line.dataset.run), worst = worstAt(rows);
    write($(".ratio", line), ratioText(worst?.ratio));
    write($(".state", line), verdictWord(statusAt(rows)));
    write($(".decides", line), worst ? worst.words : "");
  });
}
