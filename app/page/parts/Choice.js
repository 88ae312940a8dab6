// One of several words, in a list.
import { html } from "htm/preact";
import { value as heard } from "./heard.js";

/** @typedef {[string, string]} Item its value, and its text */
/**
 * @param {{label: string, value: string, onValue: (value: string) => void, items?: (string | Item)[],
 *   groups?: [string, Item[]][],
 *   none?: string, hidden?: boolean, disabled?: boolean, error?: string}} props
 *   `items`, or `groups` with a title of each; `none`: the text of nothing chosen; `hidden`: the label is read only
 */
export function Choice({ label, value, onValue, items = [], groups = [], none, hidden = false, disabled = false,
  error = "" }) {
  const item = (/** @type {string | Item} */ one) => {
    const [key, text] = Array.isArray(one) ? one : [one, one];
    return html`<option key=${key} value=${key} selected=${key === value}>${text}</option>`;
  };
  const there = groups.filter(([, list]) => list.length > 0);
  return html`
    <label class="choice"><span class=${hidden ? "unseen" : "label"}>${label}</span>
      <select value=${value} disabled=${disabled} aria-label=${label} aria-invalid=${Boolean(error)}
        onChange=${heard(onValue)}>
        ${none !== undefined && html`<option value="" selected=${value === ""}>${none}</option>`}
        ${items.map(item)}
        ${there.length === 1 ? there[0][1].map(item)
          : there.map(([title, list]) => html`<optgroup label=${title}>${list.map(item)}</optgroup>`)}
      </select>
      ${error && html`<span class="error" role="alert">${error}</span>`}
    </label>`;
}
