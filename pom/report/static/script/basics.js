// ---- shorthands, numbers, colours -----------------------------------------------------------------------------------
const $ = (query, root = document) => root.querySelector(query);
const all = (query, root = document) => [...root.querySelectorAll(query)];
const SVG = "http://www.w3.org/2000/svg";
const root = document.documentElement;
const pages = all("main > .page");
const cases = pages.filter((page) => page.classList.contains("case"));
const SYMBOLS = { pass: "\u2713", pass_with_departures: "\u2713*", limits_exceeded: "\u2713!", record_error: "\u2713?", leak: "\u2717=", not_driven: "\u2717~", demonstration: "\u25c7", fail: "\u2717", invalid: "!", not_tested: "\u2013", advisory: "\u25cb" };
const WORDS = { pass: "pass", pass_with_departures: "pass with departures", limits_exceeded: "pass with limits exceeded", record_error: "pass on a record with errors", leak: "LEAK: the record identified the model", not_driven: "NOT DRIVEN by the inputs", demonstration: "shown, no tolerance", fail: "FAIL", invalid: "invalid", not_tested: "not tested", advisory: "advisory" };

const colour = (name) => getComputedStyle(root).getPropertyValue(`--${name}`).trim();
const font = (size) => `${size}px ${colour("sans")}`;
const minus = (text) => text.replace("-", "\u2212");
function fixed(value, decimals) {
  const text = value.toFixed(decimals);
  return minus(Number(text) === 0 ? text.replace("-", "") : text);
}
const rough = (value) => minus(Number(value.toPrecision(3)).toString());
function tickText(splits, increment) {
  const decimals = Math.max(0, -Math.floor(Math.log10(increment) + 1e-9));
  return splits.map((value) => (value == null ? "" : fixed(value, decimals)));
}
function element(tag, attributes = {}, ...children) {
  const node = document.createElement(tag);
  for (const [key, value] of Object.entries(attributes)) {
    if (key === "class") node.className = value; else if (key.startsWith("on")) node[key] = value; else node.setAttribute(key, value);
  }
  node.append(...children);
  return node;
}
function drawing(attributes, ...shapes) {
  const node = document.createElementNS(SVG, "svg");
  node.setAttribute("aria-hidden", "true");
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  for (const [tag, given] of shapes) {
    const shape = document.createElementNS(SVG, tag);
    for (const [key, value] of Object.entries(given)) shape.setAttribute(key, value);
    node.append(shape);
  }
  return node;
}
const sample = (style) => drawing({ class: "sample" }, ["path", { class: `trace ${style}`, d: "M1 4h32" }]);
const verdictWord = (word) => element("span", { class: `verdict is-${word}` }, element("span", { class: "mark", "aria-hidden": "true" }, SYMBOLS[word]), ` ${WORDS[word]}`);
