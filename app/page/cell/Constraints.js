// What every measurement must keep: part of the plan, judged as it changes. An empty field is not judged.
import { html } from "htm/preact";
import { change } from "../core/editing.js";
import { NumberField } from "../parts/Controls.js";
import { problemAt, state, stated } from "./keys.js";

/**
 * Numbers that are stated together, or none of them.
 * @param {{name: string, labels: string[], unit: string, usual: number[]}} props
 */
function Together({ name, labels, unit, usual }) {
  const at = ["constraints", name], values = /** @type {number[] | null} */ (stated(at) ?? null);
  const set = (/** @type {number} */ i, /** @type {number | null} */ value) => {
    if (value === null
      && name === "facing") change(`constraints/${name}`, (content) => {
        delete content.constraints?.facing;
        delete content.constraints?.acceptance_deg;
      }); // an angle to what is no longer there
    else state(at, value === null ? undefined : (values ?? usual).map((one, k) => (k === i ? value : one)));
  };
  return labels.map((label, i) => html`
    <${NumberField} key=${label} label=${label} unit=${unit} optional value=${values?.[i]}
      error=${i === 0 ? problemAt(at) : ""} onValue=${(/** @type {number | null} */ value) => set(i, value)} />`);
}

export function Constraints() {
  const one = (/** @type {string} */ name, /** @type {string} */ label, /** @type {string} */ usual) => html`
    <${NumberField} label=${label} unit="°" optional least=${0} placeholder=${usual}
      value=${stated(["constraints", name])} error=${problemAt(["constraints", name])}
      onValue=${(/** @type {number | null} */ value) => state(["constraints", name], value)} />`;
  return html`<div class="fields">
    <${Together} name="facing" labels=${["Normal of the target x", "y", "z"]} unit="" usual=${[0, 0, 1]} />
    ${one("acceptance_deg", "Largest angle to it", "60")}
    <${Together} name="beam_mm" labels=${["Shortest beam", "Longest beam"]} unit="mm" usual=${[200, 2000]} />
    ${one("margin_deg", "Margin to joint limits", "none")}
  </div>`;
}
