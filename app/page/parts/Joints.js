// Joint positions as the pendant names and orders them: a slider within the limits and a number each.
import { html } from "htm/preact";
import { unitSign } from "../core/words.js";
import { NumberField, heard } from "./Controls.js";

const LARGEST = /** @type {Record<string, number>} */ ({ deg: 1e5, mm: 1e6 }); // as files have it

/**
 * @param {{arm: import("../core/counting.js").CountedArm, values: number[], beyond: boolean[],
 *   onJoint: (joint: number, value: number) => void}} props
 *   `values` as the pendant counts, joint 1 first; joints from 1
 */
export function Joints({ arm, values, beyond, onJoint }) {
  const { names, order } = arm.pendant;
  return html`<div class="joints">${order.map((number) => {
    const i = number - 1, joint = arm.joints[i], value = values[i] ?? 0;
    return html`<div class="joint" key=${i}><b>${names[i]}</b>
      <input type="range" min=${Math.max(joint.lower, -1e4)} max=${Math.min(joint.upper, 1e4)} step="0.1" value=${value}
        aria-label=${`${names[i]}, ${joint.name}`} aria-valuetext=${`${Number(value.toFixed(2))} ${joint.unit}`}
        onInput=${heard((text) => onJoint(number, Number(text)))} />
      <${NumberField} label=${names[i]} hidden unit=${unitSign(joint.unit)} value=${value} digits=${3}
        least=${-LARGEST[joint.unit]} most=${LARGEST[joint.unit]} beyond=${beyond[i]}
        onValue=${(/** @type {number} */ given) => onJoint(number, given)} /></div>`;
  })}</div>`;
}
