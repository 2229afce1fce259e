// ---- sides of a page that can be folded away, so that the middle has room from 800 px up --------------------------------
import { element } from "./core.js";

const wide = matchMedia("(min-width: 1000px)"), SIDES = [["left", "nav", "\u00ab"], ["right", "aside", "\u00bb"]];
const KEPT_OPEN = new Set(["records left", "identification left", "database left", "match left"]);   // on a narrow screen: what the page is chosen with
let folds = [];

export function foldSides(host, page) {
  folds = [];
  const columns = host.querySelector(".columns");
  if (!columns) return;
  for (const [side, tag, arrow] of SIDES) {
    const node = columns.querySelector(`:scope > ${tag}.column`);
    if (!node) continue;
    const name = `${page} ${side}`, label = node.getAttribute("aria-label"), fold = element("button", { type: "button", class: "fold", onclick: () => {
      const opens = !isOpen(), other = `${page} ${side === "left" ? "right" : "left"}`;
      sessionStorage.setItem(`side ${name}`, opens ? "open" : "closed");
      if (opens && !wide.matches) sessionStorage.setItem(`side ${other}`, "closed");   // a narrow screen has room for one side
      folds.forEach((one) => one());
    } });
    const isOpen = () => { const chosen = sessionStorage.getItem(`side ${name}`); return chosen ? chosen === "open" : wide.matches || KEPT_OPEN.has(name); };
    const show = () => {
      const open = isOpen();
      columns.classList.toggle(`${side}-closed`, !open);
      node.classList.toggle("closed", !open);
      fold.textContent = open ? arrow : label;
      fold.setAttribute("aria-expanded", open);
      fold.setAttribute("aria-label", `${open ? "Hide" : "Show"} the side: ${label}`);
      fold.title = `${open ? "Hide" : "Show"}: ${label}`;
    };
    node.prepend(fold);
    folds.push(show);
    show();
  }
}
wide.addEventListener("change", () => folds.forEach((show) => show()));
