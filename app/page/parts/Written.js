// A command that writes files: begun by a form, followed, and what it wrote to be downloaded.
import { html } from "htm/preact";
import { useSignal } from "@preact/signals";
import { downloadOf } from "../core/api.js";
import { begin, over, well } from "../core/jobs.js";
import { refresh } from "../core/store.js";
import { sentence } from "../core/words.js";
import { Submit } from "./Form.js";
import { JobProgress } from "./JobProgress.js";

/**
 * @typedef {import("@preact/signals").Signal<{job: import("../core/jobs.js").Followed, files: string[]} | null>} Made
 */

export function useWritten() {
  /** @type {Made} */
  const made = useSignal(null);
  /** Begins a command, which will write these files. @param {string[]} words @param {string[]} files */
  const carryOut = async (words, files) => {
    const job = await begin(words);
    made.value = { job, files };
    if (well(await job.ended)) await refresh();
  };
  return { made, carryOut };
}

/**
 * The foot of such a form: what was written, and what the command says of it.
 * @param {{made: Made, button: string, title: string, disabled?: boolean, after?: string, more?: string[]}} props
 */
export function Written({ made, button, title, disabled = false, after = "", more = [] }) {
  const now = made.value;
  return html`
    <p class="bar"><${Submit} disabled=${disabled || (now !== null && !over(now.job.state.value))}>${button}<//></p>
    ${now && html`<${JobProgress} key=${now.job.id} job=${now.job} title=${title}>
      <p>${[...now.files, ...more].map((one) => html`
        <a class="button" href=${downloadOf(one)} download>Download ${one.replace(/^.*\//, "")}</a> `)}</p>
      <ul class="lines said">
        ${(now.job.state.value.answer?.notes ?? []).map((/** @type {string} */ note) => html`
          <li>${sentence(note)}</li>`)}</ul>
      ${after && html`<p class="muted">${after}</p>`}<//>`}`;
}
