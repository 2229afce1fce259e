// ---- address, keys, overview ----------------------------------------------------------------------------------------------
function address() {
  const [id, ...rest] = decodeURIComponent(location.hash.slice(1)).split("&");
  const given = (key) => rest.find((part) => part.startsWith(`${key}=`))?.slice(key.length + 1);
  const share = Number(given("f")) / 100;
  return { id: id || "overview", span: given("t")?.split(",").map(Number) || null, fraction: share > 0 && share <= 1 ? share : null };
}
const asked = () => (fraction == null ? "" : `&f=${Math.round(100 * fraction)}`);
function remember() {
  const span = view.span === view.whole ? "" : `&t=${view.span.map((t) => t.toFixed(2)).join(",")}`;
  history.replaceState(null, "", `#${view.page.id}${span}${asked()}`);
}
const ready = () => root.classList.contains("ready");
// a term or a fit lies on a page that may still be packed
const pageOf = (id) => (id.startsWith("term-") ? pages.find(({ dataset }) => dataset.terms?.split(" ").includes(id.slice(5))) || $("#models") : id.startsWith("fit-") ? $("#identification") : document.getElementById(id)?.closest("main > .page"));
async function route() {
  const { id, span, fraction: wanted } = address(), open = pages.find((candidate) => !candidate.hidden);
  const found = pageOf(id), page = found || (ready() ? open : pages[0]);   // "#main" of the skip link opens no page
  if (found) fraction = wanted;
  if (view?.page === page && view.data) {
    if (page.id === id) { zoom(span); applyFraction(); }
    return;
  }
  if (ready() && !found) return;
  pages.forEach((other) => { other.hidden = other !== page; });
  root.classList.add("ready");
  root.classList.toggle("print-all", page.id === "overview");
  all(".bar a").forEach((link) => (link.hash === `#${page.id}` || page.id.startsWith(`${link.hash.slice(1)}-`) ? link.setAttribute("aria-current", "page") : link.removeAttribute("aria-current")));
  const at = cases.indexOf(page);
  $("#previous").disabled = at === 0 || !cases.length;
  $("#next").disabled = at === cases.length - 1;
  scrollTo(0, 0);
  if (at >= 0) { await show(page, span); return; }
  drop();
  if ($("script.parcel", page)) await unpack(page).then(() => layOut(page), () => layOutPlain(page));
  const part = page.id === id ? null : document.getElementById(id);
  if (part?.matches(".fit, .submodel")) part.open = true;
  part?.scrollIntoView();
}
const go = (page) => { if (page) location.hash = page.id + (cases.includes(page) ? asked() : ""); };
function step(by) {
  const at = cases.indexOf(pages.find((page) => !page.hidden));
  go(at < 0 ? cases[by > 0 ? 0 : cases.length - 1] : cases[at + by]);
}
function nextFailure() {
  const at = cases.indexOf(pages.find((page) => !page.hidden));
  go([...cases.slice(at + 1), ...cases.slice(0, at + 1)].find((page) => page.dataset.fail === "1"));
}
function openHelp() { const dialog = $("#keys"); if (!dialog.open) dialog.showModal(); }
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
document.addEventListener("click", (event) => {
  if (event.target.closest(".reset")) zoom(null); else jump(event);
});
document.addEventListener("change", (event) => {
  if (event.target.matches(".from, .to")) zoom([Number($(".from", view.page).value), Number($(".to", view.page).value)]);
});

// ---- overview: which cases are shown, in which order ------------------------------------------------------------------------
const rows = all("#matrix tbody tr");
function filterRows() {
  const kind = $("[data-filter][aria-pressed=true]").dataset.filter, chapter = $("#chapter").value;
  const wanted = { all: () => true, fail: (row) => row.dataset.fail === "1", "not-run": (row) => row.dataset.notRun === "1" }[kind];
  rows.forEach((row) => { row.hidden = !wanted(row) || (chapter !== "" && row.dataset.chapter !== chapter); });
  const shown = rows.filter((row) => !row.hidden).length;
  $("#shown-count").textContent = shown === rows.length ? "" : `${shown} of ${rows.length} cases`;
}
all("[data-filter]").forEach((button) => {
  button.onclick = () => {
    all("[data-filter]").forEach((other) => other.setAttribute("aria-pressed", String(other === button)));
    filterRows();
  };
});
$("#chapter").onchange = filterRows;
// A head sorts by its column: first the worst or the first, then the other way, then as in the report.
const TURN = { none: "descending", descending: "ascending", ascending: "none" };
all("#matrix thead th[data-sort]").forEach((head) => {
  $("button", head).onclick = () => {
    const way = TURN[head.getAttribute("aria-sort") || "none"], column = Number(head.dataset.sort);
    all("#matrix thead th").forEach((other) => other.removeAttribute("aria-sort"));
    const value = (row) => Number(row.children[column].dataset.value ?? -1);
    const order = way === "none" ? rows : [...rows].sort((a, b) => (way === "descending" ? value(b) - value(a) : value(a) - value(b)));
    if (way !== "none") head.setAttribute("aria-sort", way);
    $("#matrix tbody").append(...order);
  };
});

// ---- size, colours, paper -----------------------------------------------------------------------------------------------------
const bar = () => root.style.setProperty("--bar", getComputedStyle($(".bar")).position === "sticky" ? `${$(".bar").offsetHeight}px` : "0px");
let pending = 0;
new ResizeObserver(() => {
  bar();
  cancelAnimationFrame(pending);
  pending = requestAnimationFrame(() => { if (view?.data && $(".panels", view.page).clientWidth !== view.width) draw(); });
}).observe($("main"));
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { if (view?.data) draw(); });
addEventListener("hashchange", route);
addEventListener("beforeprint", layOutPaper);
matchMedia("print").addEventListener("change", (event) => { if (event.matches) layOutPaper(); });
// for scripts that drive the page: scales and exits as drawn, a span of time, the moment from which print has all pages
let unpackedAll;
window.report = {
  limits: () => (view?.plots || []).map(({ scales: { x } }) => [x.min, x.max]),
  scales: () => (view?.plots || []).map(({ scales: { y } }) => [y.min, y.max]),
  exits: () => Object.fromEntries((view?.data?.panels || []).map(({ channel, exits }) => [channel, exits])),
  zoom,
  unpacked: new Promise((done) => { unpackedAll = done; }),
};
bar();
route().then(async () => {
  if (window.DecompressionStream) await unpackAll();
  unpackedAll();
});
