// The words of the import as a command: from files, header, format and targets.
import { computed, signal } from "@preact/signals";
import { freeName, inside } from "../core/store.js";
import { chosen } from "./header.js";
import { mapperWords, openMapping } from "./mapping.js";
import { format, open, optionWords, values } from "./formats.js";
import { folder, recordings } from "./sources.js";

/** What was typed of targets, by file. */
export const targets = signal(/** @type {Record<string, string>} */ ({}));
/** The run file as it was typed; "": a free name. */
export const outTyped = signal("");

/** The files that hold measurements: a table of joints beside points holds none. */
export const sources = computed(() =>
  recordings.value.filter((row) => format.value !== "points" || row.path !== values.value["--joints"]));
export const out = computed(() => outTyped.value.trim() || freeName(`${inside(folder.value)}run.jsonl`));

/** Why no target is stated for each file; "" where it is. */
export const noTargets = computed(() => {
  if (chosen.value?.plan) return "Targets are those of the plan.";
  if (format.value === "csv" && values.value["--target-column"]) return "The column names the target of each row.";
  return "";
});

/** The target of a file: as typed, or the header's only one. @param {string} path */
export function targetOf(path) {
  const usual = sources.value.length === 1 && format.value !== "points" && !values.value["--marker-topic"]
    ? chosen.value?.target ?? "" : "";
  return (targets.value[path] ?? usual).trim();
}

const word = (/** @type {string} */ file) => (file.startsWith("-") ? `./${file}` : file);
const quoted = (/** @type {string} */ one) => (/^[\w./=,:-]+$/.test(one) ? one : `'${one.replaceAll("'", "'\\''")}'`);

/**
 * The command, or what is still to be stated; null before files, header and format are there.
 * @type {import("@preact/signals").ReadonlySignal<{missing: string | null, words: string[], text: string} | null>}
 */
export const command = computed(() => {
  const header = chosen.value, of = sources.value;
  if (!header || !format.value || !of.length) return null;
  const names = noTargets.value ? [] : of.map((row) => targetOf(row.path));
  const left = names.every((name) => !name) && (Boolean(values.value["--marker-topic"]) || format.value === "points");
  const missing = (format.value === "csv" && openMapping.value) || open.value
    || (names.some((name) => !name) && !left
      ? "state the target of each file: the same name where it was at the same position" : null);
  const words = ["import", ...format.value.split(" "), ...(format.value === "csv" ? mapperWords.value : []),
    ...optionWords.value,
    `--${header.plan ? "plan" : "header"}=${word(header.file)}`,
    ...(left ? [] : names.map((name) => `--target=${name}`)), `--out=${out.value}`, ...of.map((row) => word(row.path))];
  return { missing, words, text: missing ? `Not complete: ${missing}.` : `zerobeam ${words.map(quoted).join(" ")}` };
});
