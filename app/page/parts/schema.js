// A JSON Schema as a form reads it: what a key is, what is missing, and where an error belongs.
import { capital } from "../core/words.js";

/**
 * @typedef {{$ref?: string, $defs?: Record<string, Schema>, description?: string, type?: string,
 *   properties?: Record<string, Schema>, required?: string[], items?: Schema, prefixItems?: Schema[],
 *   additionalProperties?: Schema | boolean, anyOf?: Schema[], oneOf?: Schema[], enum?: string[], const?: string,
 *   default?: unknown}} Schema
 * @typedef {(string | number)[]} Path
 * @typedef {{kind: "field" | "group" | "text or group" | "one of" | "list" | "named", schema: Schema,
 *   kinds: Schema[]}} Shape
 *   `kinds`: the alternatives that are objects, or, of a field, all of them
 */

/** @param {Schema} root @param {Schema} schema @returns {Schema} */
export function resolved(root, schema) {
  const own = schema.$ref ? { ...root.$defs?.[schema.$ref.split("/").at(-1) ?? ""], ...schema } : schema;
  const several = alternatives(own);
  return several.length === 1 ? { ...resolved(root, several[0]), description: own.description } : own;
}

/** @param {Schema} schema */
const alternatives = (schema) => (schema.anyOf ?? schema.oneOf ?? []).filter((one) => one.type !== "null");

/** @param {Schema} root @param {Schema} schema @returns {Shape} */
export function shapeOf(root, schema) {
  const own = resolved(root, schema), kinds = alternatives(own).map((one) => resolved(root, one));
  const objects = kinds.filter((kind) => kind.properties);
  if (objects.length > 1) return { kind: "one of", schema: own, kinds: objects };
  if (objects.length) return { kind: "text or group", schema: own, kinds: objects };
  if (own.properties) return { kind: "group", schema: own, kinds };
  if (own.type === "object") return { kind: "named", schema: own, kinds };
  if (own.type === "array" && own.items && resolved(root, own.items).properties) {
    return { kind: "list", schema: own, kinds };
  }
  return { kind: "field", schema: own, kinds };
}

/** The words that `kind` may be in an alternative. @param {Schema} schema @returns {string[]} */
export const kindWords = (schema) => {
  const kind = schema.properties?.kind;
  return kind?.enum ?? (kind?.const ? [kind.const] : []);
};

/** @typedef {Record<string, unknown>} Part an object that is stated */
/** Such an object; one without keys for all else. @param {unknown} value @returns {Part} */
export const partOf = (value) => (isPart(value) ? /** @type {Part} */ (value) : {});
/** @param {unknown} value */
const isPart = (value) => value !== null && typeof value === "object";

/** The alternative that a value is of. @param {Schema[]} kinds @param {unknown} value */
export const alternativeOf = (kinds, value) =>
  kinds.find((kind) => kindWords(kind).includes(String(partOf(value).kind)));

/** What is entered by name, or item by item. @param {Schema} root @param {Schema} schema */
export const itemOf = (root, schema) =>
  resolved(root, schema.items ?? (typeof schema.additionalProperties === "object" ? schema.additionalProperties : {}));

/**
 * All places of a form, with whether something must be stated there that is not.
 * @param {Schema} root @param {Schema} schema @param {unknown} value @param {Path} path @param {boolean} required
 * @returns {{path: Path, missing: boolean}[]}
 */
export function places(root, schema, value, path = [], required = true) {
  const { kind, schema: own, kinds } = shapeOf(root, schema), here = { path, missing: false };
  const keys = (/** @type {Schema} */ of) => Object.entries(of.properties ?? {}).filter(([key]) => key !== "schema")
    .flatMap(([key, one]) => places(root, one, partOf(value)[key], [...path, key], (of.required ?? []).includes(key)));
  if (kind === "field" || (kind === "text or group" && !isPart(value))) {
    return [{ path, missing: required && value === undefined }];
  }
  if (kind === "text or group") return [here, ...keys(kinds[0])];
  if (kind === "one of") {
    const of = alternativeOf(kinds, value);
    return [{ path, missing: !of }, ...(of ? keys(of) : [])];
  }
  if (kind === "group") return [here, ...(required || value !== undefined ? keys(own) : [])];
  const entries = Object.entries(partOf(value));
  return [here,
    ...entries.flatMap(([key, one]) =>
      places(root, itemOf(root, own), one, [...path, kind === "list" ? Number(key) : key], true))];
}

/**
 * The innermost place of a form that a key leads to; "" where none does.
 * @param {Schema} root @param {unknown} value @param {Path} path
 */
export function nearest(root, value, path) {
  const at = keyOf(path), all = places(root, root, value).map((one) => keyOf(one.path));
  return all.filter((key) => key && (at === key || at.startsWith(`${key}/`))).sort((a, b) => b.length - a.length)[0]
    ?? "";
}

/** The key of a place in one word. @param {Path} path */
export const keyOf = (path) => path.join("/");

/** @param {string} key */
export const title = (key) => capital(key.replace(/_(mm|deg|kg)$/, "").replaceAll("_", " "));

/** @type {Record<string, string>} */
const UNITS = { mm: "mm", deg: "°", kg: "kg" };
/** @param {string} key */
export const unitOf = (key) => UNITS[key.match(/(?:^|_)(mm|deg|kg)$/)?.[1] ?? ""] ?? "";
