// What a plan states of instrument, noise, geometry and constraints, as the schema of its file has it: names,
// descriptions, usual values and what need not be stated.
import { html } from "htm/preact";
import { useEffect } from "preact/hooks";
import { signal } from "@preact/signals";
import { get } from "../core/api.js";
import { change, plan, wrong } from "../core/editing.js";
import { failed } from "../core/store.js";
import { nearest, resolved } from "../parts/schema.js";
import { Group } from "../parts/StatedParts.js";

/** @typedef {import("../parts/schema.js").Schema} Schema */

const known = signal(/** @type {Schema | null} */ (null));

/** @param {{keys: string[]}} props keys of the plan's file */
export function Stated({ keys }) {
  useEffect(() => {
    if (known.value === null) get("/api/plan/schema").then((found) => { known.value = found; }, failed);
  }, []);
  const root = known.value, content = plan.value;
  if (root === null || content === null) return html`<p class="muted">…</p>`;
  const of = (/** @type {string} */ key) => {
    const own = resolved(root, root.properties?.[key] ?? {}), { obstacles, ...others } = own.properties ?? {};
    return obstacles ? { ...own, properties: others } : own; // which have a form of their own
  };
  const schema = { properties: Object.fromEntries(keys.map((key) => [key, of(key)])), required: root.required };
  const near = wrong.value?.key[0] === "plan" ? nearest(root, content, wrong.value.key.slice(1)) : "";
  let at = "";
  const form = { root, errors: near ? { [near]: wrong.value?.text ?? "" } : {}, lists: {}, live: true,
    touched: (/** @type {string} */ key) => { at = key; } };
  const stated = (/** @type {Record<string, unknown>} */ next) => change(at || null, (edited) => {
    Object.assign(edited, Object.fromEntries(keys.map((key) => [key, next[key]])));
    for (const key of keys) if (next[key] === undefined) delete edited[/** @type {"tool"} */ (key)];
  });
  return html`<${Group} form=${form} schema=${schema} path=${[]} value=${content} onValue=${stated} />`;
}
