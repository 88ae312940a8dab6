// Runs or results of one arm compared: whether they agree within their uncertainties.
import { html } from "htm/preact";
import { useSignal } from "@preact/signals";
import { pageOf } from "../core/api.js";
import { attempt, inside } from "../core/store.js";
import { route } from "../core/route.js";
import { capital, estimateOf, expandedOf, expandedWord, fixed, named } from "../core/words.js";
import { Check, into, TextField } from "../parts/Controls.js";
import { useCommand } from "../parts/JobProgress.js";
import { history } from "./state.js";
import { Table } from "../parts/Table.js";

/** @typedef {import("../core/jobs.js").Comparison} Comparison */

/** @type {Record<string, string>} */
const TONES = { agrees: "pass", misfit: "misfit" };

/** @param {{serial: string | null}} props the arm whose recordings come first */
export function Compare({ serial }) {
  const chosen = useSignal(/** @type {string[]} */ ([])), folder = useSignal(""), all = useSignal(false);
  const to = useSignal(""), { busy, state, carryOut, progress } = useCommand();
  const found = /** @type {Comparison | undefined} */ (/** @type {unknown} */ (state?.answer));
  const known = history.value;
  if (known === null) return html`<p class="muted">…</p>`;
  const runs = known.runs.filter((run) => !run.error), own = serial ? runs.filter((run) => run.serial === serial) : [];
  const names = (all.value || own.length < 2 ? [...runs, ...known.results.filter((one) => !one.error)]
    : own).map((one) =>
    one.file);
  const proposed = `${inside(route.value.name)}comparison`;
  const choose = (/** @type {string} */ file, /** @type {boolean} */ on) => {
    chosen.value = [...chosen.value.filter((one) => one !== file), ...(on ? [file] : [])];
  };
  const compare = (/** @type {Event} */ event) => {
    event.preventDefault();
    to.value = folder.value.trim() || proposed;
    const words = ["compare", ...chosen.value, `--out=${to.value}`];
    attempt(() => carryOut(words, `Comparison of ${chosen.value.length}`));
  };
  return html`
    <form onSubmit=${compare}>
      <fieldset class="choice-of"><legend>Two or more of the same arm, of different recordings</legend>
        ${names.map((file) => html`
          <${Check} key=${file} data-file=${file} on=${chosen.value.includes(file)}
            onTurn=${(/** @type {boolean} */ on) => choose(file, on)}>${file}<//>`)}
      </fieldset>
      ${own.length >= 2 && html`<${Check} on=${all.value} onTurn=${into(all)}>Also recordings of other arms<//>`}
      <div class="bar">
        <${TextField} label="Folder of the comparison" value=${folder.value} placeholder=${proposed}
          onValue=${into(folder)} />
        <button disabled=${chosen.value.length < 2 || busy}>Compare</button></div>
      ${progress()}
      ${found && html`<${Compared} found=${found} folder=${to.value} />`}
    </form>`;
}

/** @param {{found: Comparison, folder: string}} props */
function Compared({ found, folder }) {
  const cell = (/** @type {string} */ name, /** @type {{offsets: import("answers").BriefOffset[]}} */ run) => {
    const row = run.offsets.find((one) => one.name === name);
    return row && row.estimate !== null && row.std !== null ? `${estimateOf(row, 2)} ± ${expandedOf(row, 2)}`
      : row?.status ?? "—";
  };
  return html`
    <div class=${`verdict ${TONES[found.verdict] ?? "weak"}`}
      role="status"><p><b class="word">${capital(found.verdict)}.</b> ${named(found.headline)}</p></div>
    <ul class="notes">${found.notes.map((note) => html`<li>${named(note)}</li>`)}</ul>
    <${Table} name="Comparison"
      heads=${[`offset ± ${expandedWord(2)}`, ...found.runs.map((run) => [run.name, "right"]),
        ["scatter over predicted", "right"]]}>
      <tbody>${found.offsets.map((row) => html`
        <tr key=${row.name}><th scope="row">${named(row.name)}</th>
          ${found.runs.map((run) => html`<td class="right">${cell(row.name, run)}</td>`)}
        <td class="right">${row.ratio === null ? "—" : fixed(row.ratio, 2)}</td></tr>`)}</tbody>
    <//>
    <p><a href=${pageOf(`${folder.replace(/\/+$/, "")}/compare.html`)} target="_blank"
      rel="noopener">Open the whole comparison</a></p>`;
}
