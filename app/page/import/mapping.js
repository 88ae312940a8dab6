// Which column of a table is which joint, with what unit and sign, against the limits of the joints.
import { computed, effect, signal } from "@preact/signals";
import { latest, post, Refused } from "../core/api.js";
import { chosen } from "./header.js";
import { format } from "./formats.js";
import { lookAgain, recordings } from "./sources.js";

/** @typedef {import("answers").ColumnsAnswer} ColumnsAnswer */
/**
 * @typedef {{columns: (string | null)[] | null, units: string, lengths: string, reversed: number[], j3: string}} Mapped
 */

/** @type {Mapped} */
const EMPTY = { columns: null, units: "", lengths: "", reversed: [], j3: "" };

/** Where they were stated otherwise than found: header_row, delimiter, decimal. */
export const layout = signal(/** @type {{header_row?: boolean, delimiter?: string, decimal?: string}} */ ({}));
export const mapped = signal(/** @type {Mapped} */ (EMPTY));
export const answer = signal(/** @type {ColumnsAnswer | null} */ (null));
export const wrong = signal(/** @type {Refused | null} */ (null));

/** What the columns are asked of; null where there is no table to map. */
const source = computed(() => {
  const header = chosen.value, tables = recordings.value;
  if (format.value !== "csv" || header === null || !tables.length) return null;
  return { files: tables.map((row) => row.path), robot: header.header.robot, beside: header.file,
    columns: tables[0].found?.columns ?? [] };
});

const ask = latest(
  () => source.peek(),
  async () => {
    const asked = source.peek(), { columns, units, lengths, reversed, j3 } = mapped.peek();
    if (asked === null) return null;
    const { files, robot, beside } = asked;
    return post("/api/columns", { files, robot, beside, ...layout.peek(), ...(columns ? { columns } : {}),
      units: units || null, lengths: lengths || null, reversed_joints: reversed, j3: j3 || null });
  },
  (found) => {
    wrong.value = null;
    answer.value = found;
    if (mapped.value.columns === null) mapped.value = { ...mapped.value, columns: found.joints.map(() => null) };
  },
  (error) => {
    wrong.value = error;
    if (error.key[0] !== "columns") answer.value = null;
  },
);

// What was stated for another robot or other columns is dropped.
let last = "";
effect(() => {
  const now = source.value;
  if (now === null) return;
  const of = JSON.stringify([now.columns, now.robot]);
  if (of !== last) {
    mapped.value = EMPTY;
    answer.value = null;
  }
  last = of;
  ask();
});

/** @param {Partial<Mapped>} more */
export function map(more) {
  mapped.value = { ...mapped.peek(), ...more };
  ask();
}

/** @param {number} joint @param {string | null} column */
export const mapColumn = (joint, column) =>
  map({ columns: (mapped.peek().columns ?? []).map((one, i) => (i === joint ? column : one)) });

/** @param {number} joint from 1 @param {boolean} on */
export const reverse = (joint, on) =>
  map({ reversed: [...mapped.peek().reversed.filter((other) => other !== joint), ...(on ? [joint] : [])].sort((a, b) =>
    a - b) });

/** @param {number} a @param {number} b from 1 */
export function swap(a, b) {
  const columns = [...(mapped.peek().columns ?? [])];
  [columns[a - 1], columns[b - 1]] = [columns[b - 1], columns[a - 1]];
  map({ columns });
}

/**
 * The tables are read anew, as they are stated to be laid out.
 * @param {Partial<{header_row: boolean, delimiter: string, decimal: string}>} more
 */
export async function layOut(more) {
  layout.value = { ...layout.peek(), ...more };
  try {
    await Promise.all(recordings.peek().map((row) => lookAgain(row, layout.peek())));
  } catch (error) {
    if (!(error instanceof Refused)) throw error;
    wrong.value = error;
  }
}

/** The words that say so to the command. */
export const mapperWords = computed(() => {
  const own = recordings.value[0]?.found?.layout, { columns, units, lengths, reversed, j3 } = mapped.value;
  return [
    ...(layout.value.delimiter && own ? [`--delimiter=${own.delimiter}`] : []),
    ...(own && own.decimal !== "." ? [`--decimal=${own.decimal}`] : []),
    ...(own?.header_row ? ["--header-row"] : []),
    ...(units ? [`--units=${units}`] : []),
    ...(lengths ? [`--lengths=${lengths}`] : []),
    ...(columns ? [`--columns=${columns.join(",")}`] : []),
    ...(reversed.length ? [`--reversed=${reversed.map((n) => `j${n}`).join(",")}`] : []),
    ...(j3 ? [`--j3=${j3}`] : []),
  ];
});

/** What is not stated yet, in words; null where all is. */
export const openMapping = computed(() => {
  const { columns, units, lengths } = mapped.value, joints = answer.value?.joints ?? [];
  if (!columns || columns.some((column) => column === null)) return "state the column of each joint";
  if (joints.some((joint) => joint.unit === "deg") && !units) return "state the unit of the angles";
  if (joints.some((joint) => joint.unit === "mm") && !lengths) return "state the unit of the prismatic joints";
  return null;
});
