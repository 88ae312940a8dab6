// Drafts of plans whose files are gone: this browser alone has them.
import { html } from "htm/preact";
import { calibrationOf, toJob } from "../core/route.js";

/** @param {{drafts: import("../core/editing.js").Draft[]}} props */
export function Drafts({ drafts }) {
  if (!drafts.length) return null;
  return html`
    <section class="drafts" aria-label="Drafts">
      <p>The files of these plans are gone from the folder. This browser has their unsaved changes:</p>
      <ul>${drafts.map((one) => html`
        <li key=${one.plan}>
          <a href=${toJob(calibrationOf(one.plan), "plan", one.plan)}>${one.plan}</a> <small class="muted">
            ${one.when.slice(0, 16).replace("T", " ")}</small></li>`)}</ul>
    </section>`;
}
