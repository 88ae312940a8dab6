// A line of text: a name, a file.
import { html } from "htm/preact";
import { useFault } from "./Form.js";
import { value as heard } from "./heard.js";

/**
 * @param {{label: string, value: string, onValue: (value: string) => void, error?: string, list?: string[],
 *   placeholder?: string, secret?: boolean, required?: boolean, id?: string, sent?: boolean}} props
 *   `sent`: the error is of what was sent, and may be sent again
 */
export function TextField({ label, value, onValue, error = "", list, placeholder, secret = false, required = false, id,
  sent = false }) {
  const field = useFault(error && !sent ? `${label}: ${error}` : "");
  const names = list && `${id ?? label}-list`.replace(/\W+/g, "-");
  return html`
    <label class=${`text${error ? " wrong" : ""}`}><span class="label">${label}</span>
      <input type=${secret ? "password" : "text"} id=${id} value=${value} autocomplete="off" spellcheck=${false}
        placeholder=${placeholder} required=${required} list=${names} aria-invalid=${Boolean(error)} ref=${field}
        onInput=${heard(onValue)} />
      ${list && html`<datalist id=${names}>${list.map((one) => html`<option value=${one} />`)}</datalist>`}
      ${error && html`<span class="error" role="alert">${error}</span>`}
    </label>`;
}
