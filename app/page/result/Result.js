// The step Result: what a run determined, what it does to the TCP, and what to do with it.
import { html } from "htm/preact";
import { useEffect } from "preact/hooks";
import { go, route, toJob } from "../core/route.js";
import { addressed, attempt, calibration, files, ownerOf } from "../core/store.js";
import { bytes, named, sentence, WORDS } from "../core/words.js";
import { Choice } from "../parts/Controls.js";
import { Fold } from "../parts/Fold.js";
import { Message } from "../parts/Message.js";
import { Workspace } from "../parts/Workspace.js";
import { Bare } from "./Bare.js";
import { Compare } from "./Compare.js";
import { Exports } from "./Exports.js";
import { History } from "./History.js";
import { Measurements } from "./Measurements.js";
import { Front, Offsets, Steps } from "./Offsets.js";
import { Pairs } from "./Pairs.js";
import { Picture } from "./Picture.js";
import { MyPrograms } from "./MyPrograms.js";
import { bareRun, failure, history, leaveOutThese, loadHistory, open, show, shown } from "./state.js";
import { downloadOf, pageOf } from "../core/api.js";

/** @typedef {import("./state.js").Found} Found */

/** The file that the address names, else the newest of the calibration: of a run its newest result, if there is one. */
function useAddressed() {
  const file = addressed.value, known = calibration.value, own = known?.state.file ?? "";
  const ours = known ? [...known.files.result, ...known.files.run] : [];
  const wanted = file || (ours.includes(own) ? own : ours[0] ?? "");
  const isRun = files.value.find((one) => one.path === wanted)?.kind === "run";
  const made = isRun ? history.value?.runs.find((one) => one.file === wanted)?.results.find((one) => !one.error)?.file
    : undefined;
  const ready = !isRun || history.value !== null, version = known?.modified ?? "";
  useEffect(() => { attempt(loadHistory); }, [version]);
  useEffect(() => {
    if (!wanted || !ready) return;
    if (made) { go(toJob(ownerOf(made), "result", made), { replace: true }); return; }
    show(wanted, isRun);
  }, [wanted, isRun, made, ready]);
  return wanted;
}

/** Results and runs of the calibration, where there are several. */
function Others() {
  const known = calibration.value, { name } = route.value, here = open.value?.file || bareRun.value;
  const reported = new Set(history.value?.runs.filter((run) => run.results.length).map((run) => run.file));
  const groups = /** @type {[string, [string, string][]][]} */ ([["results",
    (known?.files.result ?? []).map((one) => [one, one])],
    ["runs without a report", (known?.files.run ?? []).filter((one) => !reported.has(one)).map((one) => [one, one])]]);
  if (groups.flatMap(([, items]) => items).length < 2) return null;
  return html`
    <${Choice} label="Result" value=${here} groups=${groups}
      onValue=${(/** @type {string} */ value) => go(toJob(name, "result", value))} />`;
}

/** Of a result of an earlier version, which has no message. @param {{found: Found}} props */
function Headline({ found }) {
  return html`
    <section class=${`message verdict ${found.verdict}`} aria-label="Verdict"><div role="status">
      <p class="word">${WORDS[found.verdict]}.</p><p>${named(found.headline)}</p>
      ${found.notes.length > 0 && html`<ul>${found.notes.map((note) => html`<li>${sentence(note)}</li>`)}</ul>`}
    </div></section>`;
}

/** @param {{found: Found}} props */
function About({ found: { inputs, origin } }) {
  const of = inputs.targets.length === 1 ? inputs.targets[0] : `${inputs.targets.length} targets`;
  const parts = [`${inputs.run}: ${inputs.shots} measurements of ${of}, ${inputs.robot}`,
    origin.serial && `serial number ${origin.serial}`, origin.when, origin.who && `by ${origin.who}`, origin.instrument,
    inputs.versions.zerobeam && `made by zerobeam ${inputs.versions.zerobeam}`];
  return html`<p class="muted about-result">${parts.filter(Boolean).join("; ")}.</p>`;
}

const isSimulated = (/** @type {Found} */ found) =>
  found.origin.origin === "simulated" || Boolean(found.message?.verdict.startsWith("Simulated"));

/** @param {{found: import("./state.js").Found}} props */
function Downloads({ found }) {
  return html`
    <ul class="downloads">
      <li><a href=${`/api/archive?file=${encodeURIComponent(found.file)}`}
        download>Everything in one archive (.zip)</a></li>
      ${found.files.map((one) => html`
        <li key=${one.path}>
          <a href=${downloadOf(one.path)} download>${one.path}</a> <small class="muted">
            ${bytes(one.bytes)}</small></li>`)}
      ${found.run && html`
        <li>
          <a href=${downloadOf(found.run)} download>${found.run}</a> <small class="muted">the run itself</small></li>`}
    </ul>`;
}

/** @param {{found: import("./state.js").Found}} props */
const ReportLink = ({ found }) =>
  (found.report
    ? html`<a class="button report" href=${pageOf(found.report)} target="_blank" rel="noopener">Open the report</a>`
    : null);

/** @param {{found: Found}} props */
function Inspector({ found }) {
  const stated = history.value?.runs.find((run) => run.file === found.run)?.serial;
  const serial = stated && !/^none\b/i.test(stated) ? stated : null;
  const why = [...found.misfit?.criteria ?? [], ...found.diagnosis].map((one) => one.sentence);
  return html`
    <${Others} />
    ${bareRun.value && html`<${Bare} key=${bareRun.value} run=${bareRun.value} analysed=${true} />`}
    <div class="bar"><${ReportLink} found=${found} /></div>
    ${why.length > 0 && html`<ul class="notes">${why.map((one) => html`<li>${sentence(one ?? "")}</li>`)}</ul>`}
    <${Front} found=${found} />
    <${Offsets} found=${found} />
    <${Fold} title="What to do next"><${Steps} found=${found} /><//>
    ${found.run && html`<${Fold} title="Export to a controller"><${Exports} key=${found.run} run=${found.run} /><//>`}
    ${found.run && !isSimulated(found) && html`
      <${Fold} title="My programs"><${MyPrograms} key=${found.run} run=${found.run} /><//>`}
    ${found.file && html`
      <${Fold} title="Posterior of the offsets, pair by pair"><${Pairs} key=${found.file} found=${found} /><//>`}
    <${Fold} title="History of this arm, and drift"><${History} serial=${serial} run=${found.run} /><//>
    <${Fold} title="Compare runs or results"><${Compare} serial=${serial} /><//>
    ${found.file && html`<${Fold} title="Files"><${Downloads} found=${found} /><//>`}
    <${About} found=${found} />`;
}

export function Result() {
  const wanted = useAddressed(), found = open.value;
  if (!wanted) {
    return html`
      <div class="alone"><h2>No result yet</h2>
        <p>A run becomes a result here: measure the plan, or import a recording into this calibration.</p></div>`;
  }
  if (shown.value !== wanted) {
    return html`<p class="muted centred" role="status">…</p>`;
  } // nothing of another calibration
  if (failure.value) {
    return html`<div class="alone"><p class="fault" role="alert">${failure.value}</p><${Others} /></div>`;
  }
  if (found === null) {
    return bareRun.value
      ? html`
        <div class="alone"><${Others} /><${Bare} key=${bareRun.value} run=${bareRun.value} analysed=${false} /></div>`
      : html`<p class="muted centred" role="status">…</p>`;
  }
  return html`
    <${Workspace} name="Result"
      message=${found.message
        ? html`
          <${Message} verdict=${found.verdict} message=${found.message} action=${found.action ?? null}
            simulated=${isSimulated(found)} leaveOut=${leaveOutThese} />`
        : html`<${Headline} found=${found} />`}
      scene=${html`<${Picture} key=${found.file || found.run} found=${found} />`}
      inspector=${html`<${Inspector} key=${found.file || found.run} found=${found} />`}
      drawer=${html`<${Measurements} key=${found.file || found.run} found=${found} />`} />`;
}
