// What the server says of recordings, columns and headers, by its own records.

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

export {};
