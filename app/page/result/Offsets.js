// The first page of the report, and the offsets: with their expanded uncertainty and status, beside them what a fit
// without some measurements says.
import { html } from "htm/preact";
import { goOn, route, toJob } from "../core/route.js";
import { attempt } from "../core/store.js";
import { capital, estimateOf, expandedOf, expandedWord, fixed, marked, named, sentence, SHAPES,
  WORDS } from "../core/words.js";
import { Fold } from "../parts/Fold.js";
import { refitFault, refitted, saveWithout, shift, single } from "./state.js";
import { Table as Scrolled } from "../parts/Table.js";

/** @typedef {import("./state.js").Found} Found */

/**
 * What the first page of the report has: values and their U, what they gain, what would make it better.
 * @param {{found: Found}} props
 */
export function Front({ found }) {
  if (found.front === null) {
    return html`
      <p>This result is of an earlier version, which does not say what to enter. Make the report of the run again; until
        then enter nothing.</p>`;
  }
  return html`<div class="front" dangerouslySetInnerHTML=${{ __html: found.front }} />`;
}

/** What else there is to do, after the action of the message. @param {{found: Found}} props */
export function Steps({ found }) {
  const steps = found.next_steps?.steps.slice(found.message ? 1 : 0) ?? [];
  return html`
    ${steps.map((step) => html`
      <p>${named(step.text)}</p>
      ${step.commands.length > 0 && html`
        <pre class="commands" tabindex="0" aria-label="Commands"><code>${step.commands.join("\n")}</code></pre>`}`)}`;
}

/** @param {import("answers").RefitRow} row */
const ratio = (row) =>
  (row.std === null || row.before.std === null ? "" : `${fixed(row.std / row.before.std, 2)}\u00a0×`);

/**
 * @param {{rows: import("answers").ParameterResult[], k: number, again: import("answers").Refit | null,
 *   label: string}} props `again`: the fit beside
 */
function Table({ rows, k, again, label }) {
  const unseen = (/** @type {string} */ text) => html`<span class="unseen">${text}</span>`;
  const others = new Map(again?.parameters.map((row) => [row.name, row]));
  const shape = (/** @type {string} */ status) => html`
    <span aria-hidden="true">${SHAPES[status] ?? ""}</span><span class="unseen">${status}</span>`;
  return html`
    <${Scrolled} name=${label} of="offsets" heads=${["name", ["estimate", "right"], [expandedWord(k), "right"],
      again ? unseen("status") : "status",
      ...(again ? [["without them", "right"], [expandedWord(again.coverage_factor), "right"],
        unseen("status without them")] : [])]}>
      <tbody>${rows.map((row) => {
        const other = others.get(row.name);
        return html`
          <tr key=${row.name} class=${row.status} title=${row.reason ? sentence(row.reason) : undefined}
            data-of=${row.name}>
            <th scope="row">${named(row.name)}</th><td class="right u">${estimateOf(row, k)}</td>
            <td class="right">${expandedOf(row, k)}</td>
            <td class="status">${again ? shape(row.status) : marked(row.status)}</td>
            ${again && html`
              <td class="right refit">${other ? estimateOf(other, again.coverage_factor) : "—"}</td>
              <td class="right">
                ${other ? html`${expandedOf(other, again.coverage_factor)}<small>${ratio(other)}</small>` : "—"}</td>
              <td class=${`refit-status ${other?.status ?? ""}`}>${other ? shape(other.status) : "—"}</td>`}
          </tr>`;
      })}</tbody><//>`;
}

/** @param {{found: Found}} props */
export function Offsets({ found }) {
  const others = found.parameters.filter((row) => row.group === "tool" || row.group === "noise");
  return html`
    <h2>Offsets</h2>
    <${Table} rows=${found.parameters.filter((row) => row.group === "offset")} k=${found.coverage_factor}
      again=${refitted.value} label="Offsets" />
    <${Without} found=${found} />
    ${others.length > 0 && html`
      <${Fold} title="Tool and noise">
        <${Table} rows=${others} k=${found.coverage_factor} again=${null} label="Tool and noise" /><//>`}`;
}

/** What the fit without some measurements says. @param {{found: Found}} props */
function Without({ found }) {
  const again = refitted.value, alone = shift.value;
  if (found.run === null) {
    return html`<p class="muted">The run of this result is not in the folder: nothing can be left out.</p>`;
  }
  if (refitFault.value) return html`<p class="error" role="alert">${refitFault.value}</p>`;
  if (again === null) {
    return alone === null ? null
      : html`
        <p class="muted" role="status">Arrow: the estimates without
          measurement ${single.value}.${alone.lost.length > 0
            && ` Without it no longer determined: ${alone.lost.map(named).join(", ")}.`}</p>`;
  }
  const { run } = found, save = () => attempt(async () => {
    const from = route.value, file = await saveWithout(run, again.without);
    goOn(from, toJob(from.name, "result", file));
  });
  const measurements = `measurement${again.without.length === 1 ? "" : "s"} ${again.without.join(", ")}`;
  const lost = again.lost.map(named).join(", ");
  const fitted = `Fitted again without ${measurements}: ${again.measurements} of ${again.of} are left.`;
  return html`
    <div class=${`without verdict ${again.verdict}`} role="status">
      <p>${fitted}${lost && ` Without them no longer determined: ${lost}.`}</p>
      <p><b class="word">${WORDS[again.verdict]}.</b> ${capital(named(again.headline))}</p>
      ${again.misfit.length > 0 && html`<ul>${again.misfit.map((one) => html`<li>${sentence(one)}</li>`)}</ul>`}
      ${again.null_space.map((one) => html`
        <p>Why: ${sentence(one.reason ?? "")} To do: ${sentence(one.remedy ?? "")}</p>`)}
      <button type="button" onClick=${save}>Save as a run without ${again.without.length === 1 ? "it" : "them"}</button>
      <small class="muted">A new file beside the run, which says what was left out; then its report.</small>
    </div>`;
}
