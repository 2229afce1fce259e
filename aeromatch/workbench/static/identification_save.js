// ---- identification: save a fit, write it into the project ------------------------------------------------------------
import { act, attempt, button, element, labelled, post, redraw } from "./core.js";
import { view } from "./identification_state.js";

export function saving() {
  const node = view.parts.save, { about, answer, origin } = view;
  if (!answer) { node.replaceChildren(element("p", { class: "quiet" }, "No fit.")); return; }
  const from = origin && about.fits[origin[0]], proposed = (from ? `${from.name} ${answer.coefficient}` : answer.coefficient).replace(/[^\w]+/g, "_");
  const name = element("input", { value: view.name ?? proposed, oninput: () => { view.name = name.value; } });
  const error = view.parts.failed || element("div"), given = () => {
    const text = name.value.trim();
    if (!/^[\w\- ]+$/.test(text)) throw new Error("Give a name of letters, digits, spaces, _ and -.");
    return text;
  };
  const models = from && (from.models.some((text) => text.split("=")[0].trim() === answer.coefficient) ? from.models.map((text) => (text.split("=")[0].trim() === answer.coefficient ? answer.model : text)) : [...from.models, answer.model]);
  view.parts.failed = error;
  redraw(node, String(origin), labelled("Name", name), error,
    element("div", { class: "row" },
      button("Save the fit", () => attempt(() => act([...answer.command, "-o", `{work}/fits/${given()}.nc`]), error)),
      button("Add to the project as a new fit", () => attempt(async () => {
        const { entries } = await post("/api/fit/entry", { fit: view.wanted, name: given() });
        for (const text of entries) await act(["set", about.file, "fit.+", text]);
      }, error)),
      from ? button(`Write the model into \u201c${from.name}\u201d`, () => attempt(() => act(["set", about.file, `fit.${origin[0]}.models`, JSON.stringify(models)]), error), { disabled: JSON.stringify(models) === JSON.stringify(from.models) }) : null),
    view.wanted.band || view.wanted.ridge || view.intercepts !== "common" || (view.wanted.weights && view.wanted.weights !== "equal") ? element("p", { class: "quiet" }, "A fit of the project is made in time by equal weights, without ridge, with one constant; the saved fit is the one shown.") : "",
    element("p", { class: "quiet" }, about.saved.length ? `Saved: ${about.saved.map((file) => file.replace("{work}/fits/", "")).join(", ")}` : "None saved yet."));
}
