// The parts of a form by the JSON Schema of a file: fields, groups of them, lists, entries by name.
import { html } from "htm/preact";
import { useEffect, useRef } from "preact/hooks";
import { useSignal } from "@preact/signals";
import { ALLOWED, LIST, numbersOf, parsed } from "../core/decimal.js";
import { Check, heard } from "./Controls.js";
import { alternativeOf, itemOf, keyOf, kindWords, partOf, resolved, shapeOf, title, unitOf } from "./schema.js";

/** @typedef {import("./schema.js").Schema} Schema */
/** @typedef {import("./schema.js").Path} Path */
/**
 * @typedef {{root: Schema, errors: Record<string, string>, lists: Record<string, string[]>, live?: boolean,
 *   touched: (key: string) => void}} FormFacts `live`: what cannot be read is not handed on, to be refused later
 */
/** @typedef {(value: unknown) => void} Heard */
/**
 * @typedef {{form: FormFacts, schema: Schema, path: Path, value: unknown, onValue: Heard, required?: boolean,
 *   named?: string}} PartProps
 *   `named`: the label, if it is not the key's
 */

/** @param {{form: FormFacts, path: Path}} props */
function Problem({ form, path }) {
  const error = form.errors[keyOf(path)];
  return error ? html`<span class="error" role="alert">${error}</span>` : null;
}

/** @param {{schema: Schema, id?: string, usual?: unknown}} props */
function Help({ schema, id, usual = schema.default }) {
  const about = schema.description ?? "";
  const said = usual == null || typeof usual === "object" || about.includes("default");
  return html`<span class="help" id=${id}>${about}${said ? "" : `; default: ${usual}`}</span>`;
}

/** The label of a part: its name, or that of its key. @param {{path: Path, named?: string}} props */
const labelOf = ({ path, named }) => named ?? title(String(path.at(-1)));

/** Whether an error belongs here or below. @param {FormFacts} form @param {Path} path */
const wrongBelow = (form, path) =>
  Object.keys(form.errors).some((key) => key === keyOf(path) || key.startsWith(`${keyOf(path)}/`));

/**
 * What a field takes: words to choose from, yes or no, numbers, lists, texts.
 * @param {Schema} schema @param {Schema[]} kinds
 */
function takenBy(schema, kinds) {
  const all = [schema, ...kinds], is = (/** @type {string} */ type) => all.some((one) => one.type === type);
  const listed = is("array"), numeric = is("number") || schema.type === "integer";
  const words = schema.enum
    ?? (schema.const ? [schema.const] : kinds.flatMap((kind) => kind.enum ?? (kind.const ? [kind.const] : [])));
  const texts = schema.type === "string" || (listed && JSON.stringify(schema).includes('"string"'));
  return { words, logical: is("boolean"), numeric, listed, texts };
}

/**
 * What a text states in such a field: undefined for none, null for what is refused.
 * @param {ReturnType<typeof takenBy>} taken @param {string} plain
 */
function readBy({ texts, listed, numeric }, plain) {
  if (plain === "") return undefined;
  if (texts) return listed ? plain.split(",").map((part) => part.trim()).filter(Boolean) : plain;
  const one = parsed(plain), several = listed ? numbersOf(plain) : null;
  if (one !== null && (numeric || several === null) && !(listed && !numeric)) return one;
  if (several === null) return null;
  return several.length > 1 || !numeric ? several : several[0];
}

/** @param {PartProps & {kinds: Schema[]}} props */
function Field(props) {
  const { form, schema, kinds, path, value, onValue, required = false } = props;
  const key = String(path.at(-1)), at = keyOf(path), id = `header-${at.replace(/[^\w-]+/g, "-")}`;
  const taken = takenBy(schema, kinds), { words, logical, numeric, listed, texts } = taken;
  const shown = value == null ? "" : Array.isArray(value) ? value.join(texts ? ", " : " ") : String(value);
  const text = useSignal(shown), refused = useSignal(""), field = useRef(/** @type {HTMLInputElement | null} */ (null));
  useEffect(() => {
    if (document.activeElement !== field.current) { text.value = shown; refused.value = ""; }
  }, [shown]);
  const take = (/** @type {string} */ given) => {
    text.value = given;
    form.touched(at);
    const plain = given.trim(), read = readBy(taken, plain);
    refused.value = read === null
      ? `allowed: ${listed && !numeric ? LIST : listed ? `${ALLOWED}; or ${LIST}` : ALLOWED}` : "";
    if (read !== null || !form.live) onValue(read === null ? plain : read);
  };
  const choose = (/** @type {string} */ given) => {
    form.touched(at);
    const yes = given === "true", either = logical && (yes || given === "false");
    onValue(given === "" ? undefined : either ? yes : given);
  };
  const label = `${labelOf(props)}${unitOf(key) ? ` (${unitOf(key)})` : ""}${required ? ", required" : ""}`;
  const usual = schema.default, list = form.lists[key];
  if ((words.length && !numeric) || logical) {
    const none = usual === undefined ? (required ? "choose" : "not stated") : `default (${usual})`;
    return html`
      <div class="stated" data-key=${at}><label><span class="label">${label}</span>
        <select aria-describedby=${id} aria-invalid=${at in form.errors} value=${shown} onChange=${heard(choose)}>
          <option value="" selected=${shown === ""}>${none}</option>
          ${[...words, ...(logical ? ["true", "false"] : [])].map((word) => html`
            <option value=${word} selected=${word === shown}>${word}</option>`)}
        </select></label><${Help} schema=${schema} id=${id} usual=${null} /><${Problem} form=${form} path=${path} />
      </div>`;
  }
  return html`
    <div class="stated" data-key=${at}><label><span class="label">${label}</span>
      <input type="text" autocomplete="off" spellcheck=${false} inputmode=${texts || listed ? "text" : "decimal"}
        list=${list && `${id}-list`} ref=${field}
        aria-describedby=${id} aria-invalid=${Boolean(refused.value) || at in form.errors}
        placeholder=${usual == null ? undefined : [usual].flat().join(" ")} value=${text.value}
          onInput=${heard(take)} /></label>
      ${list && html`<datalist id=${`${id}-list`}>${list.map((one) => html`<option value=${one} />`)}</datalist>`}
      <${Help} schema=${schema} id=${id} />
      ${refused.value ? html`<span class="error" role="alert">${refused.value}</span>`
        : html`<${Problem} form=${form} path=${path} />`}
    </div>`;
}

/** The keys of an object, as they are stated. @param {PartProps & {without?: string}} props */
export function Group({ form, schema, path, value, onValue, required = true, without = "" }) {
  const keys = Object.entries(schema.properties ?? {}).filter(([key]) => key !== "schema" && key !== without);
  const change = (/** @type {string} */ key, /** @type {unknown} */ given) => {
    const next = Object.fromEntries(Object.entries({ ...partOf(value), [key]: given })
      .filter(([, one]) => one !== undefined));
    onValue(required || Object.keys(next).length ? next : undefined);
  };
  return html`<div class="fields">${keys.map(([key, own]) => html`
    <${Part} key=${key} form=${form} schema=${own} path=${[...path, key]} value=${partOf(value)[key]}
      required=${(schema.required ?? []).includes(key)}
        onValue=${(/** @type {unknown} */ given) => change(key, given)} />`)}</div>`;
}

/**
 * What need not be stated stays folded.
 * @param {{form: FormFacts, path: Path, schema: Schema, open: boolean, named?: string, children?: unknown}} props
 */
function Folded({ form, path, schema, open, named, children }) {
  const opened = useSignal(open);
  const toggled = (/** @type {import("preact").TargetedEvent<HTMLDetailsElement>} */ event) => {
    opened.value = event.currentTarget.open;
  };
  return html`
    <details class="group" data-key=${keyOf(path)} open=${opened.value || wrongBelow(form, path)} onToggle=${toggled}>
      <summary>${labelOf({ path, named })}</summary>
      <${Help} schema=${schema} /><${Problem} form=${form} path=${path} />${children}
    </details>`;
}

/** Items that come and go: each is stated as in `item`. @param {PartProps & {item: Schema}} props */
function Entries({ form, schema, path, value, onValue, item, named }) {
  const list = /** @type {unknown[]} */ (Array.isArray(value) ? value : []);
  const set = (/** @type {unknown[]} */ next) => onValue(next.length ? next : undefined);
  const change = (/** @type {number} */ i) =>
    (/** @type {unknown} */ given) => set(list.map((other, k) => (k === i ? given ?? {} : other)));
  return html`
    <${Folded} form=${form} path=${path} schema=${schema} open=${list.length > 0} named=${named}>
      ${list.map((one, i) => html`
        <div class="entry" key=${`${i} of ${list.length}`}>
          <${Part} form=${form} schema=${item} path=${[...path, i]} value=${one} required named=${`${i + 1}`}
            onValue=${change(i)} />
          <p><button type="button" onClick=${() => set(list.filter((_, k) => k !== i))}>Remove</button></p>
        </div>`)}
      <button type="button" onClick=${() => set([...list, {}])}>Add
        to ${labelOf({ path, named }).toLowerCase()}</button>
    <//>`;
}

/** Entries by name: the name is a field of its own. @param {PartProps & {item: Schema}} props */
function Named({ form, schema, path, value, onValue, item }) {
  const pairs = useSignal(Object.entries(partOf(value))), own = JSON.stringify(partOf(value));
  useEffect(() => {
    if (JSON.stringify(Object.fromEntries(pairs.value)) !== own) pairs.value = Object.entries(partOf(value));
  }, [own]);
  const set = (/** @type {[string, unknown][]} */ next) => {
    pairs.value = next;
    onValue(next.length ? Object.fromEntries(next) : undefined);
  };
  const object = shapeOf(form.root, item).kind !== "field", empty = object ? {} : "";
  const stated = object ? item : { ...item, type: "string", anyOf: undefined };
  const change = (/** @type {number} */ i, /** @type {[string, unknown]} */ pair) =>
    set(pairs.value.map((one, k) => (k === i ? pair : one)));
  return html`
    <${Folded} form=${form} path=${path} schema=${schema} open=${pairs.value.length > 0}>
      ${pairs.value.map(([name, one], i) => html`
        <div class="entry" key=${`${i} of ${pairs.value.length}`}>
          <label class="stated"><span class="label">Name</span>
            <input type="text" autocomplete="off" spellcheck=${false} value=${name}
              onInput=${heard((text) => change(i, [text.trim(), one]))} />
          </label>
          <${Part} form=${form} schema=${stated} path=${[...path, name]} value=${one} required
            named=${object ? name || "Values" : "Value"}
            onValue=${(/** @type {unknown} */ given) => change(i, [name, given ?? empty])} />
          <p><button type="button" onClick=${() => set(pairs.value.filter((_, k) => k !== i))}>Remove</button></p>
        </div>`)}
      <button type="button"
        onClick=${() => set([...pairs.value, ["", empty]])}>Add to ${labelOf({ path }).toLowerCase()}</button>
    <//>`;
}

/** One of several kinds of object, which their key `kind` tells apart. @param {PartProps & {kinds: Schema[]}} props */
function OneOf({ form, schema, kinds, path, value, onValue, named }) {
  const of = alternativeOf(kinds, value), now = partOf(value).kind ?? "";
  const choose = (/** @type {string} */ kind) => { form.touched(keyOf(path)); onValue(kind ? { kind } : {}); };
  return html`
    <fieldset class="group" data-key=${keyOf(path)}><legend>${labelOf({ path, named })}</legend>
      <${Help} schema=${schema} />
      <label class="stated"><span class="label">Kind, required</span><select value=${now} onChange=${heard(choose)}>
        <option value="" selected=${!of}>choose</option>
        ${kinds.flatMap(kindWords)
          .map((word) => html`<option value=${word} selected=${word === now}>${word}</option>`)}</select></label>
      <${Problem} form=${form} path=${path} />
      ${of && html`
        <${Group} key=${now} form=${form} schema=${of} path=${path} value=${value} onValue=${onValue}
          without="kind" />`}
    </fieldset>`;
}

/** A word, or instead of it an object. @param {PartProps & {kinds: Schema[]}} props */
function TextOrGroup({ form, schema, kinds, path, value, onValue, required }) {
  const other = useSignal(value !== null && typeof value === "object");
  const about = (kinds[0].description ?? "").replace(/\.$/, "");
  const texts = [...(schema.anyOf ?? schema.oneOf ?? [])].map((one) => resolved(form.root, one))
    .filter((one) => one.type !== "null" && !one.properties);
  const plain = { ...schema, type: texts.every((one) => one.type === "string" && !one.const) ? "string" : undefined };
  const turn = (/** @type {boolean} */ on) => {
    other.value = on;
    form.touched(keyOf(path));
    onValue(on ? {} : undefined);
  };
  return html`
    <div class="entry" data-key=${keyOf(path)}>
      <${Check} on=${other.value} onTurn=${turn}>
        ${labelOf({ path })}: ${about.charAt(0).toLowerCase()}${about.slice(1)}<//>
      ${other.value
        ? html`<${Group} form=${form} schema=${kinds[0]} path=${path} value=${value} onValue=${onValue} />
        <${Problem} form=${form} path=${path} />`
        : html`<${Field} form=${form} schema=${plain} kinds=${texts} path=${path} value=${value} required=${required}
          onValue=${onValue} />`}
    </div>`;
}

/** What is stated at a key. @param {PartProps} props */
function Part(props) {
  const { form, schema, path, value, onValue, required = false, named } = props, { root } = form;
  const { kind, schema: own, kinds } = shapeOf(root, schema);
  const given = { ...props, schema: own, kinds };
  if (kind === "one of") return html`<${OneOf} ...${given} />`;
  if (kind === "text or group") return html`<${TextOrGroup} ...${given} />`;
  if (kind === "list") return html`<${Entries} ...${given} item=${itemOf(root, own)} />`;
  if (kind === "named") return html`<${Named} ...${given} item=${itemOf(root, own)} />`;
  if (kind === "field") return html`<${Field} ...${given} />`;
  const group = html`
    <${Group} form=${form} schema=${own} path=${path} value=${value} onValue=${onValue} required=${required} />`;
  if (!required && (path.length === 1 || (own.required ?? []).length)) {
    return html`
      <${Folded} form=${form} path=${path} schema=${own} open=${value !== undefined} named=${named}>${group}<//>`;
  }
  return html`
    <fieldset class="group" data-key=${keyOf(path)}><legend>${labelOf(props)}</legend><${Help} schema=${own} />
      ${group}</fieldset>`;
}
