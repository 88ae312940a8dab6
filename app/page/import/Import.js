// Recordings of others become a run, by the command that is shown; then the calibration goes on with its result.
import { html } from "htm/preact";
import { useEffect } from "preact/hooks";
import { route } from "../core/route.js";
import { attempt, ofKind } from "../core/store.js";
import { Choice, into, TextField } from "../parts/Controls.js";
import { useForms } from "../parts/Fields.js";
import { Fold } from "../parts/Fold.js";
import { JobProgress } from "../parts/JobProgress.js";
import { carryOut, outcome, refusal, underWay, wordsOf } from "./carrying.js";
import { command, noTargets, out, outTyped, sources, targetOf, targets } from "./command.js";
import { about, chosen, editCopy, headerFault, headerFile, NEW, pick } from "./header.js";
import { Mapper } from "./Mapper.js";
import { Options } from "./Options.js";
import { aboutOf, format, formatsOf, setFormat, values } from "./formats.js";
import { Outcome } from "./Outcome.js";
import { Recordings } from "./Recordings.js";
import { choose, recordings } from "./sources.js";
import { HeaderForm } from "./HeaderForm.js";

function HeaderChoice() {
  const named = (/** @type {string} */ kind) =>
    ofKind(kind).map((path) => /** @type {[string, string]} */ ([path, path]));
  return html`
    <section aria-labelledby="import-header">
      <h2 id="import-header">2. Robot, tool and noise</h2>
      <div class="fields">
        <${Choice} label="Header or plan" value=${headerFile.value} none="choose"
          groups=${[["new", [[NEW, "fill in a new header"]]], ["headers of the folder", named("header")],
            ["measured plans of the folder", named("plan")]]}
          onValue=${(/** @type {string} */ file) => pick(file, ofKind("plan").includes(file))} />
      </div>
      ${chosen.value && html`
        <p class="chosen">${about(chosen.value)}</p>
        <p><button type="button" onClick=${editCopy}>Make a new header from this one</button></p>`}
      ${headerFault.value && html`<p class="error" role="alert">${headerFault.value}</p>`}
      ${headerFile.value === NEW && html`<${HeaderForm} />`}
    </section>`;
}

/** One target for each file; a plan says them itself, and a column or a marker may. */
function Targets() {
  if (noTargets.value) return html`<p class="muted">${noTargets.value}</p>`;
  const known = Object.keys(chosen.value?.header.targets ?? {});
  return html`
    <div class="fields targets">
      ${sources.value.map((row) => html`
        <${TextField} key=${row.path} id=${`target ${row.path}`} label=${`Target of ${row.path}`} list=${known}
          value=${targets.value[row.path] ?? targetOf(row.path)}
          onValue=${(/** @type {string} */ value) => { targets.value = { ...targets.value, [row.path]: value }; }} />`)}
    </div>
    ${values.value["--marker-topic"] && html`<p class="muted">Without targets the markers name them.</p>`}`;
}

function Format() {
  const founds = recordings.value.flatMap((row) => (row.found ? [row.found] : [])), forms = formatsOf(founds);
  const several = new Set(founds.map((found) => found.form)).size > 1;
  useEffect(() => { if (!forms.includes(format.value) || !format.value) setFormat(forms[0]); }, [forms.join()]);
  return html`
    <div class="fields">
      <${Choice} label="Format" value=${format.value} none=${forms[0] ? undefined : "choose"}
        groups=${[["formats", forms.filter(Boolean).map((form) => [form, aboutOf(form)])]]} onValue=${setFormat} />
      <p class="muted help">
        ${several && forms[0] !== "points"
          ? "The files are of different kinds: all files of one import have one format."
          : forms[0] ? `Recognised by ${(founds.find((found) => found.form === format.value) ?? founds[0]).why}.`
          : "State which controller wrote it."}</p>
    </div>`;
}

export function Import() {
  const { file } = route.value, now = command.value, busy = underWay.value !== null, forms = useForms("import");
  useEffect(() => { if (file) attempt(() => choose(file)); }, [file]);
  const changed = now !== null && outcome.value !== null && outcome.value.words !== wordsOf(now.words);
  return html`
    <div class="import">
      <p class="muted">Recorded joint positions become a run. What is not in a recording you state: nothing is guessed,
        and a proposal is applied only when you take it.</p>
      <${Recordings} />
      ${recordings.value.length > 0 && forms.length > 0 && html`
        <${Format} />
        <${HeaderChoice} />
        ${chosen.value && format.value && html`
          <section aria-labelledby="import-read">
            <h2 id="import-read">3. How to read the files</h2>
            ${format.value === "csv" && html`<${Mapper} />`}
            <${Options} />
          </section>
          <section aria-labelledby="import-run">
            <h2 id="import-run">4. Run</h2>
            <${Targets} />
            <div class="bar">
              <${TextField} label="Run file" value=${outTyped.value || out.value} onValue=${into(outTyped)} />
              <button type="button" disabled=${busy} onClick=${() => carryOut(true)}>Try</button>
              <button type="button" class="main" disabled=${busy} onClick=${() => carryOut(false)}>Import</button>
              ${now?.missing ? html`<span class="muted">${now.text}</span>`
                : changed ? html`<span class="muted">Changed since then: try or import again.</span>` : ""}
            </div>
            ${underWay.value && html`
              <${JobProgress} job=${underWay.value.job} title=${underWay.value.title} />
              <p class="muted">${underWay.value.title}…</p>`}
            ${refusal.value && html`<p class="fault" role="alert">${refusal.value}</p>`}
            <${Outcome} />
            <${Fold} title="The same on the command line">
              <pre class="command" tabindex="0" aria-label="Command">${now?.text}</pre><//>
          </section>`}`}
    </div>`;
}
