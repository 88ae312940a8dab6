// The format of an import, and what it may be told besides columns: formats and options are those of the makers'
// readers, as the server has them.
import { computed, signal } from "@preact/signals";
import { formsOf, missingOf, wordsOf } from "../parts/Fields.js";
import { recordings } from "./sources.js";

/** @typedef {import("./sources.js").Found} Found */

export const format = signal("");
export const values = signal(/** @type {import("../parts/Fields.js").Values} */ ({}));
/** @param {string} key @param {string} value */
export function set(key, value) { values.value = { ...values.value, [key]: value }; }

/** @param {string} next */
export function setFormat(next) {
  if (next !== format.value) values.value = {};
  format.value = next;
}

/** @param {string} name */
const formOf = (name) => formsOf("import")?.find((one) => one.name === name);
/** What a format is. @param {string} name */
export const aboutOf = (name) => formOf(name)?.label ?? name;

/**
 * The formats that files may have: the first is taken, unless the person has to say which ("" first).
 * @param {Found[]} founds
 */
export function formatsOf(founds) {
  const kinds = [...new Set(founds.map((found) => found.form))];
  const all = [...new Set(founds.flatMap((found) => found.formats))];
  // A table beside points is that of their joints.
  if (kinds.includes("points") && kinds.every((form) => form === "points" || form === "csv")) return ["points"];
  return kinds.length === 1 && (all.length === 1 || all.includes(kinds[0])) ? all : ["", ...all];
}

/** What the format may be told; joint states in text have no times, and points of a plan say what they are. */
export const fields = computed(() => {
  const all = formOf(format.value)?.fields ?? [], found = recordings.value[0]?.found;
  if (found?.form === "joint states") return all.filter((one) => one.flag === "--columns");
  return all.filter((one) => one.kind !== "names" || found?.points.length);
});
/** What must be stated before the import, in words; null where all is. */
export const open = computed(() => {
  const label = missingOf(fields.value, values.value);
  return label && `state: ${label}`;
});
export const optionWords = computed(() => wordsOf(fields.value, values.value));
