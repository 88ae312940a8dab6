// The one message of an answer, as the server words it: what is known, why not more, what to do, and the button that
// does it.
import { html } from "htm/preact";
import { useSignal } from "@preact/signals";
import { doAction } from "../core/actions.js";
import { attempt } from "../core/store.js";
import { JobProgress } from "./JobProgress.js";

/** @typedef {import("answers").Message} MessageFacts */
/** @typedef {import("answers").OfferedAction} ActionFacts */

/**
 * @param {{verdict: string, message: MessageFacts, action?: ActionFacts | null, simulated?: boolean,
 *   pending?: boolean, leaveOut?: (measurements: number[]) => void, children?: unknown}} props
 */
export function Message({ verdict, message, action = null, simulated = false, pending = false, leaveOut = () => {},
  children = null }) {
  const { cause, worst, cautions } = message;
  const job = useSignal(/** @type {import("../core/jobs.js").Followed | null} */ (null));
  const act = () => attempt(async () => {
    if (action?.does) await doAction(action.does, (begun) => { job.value = begun; }, leaveOut);
  });
  return html`
    <section class=${`message verdict ${message.grade ?? verdict}${pending ? " pending" : ""}`} aria-label="Verdict"
      aria-busy=${pending}>
      <div role="status">
        <p class="word">${message.verdict}${simulated && html` <strong class="simulated">SIMULATED</strong>`}</p>
        ${cause && html`<p>${cause}</p>`}
        ${worst && html`<p>${worst.text}</p>`}
      </div>
      <div class="do">
        <p><b>What to do: </b>${message.action.text}</p>
        ${action?.does && html`
          <button type="button" class="main" disabled=${pending} onClick=${act}>${action.label}</button>`}
        ${!action?.does && message.action.command && html`
          <pre class="commands" tabindex="0" aria-label="Command"><code>${message.action.command}</code></pre>`}
      </div>
      ${job.value && html`<${JobProgress} job=${job.value} title=${action?.label ?? ""} />`}
      ${(message.basis ?? []).map((line) => html`<p class="basis muted" key=${line}>${line}</p>`)}
      ${cautions.length > 0 && html`
        <details><summary>${cautions.length === 1 ? "1 caution" : `${cautions.length} cautions`}</summary>
          <ul>${cautions.map((one) => html`<li>${one}</li>`)}</ul></details>`}
      ${children}
    </section>`;
}
