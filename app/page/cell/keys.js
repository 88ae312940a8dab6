// A value inside the plan, by its key, and how it is changed; what the server finds wrong stands at the value.
import { change, plan, wrong } from "../core/editing.js";

/** @typedef {(string | number)[]} Key */

/** @param {any} content @param {Key} key */
const valueAt = (content, key) => key.reduce((value, part) => (value === undefined || value === null ? undefined : value[part]), content);

/** The value of the plan that is open. @param {Key} key */
export const stated = (key) => valueAt(plan.value, key);

/** States a value; undefined takes it away. @param {Key} key @param {unknown} value */
export const state = (key, value) => change(key.join("/"), (content) => {
  let inside = /** @type {any} */ (content);
  for (const part of key.slice(0, -1)) inside = inside[part] ??= {};
  const last = /** @type {string | number} */ (key.at(-1));
  if (value === undefined || value === null) delete inside[last];
  else inside[last] = value;
});

/** What is wrong with a value, or inside it; "" where nothing is. @param {Key} key */
export function problemAt(key) {
  const found = wrong.value;
  if (!found) return "";
  const at = found.key.slice(found.key[0] === "plan" ? 1 : 0);
  return key.every((part, i) => String(at[i]) === String(part)) ? found.text : "";
}
