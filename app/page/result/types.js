// What the server says of results.

/** @typedef {import("../parts/Message.js").MessageFacts} MessageFacts */
/** @typedef {import("../parts/Message.js").ActionFacts} ActionFacts */
/** @typedef {[number, number, number]} Vec */
/**
 * @typedef {{name: string, unit: string, group: string, status: string, held: boolean, estimate: number | null, std: number | null,
 *   interval95: [number, number] | null, prior_std: number | null, reason: string | null}} ParameterRow
 * @typedef {ParameterRow & {before: ParameterRow}} RefitRow
 * @typedef {{shot: number, target: string, whitened: number, leave_one_out: number | null, cooks: number | null}} ShotRow
 * @typedef {{steps: {text: string, commands: string[]}[]}} NextSteps
 */
/**
 * A result, or an analysis of which no report was written (`file` is "").
 * @typedef {{file: string, run: string | null, report: string | null, posterior_file: string | null, files: {path: string, bytes: number}[], verdict: string, message: MessageFacts | null,
 *   action?: ActionFacts | null, front: string | null, coverage_factor: number, headline: string, posterior: {converged: boolean | null, message: string | null}, notes: string[], next_steps: NextSteps | null,
 *   misfit: {criteria: {sentence: string}[]} | null, diagnosis: {sentence: string}[], parameters: ParameterRow[], shots: ShotRow[],
 *   inputs: {run: string, sha256: string, robot: string, shots: number, targets: string[], versions: Record<string, string>},
 *   origin: {serial?: string, when?: string, who?: string, instrument?: string, origin?: string},
 *   arm?: any, tcp?: {before: number, after: number} | null, tcp_map?: {at: Vec, before: Vec | null, after: Vec | null}[] | null, tcp_why?: string | null,
 *   residuals?: {shot: number, at: Vec, size_mm: number, whitened: number}[] | null, skeletons?: Vec[][] | null, marks?: any[] | null}} Found
 */
/** @typedef {{without: number[], measurements: number, of: number, verdict: string, verdict_before: string, headline: string, coverage_factor: number, parameters: RefitRow[], lost: string[], null_space: {reason: string, remedy: string}[], misfit: string[]}} Refit */
/** @typedef {{file: string, converged: boolean, total: number, names: string[], units: string[], draws: number[][], prior_only: string[]}} Posterior */
/** @typedef {{draws: number, chosen: number, shots: {shot: number, all: number, chosen: number}[], reason: string | null}} Brushed */
/** @typedef {Record<string, [number, number]>} Ranges of parameters, by name */
/** @typedef {{name: string, unit: string, status: string, estimate: number | null, std: number | null}} BriefOffset */
/** @typedef {{file: string, verdict?: string, grade?: string, words?: string, offsets?: BriefOffset[], error?: string}} BriefResult */
/** @typedef {{file: string, robot?: string, serial?: string, when?: string, who?: string, instrument?: string, origin?: string, error?: string, results: BriefResult[]}} BriefRun */
/** @typedef {{runs: BriefRun[], results: BriefResult[], left_out: number}} History */

export {};
