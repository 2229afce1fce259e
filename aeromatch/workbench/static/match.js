// ---- match: verdicts of all cases, what explains a miss, trials by edited models, tuning, rationale --------------------
import { act, attempt, button, colour, DASHES, drawing, element, get, inTurn, key, labelled, number, plot, redraw, select, sent, table, traces } from "./core.js";

let view = null;

export function open(host) {
  view = { host, parts: {}, plots: [], report: sessionStorage.getItem("report") || "match", chosen: sessionStorage.getItem("case"), refresh: inTurn(refresh), changed: () => attempt(view.refresh) };
  const part = (name, node) => (view.parts[name] = node);
  host.replaceChildren(element("div", { class: "columns match" },
    element("nav", { class: "column", "aria-label": "Job and reports" },
      element("h2", {}, "Match"), part("job", element("div")), part("error", element("div")),
      element("h2", {}, "Report"), part("reports", element("div")),
      element("h2", {}, "Fly again"), part("trial", element("div")),
      element("h2", {}, "Move terms by hand"), part("moves", element("div")),
      element("h2", {}, "Tune"), part("tune", element("div"))),
    element("div", { class: "column", id: "match-column" }, part("cases", element("div")), part("signals", element("div"))),
    element("aside", { class: "column", "aria-label": "Case" }, part("case", element("div")))));
  view.resized = new ResizeObserver(() => { if (view && view.groups && view.width !== view.parts.signals.clientWidth) drawSignals(); });
  view.resized.observe(view.parts.signals);
  document.addEventListener("changed", view.changed);
  key("n", "next case", () => step(1));
  key("p", "case before", () => step(-1));
  return view.refresh();
}
export function close() {
  document.removeEventListener("changed", view.changed);
  view.resized.disconnect();
  drop();
  view = null;
}
const run = (words) => attempt(() => act(words, { wait: 1 }), view.parts.error);
async function send(words, host, fields) {
  const written = sent(host, fields);
  await act(words, { wait: 1 });
  written();
}

async function refresh() {
  const own = view;
  let found = await get("/api/match", { report: view.report });
  const { terms } = await get("/api/moves");
  if (!found.reports.includes(view.report) && found.reports.length) { view.report = found.reports[0]; found = await get("/api/match", { report: view.report }); }
  const place = await get("/api/jobs");
  if (own !== view || found.report !== view.report) return;   // another report has been chosen meanwhile
  view.found = found;
  view.terms = terms;
  view.ticket = place.report ? /^\/report\/\w+\//.exec(place.report)[0] : null;
  if (!found.cases.some((one) => one.name === view.chosen)) view.chosen = found.cases.length ? found.cases[0].name : null;
  jobs();
  reports();
  moves();
  tune();
  cases();
  await showCase();
}
function jobs() {
  redraw(view.parts.job, "job",
    element("p", { class: "quiet" }, "Databases, FMUs and report of the project as its files are now."),
    view.found.reports.includes("match") && view.ticket ? element("p", {}, element("a", { href: `${view.ticket}match/report/report.pdf`, download: "report.pdf" }, "report.pdf"), ", with the blocks for signatures") : "",
    element("details", {}, element("summary", {}, "Signatures of the report"), signatureForm(view.found.project, view.found.signatures, view.found.results, "the report", view.parts.job)),
    button(view.found.reports.includes("match") ? "Match again" : "Match the project", () => run(["match", view.found.project, "-o", "{work}/match"]), { class: "first" }));
}
function reports() {
  const { reports: names } = view.found;
  view.parts.reports.replaceChildren(names.length
    ? select(names.map((name) => [name, name === "match" ? "proof of match" : `trial ${name.replace("runs/", "")}`]), view.report, (name) => { view.report = name; sessionStorage.setItem("report", name); attempt(view.refresh); }, { "aria-label": "Report" })
    : element("p", {}, "None yet."));
}

// ---- the cases -------------------------------------------------------------------------------------------------------
const cell = (one, name) => {
  if (!(name in one.status)) return "";
  const worst = one.worst[name];
  return element("span", { class: one.passed[name] ? "pass" : "fail" }, `${one.passed[name] ? "\u2713" : "\u2717"} ${one.status[name]}${worst == null ? "" : ` ${number(worst, 3)}`}`);
};
function cases() {
  const { cases: rows, runs } = view.found;
  view.parts.cases.replaceChildren(
    element("h2", {}, view.report === "match" ? "Verdicts" : `Trial \u201c${view.report.replace("runs/", "")}\u201d: no part of the proof`),
    rows.length ? table([["row", "row"], ["case", "title"], ...runs.map((name) => [name, (one) => cell(one, name)])], rows,
      { label: "Cases: verdict and worst difference over tolerance", chosen: (one) => one.name === view.chosen, onchoose: (one) => choose(one.name) })
      : element("p", {}, "Nothing has been matched yet."));
}
function choose(name) {
  view.chosen = name;
  sessionStorage.setItem("case", name);
  cases();
  attempt(showCase);
}
function step(by) {
  const names = view.found.cases.map((one) => one.name), place = names.indexOf(view.chosen) + by;
  if (names[place]) choose(names[place]);
}
async function showCase() {
  const own = view, turn = (own.showing = (own.showing || 0) + 1), name = view.chosen, about = view.found.cases.find((one) => one.name === name);
  if (!about) { drop(); view.groups = null; view.parts.case.replaceChildren(); view.parts.signals.replaceChildren(); return; }
  const found = await get("/api/case", { report: view.report, name }), groups = await traces({ report: view.report, name }, undefined, "/api/case/signals");
  const proof = found.trial && view.found.reports.includes("match") ? await get("/api/case", { report: "match", name }).catch(() => null) : null;
  if (own !== view || turn !== own.showing) return;
  view.groups = groups;
  view.about = about;
  drawSignals();
  const before = new Map(proof ? proof.rows.map((row) => [`${row.run} ${row.criterion}`, row.worst_ratio]) : []);
  const kind = (verdict) => ({ pass: "pass", fail: "fail", invalid: "fail" })[verdict] || "quiet";
  const columns = [["criterion", (row) => `${row.criterion.replaceAll("_", " ")}`], ["model", "run"], ["ratio", "worst_ratio", { number: true, digits: 3 }], ["verdict", (row) => element("span", { class: kind(row.verdict) }, row.verdict.replaceAll("_", " "))]];
  if (proof) columns.splice(3, 0, ["proof", (row) => before.get(`${row.run} ${row.criterion}`), { number: true, digits: 3 }]);
  view.case = found;
  trial();
  redraw(view.parts.case, `${view.report} ${name}`,
    element("h2", {}, `${about.row}  ${about.title}`),
    about.failure ? element("p", { class: "fail" }, about.failure) : "",
    found.trial && found.notes ? element("p", { class: "trial" }, found.notes) : "",
    element("h3", {}, "Worst difference / tolerance"), table(columns, found.rows, { label: "Criteria" }),
    found.story ? element("h3", {}, "What explains the miss of the a-priori model") : "", element("p", {}, found.story),
    found.causes.length ? table([["stage", "stage"], ["term", "term"], ["explained", (row) => (row.explained == null ? "" : `${Math.round(100 * row.explained)} %`), { number: true }]], found.causes, { label: "Term swaps" }) : "",
    ...(found.trial ? [] : [element("h3", {}, "Window"), windowForm(about, found), element("h3", {}, "Rationale"), rationaleForm(about, found),
      element("h3", {}, "Signatures"), about.file ? signatureForm(about.file, found.signatures, found.results, "the case", view.parts.case) : ""]));
}
// ---- the signals of the chosen case; the report opens in a tab of its own ----------------------------------------------
const PANEL = 190, BANDS = ["low", "high"];
const drop = () => { view.plots.forEach((made) => made.destroy()); view.plots = []; };
function drawSignals() {
  const { about, groups } = view, host = view.parts.signals, report = view.ticket && view.found.place ? `${view.ticket}${view.found.place}#case-${about.key}` : null;
  drop();
  view.width = host.clientWidth;
  const runs = groups.length ? Object.keys(groups[0].values).filter((run) => !BANDS.includes(run)) : [];
  const swatch = (i) => drawing("svg", { width: 30, height: 10, "aria-hidden": "true" }, drawing("path", { d: "M1 5H29", stroke: colour(`line-${i}`), "stroke-width": 1.6, "stroke-dasharray": DASHES[i % DASHES.length].join(" ") }));
  host.replaceChildren(
    element("h2", {}, `${about.row}  ${about.title}`),
    element("div", { class: "row" }, report ? element("a", { href: report, target: "_blank", rel: "noopener" }, "The case in the report (new tab)") : "",
      groups.length ? element("span", { class: "quiet legend" }, runs.map((run, i) => element("span", {}, swatch(i), run)), element("span", {}, " \u2003shaded: flight \u00b1 tolerance")) : ""),
    groups.length ? "" : element("p", { class: "quiet" }, "The report has no signals of this case."));
  for (const group of groups) {
    const box = element("div", { class: "plot", role: "img", "aria-label": `${group.leaf} of ${about.title}` }), lines = runs.map((run, i) => ({ label: run, values: group.values[run], line: i })), unit = group.unit === "1" ? "" : group.unit;
    // The band is drawn first, below the lines of flight and models.
    const edges = BANDS.filter((edge) => group.values[edge]).map((edge) => ({ label: edge, values: group.values[edge], line: 5, dash: 0, width: 0.6 }));
    host.append(element("h3", {}, unit ? `${group.leaf}, ${unit}` : group.leaf), box);
    view.plots.push(plot(box, {
      x: group.time, lines: [...edges, ...lines], width: view.width || 600, height: PANEL, sync: "case", xLabel: "time of the record, s",
      bands: edges.length ? [{ series: [2, 1], fill: colour("band") }] : undefined,
    }));
  }
}

// ---- what changes files ----------------------------------------------------------------------------------------------
const field = (value, more = {}) => element("input", { value, size: 10, ...more });
function windowForm(about, found) {
  if (!about.file) return element("p", { class: "quiet" }, "The case is not one of the project.");
  const [start, end] = found.window.map((time, i) => field(time, { type: "number", step: "any", "aria-label": i ? "end of the window" : "start of the window" }));
  return element("div", {}, element("div", { class: "row" }, start, end, button("Change the case", () => attempt(() => send(["set", about.file, "case.window", `[${start.value}, ${end.value}]`], view.parts.case, [start, end]), view.parts.error))),
    element("p", { class: "quiet" }, "Changes the case file; the report changes with the next match."));
}
function rationaleForm(about, found) {
  if (!about.file) return "";
  const advisory = [...new Set(found.rows.filter((row) => row.verdict === "advisory").map((row) => row.criterion))];
  const list = (given) => (Object.keys(given).length ? element("dl", {}, Object.entries(given).flatMap(([name, why]) => [element("dt", {}, name), element("dd", {}, why)])) : "");
  const form = (names, key, what) => {
    const text = element("textarea", { rows: 3, "aria-label": what }), of = select(names, names[0], null, { "aria-label": `${what} of` }), error = element("div");
    return element("div", {}, labelled("of", of), text,
      button("Write", () => attempt(async () => {
        if (!text.value.trim()) throw new Error("Write the words first.");
        await send(["set", about.file, `${key}."${of.value}"`, JSON.stringify(text.value.trim())], view.parts.case, [text, of]);
      }, error), { "aria-label": `Write the ${what}` }), error);
  };
  return element("div", {}, list(found.rationale), form(found.subjects, "rationale", "rationale"),
    ...(advisory.length ? [element("h3", {}, "Tick of an engineer"), list(found.ticks), element("p", { class: "quiet" }, "Name, date and words."), form(advisory, "ticks", "tick")] : []),
    element("p", { class: "quiet" }, "Written into the case file; the report prints it with the next match."));
}

function signatureForm(file, rows, results, of, host) {   // the block as the report prints it, and one line of it to write
  const role = select(rows.map((row) => row.role), (rows.find((row) => !row.name) || rows[0]).role, null, { "aria-label": `role of who signs ${of}` }), error = element("div"), today = new Date();
  const name = field("", { size: 18, "aria-label": `name of who signs ${of}`, placeholder: "name" }), organisation = field("", { size: 18, "aria-label": `organisation of who signs ${of}`, placeholder: "organisation, if any" });
  const date = field([today.getFullYear(), today.getMonth() + 1, today.getDate()].map((part) => String(part).padStart(2, "0")).join("-"), { type: "date", "aria-label": `day of the signature of ${of}` });
  const write = () => attempt(async () => {
    if (!name.value.trim()) throw new Error("Give the name of who signs.");
    const entry = [["name", name], ["date", date], ["organisation", organisation]].filter(([, input]) => input.value.trim()).map(([key, input]) => `${key} = ${JSON.stringify(input.value.trim())}`);
    if (results) entry.push(`results = ${JSON.stringify(results)}`);
    await send(["set", file, `signatures.${role.value}`, `{ ${entry.join(", ")} }`], host, [role, name, date, organisation]);
  }, error);
  const remove = (row) => attempt(() => act(["set", file, `signatures.${row.role}`, "--remove"], { wait: 1 }), error);
  return element("div", { class: "signed" },
    table([["role", "role"], ["name", (row) => element("span", {}, row.name, row.remark ? element("span", { class: "fail block" }, row.remark) : "")], ["date", "date"], ["take back", (row) => (row.name ? button("\u2715", () => remove(row), { "aria-label": `take back: ${row.role}, ${of}` }) : ""), { hidden: true }]], rows, { label: `Signatures of ${of}` }),
    element("div", { class: "row" }, role, date), element("div", { class: "row" }, name, organisation, button(`Sign ${of}`, write)), error,
    element("p", { class: "quiet" }, `${results ? `Signs the results ${results}; a report with others marks it. ` : ""}Name and day are printed by the next match; the room for the signature itself stays.`));
}

// ---- trials: other models, another trim, other tolerances; apart from the proof ----------------------------------------
const NAME = /^[\w-]+$/;
function trialName(input) {
  const name = input.value.trim();
  if (!NAME.test(name)) throw new Error("The name of a trial has letters, digits, _ and -.");
  return name;
}
const flown = (name, files, models) => ["pom", "run", ...files, ...models.flatMap((model) => ["--model", `${model.name}=${model.file}`]), "-o", `{work}/runs/${name}`, "--title", `TRIAL ${name}: no part of the proof`, "--no-pdf"];
async function fly(name, files, models) {
  await act(flown(name, files, models), { wait: 1 });
  view.report = `runs/${name}`;
  sessionStorage.setItem("report", view.report);
  await view.refresh();
}
function trial() {
  const { models, cases: rows } = view.found, files = rows.map((one) => one.file).filter(Boolean), about = rows.find((one) => one.name === view.chosen);
  if (!models.length || !about) { view.parts.trial.replaceChildren(element("p", { class: "quiet" }, "After a match: its cases are flown here with other models, another trim or other tolerances, apart from the proof.")); return; }
  const edited = models.filter((one) => !one.file.startsWith("{work}/match/")), final = models.find((one) => one.file === "{work}/match/final.fmu");
  if (!models.some((one) => one.file === view.model)) view.model = (edited[0] || final || models[0]).file;
  const name = field(view.trialName || "trial", { "aria-label": "name of the trial", oninput: () => { view.trialName = name.value; } }), error = element("div");
  const chosen = () => { const model = models.find((one) => one.file === view.model); return [...(final && final !== model ? [final] : []), model]; };
  const given = view.conditions && view.conditions.of === about.name ? view.conditions : (view.conditions = { of: about.name, trim: "", bands: {}, key: "", value: "" });
  const bands = [...new Map(view.case.rows.filter((row) => row.tolerance_text).map((row) => [row.criterion, row.tolerance_text]))];
  const changes = () => [
    ...(given.trim ? [["drive.trim", given.trim]] : []),
    ...Object.entries(given.bands).filter(([, band]) => band.trim()).map(([criterion, band]) => [`tolerance."${criterion}"`, band.trim()]),
    ...(given.key.trim() && given.value.trim() ? [[given.key.trim(), given.value.trim()]] : []),
  ];
  const one = () => attempt(async () => {
    const word = trialName(name), own = changes(), copy = `{work}/trials/${word}.toml`;
    if (!about.file) throw new Error("The case is not one of the project.");
    if (own.length) await act(["set", about.file, ...own[0], ...own.slice(1).flatMap(([key, value]) => ["--also", key, value]), "--trial", copy], { wait: 1 });
    await fly(word, [own.length ? copy : about.file], chosen());
  }, error);
  const all = () => attempt(async () => {
    if (changes().length) throw new Error("Other conditions are those of one case; empty them to fly all.");
    await fly(trialName(name), files, chosen());
  }, error);
  redraw(view.parts.trial, about.name,
    labelled("model", select(models.map((model) => [model.file, model.name]), view.model, (file) => { view.model = file; }, { "aria-label": "model" })), labelled("name", name),
    element("details", {}, element("summary", {}, "Another trim, other tolerances"),
      element("p", { class: "quiet" }, "On a copy of the case, marked as a trial; the case of the project stays."),
      labelled("trim", select([["", "as the case has it"], ["true", "trimmed to the flight condition"], ["false", "not trimmed"], ["ground", "on the wheels"]], given.trim, (value) => { given.trim = value; }, { "aria-label": "trim of the trial" })),
      bands.map(([criterion, band]) => element("label", { class: "block" }, criterion.replaceAll("_", " "), element("input", { class: "wide", value: given.bands[criterion] || "", placeholder: band, title: band, "aria-label": `tolerance of ${criterion.replaceAll("_", " ")} in the trial`, oninput: (event) => { given.bands[criterion] = event.target.value; } }))),
      element("div", { class: "row" }, field(given.key, { placeholder: "key of the case", size: 12, "aria-label": "another key of the case", oninput: (event) => { given.key = event.target.value; } }), field(given.value, { placeholder: "value", "aria-label": "its value", oninput: (event) => { given.value = event.target.value; } }))),
    element("div", { class: "row" }, button("This case", one), button("All cases", all)), error);
}
function moves() {   // terms of the final database, scaled by sliders that count in its standard errors
  const { terms } = view, files = view.found.cases.map((one) => one.file).filter(Boolean), models = view.found.models.filter((one) => one.file === "{work}/match/final.fmu");
  if (!terms.length || !files.length) { view.parts.moves.replaceChildren(element("p", { class: "quiet" }, "After a match.")); return; }
  view.moved = view.moved || new Map();
  const bound = Number(view.bound) || 2, error = element("div"), name = field(view.moveName || "by_hand", { "aria-label": "name of the moved database", oninput: () => { view.moveName = name.value; } });
  const factor = (term, k) => 1 + k / terms.find((one) => one.term === term).size;
  const line = ([term, k]) => {
    const words = element("span", { class: "quiet" }), slider = element("input", { type: "range", min: -2 * bound, max: 2 * bound, step: 0.1, value: k, "aria-label": `${term}, standard errors` });
    const say = () => {
      const spent = Math.abs(Number(slider.value)), text = `\u00d7 ${number(factor(term, Number(slider.value)), 4)}, spends ${number(spent, 2)} of ${bound} standard errors${spent > bound ? ": beyond the bound" : ""}`;
      words.textContent = text;
      words.className = spent > bound ? "fail" : "quiet";
      slider.setAttribute("aria-valuetext", text);
    };
    slider.addEventListener("input", () => { view.moved.set(term, Number(slider.value)); say(); });
    say();
    return element("div", { class: "move" }, element("div", { class: "row" }, element("b", {}, term), slider, button("\u2715", () => { view.moved.delete(term); moves(); }, { "aria-label": `leave ${term} as it is` })), words);
  };
  const rest = terms.map((one) => one.term).filter((term) => !view.moved.has(term));
  const go = () => attempt(async () => {
    const word = trialName(name), output = `{work}/databases/${word}.nc`, fmu = `{work}/databases/${word}.fmu`, moved = [...view.moved].filter(([, k]) => k !== 0);
    if (!moved.length) throw new Error("Choose a term and move its slider.");
    let from = "{work}/match/final.nc";
    for (const [term, k] of moved) {
      await act(["db", "edit", from, "scale", term, "--by", String(factor(term, k)), "--note", `moved by ${number(Math.abs(k), 2).replace("\u2212", "-")} standard errors`, "-o", output], { wait: 1 });
      from = output;
    }
    await act(["fmu", "write", "{work}/match/final.toml", output, "-o", fmu], { wait: 1 });
    await fly(word, files, [...models, { name: word, file: fmu }]);
  }, error);
  redraw(view.parts.moves, "moves",
    ...[...view.moved].map(line),
    select([["", "move a term ..."], ...rest], "", (term) => { if (term) { view.moved.set(term, 0); moves(); } }, { "aria-label": "term to move" }),
    view.moved.size ? labelled("name", name) : "", view.moved.size ? button("Write, and fly all cases", go) : "", error);
}
function tune() {
  const { databases, tuned, cases: rows } = view.found, files = rows.map((one) => one.file).filter(Boolean);
  if (!databases.length || !files.length) { view.parts.tune.replaceChildren(element("p", { class: "quiet" }, "After a match.")); return; }
  const final = "{work}/match/final.nc", chosen = { file: databases.some((one) => one.file === view.tuneFrom) ? view.tuneFrom : databases[0].file };
  const evidence = () => (chosen.file !== final && databases.some((one) => one.file === final) ? ["--evidence", final] : []), bound = field(view.bound || 2, { type: "number", min: 0.1, step: 0.1, "aria-label": "bound in standard errors" });
  const moves = tuned ? tuned.moves.map((move) => ({ ...move, bar: spent(move, tuned.bound) })) : [];
  redraw(view.parts.tune, "tune",
    labelled("database", select(databases.map((one) => [one.file, one.name]), chosen.file, (file) => { chosen.file = view.tuneFrom = file; }, { "aria-label": "database" })),
    labelled("bound, standard errors", bound),
    button("Tune until all cases pass", () => run(["pom", "tune", ...files, "--database", chosen.file, ...evidence(), "--bound", (view.bound = bound.value), "--aircraft", "{work}/match/final.toml", "-o", "{work}/tuned", "--fmu", "--log", "{work}/tuning.json"])),
    tuned ? element("div", {}, element("p", {}, tuned.refusal ? `Refused: ${tuned.refusal}` : moves.length ? `Distance ${number(tuned.distance, 3)}, bound ${tuned.bound} standard errors.` : "Nothing had to move."),
      moves.length ? table([["term", "term"], ["spent", "from_evidence", { number: true, digits: 2 }], ["of the bound", "bar"]], moves, { label: "Moves in standard errors" }) : "") : "");
}
function spent(move, bound) {
  const node = element("meter", { min: 0, max: Math.max(bound, move.from_evidence), "aria-label": `${move.term}: ${number(move.from_evidence, 2)} of ${bound} standard errors` });
  node.value = move.from_evidence;
  node.high = bound;
  return node;
}
