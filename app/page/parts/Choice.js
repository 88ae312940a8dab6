// One of several words, in a list.
import { html } from "htm/preact";

/**
 * @param {{label: string, value: string, groups: [string, [string, string][]][], onValue: (value: string) => void, none?: string, hidden?: boolean, disabled?: boolean}} props
 *   `groups`: title and items (value, text); `none`: the text of nothing chosen
 */
export function Choice({ label, value, groups, onValue, none, hidden = false, disabled = false }) {
  const item = (/** @type {[string, string]} */ [key, text]) => html`<option key=${key} value=${key} selected=${key === value}>${text}</option>`;
  const there = groups.filter(([, items]) => items.length > 0);
  return html`
    <label class="choice"><span class=${hidden ? "unseen" : "label"}>${label}</span>
      <select value=${value} disabled=${disabled} aria-label=${label} onChange=${(/** @type {any} */ event) => onValue(event.target.value)}>
        ${none !== undefined && html`<option value="" selected=${value === ""}>${none}</option>`}
        ${there.length === 1 ? there[0][1].map(item) : there.map(([title, items]) => html`<optgroup label=${title}>${items.map(item)}</optgroup>`)}
      </select>
    </label>`;
}
