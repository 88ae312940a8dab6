// The parts of a header's form: fields, groups of them, lists, entries by name.
import { html } from "htm/preact";
import { useSignal } from "@preact/signals";
import { ALLOWED, parsed } from "../core/decimal.js";
import { alternativeOf, itemOf, keyOf, kindWords, LIST, numbersOf, resolved, shapeOf, title, unitOf } from "./schema.js";

/** @typedef {import("./schema.js").Schema} Schema */
/** @typedef {import("./schema.js").Path} Path */
/** @typedef {{root: Schema, errors: Record<string, string>, lists: Record<string, string[]>, touched: (key: string) => void}} FormFacts */
/** @typedef {{form: FormFacts, schema: Schema, path: Path, value: any, onValue: (value: any) => void, required?: boolean, named?: string}} PartProps `named`: the label, if it is not the key's */

/** @param {{form: FormFacts, path: Path}} props */
function Problem({ form, path }) {
  const error = form.errors[keyOf(path)];
  return error ? html`<span class="error" role="alert">${error}</span>` : null;
}

/** @param {{schema: Schema, id?: string, usual?: unknown}} props */
function Help({ schema, id, usual = schema.default }) {
  const said = usual === undefined || usual === null || typeof usual === "object" || (schema.description ?? "").includes("default") ? "" : `; default: ${usual}`;
  return html`<span class="help" id=${id}>${schema.description ?? ""}${said}</span>`;
}

/** Whether an error belongs here or below. @param {FormFacts} form @param {Path} path */
const wrongBelow = (form, path) => Object.keys(form.errors).some((key) => key === keyOf(path) || key.startsWith(`${keyOf(path)}/`));

/** @param {PartProps & {kinds: Schema[]}} props */
function Field({ form, schema, kinds, path, value, onValue, required = false, named }) {
  const key = String(path.at(-1)), id = `header-${keyOf(path).replace(/[^\w-]+/g, "-")}`;
  const words = schema.enum ?? (schema.const ? [schema.const] : kinds.flatMap((kind) => kind.enum ?? (kind.const ? [kind.const] : [])));
  const logical = schema.type === "boolean" || kinds.some((kind) => kind.type === "boolean"), listed = schema.type === "array" || kinds.some((kind) => kind.type === "array");
  const numeric = schema.type === "number" || schema.type === "integer" || kinds.some((kind) => kind.type === "number");
  const texts = schema.type === "string" || (listed && JSON.stringify(schema).includes('"string"'));
  const shown = value === undefined || value === null ? "" : Array.isArray(value) ? value.join(texts ? ", " : " ") : String(value);
  const text = useSignal(shown), refused = useSignal("");
  const take = (/** @type {string} */ given) => {
    text.value = given;
    refused.value = "";
    form.touched(keyOf(path));
    const plain = given.trim();
    if (plain === "") { onValue(undefined); return; }
    if (texts) { onValue(listed ? plain.split(",").map((part) => part.trim()).filter(Boolean) : plain); return; }
    const one = parsed(plain), several = listed ? numbersOf(plain) : null;
    const read = one !== null && (numeric || several === null) && !(listed && !numeric) ? one : several !== null ? (several.length > 1 || !numeric ? several : several[0]) : null;
    if (read === null) refused.value = `allowed: ${listed && !numeric ? LIST : listed ? `${ALLOWED}; or ${LIST}` : ALLOWED}`;
    onValue(read ?? plain);
  };
  const label = `${named ?? title(key)}${unitOf(key) ? ` (${unitOf(key)})` : ""}${required ? ", required" : ""}`;
  const usual = schema.default, list = form.lists[key];
  if ((words.length && !numeric) || logical) {
    const none = usual === undefined ? (required ? "choose" : "not stated") : `default (${usual})`;
    return html`
      <div class="stated" data-key=${keyOf(path)}><label><span class="label">${label}</span>
        <select aria-describedby=${id} aria-invalid=${keyOf(path) in form.errors} value=${shown} onChange=${(/** @type {any} */ event) => { const given = event.target.value; form.touched(keyOf(path)); onValue(given === "" ? undefined : logical && (given === "true" || given === "false") ? given === "true" : given); }}>
          <option value="" selected=${shown === ""}>${none}</option>
          ${[...words, ...(logical ? ["true", "false"] : [])].map((word) => html`<option value=${word} selected=${word === shown}>${word}</option>`)}
        </select></label><${Help} schema=${schema} id=${id} usual=${null} /><${Problem} form=${form} path=${path} />
      </div>`;
  }
  return html`
    <div class="stated" data-key=${keyOf(path)}><label><span class="label">${label}</span>
      <input type="text" autocomplete="off" spellcheck=${false} inputmode=${texts || listed ? "text" : "decimal"} list=${list && `${id}-list`} aria-describedby=${id} aria-invalid=${Boolean(refused.value) || keyOf(path) in form.errors}
        placeholder=${usual === undefined || usual === null ? undefined : [usual].flat().join(" ")} value=${text.value} onInput=${(/** @type {any} */ event) => take(event.target.value)} /></label>
      ${list && html`<datalist id=${`${id}-list`}>${list.map((one) => html`<option value=${one} />`)}</datalist>`}
      <${Help} schema=${schema} id=${id} />${refused.value ? html`<span class="error" role="alert">${refused.value}</span>` : html`<${Problem} form=${form} path=${path} />`}
    </div>`;
}

/** The keys of an object, as they are stated. @param {PartProps & {without?: string}} props */
export function Group({ form, schema, path, value, onValue, required = true, without = "" }) {
  const keys = Object.entries(schema.properties ?? {}).filter(([key]) => key !== "schema" && key !== without);
  const change = (/** @type {string} */ key, /** @type {unknown} */ given) => {
    const next = Object.fromEntries(Object.entries({ ...value, [key]: given }).filter(([, one]) => one !== undefined));
    onValue(required || Object.keys(next).length ? next : undefined);
  };
  return html`<div class="fields">${keys.map(([key, own]) => html`<${Part} key=${key} form=${form} schema=${own} path=${[...path, key]} value=${value?.[key]} required=${(schema.required ?? []).includes(key)} onValue=${(/** @type {unknown} */ given) => change(key, given)} />`)}</div>`;
}

/** What need not be stated stays folded. @param {{form: FormFacts, path: Path, schema: Schema, open: boolean, named?: string, children?: unknown}} props */
function Folded({ form, path, schema, open, named, children }) {
  const opened = useSignal(open);
  return html`
    <details class="group" data-key=${keyOf(path)} open=${opened.value || wrongBelow(form, path)} onToggle=${(/** @type {any} */ event) => { opened.value = event.target.open; }}>
      <summary>${named ?? title(String(path.at(-1)))}</summary><${Help} schema=${schema} /><${Problem} form=${form} path=${path} />${children}
    </details>`;
}

/** Items that come and go: each is stated as in `item`. @param {PartProps & {item: Schema}} props */
function Entries({ form, schema, path, value, onValue, item, named }) {
  const list = Array.isArray(value) ? value : [], label = (named ?? title(String(path.at(-1)))).toLowerCase();
  const set = (/** @type {any[]} */ next) => onValue(next.length ? next : undefined);
  return html`
    <${Folded} form=${form} path=${path} schema=${schema} open=${list.length > 0} named=${named}>
      ${list.map((one, i) => html`
        <div class="entry" key=${`${i} of ${list.length}`}><${Part} form=${form} schema=${item} path=${[...path, i]} value=${one} required named=${`${i + 1}`} onValue=${(/** @type {any} */ given) => set(list.map((other, k) => (k === i ? given ?? {} : other)))} />
          <p><button type="button" onClick=${() => set(list.filter((_, k) => k !== i))}>Remove</button></p></div>`)}
      <button type="button" onClick=${() => set([...list, {}])}>Add to ${label}</button>
    <//>`;
}

/** Entries by name: the name is a field of its own. @param {PartProps & {item: Schema}} props */
function Named({ form, schema, path, value, onValue, item }) {
  const label = title(String(path.at(-1)));
  const pairs = useSignal(/** @type {[string, any][]} */ (Object.entries(value ?? {})));
  const set = (/** @type {[string, any][]} */ next) => { pairs.value = next; onValue(next.length ? Object.fromEntries(next) : undefined); };
  const object = shapeOf(form.root, item).kind !== "field";
  return html`
    <${Folded} form=${form} path=${path} schema=${schema} open=${pairs.value.length > 0}>
      ${pairs.value.map(([name, one], i) => html`
        <div class="entry" key=${`${i} of ${pairs.value.length}`}>
          <label class="stated"><span class="label">Name</span><input type="text" autocomplete="off" spellcheck=${false} value=${name} onInput=${(/** @type {any} */ event) => set(pairs.value.map((pair, k) => (k === i ? [event.target.value.trim(), pair[1]] : pair)))} /></label>
          <${Part} form=${form} schema=${object ? item : { ...item, type: "string", anyOf: undefined }} path=${[...path, name]} value=${one} required named=${object ? name || "Values" : "Value"} onValue=${(/** @type {any} */ given) => set(pairs.value.map((pair, k) => (k === i ? [pair[0], given ?? (object ? {} : "")] : pair)))} />
          <p><button type="button" onClick=${() => set(pairs.value.filter((_, k) => k !== i))}>Remove</button></p>
        </div>`)}
      <button type="button" onClick=${() => set([...pairs.value, ["", object ? {} : ""]])}>Add to ${label.toLowerCase()}</button>
    <//>`;
}

/** One of several kinds of object, which their key `kind` tells apart. @param {PartProps & {kinds: Schema[]}} props */
function OneOf({ form, schema, kinds, path, value, onValue, named }) {
  const of = alternativeOf(kinds, value);
  return html`
    <fieldset class="group" data-key=${keyOf(path)}><legend>${named ?? title(String(path.at(-1)))}</legend><${Help} schema=${schema} />
      <label class="stated"><span class="label">Kind, required</span><select value=${value?.kind ?? ""} onChange=${(/** @type {any} */ event) => { form.touched(keyOf(path)); onValue(event.target.value ? { kind: event.target.value } : {}); }}>
        <option value="" selected=${!of}>choose</option>${kinds.flatMap(kindWords).map((word) => html`<option value=${word} selected=${word === value?.kind}>${word}</option>`)}</select></label>
      <${Problem} form=${form} path=${path} />
      ${of && html`<${Group} key=${value.kind} form=${form} schema=${of} path=${path} value=${value} onValue=${onValue} without="kind" />`}
    </fieldset>`;
}

/** A word, or instead of it an object. @param {PartProps & {kinds: Schema[]}} props */
function TextOrGroup({ form, schema, kinds, path, value, onValue, required }) {
  const other = useSignal(value !== null && typeof value === "object"), about = (kinds[0].description ?? "").replace(/\.$/, "");
  const texts = [...(schema.anyOf ?? schema.oneOf ?? [])].map((one) => resolved(form.root, one)).filter((one) => one.type !== "null" && !one.properties);
  return html`
    <div class="entry" data-key=${keyOf(path)}>
      <label class="check"><input type="checkbox" checked=${other.value} onChange=${(/** @type {any} */ event) => { other.value = event.target.checked; form.touched(keyOf(path)); onValue(other.value ? {} : undefined); }} /> ${title(String(path.at(-1)))}: ${about.charAt(0).toLowerCase()}${about.slice(1)}</label>
      ${other.value ? html`<${Group} form=${form} schema=${kinds[0]} path=${path} value=${value} onValue=${onValue} /><${Problem} form=${form} path=${path} />`
        : html`<${Field} form=${form} schema=${{ ...schema, type: texts.every((one) => one.type === "string" && !one.const) ? "string" : undefined }} kinds=${texts} path=${path} value=${value} required=${required} onValue=${onValue} />`}
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
  const group = html`<${Group} form=${form} schema=${own} path=${path} value=${value} onValue=${onValue} required=${required} />`;
  if (!required && (path.length === 1 || (own.required ?? []).length)) return html`<${Folded} form=${form} path=${path} schema=${own} open=${value !== undefined} named=${named}>${group}<//>`;
  return html`<fieldset class="group" data-key=${keyOf(path)}><legend>${named ?? title(String(path.at(-1)))}</legend><${Help} schema=${own} />${group}</fieldset>`;
}
