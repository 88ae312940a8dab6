// The import carried out: tried, written, tested by a fit, and then its result.
import { signal } from "@preact/signals";
import { begin, well } from "../core/jobs.js";
import { calibrationOf, goOn, route, toJob } from "../core/route.js";
import { Refused } from "../core/api.js";
import { home, refresh, say } from "../core/store.js";
import { keepAnalysis } from "../result/state.js";
import { command, out, outTyped } from "./command.js";
import { ensureFolder, folder } from "./sources.js";

/** @typedef {import("../core/jobs.js").Followed} Followed */
/** @typedef {import("answers").Explanation} Explanation */
/**
 * What an import came to: `understood` has how the files were read, `words` what was carried out, `written` the
 *   run ("" of a trial), `folder` its calibration;
 * `fit` is the answer of the test by a fit.
 * @typedef {{words: string, understood: string[], written: string, folder: string,
 *   fit: import("../result/state.js").Found | null}} Outcome
 */

export const outcome = signal(/** @type {Outcome | null} */ (null));
export const underWay = signal(/** @type {{job: Followed, title: string} | null} */ (null));
export const refusal = signal("");

/** Without the file that is written: whether what is stated has changed since. @param {string[]} words */
export const wordsOf = (words) => words.filter((word) => !word.startsWith("--out=")).join("\n");

/** @param {string[]} words @param {string} title */
async function done(words, title) {
  const job = await begin(words);
  underWay.value = { job, title };
  const ended = await job.ended;
  underWay.value = null;
  if (well(ended)) return ended;
  if (ended.state === "failed") refusal.value = ended.log.map((line) => line.trim()).join("; ").replace(/^error: /, "")
    || "the command failed";
  else say("Cancelled: nothing was written.");
  return null;
}

/** @param {() => Promise<void>} work */
async function refusable(work) {
  refusal.value = "";
  try {
    await work();
  } catch (error) {
    if (!(error instanceof Refused)) throw error;
    refusal.value = error.text;
  }
}

/** Says what the import would come to, or writes the run and tests it. @param {boolean} dry */
export const carryOut = (dry) => refusable(async () => {
  const asked = command.value;
  if (asked === null) return;
  if (asked.missing) { refusal.value = asked.text; return; }
  outcome.value = null;
  const { words } = asked, file = out.value, to = folder.value, from = route.value;
  await ensureFolder();
  const job = await done(dry ? [...words, "--dry-run"] : words, dry ? "Trying" : "Importing");
  if (job === null) return;
  outcome.value = { words: wordsOf(words), understood: job.log.map((line) => line.trim()), written: dry ? "" : file,
    folder: to, fit: null };
  if (dry) { say("Tried: nothing was written."); return; }
  outTyped.value = "";
  await refresh();
  await test(from);
});

/**
 * A fit tries what is often wrong with a recording; where it finds nothing, the result is shown.
 * @param {import("../core/route.js").Route} from
 */
async function test(from) {
  const imported = outcome.value;
  if (imported === null) return;
  const job = await done(["analyse", imported.written], "Testing unit, signs and order by a fit");
  if (job?.answer == null || outcome.value !== imported) return;
  outcome.value = { ...imported, fit: /** @type {Outcome["fit"]} */ (job.answer) };
  keepAnalysis(job, imported.written);
  if (!job.answer.diagnosis?.length) toResult(from);
}

/** @param {import("../core/route.js").Route} [from] where its reader was */
export function toResult(from = route.value) {
  const imported = outcome.value;
  if (imported === null) return;
  const { fit } = imported, name = calibrationOf(imported.written);
  const clear = "A fit contradicts neither unit nor signs nor order. "
    + "An error that changes no residual stays unseen, such as the sign of a joint that did not move.";
  const tested = fit?.verdict === "misfit" ? "None of the causes that were tried explains the misfit." : clear;
  say(fit === null ? "Imported." : `Imported. ${tested}`);
  goOn(from, toJob(home.value?.calibrations.some((one) => one.name === name) ? name : imported.folder, "result",
    imported.written));
}
