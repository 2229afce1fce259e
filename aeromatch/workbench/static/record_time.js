// ---- the span of time on the screen: zoom, pan, and what is fetched for it --------------------------------------------
import { attempt } from "./core.js";
import { placeMarks } from "./record_marks.js";
import { fetchTraces } from "./record_panels.js";
import { shown, view, whole } from "./record_state.js";
import { spanChanged } from "./record_tools.js";

export function zoom(span) {
  if (!view.record) return;
  const [low, high] = whole();
  if (span) {
    const width = Math.min(Math.max(span[1] - span[0], 0.02), high - low), start = Math.min(Math.max(span[0], low), high - width);
    span = width >= (high - low) * 0.999 ? null : [start, start + width];
  }
  view.span = span;
  if (view.frame) return;
  view.frame = requestAnimationFrame(() => {
    view.frame = null;
    spanned();
    placeMarks();
    spanText();
    spanChanged();
    const [from, to] = shown(), got = view.fetched;
    if (!got || from < got.start || to > got.stop || (got.coarse && (to - from) < 0.5 * got.width) || to - from > 2.1 * got.width) {
      fetchSoon();
    }
  });
}
function fetchSoon() {   // not while channels are drawn: that would abort their own request
  clearTimeout(view.later);
  view.later = setTimeout(() => (!view ? null : view.drawing ? fetchSoon() : attempt(fetchTraces)), 60);
}
export function spanned() {   // panels on the screen now, the others when they are scrolled to
  for (const entry of view.plots) {
    const { top, bottom } = entry.made.root.getBoundingClientRect();
    entry.late = bottom < 0 || top > innerHeight;
    if (!entry.late) entry.made.setSpan(shown());
  }
}
export function scrolled() {
  for (const entry of view.plots) {
    if (!entry.late) continue;
    const { top, bottom } = entry.made.root.getBoundingClientRect();
    if (bottom < 0 || top > innerHeight) continue;
    entry.late = false;
    entry.made.setSpan(shown());
  }
}
export function scale(factor, centre = null) {
  const [from, to] = shown(), middle = centre ?? (from + to) / 2;
  zoom([middle - (middle - from) * factor, middle + (to - middle) * factor]);
}
export function pan(by) { const [from, to] = shown(), shift = by * (to - from); zoom([from + shift, to + shift]); }
export function wheel(event) {
  const over = event.target.closest(".u-over");
  if (!over || (!event.shiftKey && !event.ctrlKey)) return;
  event.preventDefault();
  const amount = event.deltaY || event.deltaX;
  if (event.shiftKey) return pan(0.1 * Math.sign(amount));
  const box = over.getBoundingClientRect(), [from, to] = shown();
  return scale(amount > 0 ? 1.25 : 0.8, from + (to - from) * (event.clientX - box.left) / box.width);
}
export const spanText = () => { const [from, to] = shown(); view.parts.span.textContent = `${from.toFixed(2)} to ${to.toFixed(2)} s`; };
