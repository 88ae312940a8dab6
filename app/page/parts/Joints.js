// Joint positions: a slider within the limits and a number each.
import { html } from "htm/preact";
import { unitSign } from "../core/words.js";
import { NumberField } from "./NumberField.js";

/** @param {{joints: {name: string, unit: string, lower: number, upper: number}[], values: number[], names?: string[], onJoint: (joint: number, value: number) => void}} props joints from 1 */
export function Joints({ joints, values, names, onJoint }) {
  return html`<div class="joints">${joints.map((joint, i) => {
    const value = values[i] ?? 0, beyond = value < joint.lower - 1e-9 || value > joint.upper + 1e-9;
    return html`<div class="joint" key=${i}><b>${names?.[i] ?? `J${i + 1}`}</b>
      <input type="range" min=${Math.max(joint.lower, -1e4)} max=${Math.min(joint.upper, 1e4)} step="0.1" value=${value} aria-label=${`J${i + 1}, ${joint.name}`} aria-valuetext=${`${Number(value.toFixed(2))} ${joint.unit}`}
        onInput=${(/** @type {any} */ event) => onJoint(i + 1, Number(event.target.value))} />
      <${NumberField} label=${`J${i + 1}`} hidden unit=${unitSign(joint.unit)} value=${value} digits=${3} beyond=${beyond} onValue=${(/** @type {number} */ given) => onJoint(i + 1, given)} /></div>`;
  })}</div>`;
}
