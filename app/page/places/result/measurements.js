// The measurements of a result: what leaving some out does to the answer, and what chosen draws do to their residuals.
import { latest, post } from "/page/parts/api.js";
import { by, fill, fixed, make, named, say } from "/page/parts/dom.js";
import { showRefit } from "/page/places/result/answer.js";
import { clearRanges, showShift } from "/page/places/result/pairs.js";

const CLEAR = 0.05; // a change of a normalised residual that is shown in colour
let found = null, out = new Set(), single = null, ranges = {};

const number = (value, digits) => (value === null ? "—" : fixed(value, digits));

export function showMeasurements(result) {
  found = result;
  out = new Set();
  single = null;
  ranges = {};
  const refits = result.run !== null;
  fill(by("result-measurements").tBodies[0], result.shots.map((shot) => {
    const box = make("input", { type: "checkbox", "aria-label": `Leave out measurement ${shot.shot}`, disabled: !refits });
    box.addEventListener("change", () => { if (box.checked) out.add(shot.shot); else out.delete(shot.shot); single = null; asked(); });
    const shift = make("button", { type: "button", "aria-pressed": "false", "aria-label": `Show the shift by measurement ${shot.shot}`, disabled: !refits, onclick: () => { single = single === shot.shot ? null : shot.shot; asked(); } }, "Shift");
    return make("tr", { "data-shot": shot.shot },
      make("td", {}, make("label", {}, box)), make("th", { scope: "row", class: "right" }, String(shot.shot)), make("td", { class: "aside" }, shot.target),
      make("td", { class: "right" }, number(shot.whitened, 2)), make("td", { class: "right" }, number(shot.leave_one_out, 3)), make("td", { class: "right" }, number(shot.cooks, 2)),
      make("td", { class: "right brushed" }), make("td", { class: "right brushed" }), make("td", { class: "right brushed" }),
      make("td", {}, shift));
  }));
  by("result-more").textContent = result.shots.length < result.inputs.shots ? `The ${result.shots.length} of ${result.inputs.shots} measurements with the largest residuals.` : "";
  by("result-without").textContent = refits ? "" : "The run of this result is not in the folder: nothing can be left out.";
  by("result-chosen").textContent = "";
  render();
  if (refits) warm();
}

// The first fit takes longest: it is made before anybody waits for it.
function warm() {
  const own = found;
  post("/api/refit", { run: own.run }).catch((error) => { if (own === found) by("result-without").textContent = error.text; });
}

function render() {
  for (const row of by("result-measurements").tBodies[0].rows) {
    const shot = Number(row.dataset.shot);
    row.toggleAttribute("data-out", out.has(shot));
    row.querySelector("input").checked = out.has(shot);
    row.querySelector("button").setAttribute("aria-pressed", String(single === shot));
  }
  by("result-all").disabled = !out.size;
}

function asked() {
  render();
  if (!out.size && single === null) { showRefit(null); showShift(null); return; }
  refit();
}

const refit = latest(
  async () => {
    const own = found, without = [...out];
    if (!own || !own.run || (!without.length && single === null)) return null;
    const alone = single === null ? null : await post("/api/refit", { run: own.run, without: [single] });
    const whole = without.length ? await post("/api/refit", { run: own.run, without }) : null;
    return own === found ? { whole, alone } : null;
  },
  ({ whole, alone }) => {
    if (!out.size && single === null) return;
    showRefit(whole);
    showShift((alone || whole).parameters);
    const shown = alone || whole;
    if (!whole && alone) by("result-without").textContent = `Arrow: the estimates without measurement ${single}.${alone.lost.length ? ` Without it no longer determined: ${alone.lost.map(named).join(", ")}.` : ""}`;
    say(`Without measurement ${shown.without.join(", ")}: ${shown.verdict}${shown.lost.length ? `, no longer determined: ${shown.lost.map(named).join(", ")}` : ""}`);
  },
  (error) => { showRefit(null); showShift(null); by("result-without").textContent = error.text; },
);

// Called with the chosen ranges of parameters, {} for none.
export function brushed(chosen) {
  ranges = chosen;
  if (!Object.keys(ranges).length) { plain(); return; }
  if (!found.run) { by("result-chosen").textContent = "The run of this result is not in the folder: its residuals cannot be computed."; return; }
  brush();
}

function plain() {
  by("result-chosen").textContent = "";
  for (const cell of by("result-measurements").querySelectorAll(".brushed")) { cell.textContent = ""; cell.classList.remove("more", "less"); }
}

const brush = latest(
  () => (found && Object.keys(ranges).length ? post("/api/brush", { posterior: found.posterior_file, run: found.run, ranges }) : null),
  (answer) => {
    if (!Object.keys(ranges).length) return;
    by("result-chosen").textContent = `${answer.chosen} of ${answer.draws} draws are chosen.${answer.reason ? ` No residuals: ${named(answer.reason)}.` : " Normalised residuals below: mean length over all draws and over the chosen ones."}`;
    const rows = new Map(answer.shots.map((shot) => [shot.shot, shot]));
    for (const row of by("result-measurements").tBodies[0].rows) {
      const own = rows.get(Number(row.dataset.shot)), [all, part, change] = row.querySelectorAll(".brushed");
      const by_ = own ? own.chosen - own.all : 0;
      all.textContent = own ? fixed(own.all, 2) : "";
      part.textContent = own ? fixed(own.chosen, 2) : "";
      change.textContent = own ? `${by_ > 0 ? "+" : ""}${fixed(by_, 2)}` : "";
      change.classList.toggle("more", by_ > CLEAR);
      change.classList.toggle("less", by_ < -CLEAR);
    }
  },
  (error) => { by("result-chosen").textContent = error.text; },
);

export function beginMeasurements() {
  by("result-all").addEventListener("click", () => { out.clear(); single = null; asked(); });
  by("result-clear").addEventListener("click", clearRanges);
}
