// What an import came to: how the files were read, and what a fit says of unit, signs and order.
import { html } from "htm/preact";
import { capital, sentence } from "../core/words.js";
import { Message } from "../parts/Message.js";
import { outcome, toResult } from "./carrying.js";
import { mapped, reverse, swap } from "./mapping.js";
import { format } from "./formats.js";

/**
 * What takes a cause back, where this import can.
 * @param {import("./carrying.js").Explanation} found @returns {(() => void) | null}
 */
function remedy(found) {
  if (format.value !== "csv") return null;
  const [first, second] = found.joints;
  if (found.cause === "swapped_joints") return () => swap(first, second);
  if (found.cause === "sign") return () => reverse(first, !mapped.value.reversed.includes(first));
  return null;
}

export function Outcome() {
  const came = outcome.value;
  if (came === null) return null;
  const { written, understood, fit } = came;
  return html`
    <section class="outcome" aria-label="What the import came to">
      <p role="status">${written ? `Written to ${written}.` : "Tried: nothing was written."}</p>
      ${fit && html`
        <h3>Unit, signs and order, tested by a fit</h3>
        <p class="muted">A fit tries what is often wrong with a recording. An error that changes no residual stays
          unseen, such as the sign of a joint that did not move: no finding is no proof.</p>
        ${fit.message ? html`<${Message} verdict=${fit.verdict} message=${fit.message} />`
          : html`<p class=${`verdict ${fit.verdict}`}>${sentence(fit.headline)}</p>`}
        <ul class="proposals diagnosis">${fit.diagnosis.map((found) => {
          const take = remedy(found);
          return html`
            <li class=${take ? "proposed" : ""}><span>${capital(found.sentence ?? "")}.</span>
              ${take && html`
                <button type="button"
                  onClick=${() => { take(); outcome.value = null; }}>Take it, then import again</button>`}</li>`;
        })}</ul>`}
      ${written && html`
        <p class="bar">
          <button type="button" class=${fit ? "" : "main"} onClick=${() => toResult()}>To the result</button></p>`}
      <h3>How the files were read</h3>
      <ul class="understood">${understood.map((line) => html`<li>${line}</li>`)}</ul>
    </section>`;
}
