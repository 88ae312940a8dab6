// What /api/check says of a plan: verdict, uncertainties, null-space directions. What is not determined has no number.
import { by, fill, fixed, make, named, sentence, SHAPES, spread, WORDS } from "/page/parts/dom.js";

const MOST_TERMS = 6;

function verdict(tone, word, text) {
  const box = by("plan-verdict");
  const said = `${word}. ${text}`;
  if (box.dataset.said === said) return;
  box.dataset.said = said;
  box.className = `verdict ${tone}${box.classList.contains("pending") ? " pending" : ""}`;
  fill(box, [make("p", {}, make("span", { class: "word" }, `${word}.`), ` ${text}`)]);
}

function row(own, worth) {
  const known = own.std !== null && own.status !== "unidentifiable" && !own.held;
  const u = own.held ? "held" : known ? spread(own.std, own.unit) : "not determined";
  const alone = own.held ? "—" : own.data_std === null ? "infinite" : spread(own.data_std, own.unit);
  return make("tr", { class: own.status, "data-of": own.name, title: own.reason ? sentence(own.reason) : null },
    make("th", { scope: "row" }, named(own.name)),
    make("td", { class: "right u" }, u),
    make("td", { class: "right" }, worth[own.name] ?? ""),
    make("td", { class: "right" }, own.status === "unidentifiable" ? "—" : alone),
    make("td", { class: "right" }, spread(own.prior_std, own.unit)),
    make("td", { class: "status" }, `${SHAPES[own.status] || ""} ${own.status}`));
}

// The same beside the picture, where it is seen while a joint is dragged.
function glance(parameters) {
  fill(by("glance"), parameters.filter((p) => p.group === "offset" && !p.held).map((own) => make("span", { class: own.status },
    `${SHAPES[own.status] || ""} ${own.name.replace("delta", "J")} ${own.std !== null && own.status !== "unidentifiable" ? spread(own.std, own.unit) : "not determined"}`)));
}

function combination(weights) {
  const terms = Object.entries(weights).sort((a, b) => Math.abs(b[1]) - Math.abs(a[1]));
  const said = terms.slice(0, MOST_TERMS).map(([name, weight], i) => {
    const sign = weight < 0 ? "− " : i ? "+ " : "";
    return sign + (Math.abs(weight) === 1 ? "" : `${Number(Math.abs(weight).toPrecision(2))}\u00a0`) + named(name);
  });
  return said.join(" ") + (terms.length > MOST_TERMS ? ` and ${terms.length - MOST_TERMS} smaller` : "");
}

function kind(direction) {
  if (direction.kind === "exact") return "exact null-space direction: no number of such measurements determines it";
  if (direction.kind === "optima") return "not decided: the way from the best local optimum to another that explains the data as well";
  if (direction.data_std === null || direction.data_std >= 1) return "not resolvable at this noise level: the data say less than the prior";
  return `weakly observable: its uncertainty is ${Number(direction.data_std.toPrecision(2))} of the prior`;
}

// Shows an answer; `move(index)` is asked for when a direction is to be shown as a motion.
export function showAnswer(answer, move, moving) {
  verdict(answer.verdict === "violated" ? "misfit" : answer.verdict, WORDS[answer.verdict], named(answer.headline));
  const { worth, lines, advice, over_target } = answer.said;
  const tolerated = new Set(answer.said.tolerated);
  by("plan-worth").textContent = worth.head;
  fill(by("plan-table").tBodies[0], answer.parameters.filter((p) => !tolerated.has(p.name)).map((own) => row(own, worth.of)));
  fill(by("plan-lines"), [...lines, advice, over_target].filter(Boolean).map((line) => make("li", {}, line)));
  by("plan-table").classList.remove("outdated");
  glance(answer.parameters);
  fill(by("plan-notes"), [...answer.notes, ...(answer.warnings || [])].map((note) => make("li", {}, sentence(note))));
  const shown = answer.identifiability.null_space.map((direction, i) => [direction, i])
    .filter(([d]) => !Object.keys(d.combination).every((name) => tolerated.has(name)));
  const focus = document.activeElement && document.activeElement.dataset.direction;
  fill(by("plan-directions"), !shown.length ? [] : [make("h3", {}, "What cannot be determined"), ...shown.map(([direction, i]) => {
    const motion = answer.null_motion && answer.null_motion[i];
    const moves = motion && motion.joints_deg.some((v) => v !== 0);
    return make("div", { class: "item" },
      make("p", { class: "combination" }, combination(direction.combination)),
      make("p", { class: "muted" }, kind(direction)),
      make("p", {}, `Why: ${named(direction.reason)}.`),
      make("p", {}, `To do: ${named(direction.remedy)}.`),
      moves ? make("button", { type: "button", "data-direction": i, "aria-pressed": String(moving === i), onclick: () => move(i) }, "Move the arm along it") : "");
  })]);
  if (focus !== undefined) by("plan-directions").querySelector(`[data-direction="${focus}"]`)?.focus();
}

// What was shown no longer holds: no number stays beside a plan that it was not computed for.
export function showRefusal(text) {
  verdict("misfit", "Not checked", text);
  fill(by("glance"), []);
  for (const cell of by("plan-table").querySelectorAll("tbody td")) cell.textContent = "—";
  by("plan-table").classList.add("outdated");
  for (const id of ["plan-directions", "plan-notes", "plan-lines"]) fill(by(id), []);
}

export const offBy = (posture) => (!posture.hit ? "the target cannot be hit" : posture.off_mm < 0.05 ? "on the target" : `${fixed(posture.off_mm, 1)} mm beside the target before aiming`);
