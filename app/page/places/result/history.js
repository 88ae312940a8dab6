// The folder's runs by serial number: a table, and each joint's offset over time with its expanded uncertainty.
import { by, fill, fixed, make, named, SHAPES, spread, WORDS } from "/page/parts/dom.js";
import { rounded } from "/page/places/result/answer.js";

const NONE = "No serial number stated";
const SVG = "http://www.w3.org/2000/svg";
const WIDTH = 300, HEIGHT = 120, EDGE = { left: 50, right: 10, top: 10, bottom: 20 };

export const serialOf = (run) => run.serial || NONE;
const when = (run) => run.when || "";

export function bySerial(runs) {
  const groups = new Map();
  for (const run of runs) groups.set(serialOf(run), [...(groups.get(serialOf(run)) || []), run]);
  for (const own of groups.values()) own.sort((a, b) => when(a).localeCompare(when(b)) || a.file.localeCompare(b.file));
  return [...groups].sort(([a], [b]) => (a === NONE) - (b === NONE) || a.localeCompare(b));
}

// `open` is called with a file.
export function showHistory(found, open) {
  const parts = bySerial(found.runs).map(([serial, runs]) => make("div", {},
    make("h4", {}, serial === NONE ? NONE : `Serial number ${serial}`),
    table(runs.map((run) => [run, run.results[0]]), open),
    ...trends(runs)));
  if (found.results.length) parts.push(make("div", {}, make("h4", {}, "Results whose run is not in this folder"), table(found.results.map((own) => [null, own]), open)));
  if (found.left_out) parts.push(make("p", { class: "muted" }, `${found.left_out} older files are not listed.`));
  if (!parts.length) parts.push(make("p", { class: "muted" }, "This folder has no runs yet."));
  fill(by("history"), parts);
}

function table(rows, open) {
  const heads = ["run", "date", "operator", "instrument", "verdict", "offsets, ± U (k = 2)"];
  return make("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": "Runs" }, make("table", { class: "wide" },
    make("thead", {}, make("tr", {}, ...heads.map((head) => make("th", { scope: "col" }, head)))),
    make("tbody", {}, ...rows.map(([run, result]) => make("tr", {},
      make("th", { scope: "row" }, make("button", { type: "button", onclick: () => open(result && !result.error ? result.file : run ? run.file : result.file) }, run ? run.file : result.file)),
      make("td", { class: "date", "data-of": "date" }, run ? when(run) : ""), make("td", { "data-of": "operator" }, run ? run.who || "" : ""), make("td", { "data-of": "instrument" }, run ? run.instrument || "" : ""),
      verdictCell(run, result),
      make("td", { class: "long", "data-of": "offsets ± U (k = 2)" }, result && result.offsets ? offsets(result) : ""))))));
}

function verdictCell(run, result) {
  const error = (run && run.error) || (result && result.error);
  if (error) return make("td", { class: "words misfit", "data-of": "error" }, error);
  if (!result) return make("td", { class: "muted", "data-of": "verdict" }, "no report");
  return make("td", { class: `words ${result.verdict}`, "data-of": "verdict" }, WORDS[result.verdict]);
}

// Numbers that the measurements support: none of a misfit.
function offsets(result) {
  const said = result.offsets.map((own) => {
    const name = named(own.name).split(" ")[0];
    if (own.status === "unvalidated") return `${name} unvalidated`;
    if (own.estimate === null) return `${name} not determined`;
    return `${name} ${rounded(own.estimate, 2 * own.std, own.unit)} ± ${spread(2 * own.std, own.unit)}${own.status === "weak" ? ` ${SHAPES.weak}\u00a0weak` : ""}`;
  });
  return said.join(", ");
}

function draw(tag, attributes) {
  const element = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  return element;
}

// Of each joint of one robot that two results or more determine; a misfit has no number here.
function trends(runs) {
  if (serialOf(runs[0]) === NONE || new Set(runs.map((run) => run.robot)).size > 1) return [];
  const points = new Map();
  for (const run of runs) {
    for (const own of run.results[0]?.offsets || []) {
      if (own.estimate === null || !["identified", "weak"].includes(own.status)) continue;
      points.set(own.name, [...(points.get(own.name) || []), { ...own, run }]);
    }
  }
  const drawn = [...points].filter(([, own]) => own.length > 1).map(([name, own]) => trend(name, own));
  return drawn.length ? [make("div", { class: "trends" }, ...drawn)] : [];
}

function trend(name, own) {
  const times = own.map(({ run }) => Date.parse(run.when)), timed = times.every(Number.isFinite) && new Set(times).size === times.length;
  const at = timed ? times : own.map((_, i) => i);
  const low = Math.min(...own.map((p) => p.estimate - 2 * p.std)), high = Math.max(...own.map((p) => p.estimate + 2 * p.std));
  const x = (v) => EDGE.left + 8 + ((v - at[0]) / (at.at(-1) - at[0] || 1)) * (WIDTH - EDGE.left - EDGE.right - 16);
  const y = (v) => EDGE.top + ((high - v) / (high - low || 1)) * (HEIGHT - EDGE.top - EDGE.bottom);
  const said = own.map((p) => `${p.run.when || p.run.file}: ${rounded(p.estimate, 2 * p.std, p.unit)} ± ${spread(2 * p.std, p.unit)}`).join("; ");
  const picture = draw("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": `${named(name)}: ${said}` });
  const upper = own.map((p, i) => `${x(at[i])},${y(p.estimate + 2 * p.std)}`), lower = own.map((p, i) => `${x(at[i])},${y(p.estimate - 2 * p.std)}`).reverse();
  picture.append(draw("polygon", { class: "band", points: [...upper, ...lower].join(" ") }), draw("polyline", { class: "path", points: own.map((p, i) => `${x(at[i])},${y(p.estimate)}`).join(" ") }));
  own.forEach((p, i) => picture.append(
    draw("line", { class: "whisker", x1: x(at[i]), x2: x(at[i]), y1: y(p.estimate - 2 * p.std), y2: y(p.estimate + 2 * p.std) }),
    draw("circle", { class: "point", cx: x(at[i]), cy: y(p.estimate), r: 3 })));
  const digits = Math.max(0, Math.min(6, 1 - Math.floor(Math.log10(high - low || 1))));
  for (const v of [low, high]) { const text = draw("text", { x: EDGE.left - 4, y: y(v) + 4, "text-anchor": "end" }); text.textContent = fixed(v, digits); picture.append(text); }
  const ends = [[0, "start"], [own.length - 1, "end"]];
  for (const [i, anchor] of ends) { const text = draw("text", { x: i ? WIDTH - EDGE.right : EDGE.left, y: HEIGHT - 4, "text-anchor": anchor }); text.textContent = timed ? own[i].run.when.slice(0, 10) : `run ${i + 1}`; picture.append(text); }
  picture.append(draw("line", { class: "axis", x1: EDGE.left, x2: EDGE.left, y1: EDGE.top, y2: HEIGHT - EDGE.bottom }));
  return make("figure", {}, picture, make("figcaption", {}, `${named(name)} in ${own[0].unit === "deg" ? "degrees" : own[0].unit}, with U (k = 2)`));
}
