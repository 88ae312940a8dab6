// What a result says: verdict, what to do, offsets, files. Values to enter are those that the result offers, and no others.
import { by, fill, fixed, make, named, sentence, SHAPES, spread, withUnit, WORDS } from "/page/parts/dom.js";
import { showMessage } from "/page/parts/message.js";

const MISSING = "not determined";

// To the digit of the second one of its uncertainty.
const estimated = (row, k) => (row.estimate === null ? MISSING : row.held ? `held at ${withUnit(String(row.estimate), row.unit)}` : rounded(row.estimate, k * row.std, row.unit));
const expanded = (row, k) => (row.std === null || row.status === "unvalidated" ? "—" : spread(k * row.std, row.unit));
export const marked = (status) => `${SHAPES[status] || ""} ${status}`;

export function rounded(value, std, unit) {
  const digits = Math.max(0, Math.min(12, 1 - Math.floor(Math.log10(Math.abs(std) || 1))));
  return withUnit(fixed(value, digits), unit);
}

// Of a new fit, and of a result of an earlier version, which has no message.
function showHeadline(box, found, sentences) {
  box.className = `verdict ${found.verdict}`;
  fill(box, [
    make("p", {}, make("span", { class: "word" }, `${WORDS[found.verdict]}.`), ` ${named(found.headline)}`),
    ...(sentences.length ? [make("ul", {}, ...sentences.map((one) => make("li", {}, sentence(one))))] : []),
  ]);
}

export function showAnswer(found) {
  const { inputs } = found;
  const origin = [
    `${inputs.run}: ${inputs.shots} measurements of ${inputs.targets.length === 1 ? inputs.targets[0] : `${inputs.targets.length} targets`}, ${inputs.robot}`,
    inputs.serial && `serial number ${inputs.serial}`, inputs.when, inputs.who && `by ${inputs.who}`, inputs.instrument,
    inputs.version && `made by zerobeam ${inputs.version}`,
  ];
  by("result-about").textContent = `${origin.filter(Boolean).join("; ")}.`;
  if (found.message) showMessage(by("result-verdict"), found.verdict, found.message);
  else showHeadline(by("result-verdict"), found, found.notes);
  fill(by("result-why"), [...found.misfit, ...found.diagnosis].map((one) => make("li", {}, sentence(one))));
  fill(by("result-steps"), steps(found));
  offsets(found.parameters, found.coverage_factor);
  downloads(found);
}

function steps({ next_steps: next, message }) {
  if (next === null) return [make("p", {}, "This result is of an earlier version, which does not say it here. Make the report of the run again; until then enter nothing.")];
  const said = [];
  if (next.enter.length) {
    said.push(make("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": "Values to enter" }, make("table", { id: "result-enter" },
      make("caption", {}, "Values to enter: corrected reading = recorded position + value"),
      make("thead", {}, make("tr", {}, make("th", { scope: "col" }, "joint"), make("th", { scope: "col", class: "right" }, "to enter"), make("th", { scope: "col", class: "right" }, "U"), make("th", { scope: "col", class: "right" }, "offset of the arm"))),
      make("tbody", {}, ...next.enter.map((own) => make("tr", {}, make("th", { scope: "row" }, named(own.name)), make("td", { class: "right copy" }, own.value), make("td", { class: "right" }, own.expanded_u), make("td", { class: "right" }, own.estimate ?? "")))))));
  }
  for (const step of next.steps.slice(message ? 1 : 0)) {
    said.push(make("p", {}, named(step.text)));
    if (step.commands.length) said.push(make("pre", { class: "commands", tabindex: 0, "aria-label": "Commands" }, make("code", {}, step.commands.join("\n"))));
  }
  return said;
}

function offsets(rows, k) {
  by("result-table").removeAttribute("data-refit");
  fill(by("result-table").tBodies[0], rows.map((row) => make("tr", { class: row.status, title: row.reason ? sentence(row.reason) : null, "data-of": row.name },
    make("th", { scope: "row" }, named(row.name)),
    make("td", { class: "right u" }, estimated(row, k)),
    make("td", { class: "right" }, expanded(row, k)),
    make("td", { class: "status" }, marked(row.status)),
    make("td", { class: "right refit u" }), make("td", { class: "right refit" }), make("td", { class: "refit status" }))));
}

// The offsets without some measurements beside those of all; null takes them away.
export function showRefit(found) {
  const table = by("result-table"), box = by("result-refit");
  table.toggleAttribute("data-refit", found !== null);
  box.hidden = found === null;
  if (found === null) { by("result-without").textContent = ""; return; }
  const rows = new Map(found.parameters.map((row) => [row.name, row]));
  for (const line of table.tBodies[0].rows) {
    const own = rows.get(line.dataset.of), [value, u, status] = line.querySelectorAll(".refit");
    value.textContent = own ? estimated(own, found.coverage_factor) : "—";
    u.textContent = own ? `${expanded(own, found.coverage_factor)}${ratio(own)}` : "—";
    status.textContent = own ? marked(own.status) : "—";
    status.className = `refit status ${own ? own.status : ""}`;
  }
  const lost = found.lost.length ? ` Without them no longer determined: ${found.lost.map(named).join(", ")}.` : "";
  by("result-without").textContent = `Fitted again without measurement${found.without.length === 1 ? "" : "s"} ${found.without.join(", ")}: ${found.measurements} of ${found.of} are left.${lost}`;
  const verdict = make("div", {});
  showHeadline(verdict, found, found.misfit);
  fill(box, [
    make("h3", {}, "Without the measurements that are left out"), verdict,
    ...found.null_space.map((one) => make("p", {}, `Why: ${sentence(one.reason)} To do: ${sentence(one.remedy)}`)),
  ]);
}

const ratio = (row) => (row.std === null || row.before.std === null ? "" : ` (${fixed(row.std / row.before.std, 2)}\u00a0×)`);

const size = (bytes) => (bytes < 1000 ? `${bytes} bytes` : bytes < 1e6 ? `${fixed(bytes / 1000, 0)} kB` : `${fixed(bytes / 1e6, 1)} MB`);

function downloads(found) {
  const at = (path) => `/api/file?file=${encodeURIComponent(path)}`;
  fill(by("result-downloads"), [
    make("li", {}, make("a", { href: `/api/archive?file=${encodeURIComponent(found.file)}`, download: "" }, "Everything in one archive (.zip)")),
    ...found.files.map((own) => make("li", {}, make("a", { href: at(own.path), download: "" }, own.path), ` ${size(own.bytes)}`)),
    ...(found.run ? [make("li", {}, make("a", { href: at(found.run), download: "" }, found.run), " the run itself")] : []),
  ]);
  const frame = by("result-frame");
  frame.hidden = by("result-alone").hidden = found.report === null;
  by("result-report-none").hidden = found.report !== null;
  if (found.report === null) frame.removeAttribute("src");
  else {
    const place = `/report/${found.report.split("/").map(encodeURIComponent).join("/")}`;
    frame.src = place;
    by("result-alone").href = place;
  }
}
