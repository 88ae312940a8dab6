// The plan beside another plan, and beside itself without one of its postures.
import { get, latest, post, Refused } from "/page/parts/api.js";
import { by, fill, make, named, options, SHAPES, spread, WORDS } from "/page/parts/dom.js";

const MOST = 30; // postures that the server leaves out in one answer
const offsets = (answer) => answer.parameters.filter((p) => p.group === "offset" && !p.held);
const number = (std, unit) => (std === null ? "not determined" : spread(std, unit));
const ratio = (after, before) => (after === null || before === null ? "" : `× ${Number((after / before).toPrecision(2))}`);
const cell = (status, ...texts) => make("td", { class: `right ${status}` }, `${SHAPES[status] || ""} ${texts.filter(Boolean).join(", ")}`);

let other = null; // the check of the other plan, and its name

export function beginComparing(own) {
  by("beside-with").addEventListener("change", async () => {
    const file = by("beside-with").value;
    other = null;
    try {
      if (file) {
        const { plan } = await get(`/api/plan?file=${encodeURIComponent(file)}`);
        other = { file, answer: await post("/api/check", { plan, file }) };
      }
      by("beside-fault").hidden = true;
    } catch (error) {
      if (!(error instanceof Refused)) throw error;
      by("beside-fault").textContent = error.text;
      by("beside-fault").hidden = false;
    }
    showCompared(own());
  });
}

export const listPlans = (files) => {
  const chosen = by("beside-with").value;
  options(by("beside-with"), [["plans of this folder", files.filter((f) => f.kind === "plan").map((f) => [f.path, f.path])]], "no other plan");
  by("beside-with").value = [...by("beside-with").options].some((o) => o.value === chosen) ? chosen : "";
};

export function showCompared(answer) {
  by("beside-table").hidden = !other || !answer;
  if (!other || !answer) return;
  const [head, body] = [by("beside-table").tHead.rows[0], by("beside-table").tBodies[0]];
  fill(head, ["offset", "this plan", other.file, "from the other to this"].map((name, i) => make("th", { scope: "col", class: i ? "right" : null }, name)));
  const theirs = new Map(offsets(other.answer).map((p) => [p.name, p]));
  const rows = offsets(answer).map((own) => {
    const their = theirs.get(own.name);
    const same = their && their.unit === own.unit;
    return make("tr", {}, make("th", { scope: "row" }, named(own.name)), cell(own.status, number(own.std, own.unit)),
      their ? cell(their.status, number(their.std, their.unit)) : make("td", { class: "right" }, "—"), make("td", { class: "right" }, same ? ratio(own.std, their.std) || (own.status === their.status ? "" : `${their.status} → ${own.status}`) : ""));
  });
  const last = (name, of) => make("tr", {}, make("th", { scope: "row" }, name), ...[answer, other.answer].map((own) => make("td", { class: "right" }, of(own))), make("td"));
  fill(body, [...rows, last("verdict", (own) => WORDS[own.verdict]), last("measurements", (own) => String(own.postures.length))]);
}

// Asked only while it is open, after the check: the number that follows a slider does not wait for it.
export function beginAdding(current) {
  const ask = latest(async () => {
    const { plan, answer, file, chosen } = current();
    if (!by("adds-box").open || !plan || !answer) return null;
    const count = plan.postures_deg.length;
    const postures = count <= MOST ? Array.from({ length: count }, (_, i) => i) : [chosen];
    return { rows: await post("/api/without", { plan, postures, ...(file ? { file } : {}) }), answer };
  }, ({ rows, answer }) => {
    const own = offsets(answer);
    by("adds-note").textContent = rows.length < answer.postures.length ? `Of more than ${MOST} postures only the chosen one is left out.` : "";
    fill(by("adds-table").tHead.rows[0], [make("th", { scope: "col" }, "without"), make("th", { scope: "col" }, "verdict"), ...own.map((p) => make("th", { scope: "col", class: "right" }, named(p.name)))]);
    fill(by("adds-table").tBodies[0], rows.map(({ posture, rest }) => make("tr", {}, make("th", { scope: "row" }, `posture ${posture}`),
      make("td", {}, rest === null ? "it gives no measurement that others replace" : WORDS[rest.verdict]),
      ...own.map((p) => (rest === null ? make("td", { class: "right" }, "—") : cell(rest.status[p.name], number(rest.std[p.name], p.unit), ratio(rest.std[p.name], p.std)))))));
  }, (error) => {
    by("adds-note").textContent = error.text;
    fill(by("adds-table").tBodies[0], []);
  });
  by("adds-box").addEventListener("toggle", ask);
  return ask;
}
