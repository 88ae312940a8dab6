// The run under way, wherever on the page its reader is: begun, followed, answered, stopped, and found again after a
// reload.
import { computed, signal } from "@preact/signals";
import { get, getFile, Refused } from "../core/api.js";
import { begin, follow, outOf, over } from "../core/jobs.js";
import { calibrationOf, route } from "../core/route.js";
import { failed, fault, ofCalibration, refresh, say } from "../core/store.js";
import { counted, duration } from "../core/words.js";
import { begun, heard } from "./events.js";

/** @typedef {import("../core/jobs.js").JobState} JobState */
/** @typedef {import("./events.js").RunSeen} RunSeen */
/** @typedef {import("answers").RecordedRun} Unfinished */

export const job = signal(/** @type {import("../core/jobs.js").Followed | null} */ (null));
export const run = signal(begun());
/** u after the measurements of earlier sessions, from the run file. */
export const earlier = signal(/** @type {import("./events.js").CoursePoint[]} */ ([]));
/** That it is being stopped, or that this failed. */
export const stopping = signal("");
/** That the run file was read once more after its end: what it keeps is certain. */
export const settled = signal(false);
export const unfinished = signal(/** @type {Unfinished[]} */ ([]));
/** That what was under way has ended with the server. */
export const missing = ofCalibration("");

export const state = computed(() => job.value?.state.value ?? null);
export const underWay = computed(() => state.value !== null && !over(state.value));

/** The command as it was begun, until the server says it. */
const sent = signal(/** @type {string[]} */ ([]));
/** The words of what is followed; the last is the plan. */
export const command = computed(() => (state.value?.command.length ? state.value.command : sent.value));
/** The run file that is followed. */
export const followedFile = computed(() => (state.value ? outOf(command.value) || run.value.file : ""));

/** Whether what is followed is of the calibration that is open: in another it is a link. */
export const here = computed(() => followedFile.value !== "" && calibrationOf(followedFile.value) === route.value.name);

let painting = 0;
/** @type {RunSeen} */
let newest = begun();
/** Events come faster than anybody sees: one change a frame. @param {import("./events.js").RunEvent} event */
function hear(event) {
  newest = heard(newest, event);
  if (painting) return;
  painting = setTimeout(() => { painting = 0; run.value = newest; }, 16);
}

/** @param {string[]} words @param {string} [password] */
export async function start(words, password) {
  const followed = await begin(words, { ...(password && words.includes("--rig=abb") ? { password } : {}), run: hear });
  sent.value = words;
  attach(followed);
}

/** @param {import("../core/jobs.js").Followed} followed */
function attach(followed) {
  job.value?.close();
  newest = begun();
  run.value = newest;
  earlier.value = [];
  stopping.value = missing.value = "";
  settled.value = false;
  job.value = followed;
  followed.ended.then((last) => ended(followed, last), failed);
}

/** @param {import("../core/jobs.js").Followed} followed @param {JobState} last */
async function ended(followed, last) {
  clearTimeout(painting);
  painting = 0;
  stopping.value = "";
  if (last.gone) {
    const of = calibrationOf(followedFile.value);
    job.value = null;
    missing.set("The server was started anew, and what was under way has ended with it. Go on with the run below.", of);
  } else {
    // What a run that was broken off keeps is what its file has: of the last measurement no event may have come.
    const file = outOf(last.command); // as the app's folder has it: the run itself says its last part
    if (!newest.end && file && newest.file) {
      try {
        const found = await getFile("run", file);
        newest = { ...newest, recorded: found.recorded, course: found.course, tolerances: found.tolerance,
          residuals: found.residuals };
      } catch (error) {
        if (!(error instanceof Refused)) throw error; // then the events have to do
      }
    }
    if (job.value === followed) {
      run.value = newest;
      settled.value = true;
      say(here.value ? now(last, newest, true) : `The run ${followedFile.value} has ended.`);
    }
  }
  await Promise.all([listUnfinished(), refresh()]).catch(failed);
}

/** u of earlier sessions, once a run that was resumed is heard. */
export async function fetchEarlier() {
  const of = job.value, file = followedFile.value;
  try {
    const found = await getFile("run", file);
    if (job.value !== of) return;
    earlier.value = found.course;
    if (!newest.course.length) {
      run.value = newest = { ...newest, tolerances: found.tolerance, residuals: found.residuals };
    }
  } catch (error) {
    if (!(error instanceof Refused)) throw error; // then the curve begins with the next measurement
  }
}

export async function stop() {
  const followed = job.value;
  if (!followed || !underWay.value || stopping.value) return;
  stopping.value = "Stopping. What is recorded is kept.";
  try {
    await followed.cancel();
  } catch (error) {
    if (!(error instanceof Refused)) throw error;
    stopping.value = "";
    fault.value = "The server does not answer. At a real robot press the emergency stop.";
  }
}

/** A line for the run; what was doubted is answered by it. @param {string} text */
export async function answer(text) {
  if (!underWay.value) return;
  run.value = newest = { ...newest, doubt: null };
  await job.value?.say(text);
}

let listing = 0;
/** The runs that can be gone on with. */
export async function listUnfinished() {
  const own = (listing += 1); // the last that was asked for is shown
  const [open, jobs] = await Promise.all([get("/api/unfinished"), get("/api/jobs")]);
  if (own !== listing) return;
  const busy = jobs.filter((one) => !over(one)).flatMap((one) => one.command);
  unfinished.value = open.filter((one) => !busy.includes(`--out=${one.file}`));
}

let looked = false;
/** After a reload: what is under way is followed again. */
export async function findRunning() {
  if (looked) return;
  looked = true;
  const jobs = await get("/api/jobs"), last = jobs.find((one) => one.command[0] === "run");
  if (last && !over(last) && !job.value) attach(follow(last.id, hear));
  await listUnfinished();
}

// ── in words ──────────────────────────────────────────────────────────────────────────────────

const LOST = "The connection to the server is lost. The run goes on as long as the server does; this page tries again. "
  + "Where the app was started anew, open the address that it prints.";

/**
 * Where the run is.
 * @param {JobState} at @param {RunSeen} seen @param {boolean} sure whether the file was read after the end
 */
export function now(at, seen, sure) {
  if (at.lost && !over(at)) return LOST;
  const are = seen.recorded.length === 1 ? "is" : "are";
  const kept = `${counted(seen.recorded.length, "measurement")} ${are} kept in ${seen.file}.`;
  if (seen.end) return kept;
  if (at.state === "stopped") {
    return seen.file ? `Stopped.${sure ? ` ${kept}` : ""}` : "Stopped before anything was recorded.";
  }
  if (at.state === "failed") return `The run ended with an error.${seen.file && sure ? ` ${kept}` : ""}`;
  if (at.state === "done") return kept;
  if (seen.confirm && at.asks === "confirm") return "Waiting for your confirmation: nothing has moved yet.";
  if (seen.shot === null) return "The run begins.";
  const count = seen.recorded.length + seen.refused.length + 1;
  const of = count > seen.postures ? `${count}` : `${count} of ${seen.postures}`;
  const again = seen.attempt > 1 ? `, attempt ${seen.attempt}` : "";
  return `Measurement ${seen.shot} (${of})${again}${seen.phase ? `: ${seen.phase}` : ""}`;
}

// A run that has not advanced for long takes longer, one with a tolerance may need fewer measurements.
const leftHow = (/** @type {boolean} */ atLeast, /** @type {boolean} */ mayEndSooner) =>
  (atLeast === mayEndSooner ? "about" : atLeast ? "at least" : "at most");

/**
 * How much is done, and how long the rest takes.
 * @param {Pick<JobState, "state" | "left_s" | "left_at_least">} at
 * @param {Pick<RunSeen, "recorded" | "refused" | "postures" | "rig" | "tolerance">} seen
 * @param {number} since seconds since the server said so
 */
export function progress(at, seen, since) {
  const refused = seen.refused.length ? `, ${seen.refused.length} refused` : "";
  const planned = seen.postures ? `, of ${seen.postures} planned` : "";
  const parts = [`${counted(seen.recorded.length, "measurement")} recorded${refused}${planned}`];
  if (at.state === "running" && at.left_s !== null && at.left_s !== undefined && seen.rig !== "manual"
    && seen.rig !== "live") {
    parts.push(`${leftHow(at.left_at_least, seen.tolerance !== null)} ${duration(at.left_s - since)} left`);
  }
  return `${parts.join("; ")}.`;
}

/** What looks wrong. @param {JobState} at @param {RunSeen} seen */
export function remarks(at, seen) {
  const list = [];
  if (seen.warning && !seen.end) list.push(seen.warning);
  if (seen.suspect) list.push(`Measurement ${seen.suspect.shot} ${seen.suspect.line}.`);
  if (seen.stopped && seen.stopped !== "interrupted") list.push(seen.stopped);
  else if (seen.trouble && !seen.end) list.push(seen.trouble);
  if (at.state === "failed") {
    list.push(...at.log.filter((line) => line.startsWith("error: ")).map((line) => line.slice(7)));
  }
  return seen.end ? [...list, ...seen.end.notes] : list;
}
