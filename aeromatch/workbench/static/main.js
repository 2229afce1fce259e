// ---- the pages of the workbench --------------------------------------------------------------------------------------
import { $, attempt, button, clearKeys, element, get, key, showKeys, showLog, watch } from "./core.js";
import * as database from "./database.js";
import * as identification from "./identification.js";
import * as match from "./match.js";
import * as newProject from "./new_project.js";
import * as records from "./records.js";
import { foldSides } from "./sides.js";

const PAGES = [["new", "New project", newProject], ["records", "Records", records], ["identification", "Identification", identification], ["database", "Database", database], ["match", "Match", match]];
let current = null;

function open(name) {
  const found = PAGES.find(([own]) => own === name) || PAGES.find(([own]) => own === "records");
  if (current && current.close) current.close();
  clearKeys();
  current = found[2];
  for (const tab of document.querySelectorAll("[role=tab]")) {
    const own = tab.dataset.name === found[0];
    tab.setAttribute("aria-selected", own);
    tab.tabIndex = own ? 0 : -1;
  }
  sessionStorage.setItem("page", found[0]);
  const host = element("section", { role: "tabpanel", "aria-label": found[1] });
  $("#page").replaceChildren(host);
  attempt(() => current.open(host));
  foldSides(host, found[0]);
}

const tabs = $("#tabs");
tabs.append(...PAGES.map(([name, text]) => { const tab = button(text, () => open(name), { role: "tab" }); tab.dataset.name = name; return tab; }));
tabs.addEventListener("keydown", (event) => {
  const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
  if (!step) return;
  const all = [...tabs.children], next = all[(all.indexOf(document.activeElement) + step + all.length) % all.length];
  next.focus();
  next.click();
});
$("#show-keys").onclick = showKeys;
$("#show-log").onclick = (event) => {
  const log = $("#log");
  log.hidden = !log.hidden;
  event.target.setAttribute("aria-expanded", !log.hidden);
  if (!log.hidden) attempt(showLog);
};
document.addEventListener("changed", () => { if (!$("#log").hidden) attempt(showLog); });
key("?", "these keys", showKeys);
watch();
document.addEventListener("open-page", (event) => open(event.detail));
async function showTitle() {   // of the project, or the name of its folder while its files are incomplete
  const { title, ready } = await get("/api/title");
  $("#title").textContent = title;
  $("#title").title = title;
  document.title = `${title}: aeromatch workbench`;
  return ready;
}
document.addEventListener("changed", () => attempt(showTitle));
attempt(async () => {
  const ready = await showTitle();
  if (!current) open(ready ? sessionStorage.getItem("page") || "records" : "new");   // unless a tab has been clicked meanwhile
});
