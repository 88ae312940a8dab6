// The measurements of a result: each can be left out of a new fit; what chosen draws do to their residuals.
import { html } from "htm/preact";
import { fixed } from "../core/words.js";
import { Check } from "../parts/Controls.js";
import { brushed, leaveOut, leaveOutThese, out, showShift, single } from "./state.js";
import { Table } from "../parts/Table.js";

const CLEAR = 0.05; // a change of a normalised residual that is shown in colour
/** @typedef {import("../parts/Table.js").Head} Head */
/** @type {Head[]} */
const HEADS = ["leave out", ["no.", "right"], "target", ["normalised residual", "right"],
  ["leave-one-out, mm", "right"],
  ["Cook’s distance", "right"]];
/** @type {Head[]} */
const DRAWN = [["all draws", "right"], ["chosen draws", "right"], ["change", "right"]];
const number = (/** @type {number | null} */ value, /** @type {number} */ digits) =>
  (value === null ? "—" : fixed(value, digits));

/** @param {{found: import("./state.js").Found}} props */
export function Measurements({ found }) {
  const refits = found.run !== null, chosen = new Map(brushed.value?.shots.map((shot) => [shot.shot, shot]));
  const brushes = chosen.size > 0;
  const some = found.shots.length < found.inputs.shots
    ? `The ${found.shots.length} of ${found.inputs.shots} measurements with the largest residuals. ` : "";
  return html`
    <div class="measurements">
      <div class="bar"><h2>Measurements</h2>
        <button type="button" disabled=${!out.value.length} onClick=${() => leaveOutThese([])}>Leave none out</button>
        <span class="muted">
          ${some}Numbers as in the run file and the report. A measurement that is left out is left out of a new fit at
          once; “Shift” shows the arrow of one alone in the posterior.</span>
      </div>
      <${Table} name="Measurements" heads=${[...HEADS, ...(brushes ? DRAWN : []), ""]}>
        <tbody>${found.shots.map((shot) => {
          const isOut = out.value.includes(shot.shot), draws = chosen.get(shot.shot);
          const change = draws ? draws.chosen - draws.all : 0;
          return html`
            <tr key=${shot.shot} class=${isOut ? "out" : ""} data-shot=${shot.shot}>
              <td><${Check} name=${`Leave out measurement ${shot.shot}`} disabled=${!refits} on=${isOut}
                onTurn=${(/** @type {boolean} */ on) => leaveOut(shot.shot, on)} /></td>
              <th scope="row" class="right">${shot.shot}</th><td>${shot.target}</td>
              <td class="right">${number(shot.whitened, 2)}</td><td class="right">${number(shot.leave_one_out, 3)}</td>
              <td class="right">${number(shot.cooks, 2)}</td>
              ${brushes && html`
                <td class="right">${draws ? fixed(draws.all, 2) : ""}</td>
                <td class="right">${draws ? fixed(draws.chosen, 2) : ""}</td>
                <td
                  class=${`right change${change > CLEAR ? " more" : change < -CLEAR ? " less" : ""}`}>
                  ${draws ? `${change > 0 ? "+" : ""}${fixed(change, 2)}` : ""}</td>`}
              <td><button type="button" aria-pressed=${single.value === shot.shot}
                aria-label=${`Show the shift by measurement ${shot.shot}`} disabled=${!refits}
                onClick=${() => showShift(single.value === shot.shot ? null : shot.shot)}>Shift</button></td>
            </tr>`;
        })}</tbody><//>
    </div>`;
}
