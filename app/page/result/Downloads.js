// The report alone in a new tab, and the files of a result.
import { html } from "htm/preact";
import { downloadOf, pageOf } from "../core/api.js";
import { bytes } from "../core/words.js";

/** @param {{found: import("./types.js").Found}} props */
export function Downloads({ found }) {
  return html`
    <ul class="downloads">
      <li><a href=${`/api/archive?file=${encodeURIComponent(found.file)}`}
        download>Everything in one archive (.zip)</a></li>
      ${found.files.map((one) => html`
        <li key=${one.path}>
          <a href=${downloadOf(one.path)} download>${one.path}</a> <small class="muted">
            ${bytes(one.bytes)}</small></li>`)}
      ${found.run && html`
        <li>
          <a href=${downloadOf(found.run)} download>${found.run}</a> <small class="muted">the run itself</small></li>`}
    </ul>`;
}

/** @param {{found: import("./types.js").Found}} props */
export const ReportLink = ({ found }) =>
  (found.report
    ? html`<a class="button report" href=${pageOf(found.report)} target="_blank" rel="noopener">Open the report</a>`
    : null);
