// ---- reconstruction and faults of a record --------------------------------------------------------------------------
import { act, attempt, button, element, get } from "./core.js";
import { change } from "./record_marks.js";
import { draw } from "./record_panels.js";
import { channelList } from "./records.js";
import { place, view } from "./record_state.js";
import { zoom } from "./record_time.js";

export function path() {
  const { record, project } = view, names = project.names ? ["--names", project.names] : [];
  const run = (words, output) => attempt(() => act(["flight", "reconstruct", ...words, "--aircraft", project.aircraft, ...names, "-o", output], { wait: 1 }), view.parts.error);
  const files = project.records.filter((one) => one.name !== record.name);
  view.parts.path.replaceChildren(
    element("p", {}, record.reconstructed ? "Reconstructed: its channels stand in the panels of the recorded ones." : "Not reconstructed."),
    element("div", { class: "row" },
      button(record.reconstructed ? "Reconstruct again" : "Reconstruct", () => run([record.file], `{work}/paths/${record.name}.nc`)),
      files.length ? button("All records as one programme", () => run(project.records.map((one) => one.file), "{work}/paths")) : ""));
}
async function check() {
  const own = view, node = view.parts.faults, name = view.record.name;
  node.replaceChildren(element("p", { class: "quiet" }, "checking ..."));
  const found = await attempt(() => get("/api/check", { name }), node);
  if (found && own === view && view.record.name === name) { view.findings = found; faults(); }
}
export function faults() {
  const node = view.parts.faults;
  if (!view.findings) {
    node.replaceChildren(button("Check the record", check));
    return;
  }
  node.replaceChildren(element("p", {}, view.findings.verdict), ...view.findings.findings.map((one) => element("div", { class: `finding ${one.severity}` },
    element("p", {}, element("b", {}, one.severity), ` ${one.text}`),
    one.remedy && element("p", { class: "quiet" }, `Remedy: ${one.remedy}`),
    element("div", { class: "row" },
      one.start != null && button("Show", () => { show(one.channels); zoom([one.start - 2, (one.stop ?? one.start) + 2]); }),
      one.channels.length && one.start == null && button("Show channel", () => show(one.channels)),
      remedy(one)))));
}
function show(channels) {
  for (const one of view.record.channels) if (channels.includes(one.channel)) view.chosen.add(place(one));
  channelList();
  attempt(draw);
}
function remedy(one) {   // lines of the name map are put in the place of those that stand there; then the record is another one
  if (!one.entries.length || !view.project.names) return null;
  return button(`Write ${one.entries.map(({ key: line }) => line).join(", ")} into the name map`, () => change(async () => {
    for (const { key: line, value } of one.entries) await act(["set", view.project.names, line, value]);
    await check();
  }));
}
