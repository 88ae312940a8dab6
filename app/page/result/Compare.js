// Runs or results of one arm compared: whether they agree within their uncertainties.
import { html } from "htm/preact";
import { useSignal } from "@preact/signals";
import { pageOf } from "../core/api.js";
import { attempt, inside } from "../core/store.js";
import { route } from "../core/route.js";
import { Check, into, TextField } from "../parts/Controls.js";
import { useCommand } from "../parts/JobProgress.js";
import { history } from "./state.js";

/** @param {{serial: string | null}} props the arm whose recordings come first */
export function Compare({ serial }) {
  const chosen = useSignal(/** @type {string[]} */ ([])), folder = useSignal(""), all = useSignal(false);
  const to = useSignal(""), { busy, state, carryOut, progress } = useCommand();
  const known = history.value;
  if (known === null) return html`<p class="muted">…</p>`;
  const runs = known.runs.filter((run) => !run.error), own = serial ? runs.filter((run) => run.serial === serial) : [];
  const names = (all.value || own.length < 2 ? [...runs, ...known.results.filter((one) => !one.error)]
    : own).map((one) =>
    one.file);
  const proposed = `${inside(route.value.name)}comparison`, page = pageOf(`${to.value}/compare.html`);
  const choose = (/** @type {string} */ file, /** @type {boolean} */ on) => {
    chosen.value = [...chosen.value.filter((one) => one !== file), ...(on ? [file] : [])];
  };
  const compare = (/** @type {Event} */ event) => {
    event.preventDefault();
    to.value = (folder.value.trim() || proposed).replace(/\/+$/, "");
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
      ${state?.answer && html`
        <iframe class="report" src=${page} title="The comparison"></iframe>
        <p><a href=${page} target="_blank" rel="noopener">Open the comparison alone</a></p>`}
    </form>`;
}
