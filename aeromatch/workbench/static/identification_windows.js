// ---- identification: windows of reconstructed records, to fit and to validate -----------------------------------------
import { attempt, button, element, get, number, redraw, select } from "./core.js";
import { again, formed } from "./identification.js";
import { validationChanged } from "./identification_models.js";
import { saving } from "./identification_save.js";
import { place, view } from "./identification_state.js";

export async function list(name) {
  if (!view.rows.has(name)) {
    const own = view, found = await get("/api/windows", { name });
    if (own === view) view.rows.set(name, found.rows);
  }
}
export function starts() {
  const items = view.about.fits.flatMap((fit, i) => fit.models.map((text, j) => [`${i}.${j}`, `${fit.name}: ${text.split("=")[0].trim()}`]));
  const chosen = view.origin ? view.origin.join(".") : "";
  redraw(view.parts.start, "start", select([["", "own windows and model"], ...items], chosen, (value) => attempt(async () => {
    if (!value) { view.origin = null; saving(); return; }
    if (await start(...value.split(".").map(Number))) formed();
  }), { "aria-label": "Fit of the project to start from" }), element("p", { class: "quiet" }, "The match fits each record by itself: the first record of the fit is taken here; add others below."));
}
export async function start(i, j) {   // true unless another fit has been chosen meanwhile
  const own = view, origin = [i, j], fit = view.about.fits[i], name = fit.records.find((one) => view.about.records.includes(one));
  view.origin = origin;
  view.text = fit.models[j];
  view.off.clear();
  view.chosen.clear();
  view.reference = view.span = view.shown = view.name = view.parts.records.about = null;
  if (!name) return true;
  await list(name);
  if (own !== view || view.origin !== origin) return false;
  for (const row of view.rows.get(name)) if (fit.manoeuvres.includes(row.label) || fit.manoeuvres.includes(row.manoeuvre)) view.chosen.add(place(name, row));
  for (const [from, to] of fit.windows || []) add(name, from, to);
  return true;
}
export function add(name, from, to) {
  const row = { label: `${number(from, 6)} to ${number(to, 6)} s`, start: from, end: to, own: true }, known = [...(view.rows.get(name) || []), ...(view.own.get(name) || [])];
  if (!known.some((one) => one.start === from && one.end === to)) view.own.set(name, [...(view.own.get(name) || []), row]);
  view.chosen.add(place(name, row));
}
const rowsOf = (name) => [...(view.rows.get(name) || []), ...(view.own.get(name) || [])];
export function records() {
  const taken = new Set(windows().map((one) => one.record)), shown = view.shown || taken;
  view.shown = new Set([...shown, ...taken]);
  redraw(view.parts.records, "records", ...view.about.records.map((name) => record(name, taken)));
  count();
  const first = view.parts.records.querySelector("details[open]");
  if (first && shown === taken) first.firstChild.scrollIntoView({ block: "center" });
}
export function count() {
  const found = windows(), names = new Set(found.map((one) => one.record));
  view.parts.count.textContent = `${found.length} ${found.length === 1 ? "window" : "windows"} of ${names.size} ${names.size === 1 ? "record" : "records"}, ${number(found.reduce((sum, one) => sum + one.end - one.start, 0), 4) || 0} s; ${validationWindows().length} to validate.`;
}
function record(name, taken) {
  const body = element("div"), host = element("details", { open: view.shown.has(name) },
    element("summary", { class: taken.has(name) ? "taken" : null }, name), body);
  const fill = () => {
    const ends = [0, 1].map((i) => element("input", { type: "number", step: "any", "aria-label": `${i ? "end" : "start"} of a window of ${name} [s]`, placeholder: i ? "end, s" : "start, s" }));
    body.replaceChildren(
      element("ul", { class: "list" }, rowsOf(name).map((row) => element("li", { class: "row tight" }, element("label", { class: "window" },
        element("input", { type: "checkbox", checked: view.chosen.has(place(name, row)), onchange: (event) => {
          if (event.target.checked) view.chosen.add(place(name, row)); else view.chosen.delete(place(name, row));
          host.firstChild.className = rowsOf(name).some((one) => view.chosen.has(place(name, one))) ? "taken" : "";
          again();
        } }), element("span", {}, row.label), row.own ? "" : element("span", { class: "quiet number" }, `${number(row.start, 5)}\u2013${number(row.end, 5)}`)), validator(name, row)))),
      element("div", { class: "row" }, ends, button("Add", () => {
        const [from, to] = ends.map((one) => Number(one.value));
        if (!(to > from) || !ends[0].value) { view.parts.error.replaceChildren(element("p", { class: "fail", role: "alert" }, "Give start and end in seconds of the record, the end later.")); return; }
        add(name, from, to); fill(); again();
      }, { "aria-label": `Add a window of ${name}` })));
  };
  if (view.rows.has(name)) fill();
  host.addEventListener("toggle", () => {
    if (host.open) view.shown.add(name); else view.shown.delete(name);
    if (host.open && !view.rows.has(name)) attempt(async () => { body.replaceChildren(element("p", { class: "quiet" }, "reading ...")); await list(name); if (view) fill(); }, body);
  });
  return host;
}

// A window to validate is predicted by the fit and by the saved models; it does not enter the fit.
function validator(name, row) {
  const node = button("val", () => {
    if (view.validation.has(place(name, row))) view.validation.delete(place(name, row)); else view.validation.add(place(name, row));
    node.setAttribute("aria-pressed", String(view.validation.has(place(name, row))));
    count();
    validationChanged();
  }, { class: "small", "aria-pressed": String(view.validation.has(place(name, row))), title: "Predict this window: it is to validate models", "aria-label": `Validate on ${row.label} of ${name}` });
  return node;
}
const asWindows = (chosen) => view.about.records.flatMap((name) => rowsOf(name).filter((row) => chosen.has(place(name, row))).map((row) => ({ record: name, start: row.start, end: row.end })));
export const windows = () => asWindows(view.chosen);
export const validationWindows = () => asWindows(view.validation);
