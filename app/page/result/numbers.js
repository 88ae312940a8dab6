// Numbers of a result as its report rounds them; what is not determined has none.
import { rounded, spread, withUnit } from "../core/words.js";

/** @typedef {{estimate: number | null, std: number | null, unit: string, status: string, held?: boolean}} Estimated */

/** To the second digit of its expanded uncertainty. @param {Estimated} row @param {number} k */
export function estimateOf(row, k) {
  if (row.estimate === null) return "not determined";
  if (row.held) return `held at ${withUnit(String(row.estimate), row.unit)}`;
  return row.std === null ? withUnit(String(row.estimate), row.unit) : rounded(row.estimate, k * row.std, row.unit);
}

/** @param {Estimated} row @param {number} k */
export const expandedOf = (row, k) =>
  (row.std === null || row.status === "unvalidated" ? "—" : spread(k * row.std, row.unit));
