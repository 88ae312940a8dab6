// What the server says of results, by its own records.

/** @typedef {import("answers").ShownResult} Shown */
/**
 * @typedef {"verdict" | "headline" | "coverage_factor" | "posterior" | "notes" | "diagnosis" | "parameters" | "shots"
 *   | "inputs"} Always
 */
/**
 * A result, or an analysis of which no report was written (`file` is "").
 * @typedef {Omit<Shown, Always> & {[K in Always]: NonNullable<Shown[K]>}} Found
 */
/** @typedef {Record<string, [number, number]>} Ranges of parameters, by name */

export {};
