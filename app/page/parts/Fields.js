// What may be stated to a command, as the records of its options have it: a field each, and the words of the command.
import { html } from "htm/preact";
import { signal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { get } from "../core/api.js";
import { failed, files, ofKind } from "../core/store.js";
import { unitSign } from "../core/words.js";
import { Check, Choice, NumberField, TextField, heard } from "./Controls.js";
import { Fold } from "./Fold.js";
import { useRefusal } from "./Form.js";

/** @typedef {import("answers").FormField} FormField */
/** @typedef {import("answers").CommandForm} CommandForm */
/** @typedef {Record<string, string>} Values what is typed, by option; of a box "true" or "false" */
/** @typedef {[string, string, boolean?]} Item its value, and its text; whether it counts as chosen at first */

const known = signal(/** @type {Record<string, CommandForm[]>} */ ({}));

/** The forms of the commands of a kind; none until they are there. @param {string} of @returns {CommandForm[]} */
export function useForms(of) {
  useEffect(() => { loadForms(of).catch(failed); }, [of]);
  return known.value[of] ?? [];
}

/** @param {string} of */
async function loadForms(of) {
  if (known.peek()[of]) return;
  const found = /** @type {CommandForm[]} */ (await get(`/api/forms?of=${encodeURIComponent(of)}`));
  known.value = { ...known.peek(), [of]: found };
}

/** @param {string} of */
export const formsOf = (of) => known.value[of] ?? null;

/** The fields that say something beside what is stated. @param {FormField[]} fields @param {Values} values */
function shownOf(fields, values) {
  /** @param {FormField} field @returns {boolean} */
  const shows = (field) => field.needs.every((need) => {
    const [flag, words] = need.split("="), other = fields.find((one) => one.flag === flag);
    const value = values[flag] || other?.default || "";
    return other !== undefined && shows(other)
      && (words === undefined ? value !== "" && value !== "false" : words.split(",").includes(value));
  });
  return fields.filter(shows);
}

/** The words that state it; what is as usual has none. @param {FormField[]} fields @param {Values} values */
export const wordsOf = (fields, values) => shownOf(fields, values).flatMap((field) => {
  const { flag, kind, off, before } = field, value = (values[flag] ?? "").trim();
  if (value === "" || value === (field.default ?? (kind === "box" ? "false" : ""))) return [];
  if (kind === "box") return [value === "true" ? flag : off ?? flag];
  const all = kind === "lines" ? value.split("\n").map((one) => one.trim()).filter(Boolean) : [value];
  return all.map((one) => `${flag}=${before}${one}`);
});

/** What must be stated and is not, by its label; "" for nothing. @param {FormField[]} fields @param {Values} values */
export const missingOf = (fields, values) =>
  shownOf(fields, values).find((field) => field.required && !values[field.flag]?.trim())?.label ?? "";

/** The folder's files of a kind. @param {string} kind @returns {Item[]} */
const filesOf = (kind) => (kind === "files" ? files.value.map((one) => one.path) : ofKind(kind))
  .map((path) => [path, path]);
const FILES = ["cell", "sensors", "obstacles", "run", "files"];

/**
 * @param {{fields: FormField[], values: Values, onValue: (flag: string, value: string) => void,
 *   offers?: Record<string, Item[]>, usual?: Values, hints?: Values, title?: string, children?: unknown}} props
 *   `offers`: what values are among, besides the folder's files; `usual`: what is shown where nothing is stated, and
 *   `hints`: what more is said, by option; `title`: of what is rarely stated
 */
export function Fields({ fields, values, onValue, offers = {}, usual = {}, hints = {}, title = "More options",
  children }) {
  const shown = shownOf(fields, values), rare = shown.filter((one) => one.rare);
  const drawn = (/** @type {FormField[]} */ list) => list.map((field) => html`
    <${Field} key=${field.flag} field=${field} value=${values[field.flag] ?? ""} usual=${usual[field.flag]}
      hint=${hints[field.flag]} items=${field.among && (offers[field.among]
        ?? (FILES.includes(field.among) ? filesOf(field.among) : null))}
      onValue=${(/** @type {string} */ value) => onValue(field.flag, value)} />`);
  return html`
    <div class="fields told">${drawn(shown.filter((one) => !one.rare))}${children}</div>
    ${rare.length > 0 && html`<${Fold} title=${title} kept><div class="fields told">${drawn(rare)}</div><//>`}`;
}

/**
 * @param {{field: FormField, value: string, usual?: string, hint?: string, items?: Item[] | null,
 *   onValue: (value: string) => void}} props
 */
function Field({ field, value, usual, hint, items, onValue }) {
  const { flag, label, kind, parts } = field, { text: error, forget } = useRefusal(flag);
  const set = (/** @type {string} */ next) => { forget(); onValue(next); };
  const placeholder = usual ?? field.default ?? undefined, choices = field.choices;
  const own = { label, error, placeholder, onValue: set };
  const number = (/** @type {string} */ name, /** @type {string} */ now, /** @type {(text: string) => void} */ then,
    more = {}) => html`
      <${NumberField} ...${own} label=${name} unit=${unitSign(field.unit ?? "")} digits=${9} optional
        whole=${kind === "whole"} least=${field.least ?? -Infinity} most=${field.most ?? Infinity}
        value=${now === "" ? null : Number(now)} ...${more}
        onValue=${(/** @type {number | null} */ n) => then(n === null ? "" : String(n))} />`;
  const plain = (/** @type {string} */ text) => text.toLowerCase().replace("’", "'");
  const about = field.help.replace(/\.$/, "");
  const says = plain(about) === plain(label) ? "" : about;
  const help = html`<span class="help">${[says, hint].filter(Boolean).join("; ")}</span>`;
  if (kind === "box") {
    return html`
      <div class="wide" data-option=${flag}><${Check} on=${(value || field.default) === "true"}
        onTurn=${(/** @type {boolean} */ on) => set(String(on))}>${field.help}<//>
      ${error && html`<span class="error" role="alert">${error}</span>`}</div>`;
  }
  if (kind === "names" && items?.length) {
    return html`<${Names} field=${field} value=${value} items=${items} set=${set} />`;
  }
  if (parts.length) {
    const now = value ? value.split(",") : parts.map(() => ""), hinted = placeholder?.split(",") ?? [];
    const one = (/** @type {number} */ i) => (/** @type {string} */ text) => {
      const next = now.map((other, k) => (k === i ? text : other));
      set(next.every((part) => part === "") ? "" : next.join(","));
    };
    return html`
      <div class="wide" data-option=${flag}>
        <div class="fields">${parts.map((part, i) => number(`${label} ${part}`, now[i] ?? "", one(i),
          { key: part, placeholder: hinted[i], error: i === 0 ? error : "", optional: value === "" }))}</div>${help}
      </div>`;
  }
  const listed = choices.length > 0 || items;
  const body = listed
    ? html`<${Choice} label=${label} value=${value || field.default || ""} error=${error} onValue=${set}
      none=${field.default === null ? (field.required ? "choose" : usual ?? "not stated") : undefined}
      items=${items ?? choices.map((one) => [one.value, one.words])} />`
    : kind === "number" || kind === "whole" ? number(label, value, set)
    : kind === "lines"
      ? html`
        <label class="text"><span class="label">${label}</span>
          <textarea rows="1" autocomplete="off" spellcheck=${false} value=${value} aria-invalid=${Boolean(error)}
            placeholder="one in each line" onInput=${heard(set)}></textarea>
          ${error && html`<span class="error" role="alert">${error}</span>`}</label>`
    : html`<${TextField} ...${own} value=${value} sent />`;
  return html`<div data-option=${flag}>${body}${help}</div>`;
}

/**
 * Some of several names: nothing is stated where these are the usual ones.
 * @param {{field: FormField, value: string, items: Item[], set: (value: string) => void}} props
 */
function Names({ field, value, items, set }) {
  const on = (/** @type {Item} */ [name, , usual]) => (value ? value.split(",").includes(name) : Boolean(usual));
  const turn = (/** @type {string} */ name, /** @type {boolean} */ ticked) => {
    const names = items.filter((item) => (item[0] === name ? ticked : on(item))).map(([one]) => one);
    set(names.length === items.length ? "" : names.join(","));
  };
  return html`
    <fieldset class="points wide" data-option=${field.flag}><legend>${field.label}</legend>
      ${items.map((item) => html`
        <${Check} key=${item[0]} on=${on(item)}
          onTurn=${(/** @type {boolean} */ ticked) => turn(item[0], ticked)}>${item[1]}<//>`)}
    </fieldset>`;
}
