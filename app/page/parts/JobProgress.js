// A command under way: how far it is, how long it still takes, a button that ends it, and what it says.
// `useCommand` begins it, for a part of the page that has one at a time.
import { html } from "htm/preact";
import { useEffect } from "preact/hooks";
import { useSignal } from "@preact/signals";
import { begin, over, underWay, well } from "../core/jobs.js";
import { attempt, refresh } from "../core/store.js";
import { duration } from "../core/words.js";

/** Seconds since the server said how long a job takes. @param {import("../core/jobs.js").JobState | null} job */
export function useSince(job) {
  const since = useSignal(0), left = job?.left_s ?? null;
  useEffect(() => {
    since.value = 0;
    if (left === null) return undefined;
    const from = performance.now();
    const timer = setInterval(() => { since.value = (performance.now() - from) / 1000; }, 1000);
    return () => clearInterval(timer);
  }, [left, job?.passed_s]);
  return since.value;
}

/**
 * @param {{job: import("../core/jobs.js").Followed, title: string, children?: unknown}} props `children`: shown once
 *   it did what was asked
 */
export function JobProgress({ job, title, children = null }) {
  const now = job.state.value, done = over(now), good = well(now);
  const ending = useSignal(false);
  const cancel = () => attempt(async () => { ending.value = true; await job.cancel(); });
  const since = useSince(now);
  const left = now.left_s === null ? ""
    : `, ${now.left_at_least ? "at least" : "about"} ${duration(now.left_s - since)} left`;
  const said = now.gone ? "The server was started anew meanwhile and does not know this command any more."
    : good ? "Done." : now.state === "stopped" ? "Cancelled: nothing was written." : done ? "Refused, or failed:"
    : now.lost ? "The connection to the server is lost; this page tries again." : `${now.stage || "waiting"}${left}`;
  return html`
    <div class="job" role="group" aria-label=${title}>
      ${!done && html`
        <div class="bar"><progress max="1" value=${now.share} aria-label=${title}></progress>
          <button type="button" disabled=${ending.value} onClick=${cancel}>Cancel</button></div>`}
      <p role="status">${said}</p>
      ${now.log.length > 0 && !good && now.state !== "stopped" && html`
        <pre class="log" tabindex="0" aria-label="What the command says">${now.log.join("\n")}</pre>`}
      ${good && children}
    </div>`;
}

export function useCommand() {
  const now = useSignal(/** @type {{job: import("../core/jobs.js").Followed, title: string} | null} */ (null));
  /** Until it has ended, and the folder was looked at. @param {import("../core/jobs.js").Followed} job */
  const follow = async (job, title = "") => {
    now.value = { job, title };
    const ended = await job.ended;
    await refresh();
    return ended;
  };
  return {
    busy: underWay(now.value?.job),
    state: now.value?.job.state.value ?? null,
    follow,
    carryOut: async (/** @type {string[]} */ words, /** @type {string} */ title) => follow(await begin(words), title),
    /** @param {unknown} [children] shown once it did what was asked */
    progress: (children = null) => now.value && html`
      <${JobProgress} key=${now.value.job.id} job=${now.value.job} title=${now.value.title}>${children}<//>`,
  };
}
