// A step of a calibration: the message on top, the scene in the centre, the inspector of one screen, the drawer below.
import { html } from "htm/preact";

/**
 * @param {{message?: unknown, scene: unknown, inspector: unknown, drawer?: unknown, name: string}} props `name`: of
 *   the step, for what reads the page
 */
export function Workspace({ message = null, scene, inspector, drawer = null, name }) {
  return html`
    <div class=${`workspace${drawer ? " drawered" : ""}`}>
      <div class="top-message">${message}</div>
      <div class="centre">${scene}</div>
      <aside class="inspector" aria-label=${name} tabindex="-1">${inspector}</aside>
      ${drawer && html`<div class="drawer">${drawer}</div>`}
    </div>`;
}
