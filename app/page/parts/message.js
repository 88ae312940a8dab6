// The one message of an answer, as the server words it: what is known, why not more, what to do.
import { fill, make } from "/page/parts/dom.js";

export function showMessage(box, verdict, message, more = []) {
  const { cause, worst, action, cautions } = message;
  box.className = `verdict message ${verdict}`;
  fill(box, [
    make("p", { class: "word" }, message.verdict),
    ...(cause ? [make("p", {}, cause)] : []),
    ...(worst ? [make("p", {}, worst.text)] : []),
    make("p", {}, make("b", {}, "What to do: "), action.text),
    ...(action.command ? [make("pre", { class: "commands", tabindex: 0, "aria-label": "Command" }, make("code", {}, action.command))] : []),
    ...(cautions.length ? [make("ul", { "aria-label": "Cautions" }, ...cautions.map((one) => make("li", {}, one)))] : []),
    ...more,
  ]);
}
