// What a command says of the file that it wrote.
import { html } from "htm/preact";
import { sentence } from "../core/words.js";

/** @param {{job: import("../core/jobs.js").Followed}} props */
export function Notes({ job }) {
  /** @type {string[]} */
  const notes = job.state.value.answer?.notes ?? [];
  return html`<ul class="lines said">${notes.map((note) => html`<li>${sentence(note)}</li>`)}</ul>`;
}
