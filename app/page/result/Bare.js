// A run without a report: it is made, or the run is only analysed.
import { html } from "htm/preact";
import { useEffect } from "preact/hooks";
import { useSignal } from "@preact/signals";
import { get } from "../core/api.js";
import { follow as followed, outOf, well } from "../core/jobs.js";
import { goOn, route, toJob } from "../core/route.js";
import { attempt } from "../core/store.js";
import { useCommand } from "../parts/JobProgress.js";
import { into, TextField } from "../parts/Controls.js";
import { history, loadHistory, showAnalysis } from "./state.js";

/** @param {{run: string, analysed: boolean}} props */
export function Bare({ run, analysed }) {
  const folder = useSignal(""), proposed = `${run.replace(/\.[^./]*$/, "")}-report`;
  const { busy, state, follow, carryOut, progress } = useCommand(), title = `The report of ${run}`;
  const known = history.value?.runs.find((one) => one.file === run);

  /** @param {Promise<import("../core/jobs.js").JobState>} made @param {string} to */
  async function reported(made, to) {
    const from = route.value;
    if (!well(await made)) return;
    await loadHistory();
    if (route.value.step === "result") goOn(from, toJob(from.name, "result", `${to.replace(/\/+$/, "")}/result.json`));
  }
  // A report that was begun before the page was loaded again is followed.
  useEffect(() => {
    attempt(async () => {
      const job = (await get("/api/jobs")).find((one) =>
        one.command[0] === "report" && one.command.at(-1) === run && ["waiting", "running"].includes(one.state));
      if (job && state === null) await reported(follow(followed(job.id), title), outOf(job.command));
    });
  }, [run]);
  const report = () => attempt(async () => {
    const to = folder.value.trim() || proposed;
    await reported(carryOut(["report", run, `--out=${to}`], title), to);
  });
  const analyse = () => attempt(async () => {
    const ended = await carryOut(["analyse", run], `Analysis of ${run}`);
    if (ended.state === "done" && ended.answer) showAnalysis(ended, run);
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
      ${progress()}
    </section>`;
}
