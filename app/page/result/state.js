// The result that is open, and what is done with it: measurements left out, draws chosen.
import { batch, signal } from "@preact/signals";
import { get, getFile, latest, post, Refused } from "../core/api.js";
import { refresh, say } from "../core/store.js";
import { named } from "../core/words.js";

/** @typedef {import("answers").Refit} Refit */
/**
 * @typedef {{answer: import("../core/jobs.js").Printed | null, front: string | null}} Analysis a job that has ended
 */

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

export const open = signal(/** @type {Found | null} */ (null));
/** A run that has no report yet; "" where none is open. */
export const bareRun = signal("");
export const failure = signal("");
/** The file that all this is of. */
export const shown = signal("");
export const history = signal(/** @type {import("answers").FolderHistory | null} */ (null));

/** Measurements that are left out. */
export const out = signal(/** @type {number[]} */ ([]));
/** The measurement whose shift is shown. */
export const single = signal(/** @type {number | null} */ (null));
export const refitted = signal(/** @type {Refit | null} */ (null));
export const shift = signal(/** @type {Refit | null} */ (null));
export const refitFault = signal("");

export const posterior = signal(/** @type {import("answers").PosteriorDraws | null} */ (null));
export const posteriorSays = signal("");
export const ranges = signal(/** @type {Ranges} */ ({}));
export const brushed = signal(/** @type {import("answers").Brushed | null} */ (null));
export const brushFault = signal("");

/** Analyses of runs without a report, by run file. @type {Map<string, Found>} */
const analyses = new Map();

function clear() {
  open.value = refitted.value = shift.value = posterior.value = brushed.value = null;
  bareRun.value = failure.value = refitFault.value = posteriorSays.value = brushFault.value = "";
  out.value = [];
  single.value = null;
  ranges.value = {};
}

/** What `analyse` printed, as the page shows a result. @param {Analysis} job @param {string} run @returns {Found} */
function analysisOf({ answer, front }, run) {
  const none = { file: "", report: null, posterior_file: null, files: [],
    posterior: { converged: false, message: "The posterior is drawn with the report." } };
  return /** @type {Found} */ (/** @type {unknown} */ ({ ...answer, ...none, front, run,
    origin: answer?.inputs.header.provenance ?? {} }));
}

/**
 * An analysis is there without being made again, as long as the page is open.
 * @param {Analysis} job @param {string} run
 */
export const keepAnalysis = (job, run) => { analyses.set(run, analysisOf(job, run)); };

/** @param {string} file @param {boolean} isRun */
export async function show(file, isRun) {
  batch(() => { clear(); shown.value = file; });
  try {
    if (isRun) {
      bareRun.value = file;
      open.value = analyses.get(file) ?? null;
      if (open.value) warm(open.value);
      return;
    }
    const found = /** @type {Found} */ (await getFile("result", file));
    if (shown.value !== file) return; // another is looked at by now
    open.value = found;
    warm(found);
    await draws(found);
  } catch (error) {
    if (!(error instanceof Refused)) throw error;
    if (shown.value === file) failure.value = error.text;
  }
}

/** @param {Analysis} job @param {string} run */
export function showAnalysis(job, run) {
  keepAnalysis(job, run);
  if (bareRun.value !== run) return;
  open.value = analyses.get(run) ?? null;
  if (open.value) warm(open.value);
}

export async function loadHistory() {
  history.value = await get("/api/history");
}

/** The first fit takes longest: it is made before anybody waits for it. @param {Found} found */
function warm(found) {
  if (found.run === null) return;
  post("/api/refit", { run: found.run }).catch((error) => {
    if (!(error instanceof Refused)) throw error;
    if (open.value === found) refitFault.value = error.text;
  });
}

/** @param {Found} found */
async function draws(found) {
  const unknown = found.parameters.filter((row) => row.group === "offset" && row.status === "unidentifiable")
    .map((row) => named(row.name));
  const them = unknown.length === 1 ? "it" : "them";
  const why = `${unknown.join(", ")}: prior only, the measurements do not determine ${them}; not drawn.`;
  const lines = unknown.length ? [why] : [];
  if (found.posterior_file === null) {
    lines.push(found.posterior.message ?? "There is no posterior.nc beside this result.");
  } else {
    const drawn = await getFile("posterior", found.posterior_file);
    if (open.value !== found) return;
    if (!drawn.converged) lines.push(`No posterior is shown: ${found.posterior.message ?? "it has not converged"}`);
    else if (!drawn.names.length) lines.push("The measurements determine no offset: there is nothing to draw.");
    else lines.push(`${drawn.draws[0].length} of ${drawn.total} draws.`);
    posterior.value = drawn.converged && drawn.names.length ? drawn : null;
  }
  posteriorSays.value = lines.map(named).join(" ");
}

const refit = latest(
  () => open.value,
  async () => {
    const found = open.value, without = out.value, alone = single.value;
    if (found?.run == null || (!without.length && alone === null)) return null;
    const of = { run: found.run };
    return { alone: alone === null ? null : await post("/api/refit", { ...of, without: [alone] }),
      whole: without.length ? await post("/api/refit", { ...of, without }) : null };
  },
  ({ whole, alone }) => batch(() => {
    if (!out.value.length && single.value === null) return;
    refitted.value = whole;
    shift.value = alone ?? whole;
    refitFault.value = "";
    const { without, verdict, lost } = /** @type {Refit} */ (alone ?? whole);
    const gone = lost.length ? `, no longer determined: ${lost.map(named).join(", ")}` : "";
    say(`Without measurement ${without.join(", ")}: ${verdict}${gone}`);
  }),
  (error) => batch(() => {
    refitted.value = shift.value = null;
    refitFault.value = error.text;
  }),
);

function change() {
  refitFault.value = "";
  if (!out.value.length) refitted.value = null;
  if (!out.value.length && single.value === null) { shift.value = null; return; }
  refit();
}

/** Leaves these measurements out, and no others. @param {number[]} shots */
export function leaveOutThese(shots) {
  out.value = [...shots].sort((a, b) => a - b);
  single.value = null;
  change();
}

/** @param {number} shot @param {boolean} on */
export const leaveOut = (shot, on) =>
  leaveOutThese([...out.value.filter((other) => other !== shot), ...(on ? [shot] : [])]);

/**
 * Writes the run without what is left out as a new file.
 * @param {string} run @param {number[]} without @returns {Promise<string>} the file
 */
export async function saveWithout(run, without) {
  const { file } = await post("/api/runs", { run, without });
  await Promise.all([refresh(), loadHistory()]);
  return file;
}

/** @param {number | null} shot */
export function showShift(shot) {
  single.value = shot;
  change();
}

const brush = latest(
  () => open.value,
  async () => {
    const found = open.value;
    return found?.run && found.posterior_file && Object.keys(ranges.value).length
      ? post("/api/brush", { posterior: found.posterior_file, run: found.run, ranges: ranges.value }) : null;
  },
  (answer) => { if (Object.keys(ranges.value).length) brushed.value = answer; },
  (error) => { brushFault.value = error.text; },
);

/** Chooses draws by ranges of parameters; {}: none. @param {Ranges} next */
export function chooseDraws(next) {
  ranges.value = next;
  brushFault.value = "";
  if (!Object.keys(next).length) { brushed.value = null; return; }
  if (open.value?.run != null) brush();
  else brushFault.value = "The run of this result is not in the folder: its residuals cannot be computed.";
}
