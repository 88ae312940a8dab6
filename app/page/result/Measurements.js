// The measurements of a result: each can be left out of a new fit; what chosen draws do to their residuals.
import { html } from "htm/preact";
import { fixed } from "../core/words.js";
import { brushed, leaveOut, leaveOutThese, out, showShift, single } from "./state.js";

const CLEAR = 0.05; // a change of a normalised residual that is shown in colour
const number = (/** @type {number | null} */ value, /** @type {number} */ digits) => (value === null ? "—" : fixed(value, digits));

/** @param {{found: import("./types.js").Found}} props */
export function Measurements({ found }) {
  const refits = found.run !== null, chosen = new Map(brushed.value?.shots.map((shot) => [shot.shot, shot])), brushes = chosen.size > 0;
  return html`
    <div class="measurements">
      <div class="bar"><h2>Measurements</h2>
        <button type="button" disabled=${!out.value.length} onClick=${() => leaveOutThese([])}>Leave none out</button>
        <span class="muted">${found.shots.length < found.inputs.shots ? `The ${found.shots.length} of ${found.inputs.shots} measurements with the largest residuals. ` : ""}Numbers as in the run file and the report. A measurement that is left out is left out of a new fit at once; “Shift” shows the arrow of one alone in the posterior.</span>
      </div>
      <div class="scroll" tabindex="0" role="region" aria-label="Measurements"><table>
        <thead><tr><th scope="col">leave out</th><th scope="col" class="right">no.</th><th scope="col">target</th><th scope="col" class="right">normalised residual</th><th scope="col" class="right">leave-one-out, mm</th><th scope="col" class="right">Cook’s distance</th>
          ${brushes && html`<th scope="col" class="right">all draws</th><th scope="col" class="right">chosen draws</th><th scope="col" class="right">change</th>`}<td></td></tr></thead>
        <tbody>${found.shots.map((shot) => {
          const isOut = out.value.includes(shot.shot), draws = chosen.get(shot.shot), change = draws ? draws.chosen - draws.all : 0;
          return html`
            <tr key=${shot.shot} class=${isOut ? "out" : ""} data-shot=${shot.shot}>
              <td><label class="check"><input type="checkbox" aria-label=${`Leave out measurement ${shot.shot}`} disabled=${!refits} checked=${isOut} onChange=${(/** @type {any} */ event) => leaveOut(shot.shot, event.target.checked)} /></label></td>
              <th scope="row" class="right">${shot.shot}</th><td>${shot.target}</td><td class="right">${number(shot.whitened, 2)}</td><td class="right">${number(shot.leave_one_out, 3)}</td><td class="right">${number(shot.cooks, 2)}</td>
              ${brushes && html`<td class="right">${draws ? fixed(draws.all, 2) : ""}</td><td class="right">${draws ? fixed(draws.chosen, 2) : ""}</td><td class=${`right change${change > CLEAR ? " more" : change < -CLEAR ? " less" : ""}`}>${draws ? `${change > 0 ? "+" : ""}${fixed(change, 2)}` : ""}</td>`}
              <td><button type="button" aria-pressed=${single.value === shot.shot} aria-label=${`Show the shift by measurement ${shot.shot}`} disabled=${!refits} onClick=${() => showShift(single.value === shot.shot ? null : shot.shot)}>Shift</button></td>
            </tr>`;
        })}</tbody></table></div>
    </div>`;
}
