// A line of text: a name, a file.
import { html } from "htm/preact";

/**
 * @param {{label: string, value: string, onValue: (value: string) => void, error?: string, list?: string[], placeholder?: string, secret?: boolean, required?: boolean, id?: string}} props
 */
export function TextField({ label, value, onValue, error = "", list, placeholder, secret = false, required = false, id }) {
  const names = list && `${id ?? label}-list`.replace(/\W+/g, "-");
  return html`
    <label class=${`text${error ? " wrong" : ""}`}><span class="label">${label}</span>
      <input type=${secret ? "password" : "text"} id=${id} value=${value} autocomplete="off" spellcheck=${false} placeholder=${placeholder} required=${required} list=${names} aria-invalid=${Boolean(error)}
        onInput=${(/** @type {any} */ event) => onValue(event.target.value)} />
      ${list && html`<datalist id=${names}>${list.map((one) => html`<option value=${one} />`)}</datalist>`}
      ${error && html`<span class="error" role="alert">${error}</span>`}
    </label>`;
}
