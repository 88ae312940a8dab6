// What the plan will determine, as its check says it, and how the arm moves along what it leaves open.
import { html } from "htm/preact";
import { answer, pending, wrong } from "../core/editing.js";
import { sentence } from "../core/words.js";
import { motion, moves, play } from "./motion.js";

export function Determined() {
  const found = answer.value;
  if (wrong.value !== null && found === null) {
    return html`<p class="error" role="alert">Not checked: ${wrong.value.text}</p>`;
  }
  if (found === null) return html`<p class="muted" role="status">The plan is being checked.</p>`;
  const { predicted, directions } = found.said;
  return html`
    <div class=${`determined${pending.value ? " pending" : ""}`} aria-busy=${pending.value}>
      <div dangerouslySetInnerHTML=${{ __html: predicted }} />
      <ul class="notes">
        ${[...found.notes ?? [], ...found.warnings].map((note) => html`<li>${sentence(note)}</li>`)}</ul>
      ${directions.some(Boolean) && html`<h2>What cannot be determined</h2>`}
      ${directions.map((one, i) => one && html`
        <div class="direction" key=${i}>
          <p><b>${one.combination}</b> <span class="muted">${one.kind}</span></p>
          <p>Why: ${one.reason}</p>
          <p>To do: ${one.remedy}</p>
          ${moves(i) && html`
            <button type="button" aria-pressed=${motion.value?.direction === i}
              onClick=${() => play(i)}>Move the arm along it</button>`}
        </div>`)}
    </div>`;
}
