// A number with its unit: a decimal point or comma; what is no number, or could be misread, is refused where it stands.
import { html } from "htm/preact";
import { useEffect } from "preact/hooks";
import { useSignal } from "@preact/signals";
import { ALLOWED, parsed, typed } from "../core/decimal.js";
import { useFault } from "./Form.js";
import { value as heard } from "./heard.js";

/**
 * @param {{label: string, value: number | null | undefined, unit?: string, onValue: (value: number | null) => void,
 *   optional?: boolean,
 *   least?: number, most?: number, whole?: boolean, slider?: boolean, digits?: number, placeholder?: string,
 *   error?: string, beyond?: boolean, hidden?: boolean}} props
 *   `optional`: an empty field states null; `slider`: with one, from `least` to `most`; `hidden`: the label is read
 *   only
 */
export function NumberField({ label, value, unit = "", onValue, optional = false, least = -Infinity, most = Infinity,
  whole = false, slider = false, digits = 4, placeholder, error = "", beyond = false, hidden = false }) {
  const shown = value === null || value === undefined ? "" : typed(value, digits);
  const text = useSignal(shown), typing = useSignal(false), refused = useSignal("");
  useEffect(() => { if (!typing.value) { text.value = shown; refused.value = ""; } }, [shown]);
  const take = (/** @type {string} */ given) => {
    text.value = given;
    if (given.trim() === "" && optional) { refused.value = ""; onValue(null); return; }
    const number = parsed(given);
    refused.value = number === null ? `allowed: ${ALLOWED}`
      : whole && !Number.isInteger(number) ? "allowed: a whole number"
      : number < least ? `allowed: at least ${least}` : number > most ? `allowed: at most ${most}` : "";
    if (number !== null && !refused.value) onValue(number);
  };
  const problem = refused.value || error, called = unit ? `${label}, ${unit}` : label;
  const field = useFault(problem ? `${called}: ${problem}`
    : !optional && shown === "" ? `${called}: a number is missing` : "");
  return html`
    <label class=${`number${problem ? " wrong" : ""}${beyond ? " beyond" : ""}`}>
      <span class=${hidden ? "unseen" : "label"}>${label}</span>
      <span class="together">
        ${slider && html`
          <input type="range" min=${least} max=${most} step=${whole ? 1 : "any"} value=${value ?? 0} aria-label=${label}
            aria-valuetext=${`${shown} ${unit}`}
          onInput=${heard((text) => onValue(Number(Number(text).toFixed(digits))))} />`}
        <input type="text" inputmode=${whole && least >= 0 ? "numeric" : "decimal"} autocomplete="off"
          spellcheck=${false} value=${typing.value ? text.value : refused.value ? text.value : shown}
          placeholder=${placeholder} aria-invalid=${Boolean(problem)} aria-label=${called} ref=${field}
          onFocus=${() => { text.value = refused.value ? text.value : shown; typing.value = true; }}
            onBlur=${() => { typing.value = false; }}
          onInput=${heard(take)} />
        ${unit && html`<span class="unit" aria-hidden="true">${unit}</span>`}
      </span>
      ${problem && html`<span class="error" role="alert">${problem}</span>`}
    </label>`;
}
