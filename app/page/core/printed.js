// What commands print with --json, as far as the page reads it.

/** @typedef {import("answers").ShownResult} Shown */
/**
 * Of `analyse` a result; of `plan` the file that was made and what was said of it; of `positions keep` what was
 *   refused, is to be
 * looked at or stated; of `export` its notes.
 * @typedef {Omit<Shown, "inputs"> & {
 *   inputs: NonNullable<Shown["inputs"]> & {header: {provenance?: Record<string, string>}},
 *   plan: string | null, said: string[], removed: string | null, notes: string[],
 *   converted: boolean, files: {file: string}[], refused: Line[], listed: Line[], to_state: string[]}} Printed
 * @typedef {{name: string, offsets: import("answers").BriefOffset[]}} ComparedRun
 * @typedef {{verdict: string, headline: string, notes: string[], runs: ComparedRun[],
 *   offsets: {name: string, unit: string, ratio: number | null}[]}} Comparison of `compare`
 * @typedef {{file: string, line: number, sentence: string, accepted?: boolean}} Line
 */

export {};
