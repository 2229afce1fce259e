// ---- identification: measured and fitted coefficient of a fit, drawn when it is opened --------------------------------------
function fitFigure(page, index) {
  const { head, body } = opened.get(page), fit = head.fits[index], measured = restore(fit.measured, body), fitted = restore(fit.fitted, body);
  const x = measured.map((_, i) => i * fit.every), residual = measured.map((v, i) => (v == null || fitted[i] == null ? null : v - fitted[i]));
  const near = (values) => { const [low, high] = extent(values, 0, x.length - 1), pad = 0.06 * (high - low || 1); return [low - pad, high + pad]; };
  const width = SHEET.width - SHEET.left - SHEET.right, span = [0, Math.max(x[x.length - 1], 1)];
  const frame = frameOf(SHEET.left, 42, width, 150, span, near([measured, fitted])), strip = frameOf(SHEET.left, 200, width, 60, span, near([residual]));
  const starts = (host) => fit.starts.map((i) => straight(host.px(i * fit.every), host.top, host.px(i * fit.every), host.bottom, "window")).join("");
  const drawn = clipped(frame, starts(frame) + curve(frame, x, measured, "trace run-0") + curve(frame, x, fitted, "trace run-3"));
  return svg(300, keyOf([{ name: "measured", style: "run-0" }, { name: "fitted", style: "run-3" }], false) + quantity(frame.left, 34, { base: fit.base, sub: fit.sub, words: "and its residual", unit: "" })
    + axesOf(frame, false) + drawn + axesOf(strip, true, ticks(...strip.y, 3)) + clipped(strip, starts(strip) + curve(strip, x, residual, "trace run-0 fine"))
    + textAt(frame.left + width / 2, strip.bottom + 25, "sample", "caption", "middle"), fit.alt);
}
function openFit(details) {
  const host = $(".fit-figure", details), page = details.closest(".page");
  if (!host.firstChild && opened.has(page)) host.innerHTML = fitFigure(page, Number(details.dataset.fit));
}
document.addEventListener("toggle", (event) => { if (event.target.open && event.target.matches(".fit")) openFit(event.target); }, true);
document.addEventListener("click", (event) => {
  const link = event.target.closest('a[href^="#fit-"], a[href^="#submodel-"]');
  if (link) document.getElementById(link.hash.slice(1)).open = true;
});
