// Commands that the server carries out: begun, followed through lost connections and reloads, ended.
import { signal } from "@preact/signals";
import { get, post, Refused, remove } from "./api.js";

/**
 * @typedef {import("answers").JobWhole & {answer: Printed | null, lost: boolean, gone: boolean}} JobState
 *   `lost`: no connection; `gone`: the server does not know it any more
 * @typedef {import("../measure/events.js").RunEvent} RunEvent
 * @typedef {(event: RunEvent) => void} Heard
 * @typedef {{progress: Partial<JobState>, log: string, run: RunEvent, end: JobState}} Events
 * @typedef {{id: string, state: import("@preact/signals").Signal<JobState>, ended: Promise<JobState>,
 *   cancel: () => Promise<void>, say: (text: string) => Promise<void>, close: () => void}} Followed
 */

/** @typedef {import("answers").ShownResult} Shown */
/**
 * Of `analyse` a result; of `plan` the file that was made and what was said of it; of `positions keep` what was
 *   refused, is to be
 * looked at or stated; of `export` its notes.
 * @typedef {Omit<Shown, "inputs"> & {
 *   inputs: NonNullable<Shown["inputs"]> & {header: {provenance?: Record<string, string>}},
 *   plan: string | null, said: string[], removed: string | null, notes: string[],
 *   converted: boolean, files: {file: string}[], refused: Line[], listed: Line[], to_state: string[]}} Printed
 * @typedef {{file: string, line: number, sentence: string, accepted?: boolean}} Line
 */

const AGAIN_MS = 1500; // until a server that was ended is asked whether it is there again
const OVER = ["done", "stopped", "failed"];

/** @param {{state: string}} job */
export const over = (job) => OVER.includes(job.state);

/** Whether a job was begun that goes on. @param {Followed | null | undefined} job */
export const underWay = (job) => job != null && !over(job.state.value);

/**
 * Whether a job did what was asked: a verdict is an answer, a refused export or conversion none.
 * @param {JobState} job
 */
export const well = (job) =>
  job.state === "done" && !(["export", "positions"].includes(job.command[0]) && job.status === 1);

/** The file or folder that a command writes, as its words name it; "" where none is named. @param {string[]} command */
export function outOf(command) {
  const short = command.indexOf("-o");
  return command.find((word) => word.startsWith("--out="))?.slice("--out=".length)
    ?? (short < 0 ? "" : command[short + 1] ?? "");
}

/**
 * Begins a command. @param {string[]} command @param {{password?: string, run?: Heard}} [how]
 */
export async function begin(command, { password, run } = {}) {
  const { id } = await post("/api/jobs", { command, ...(password ? { password } : {}) });
  return follow(id, run);
}

/**
 * Follows a job; `run` hears the events of a run, from its begin. @param {string} id @param {Heard} [run]
 *   @returns {Followed}
 */
export function follow(id, run = () => {}) {
  const path = `/api/jobs/${encodeURIComponent(id)}`;
  const state = signal(/** @type {JobState} */ ({ id, command: [], state: "waiting", share: 0, stage: "",
    passed_s: null, left_s: null, left_at_least: false, status: null, asks: null, log: [], answer: null, front: null,
    lost: false, gone: false }));
  /** @type {(job: JobState) => void} */
  let resolve = () => {};
  /** @type {Promise<JobState>} */
  const ended = new Promise((done) => { resolve = done; });
  /** @type {EventSource | null} */
  let source = null;
  let closed = false, timer = 0;
  const change = (/** @type {Partial<JobState>} */ more) => { state.value = { ...state.value, ...more }; };

  function close() {
    closed = true;
    clearTimeout(timer);
    source?.close();
  }

  function listen() {
    source = new EventSource(`${path}/events`);
    /** @template {keyof Events} K @param {K} kind @param {(data: Events[K]) => void} then */
    const on = (kind, then) =>
      source?.addEventListener(kind, (event) => then(JSON.parse(/** @type {MessageEvent} */ (event).data)));
    source.addEventListener("open", () => change({ lost: false }));
    on("progress", change);
    on("log", (line) => change({ log: [...state.value.log, line] }));
    on("run", run);
    on("end", (job) => {
      close();
      change({ ...job, lost: false });
      resolve(state.value);
    });
    source.addEventListener("error", () => {
      change({ lost: true });
      // Refused, not merely cut off: a server that was started anew does not know this job.
      if (source?.readyState === EventSource.CLOSED) ask();
    });
  }

  async function ask() {
    if (closed) return;
    try {
      const job = /** @type {JobState} */ (await get(path));
      if (closed) return;
      change({ ...job, log: [], lost: false });
      listen();
    } catch (error) {
      if (!(error instanceof Refused)) throw error;
      if (closed) return;
      if (error.status === 404) {
        close();
        change({ state: "stopped", gone: true });
        resolve(state.value);
      } else {
        change({ lost: true });
        timer = setTimeout(ask, AGAIN_MS);
      }
    }
  }
  ask();
  return { id, state, ended, close, cancel: async () => { await remove(path); },
    say: async (text) => { await post(`${path}/line`, { text }); } };
}
