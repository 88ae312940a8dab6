// How a plan is to be carried out: by a simulation, by hand, by a robot.
import { html } from "htm/preact";
import { useSignal } from "@preact/signals";
import { hasEdits, saveEdits, wrong } from "../core/editing.js";
import { outOf } from "../core/jobs.js";
import { calibrationOf, goOn, route, toJob } from "../core/route.js";
import { calibration, freeName, ofCalibration, typedIn } from "../core/store.js";
import { Choice, into, TextField } from "../parts/Controls.js";
import { Fields, missingOf, wordsOf } from "../parts/Fields.js";
import { Form, Submit } from "../parts/Form.js";
import { start } from "./running.js";

const picked = ofCalibration("");
/** What is typed, for whatever rig it is. */
const typed = typedIn();

/**
 * @param {{plan: string, rigs: import("answers").RigForm[] | null, onPlan: (plan: string) => void}} props
 *   `rigs`: what can carry the plan out; null: not read yet
 */
export function Start({ plan, rigs, onPlan }) {
  const file = useSignal(""), password = useSignal(""), busy = useSignal(false), saving = useSignal(false);
  // What was chosen for another plan holds as far as it can serve this one.
  const rig = rigs?.find(({ name }) => name === picked.value) ?? rigs?.[0];
  const plans = [...new Set([...(calibration.value?.files.plan ?? []), ...(plan ? [plan] : [])])];
  const proposed = plan ? freeName(plan.replace(/\.[^./]*$/, "-run.jsonl")) : "", edited = hasEdits(plan);
  const begin = async () => {
    if (!rig) return;
    const from = route.value;
    busy.value = true;
    try {
      if (saving.value && edited && !(await saveEdits(plan))) {
        if (wrong.value) throw wrong.value;
        return; // the file was changed elsewhere: both are shown, and one is chosen
      }
      const to = file.value.trim() || proposed;
      const words = [...rig.command, `--out=${to}`, ...wordsOf(rig.fields, typed.value), plan];
      await start(words, password.value);
      password.value = file.value = "";
      const out = outOf(words);
      goOn(from, toJob(calibrationOf(out), "measure", out), { replace: true, sure: true });
    } finally {
      busy.value = false;
    }
  };
  const unready = busy.value || !plan || !rig || missingOf(rig.fields, typed.value) !== "";
  if (!plans.length) return html`<p>A run needs a plan. <a href=${toJob(route.value.name, "plan")}>Make one</a></p>`;
  return html`
    <${Form} class="start" aria-label="Start a run" onSubmit=${begin}>
      <fieldset class="rigs"><legend class="label">What carries the plan out</legend>
        ${rigs?.map(({ name, label }) => html`
          <label class="check" key=${name}>
            <input type="radio" name="rig" value=${name} checked=${rig?.name === name}
              onChange=${() => { picked.value = name; }} /> ${label}</label>`)}
      </fieldset>
      <div class="fields">
        <div class="wide"><${Choice} label="Plan" value=${plan} items=${plans} onValue=${onPlan} /></div>
        <div class="wide">
          <${TextField} label="Run file" value=${file.value} placeholder=${proposed} onValue=${into(file)} /></div>
      </div>
      ${rig && html`
        ${rig.about && html`<p class="muted">${rig.about}</p>`}
        <${Fields} key=${rig.name} fields=${rig.fields} values=${typed.value}
          onValue=${typed.set}>
          ${rig.kind === "abb" && html`
            <${TextField} label="Password" secret value=${password.value} onValue=${into(password)} />`}<//>`}
      ${edited && html`<p class="notes-line" role="status">${plan} has changes that are not saved.</p>`}
      <p class="bar" onClickCapture=${(/** @type {Event} */ event) => {
        saving.value = /** @type {Element} */ (event.target).closest("button")?.value !== "saved";
      }}>
        <${Submit} disabled=${unready}>${edited ? "Save the plan. " : ""}${rig?.begins ?? "Start"}<//>
        ${edited && html`<button value="saved" disabled=${unready}>Start by the plan as it was saved</button>`}
      </p>
    <//>`;
}
