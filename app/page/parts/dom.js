// Elements and texts. Whatever is shown goes through textContent or an attribute, so that a name stays a name.

export const by = (id) => document.getElementById(id);

export function make(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (value === true) element.setAttribute(name, "");
    else if (value !== false && value !== null && value !== undefined) element.setAttribute(name, value);
  }
  element.append(...children);
  return element;
}

// A list of rows that is only made anew where its texts change: focus and scroll position stay.
export function fill(parent, rows) {
  parent.replaceChildren(...rows);
}

// A text that is already there is left alone: a long list is only laid out anew where it changes.
export function write(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

// Names as people read them: delta2 is J2 (δ2), link2.alpha is link 2, α.
const GREEK = { alpha: "α", beta: "β", theta: "θ", cos: "cos q", sin: "sin q" };
export const named = (text) => text.replace(/\bdelta(\d+)\b/g, "J$1 (δ$1)")
  .replace(/\b(link|joint)(\d+)\.(alpha|beta|theta|gravity|cos|sin|[abd])\b/g,
    (_, body, number, axis) => `${body === "link" ? "link " : "J"}${number}, ${GREEK[axis] || axis}`);

export const sentence = (text) => { const said = named(text); return said.charAt(0).toUpperCase() + said.slice(1) + (/[.?!]$/.test(said) ? "" : "."); };

// Verdicts and the shapes of statuses, as in the reports.
export const WORDS = { pass: "Pass", weak: "Weak", degenerate: "Degenerate", misfit: "Misfit", violated: "Constraints violated" };
export const SHAPES = { identified: "●", weak: "◆", unidentifiable: "✕", held: "■", unvalidated: "▲" };

const tidy = (text) => text.replace("-", "−");

// A standard uncertainty to two significant digits.
export function spread(value, unit) {
  const digits = Math.max(0, Math.min(12, 1 - Math.floor(Math.log10(Math.abs(value) || 1))));
  return withUnit(value.toFixed(digits), unit);
}

export function withUnit(text, unit) {
  const shown = unit === "deg" ? "°" : unit === "1" || !unit ? "" : `\u00a0${unit}`;
  return tidy(text) + shown;
}

export const fixed = (value, digits) => tidy((Object.is(value, -0) ? 0 : value).toFixed(digits).replace(/^-(0(\.0+)?)$/, "$1"));

export function options(select, groups, first) {
  const made = first === undefined ? [] : [make("option", { value: "" }, first)];
  for (const [label, items] of groups) {
    if (!items.length) continue;
    const group = make("optgroup", { label });
    for (const [value, text] of items) group.append(make("option", { value }, text));
    made.push(group);
  }
  select.replaceChildren(...made);
}

let saying = 0;
// Said by a screen reader, once the last change is some moments old.
export function say(text) {
  clearTimeout(saying);
  saying = setTimeout(() => { by("live").textContent = text; }, 600);
}
