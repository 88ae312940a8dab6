// What the server says of recordings, columns and headers.

/** @typedef {{name: string, stated: string, lowest: number | null, highest: number | null, other: string | null, line: number | null}} TableColumn */
/** @typedef {{header_row: boolean, delimiter: string, decimal: string, why: string[]}} TableLayout */
/**
 * @typedef {{file: string, bytes: number, form: string, why: string, count: string, formats: string[], layout: TableLayout | null, columns: TableColumn[],
 *   rows: number, whole: boolean, points: {name: string, joints: boolean}[], topics: {name: string, type: string, messages: number, joints: string[]}[],
 *   names: string[], kind: string}} Found
 */
/** @typedef {{flag: string, help: string, choices: string[], file: boolean, box: boolean, number: boolean, required: boolean, default: string | null}} FormatOption */
/** @typedef {{name: string, about: string, maker: string, files: string, options: FormatOption[]}} ImportForm */
/** @typedef {{choice: string | null, decided: boolean, why: string, outside: Record<string, number>}} Reading */
/**
 * @typedef {{name: string, unit: string, lower: number, upper: number, recorded: [number, number] | null, seen: [number, number] | null,
 *   outside: number | null, sign: Reading | null}} JointColumn
 * @typedef {{robot: string, rows: number, whole: boolean, joints: JointColumn[], columns: {choice: string[], why: string} | null,
 *   units: Reading | null, lengths: Reading | null, j3: Reading | null, first: (number | null)[][]}} ColumnsAnswer
 */
/** @typedef {{path: string, found: Found | null, fault: string, busy: boolean, taken: {content: Blob, name: string} | null}} Row */
/** @typedef {{file: string, header: any, target: string, notes: string[], plan: boolean}} ChosenHeader */

export {};
