// ---- match: verdicts of all cases, what explains a miss, trials by edited models, tuning, rationale --------------------
import { $, act, attempt, button, element, get, key, labelled, number, select, table } from "./core.js";

let view = null;

export function open(host) {
  view = { host, parts: {}, report: sessionStorage.getItem("report") || "match", chosen: sessionStorage.getItem("case"), changed: () => attempt(refresh) };
  const part = (name, node) => (view.parts[name] = node);
  host.replaceChildren(element("div", { class: "columns" },
    element("nav", { class: "column", "aria-label": "Job and reports" },
      element("h2", {}, "Match"), part("job", element("div")), part("error", element("div")),
      element("h2", {}, "Report"), part("reports", element("div")),
      element("h2", {}, "Fly again"), part("trial", element("div")),
      element("h2", {}, "Tune"), part("tune", element("div"))),
    element("div", { class: "column", id: "match-column" }, part("cases", element("div")), part("frame", element("div"))),
    element("aside", { class: "column", "aria-label": "Case" }, part("case", element("div")))));
  document.addEventListener("changed", view.changed);
  key("n", "next case", () => step(1));
  key("p", "case before", () => step(-1));
  return refresh();
}
export function close() {
  document.removeEventListener("changed", view.changed);
  view = null;
}
const run = (words) => attempt(() => act(words, { wait: 1 }), view.parts.error);

async function refresh() {
  const own = view;
  let found = await get("/api/match", { report: view.report });
  if (!found.reports.includes(view.report) && found.reports.length) { view.report = found.reports[0]; found = await get("/api/match", { report: view.report }); }
  const place = await get("/api/jobs");
  if (own !== view) return;
  view.found = found;
  view.ticket = place.report ? /^\/report\/\w+\//.exec(place.report)[0] : null;
  jobs();
  reports();
  trial();
  tune();
  cases();
  if (!found.cases.some((one) => one.name === view.chosen)) view.chosen = found.cases.length ? found.cases[0].name : null;
  await showCase();
}
function jobs() {
  view.parts.job.replaceChildren(
    element("p", { class: "quiet" }, "Databases, FMUs and report of the project as its files are now."),
    button(view.found.reports.includes("match") ? "Match again" : "Match the project", () => run(["match", view.found.project, "-o", "{work}/match"]), { class: "first" }));
}
function reports() {
  const { reports: names } = view.found;
  view.parts.reports.replaceChildren(names.length
    ? select(names.map((name) => [name, name === "match" ? "proof of match" : `trial: ${name.replace("runs/", "")}`]), view.report, (name) => { view.report = name; sessionStorage.setItem("report", name); attempt(refresh); }, { "aria-label": "Report" })
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
    element("h2", {}, view.report === "match" ? "Verdicts" : `Trial ${view.report.replace("runs/", "")}: no part of the proof`),
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
  const own = view, name = view.chosen, about = view.found.cases.find((one) => one.name === name);
  if (!about) { view.parts.case.replaceChildren(); view.parts.frame.replaceChildren(); return; }
  const found = await get("/api/case", { report: view.report, name });
  const proof = found.trial && view.found.reports.includes("match") ? await get("/api/case", { report: "match", name }).catch(() => null) : null;
  if (own !== view || view.chosen !== name) return;
  frame(about);
  const before = new Map(proof ? proof.rows.filter((row) => row.run === "final").map((row) => [row.criterion, row.worst_ratio]) : []);
  const columns = [["criterion", (row) => `${row.criterion.replaceAll("_", " ")}`], ["model", "run"], ["ratio", "worst_ratio", { number: true, digits: 3 }], ["", (row) => element("span", { class: row.verdict === "pass" ? "pass" : "fail" }, row.verdict.replaceAll("_", " "))]];
  if (proof) columns.splice(3, 0, ["final", (row) => before.get(row.criterion), { number: true, digits: 3 }]);
  view.parts.case.replaceChildren(
    element("h2", {}, `${about.row}  ${about.title}`),
    about.failure ? element("p", { class: "fail" }, about.failure) : "",
    element("h3", {}, "Worst difference / tolerance"), table(columns, found.rows, { label: "Criteria" }),
    found.story ? element("h3", {}, "What explains the miss of the a-priori model") : "", element("p", {}, found.story),
    found.causes.length ? table([["stage", "stage"], ["term", "term"], ["explained", (row) => (row.explained == null ? "" : `${Math.round(100 * row.explained)} %`), { number: true }]], found.causes, { label: "Term swaps" }) : "",
    element("h3", {}, "Window"), windowForm(about, found),
    element("h3", {}, "Rationale"), rationaleForm(about, found));
}
function frame(about) {
  const source = view.ticket && view.found.place ? `${view.ticket}${view.found.place}#case-${about.key}` : null, old = $("iframe", view.parts.frame);
  if (!source) { view.parts.frame.replaceChildren(); return; }
  if (old && old.getAttribute("src") === source) return;
  const node = element("iframe", { src: source, title: `Report, ${about.title}`, class: "report", tabindex: "0" });
  view.parts.frame.replaceChildren(node);
}

// ---- what changes files ----------------------------------------------------------------------------------------------
const field = (value, more = {}) => element("input", { value, size: 10, ...more });
function windowForm(about, found) {
  if (!about.file) return element("p", { class: "quiet" }, "The case is not one of the project.");
  const [start, end] = found.window.map((time, i) => field(time, { type: "number", step: "any", "aria-label": i ? "end of the window" : "start of the window" }));
  return element("div", {}, element("div", { class: "row" }, start, end, button("Change the case", () => run(["set", about.file, "case.window", `[${start.value}, ${end.value}]`]))),
    element("p", { class: "quiet" }, "Changes the case file; the report changes with the next match."));
}
function rationaleForm(about, found) {
  if (!about.file) return "";
  const subject = field("", { placeholder: "criterion or trim.delta_e", size: 16, "aria-label": "criterion, channel or trim bias" }), text = element("textarea", { rows: 3, "aria-label": "rationale" });
  const given = Object.entries(found.rationale);
  return element("div", {}, given.length ? element("dl", {}, given.flatMap(([name, why]) => [element("dt", {}, name), element("dd", {}, why)])) : "",
    labelled("of", subject), text, button("Write", () => run(["set", about.file, `rationale."${subject.value.trim()}"`, JSON.stringify(text.value)])));
}
function trial() {
  const { models, cases: rows, databases } = view.found, edited = models.filter((one) => !one.file.startsWith("{work}/match/"));
  const files = rows.map((one) => one.file).filter(Boolean);
  if (!edited.length) { view.parts.trial.replaceChildren(element("p", { class: "quiet" }, "Edit a database and write its FMU (page Database), or tune: then its cases are flown here, apart from the proof of match.")); return; }
  const chosen = { file: edited[0].file };
  const name = field("trial", { "aria-label": "name of the trial" });
  const fly = (which) => {
    const model = edited.find((one) => one.file === chosen.file), word = name.value.trim() || "trial";
    const final = models.find((one) => one.file === "{work}/match/final.fmu"), both = final ? ["--model", `final=${final.file}`] : [];
    return run(["pom", "run", ...which, ...both, "--model", `${model.name}=${model.file}`, "-o", `{work}/runs/${word}`, "--title", `TRIAL ${word}: no part of the proof`, "--no-pdf"]);
  };
  view.parts.trial.replaceChildren(
    labelled("model", select(edited.map((one) => [one.file, one.name]), chosen.file, (file) => { chosen.file = file; }, { "aria-label": "model" })), labelled("name", name),
    element("div", { class: "row" },
      button("This case", () => { const own = rows.find((one) => one.name === view.chosen); return own && own.file ? fly([own.file]) : null; }),
      button("All cases", () => fly(files))),
    databases.length > 1 ? element("p", { class: "quiet" }, `${databases.length - 1} edited databases.`) : "");
}
function tune() {
  const { databases, tuned, cases: rows } = view.found, files = rows.map((one) => one.file).filter(Boolean);
  if (!databases.length || !files.length) { view.parts.tune.replaceChildren(element("p", { class: "quiet" }, "After a match.")); return; }
  const chosen = { file: databases[0].file }, bound = field(2, { type: "number", min: 0.1, step: 0.1, "aria-label": "bound in standard errors" });
  const moves = tuned ? tuned.moves.map((move) => ({ ...move, bar: spent(move, tuned.bound) })) : [];
  view.parts.tune.replaceChildren(
    labelled("database", select(databases.map((one) => [one.file, one.name]), chosen.file, (file) => { chosen.file = file; }, { "aria-label": "database" })),
    labelled("bound, standard errors", bound),
    button("Tune until all cases pass", () => run(["pom", "tune", ...files, "--database", chosen.file, "--bound", bound.value, "--aircraft", "{work}/match/final.toml", "-o", "{work}/tuned", "--fmu", "--log", "{work}/tuning.json"])),
    tuned ? element("div", {}, element("p", {}, tuned.refusal ? `Refused: ${tuned.refusal}` : moves.length ? `Distance ${number(tuned.distance, 3)}, bound ${tuned.bound} standard errors.` : "Nothing had to move."),
      moves.length ? table([["term", "term"], ["spent", "from_evidence", { number: true, digits: 2 }], ["", "bar"]], moves, { label: "Moves in standard errors" }) : "") : "");
}
function spent(move, bound) {
  const node = element("meter", { min: 0, max: Math.max(bound, move.from_evidence), "aria-label": `${move.term}: ${number(move.from_evidence, 2)} of ${bound} standard errors` });
  node.value = move.from_evidence;
  node.high = bound;
  return node;
}
