// A run without a report: it is made, or the run is only analysed.
import { html } from "htm/preact";
import { useEffect } from "preact/hooks";
import { useSignal } from "@preact/signals";
import { get } from "../core/api.js";
import { begin, follow, outOf, underWay, well } from "../core/jobs.js";
import { goOn, route, toJob } from "../core/route.js";
import { attempt, refresh } from "../core/store.js";
import { JobProgress } from "../parts/JobProgress.js";
import { TextField } from "../parts/TextField.js";
import { history, loadHistory, showAnalysis } from "./state.js";
import { into } from "../parts/heard.js";

/** @typedef {import("../core/jobs.js").Followed} Followed */

/** @param {{run: string, analysed: boolean}} props */
export function Bare({ run, analysed }) {
  const folder = useSignal(""), proposed = `${run.replace(/\.[^./]*$/, "")}-report`;
  const made = useSignal(/** @type {{job: Followed, title: string} | null} */ (null));
  const known = history.value?.runs.find((one) => one.file === run);
  const busy = underWay(made.value?.job);

  /** @param {Followed} job @param {string} to */
  async function reported(job, to) {
    const from = route.value;
    made.value = { job, title: `The report of ${run}` };
    if (!well(await job.ended)) return;
    await Promise.all([refresh(), loadHistory()]);
    if (route.value.step === "result") goOn(from, toJob(from.name, "result", `${to.replace(/\/+$/, "")}/result.json`));
  }
  // A report that was begun before the page was loaded again is followed.
  useEffect(() => {
    attempt(async () => {
      const job = (await get("/api/jobs")).find((one) =>
        one.command[0] === "report" && one.command.at(-1) === run && ["waiting", "running"].includes(one.state));
      if (job && made.value === null) await reported(follow(job.id), outOf(job.command));
    });
  }, [run]);
  const report = () => attempt(async () => {
    const to = folder.value.trim() || proposed;
    await reported(await begin(["report", run, `--out=${to}`]), to);
  });
  const analyse = () => attempt(async () => {
    const job = await begin(["analyse", run]);
    made.value = { job, title: `Analysis of ${run}` };
    const ended = await job.ended;
    if (ended.state === "done" && ended.answer) showAnalysis(ended);
  });
  return html`
    <section class="bare" aria-label="A run without a report">
      <p>${known?.error ?? `${run} has no report yet. ${analysed ? "What is shown is its analysis." : ""}`}</p>
      <div class="bar">
        <button type="button" class="main" disabled=${busy} onClick=${report}>Make the report</button>
        ${!analysed && html`<button type="button" disabled=${busy} onClick=${analyse}>Only analyse</button>`}
        <${TextField} label="Folder of the report" value=${folder.value} placeholder=${proposed}
          onValue=${into(folder)} />
      </div>
      ${made.value && html`<${JobProgress} key=${made.value.job.id} job=${made.value.job} title=${made.value.title} />`}
    </section>`;
}
