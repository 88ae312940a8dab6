// Runs or results of one arm compared: whether they agree within their uncertainties.
import { html } from "htm/preact";
import { useSignal } from "@preact/signals";
import { pageOf } from "../core/api.js";
import { begin, over } from "../core/jobs.js";
import { inside, attempt, refresh } from "../core/store.js";
import { route } from "../core/route.js";
import { capital, named, fixed } from "../core/words.js";
import { JobProgress } from "../parts/JobProgress.js";
import { TextField } from "../parts/TextField.js";
import { estimateOf, expandedOf } from "./numbers.js";
import { history } from "./state.js";

/** @typedef {{schema: string, verdict: string, headline: string, notes: string[], runs: {name: string, offsets: import("./types.js").BriefOffset[]}[], offsets: {name: string, unit: string, ratio: number | null}[]}} Comparison */

/** @type {Record<string, string>} */
const TONES = { agrees: "pass", "does not agree": "misfit", "not tested": "weak" };

/** @param {{serial: string | null}} props the arm whose recordings come first */
export function Compare({ serial }) {
  const chosen = useSignal(/** @type {string[]} */ ([])), folder = useSignal(""), all = useSignal(false);
  /** @type {import("@preact/signals").Signal<{job: import("../core/jobs.js").Followed, folder: string, answer: Comparison | null} | null>} */
  const made = useSignal(null);
  const known = history.value;
  if (known === null) return html`<p class="muted">…</p>`;
  const runs = known.runs.filter((run) => !run.error), own = serial ? runs.filter((run) => run.serial === serial) : [];
  const names = (all.value || own.length < 2 ? [...runs, ...known.results.filter((one) => !one.error)] : own).map((one) => one.file);
  const proposed = `${inside(route.value.name)}comparison`;
  const compare = (/** @type {Event} */ event) => {
    event.preventDefault();
    attempt(async () => {
      const to = folder.value.trim() || proposed, job = await begin(["compare", ...chosen.value, `--out=${to}`]);
      made.value = { job, folder: to, answer: null };
      const ended = await job.ended;
      await refresh();
      if (ended.answer?.schema && made.value?.job === job) made.value = { job, folder: to, answer: ended.answer };
    });
  };
  return html`
    <form onSubmit=${compare}>
      <fieldset class="choice-of"><legend>Two or more of the same arm, of different recordings</legend>
        ${names.map((file) => html`<label class="check" key=${file}><input type="checkbox" value=${file} checked=${chosen.value.includes(file)} onChange=${(/** @type {any} */ event) => { chosen.value = event.target.checked ? [...chosen.value, file] : chosen.value.filter((one) => one !== file); }} /> ${file}</label>`)}
      </fieldset>
      ${own.length >= 2 && html`<label class="check"><input type="checkbox" checked=${all.value} onChange=${(/** @type {any} */ event) => { all.value = event.target.checked; }} /> Also recordings of other arms</label>`}
      <div class="bar"><${TextField} label="Folder of the comparison" value=${folder.value} placeholder=${proposed} onValue=${(/** @type {string} */ value) => { folder.value = value; }} />
        <button disabled=${chosen.value.length < 2 || (made.value !== null && !over(made.value.job.state.value))}>Compare</button></div>
      ${made.value && html`<${JobProgress} key=${made.value.job.id} job=${made.value.job} title=${`Comparison of ${chosen.value.length}`} />`}
      ${made.value?.answer && html`<${Compared} found=${made.value.answer} folder=${made.value.folder} />`}
    </form>`;
}

/** @param {{found: Comparison, folder: string}} props */
function Compared({ found, folder }) {
  const cell = (/** @type {string} */ name, /** @type {{offsets: import("./types.js").BriefOffset[]}} */ run) => {
    const row = run.offsets.find((one) => one.name === name);
    return row && row.estimate !== null && row.std !== null ? `${estimateOf(row, 2)} ± ${expandedOf(row, 2)}` : row?.status ?? "—";
  };
  return html`
    <div class=${`verdict ${TONES[found.verdict] ?? "weak"}`} role="status"><p><b class="word">${capital(found.verdict)}.</b> ${named(found.headline)}</p></div>
    <ul class="notes">${found.notes.map((note) => html`<li>${named(note)}</li>`)}</ul>
    <div class="scroll" tabindex="0" role="region" aria-label="Comparison"><table>
      <thead><tr><th scope="col">offset ± U (k = 2)</th>${found.runs.map((run) => html`<th scope="col" class="right">${run.name}</th>`)}<th scope="col" class="right">scatter over predicted</th></tr></thead>
      <tbody>${found.offsets.map((row) => html`<tr key=${row.name}><th scope="row">${named(row.name)}</th>${found.runs.map((run) => html`<td class="right">${cell(row.name, run)}</td>`)}<td class="right">${row.ratio === null ? "—" : fixed(row.ratio, 2)}</td></tr>`)}</tbody>
    </table></div>
    <p><a href=${pageOf(`${folder.replace(/\/+$/, "")}/compare.html`)} target="_blank" rel="noopener">Open the whole comparison</a></p>`;
}
