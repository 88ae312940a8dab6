// The recordings of an import: sent to the folder or chosen there, what each is, and the calibration that they become.
import { computed, signal } from "@preact/signals";
import { post, Refused, upload } from "../core/api.js";
import { files, freeName, inside, refresh, say } from "../core/store.js";

/** @typedef {import("answers").RecordingAnswer} Found */
/**
 * @typedef {{path: string, found: Found | null, fault: string, busy: boolean, taken: {content: Blob, name: string} |
 *   null}} Row
 */
/** @typedef {Pick<import("answers").PlanFile, "robot" | "tool" | "instruments" | "noise" | "targets">} HeaderContent */
/**
 * @typedef {Omit<import("answers").ReadHeader, "header"> & {header: HeaderContent, plan: boolean}} ChosenHeader
 *   `plan`: it is that of a plan
 */

export const rows = signal(/** @type {Row[]} */ ([]));
/** A calibration of the folder; "": a new one. */
export const into = signal("");
/** The name of the new one, as it is typed. */
export const name = signal("");
/** Why the name of the new one is refused. */
export const nameWrong = signal("");
/** Folders that this import has made. */
const made = signal(/** @type {string[]} */ ([]));

/** What can be imported, without what is ours. */
export const recordings = computed(() => rows.value.filter((row) => row.found !== null && row.found.form !== "ours"));

/** A name that no calibration and no folder has, after the first recording. */
export const proposed = computed(() => {
  const first = rows.value[0]?.path ?? "";
  const stem = first.replace(/^.*\//, "").replace(/\.[^.]*$/, "").replace(/[\\/]/g, "-").replace(/^\.+/, "")
    || "recording";
  return freeName(stem);
});

/** The folder that the run is written to. */
export const folder = computed(() => into.value || name.value.trim() || proposed.value);

/** Makes the folder of a new calibration, once. @returns {Promise<string>} */
export async function ensureFolder() {
  const to = folder.value;
  if (to === "." || into.value || made.value.includes(to)) return to;
  nameWrong.value = "";
  try {
    await post("/api/folders", { name: to });
  } catch (error) {
    if (error instanceof Refused) nameWrong.value = error.text;
    throw error;
  }
  made.value = [...made.value, to];
  name.value = to;
  return to;
}

/** @param {Row} row @param {Partial<Row>} more */
function change(row, more) {
  rows.value = rows.value.map((one) => (one === row ? Object.assign(row, more) : one));
}

/** @param {Row} row */
async function look(row) {
  change(row, { busy: true });
  try {
    change(row, { found: await post("/api/recording", { file: row.path }), fault: "", busy: false });
    say(`${row.path}: ${row.found?.count}`);
  } catch (error) {
    if (!(error instanceof Refused)) throw error;
    change(row, { fault: error.text, busy: false });
  }
}

/** Looks at a table again, as it is stated to be laid out. @param {Row} row @param {Record<string, unknown>} layout */
export async function lookAgain(row, layout) {
  change(row, { found: await post("/api/recording", { file: row.path, ...layout }) });
}

/** @param {string} path @returns {Row} */
function added(path) {
  const row = { path, found: null, fault: "", busy: true, taken: null };
  rows.value = [...rows.value, row];
  return row;
}

/** A file of the folder: what lies in a folder below it is imported there. @param {string} path */
export async function choose(path) {
  if (rows.value.some((row) => row.path === path)) return;
  const at = path.lastIndexOf("/");
  if (at > 0 && !rows.value.length && !into.value && !name.value) into.value = path.slice(0, at);
  await look(added(path));
}

/** Sends a file under a name. @param {Row} row @param {Blob} content @param {string} as */
export async function send(row, content, as) {
  change(row, { busy: true, fault: "" });
  try {
    const done = await upload(as, content);
    change(row, { path: done.file, taken: null });
    await refresh();
    await look(row);
  } catch (error) {
    if (!(error instanceof Refused)) throw error;
    change(row, { busy: false, fault: error.text, taken: { content, name: as } });
  }
}

/** Sends files: one whose name is taken waits for another name. @param {File[]} contents */
export async function take(contents) {
  const waiting = contents.map((content) => ({ content, row: added(content.name) }));
  for (const { content, row } of waiting) {
    try {
      const path = inside(await ensureFolder()) + content.name;
      change(row, { path });
      if (files.value.some((file) => file.path === path)) change(row,
        { busy: false, taken: { content, name: freeName(path) } });
      else await send(row, content, path);
    } catch (error) {
      if (!(error instanceof Refused)) throw error;
      change(row, { busy: false, fault: error.text, taken: { content, name: content.name } });
    }
  }
}

/** Uses the file of the folder instead of the one that was to be sent. @param {Row} row */
export function useExisting(row) {
  change(row, { taken: null, fault: "" });
  return look(row);
}

/** @param {Row} row */
export function leaveOut(row) {
  rows.value = rows.value.filter((other) => other !== row);
}
