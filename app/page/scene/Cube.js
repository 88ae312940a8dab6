// The view cube: how the base frame lies, and a view from each side at a click.
import { html } from "htm/preact";

/** @typedef {{name: string, says: string, from: {azimuth: number, elevation: number}}} Side */

/** @type {Side[]} */
export const SIDES = [
  { name: "X", says: "+x", from: { azimuth: 0, elevation: 0 } },
  { name: "−X", says: "−x", from: { azimuth: 180, elevation: 0 } },
  { name: "Y", says: "+y", from: { azimuth: 90, elevation: 0 } },
  { name: "−Y", says: "−y", from: { azimuth: -90, elevation: 0 } },
  { name: "Z", says: "above", from: { azimuth: -90, elevation: 90 } },
  { name: "−Z", says: "below", from: { azimuth: -90, elevation: -90 } },
];

/**
 * Its faces are no stops of the keyboard: the keys X, Y and Z of the picture do the same.
 * @param {{turn: import("@preact/signals").Signal<string>, onSide: (side: Side) => void}} props
 */
export function Cube({ turn, onSide }) {
  return html`<div class="scene-cube" role="group" aria-label="View cube">
    <div class="turned" style=${{ transform: turn.value }}>
      ${SIDES.map((side, i) => html`
        <button type="button" class=${`side${i}`} tabindex="-1" aria-label=${`${side.name}: view from ${side.says}`}
          onClick=${() => onSide(side)}>${side.name}</button>`)}
    </div>
  </div>`;
}
