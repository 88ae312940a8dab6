// Before a robot moves: what is about to happen, in the server's words, and a person's yes or no.
import { html } from "htm/preact";
import { useEffect, useRef } from "preact/hooks";
import { attempt } from "../core/store.js";
import { answer } from "./running.js";

/** @param {{text: string}} props */
export function Confirm({ text }) {
  const no = useRef(/** @type {HTMLButtonElement | null} */ (null));
  useEffect(() => no.current?.focus(), []); // not what moves: who presses Enter by habit moves nothing
  return html`
    <div class="confirm" role="alertdialog" aria-labelledby="confirm-title" aria-describedby="confirm-text">
      <h2 id="confirm-title">The robot is about to move</h2>
      <p id="confirm-text">${text}</p>
      <p>Stop, or Escape, ends the run and stops the motion. It is no emergency stop.</p>
      <p class="bar">
        <button type="button" class="main" onClick=${() => attempt(() => answer("yes"))}>Move the robot</button>
        <button type="button" ref=${no} onClick=${() => attempt(() => answer("no"))}>Do not move</button></p>
    </div>`;
}
