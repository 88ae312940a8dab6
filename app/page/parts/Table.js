// A table that is scrolled in its room, with the heads of its columns.
import { html } from "htm/preact";

/** @typedef {unknown | [unknown, "right"]} Head what stands above a column; of numbers at the right */

/**
 * @param {{name: string, of?: string, heads?: Head[], children?: unknown}} props `name`: of the table, for what reads
 *   the page
 */
export const Table = ({ name, of = "", heads = [], children }) => html`
  <div class="scroll" tabindex="0" role="region" aria-label=${name}><table class=${of}>
    ${heads.length > 0 && html`<thead><tr>${heads.map((head) => {
      const [text, side] = Array.isArray(head) ? head : [head, ""];
      return text === "" ? html`<td></td>` : html`<th scope="col" class=${side}>${text}</th>`;
    })}</tr></thead>`}
    ${children}
  </table></div>`;
