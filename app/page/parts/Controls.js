// The controls of forms: a box to tick, one of several words, a line of text, a number with its unit; and what they
// say, handed on to a function or into a signal.
import { html } from "htm/preact";
import { useEffect } from "preact/hooks";
import { useSignal } from "@preact/signals";
import { ALLOWED, parsed, typed } from "../core/decimal.js";
import { useFault } from "./Form.js";

/** What is typed or chosen. @param {(value: string) => void} then @returns {(event: Event) => void} */
export const heard = (then) => (event) => then(/** @type {HTMLInputElement} */ (event.target).value);

/** Whether it is ticked. @param {(on: boolean) => void} then @returns {(event: Event) => void} */
export const checked = (then) => (event) => then(/** @type {HTMLInputElement} */ (event.target).checked);

/** @template T @param {{value: T}} signal @returns {(value: T) => void} */
export const into = (signal) => (next) => { signal.value = next; };

/**
 * The files that are chosen; the same can be chosen again.
 * @param {(files: File[]) => void} then @returns {(event: Event) => void}
 */
export const filesOf = (then) => (event) => {
  const field = /** @type {HTMLInputElement} */ (event.target), files = [...field.files ?? []];
  field.value = "";
  then(files);
};

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

/**
 * A decimal point or comma; what is no number, or could be misread, is refused where it stands.
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

/**
 * The three numbers of a place or direction.
 * @param {{label?: string, unit: string, values: (number | null)[], error?: string, digits?: number,
 *   onValue: (values: number[]) => void}} props
 */
export const Vector = ({ label = "", values, error = "", onValue, ...others }) => ["x", "y", "z"].map((axis, i) => html`
  <${NumberField} key=${label + axis} ...${others} label=${`${label} ${axis}`.trim()} value=${values[i]}
    error=${i === 0 ? error : ""}
    onValue=${(/** @type {number} */ value) => onValue(/** @type {number[]} */ (values.with(i, value)))} />`);

/**
 * Cards to choose one of.
 * @param {{name: string, items: {value: string, title: string, about?: string}[], value: string,
 *   onValue: (value: string) => void}} props
 */
export const Cards = ({ name, items, value, onValue }) => items.map((one) => html`
  <label class="option" key=${one.value}>
    <input type="radio" name=${name} value=${one.value} checked=${one.value === value}
      onChange=${() => onValue(one.value)} /> <b>${one.title}</b>
    ${one.about && html`<span>${one.about}</span>`}</label>`);

/**
 * How the pendant counts joint 3: `usual` is what the robot file states.
 * @param {{value: string, onValue: (value: string) => void, usual?: string}} props
 */
export const Joint3 = ({ value, onValue, usual = "" }) => html`
  <${Choice} label="Joint 3 is counted from" value=${value}
    items=${[[usual, "as the robot file states"], ["link", "link 2"], ["ground", "the ground (FANUC)"]]}
    onValue=${onValue} />`;
