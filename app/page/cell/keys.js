// A value inside the plan, by its key, and how it is changed; what the server finds wrong stands at the value.
import { change, plan, wrong } from "../core/editing.js";

/** @typedef {(string | number)[]} Key */

/** @typedef {{[key: string]: unknown}} Part an object of a plan, or a list by its numbers */

/** The value of the plan that is open. @param {Key} key */
export const stated = (key) => key.reduce((value, part) => /** @type {Part | null | undefined} */ (value)?.[part],
  /** @type {unknown} */ (plan.value));

/**
 * States a value; undefined takes it away, and so does null, where the file does not state that (`nulls`).
 * @param {Key} key @param {unknown} value
 */
export const state = (key, value, nulls = false) => change(key.join("/"), (content) => {
  let inside = /** @type {Part} */ (/** @type {unknown} */ (content));
  for (const part of key.slice(0, -1)) inside = /** @type {Part} */ (inside[part] ??= {});
  const last = /** @type {string | number} */ (key.at(-1));
  if (value === undefined || (value === null && !nulls)) delete inside[last];
  else inside[last] = value;
});

/** What is wrong with a value, or inside it; "" where nothing is. @param {Key} key */
export function problemAt(key) {
  const found = wrong.value;
  if (!found) return "";
  const at = found.key.slice(found.key[0] === "plan" ? 1 : 0);
  return key.every((part, i) => String(at[i]) === String(part)) ? found.text : "";
}
