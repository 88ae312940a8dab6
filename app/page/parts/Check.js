// A box to tick, with its words.
import { html } from "htm/preact";
import { checked } from "./heard.js";

/**
 * @param {{on: boolean, onTurn: (on: boolean) => void, disabled?: boolean, wide?: boolean, name?: string,
 *   children?: unknown}} props
 *   `name`: for what reads the page, where the words are elsewhere
 */
export function Check({ on, onTurn, disabled = false, wide = false, name, children, ...attributes }) {
  return html`
    <label class=${wide ? "check wide" : "check"} ...${attributes}>
      <input type="checkbox" checked=${on} disabled=${disabled} aria-label=${name}
        onChange=${checked(onTurn)} /> ${children}
    </label>`;
}
