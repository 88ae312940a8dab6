// The step Plan: the postures of a plan, and what they will determine as they change.
import { html } from "htm/preact";
import { useEffect } from "preact/hooks";
import { signal } from "@preact/signals";
import { beyond, counted, remarks } from "../core/counting.js";
import { answer, arm, canRedo, canUndo, chosen, close, discard, file, jointsOf, lostDraftsOf, open, opening, pending,
  plan, redo, restored, save, undo, unsaved, wrong } from "../core/editing.js";
import { mountedIn } from "../core/mounting.js";
import { calibrationOf, go, route, toJob } from "../core/route.js";
import { addressed, attempt, calibration, versionOf } from "../core/store.js";
import { Choice } from "../parts/Controls.js";
import { DownloadDraft } from "../parts/Unsaved.js";
import { Fold } from "../parts/Fold.js";
import { Joints } from "../parts/Joints.js";
import { Message } from "../parts/Message.js";
import { Workspace } from "../parts/Workspace.js";
import { Scene } from "../scene/Scene.js";
import { Beside } from "./Beside.js";
import { Determined } from "./Determined.js";
import { Exporting } from "./Exporting.js";
import { Making } from "./Making.js";
import { motion, play } from "./motion.js";
import { aside, held, meshNotes, moveBox, moveFlange, moveTarget, picture, postureName, setJoint,
  turnJoint } from "./picture.js";
import { Postures } from "./Postures.js";

/** What the picture lets take hold of; a tool of it that is in the way is put aside. */
const tools = signal({ target: true, flange: false, joints: true, boxes: true });

/** Opens the plan that the address names, else the newest of the calibration. */
function useAddressedPlan() {
  const { name, step } = route.value, newest = calibration.value?.files.plan[0] ?? lostDraftsOf(name)[0]?.plan ?? "";
  const wanted = addressed.value || newest, back = plan.value === null ? versionOf(wanted) : null;
  useEffect(() => {
    if (!wanted || calibrationOf(file.value) !== name) {
      close();
    } // what is left of another calibration is never shown in this one
    if (!wanted) return;
    attempt(() => open(wanted));
    if (!addressed.value) go(toJob(name, step, wanted), { replace: true });
  }, [wanted, back]); // a file that is there again, or another one, is opened after all
  const here = plan.value !== null && calibrationOf(file.value) === name;
  return here ? "open" : wanted ? (opening.value === wanted ? "opening" : "failed") : "none";
}

/** Where the file is gone, nothing is left to show. */
function giveUp() {
  discard();
  if (plan.value === null) go("#/", { sure: true });
}

/** Opens that plan; what is shown as long as none is open, else null. @param {unknown} [about] beside making one */
export function usePlanStep(about = null) {
  const state = useAddressedPlan();
  usePlanKeys();
  if (state === "none") return html`<div class="alone"><h2>No plan yet</h2>${about}<${Making} /></div>`;
  return state === "open" && plan.value !== null ? null : html`
    <p class="muted centred" role="status">${state === "opening" ? "…" : "The plan could not be opened."}</p>`;
}

/** Saving, undoing, and which plan is open. */
export function PlanBar() {
  const plans = calibration.value?.files.plan ?? [], { name, step } = route.value;
  return html`
    <div class="bar plan-bar" role="toolbar" aria-label="Plan">
      <button type="button" disabled=${!canUndo.value} aria-keyshortcuts="Control+Z" onClick=${undo}>Undo</button>
      <button type="button" disabled=${!canRedo.value} aria-keyshortcuts="Control+Shift+Z" onClick=${redo}>Redo</button>
      <button type="button" class=${unsaved.value ? "main" : ""} disabled=${!unsaved.value}
        aria-keyshortcuts="Control+S" onClick=${() => save()}>Save</button>
      <output class="muted">${unsaved.value ? "Changes are not saved." : "Saved."}</output>
      ${plans.length > 1 && html`
        <${Choice} label="Plan" value=${file.value}
          groups=${[["plans", plans.map((one) => [one, one.replace(/^.*\//, "")])]]}
          onValue=${(/** @type {string} */ value) => go(toJob(name, step, value))} />`}
    </div>
    ${restored.value && unsaved.value && html`
      <p class="notes-line">Changes of ${restored.value.slice(0, 16).replace("T", " ")} that were not saved are
        back. <button type="button" onClick=${giveUp}>Discard them</button> <${DownloadDraft} /></p>`}
    ${wrong.value && html`<p class="error" role="alert">${wrong.value.text}</p>`}`;
}

/** The keys of the plan, wherever the focus is. */
function usePlanKeys() {
  useEffect(() => {
    const pressed = (/** @type {KeyboardEvent} */ event) => {
      if (!(event.ctrlKey || event.metaKey) || event.altKey || plan.value === null) return;
      const key = event.key.toLowerCase();
      if (key === "s") save();
      else if (key === "z" || key === "y") (key === "y" || event.shiftKey ? redo : undo)();
      else return;
      event.preventDefault();
    };
    addEventListener("keydown", pressed);
    return () => removeEventListener("keydown", pressed);
  }, []);
}

/** The message of the plan that is open. */
export function PlanMessage() {
  const found = answer.value;
  if (!found?.message) return null;
  return html`
    <${Message} verdict=${found.verdict} message=${found.message} action=${found.action} pending=${pending.value} />`;
}

/** The arm, its targets and obstacles, to be moved. @param {{caption?: string}} props */
export function PlanScene({ caption = "Postures as the servo will leave them, rotated onto their targets." }) {
  const scene = picture.value;
  if (scene === null) {
    return html`
      <p class="muted centred">${wrong.value ? "Nothing is drawn of a plan that cannot be checked." : "…"}</p>`;
  }
  const still = motion.value !== null;
  return html`
    <${Scene} scene=${scene} chosen=${chosen.value} motion=${motion.value} tools=${still ? {} : tools.value}
      onChoose=${(/** @type {number} */ i) => { chosen.value = i; play(-1); }} onTarget=${moveTarget}
        onFlange=${moveFlange} onJoint=${turnJoint} onBox=${moveBox}
      caption=${still ? "The arm moves along the null-space direction, with the target: the measurements hardly change."
        : [aside.value || caption, held.value].filter(Boolean).join(" ")} />`;
}

export function Plan() {
  const instead = usePlanStep(), i = chosen.value;
  if (instead !== null || plan.value === null) return instead;
  const values = jointsOf(plan.value, i);
  const inspector = html`
    <${PlanBar} />
    <h2>What this plan will determine</h2>
    <${Determined} />
    ${mountedIn(plan.value).length > 0 && html`
      <p class="mounted">Planned for an instrument mounted so, in the flange frame: ${mountedIn(plan.value).join("; ")}.
        Where it is mounted otherwise, change it in
        the <a href=${toJob(route.value.name, "cell", file.value)}>cell</a>.</p>`}
    ${arm.value !== null && html`
      <h2>Joints of ${postureName(i)}</h2>
      ${remarks(arm.value).map((one) => html`<p class="muted">${one}</p>`)}
      <${Joints} arm=${arm.value} values=${counted(arm.value, values)} beyond=${beyond(arm.value, values)}
        onJoint=${setJoint} />`}
    <div class="bar" role="group" aria-label="What can be moved in the picture">
      ${/** @type {const} */ (["target", "flange", "joints", "boxes"]).map((tool) => html`
        <label class="check" key=${tool}>
          <input type="checkbox" checked=${tools.value[tool]}
            onChange=${() => {
              tools.value = { ...tools.value, [tool]: !tools.value[tool] };
            }} /> ${{ target: "Target", flange: "Flange", joints: "Joints", boxes: "Obstacles" }[tool]}</label>`)}
    </div>
    <ul class="notes">${meshNotes.value.map((note) => html`<li>${note}</li>`)}</ul>
    <${Fold} title="Make another plan"><${Making} /><//>
    <${Fold} title="Compare with another plan"><${Beside} /><//>
    <${Fold} title="Export for a controller, or as a sheet"><${Exporting} /><//>`;
  return html`
    <${Workspace} name="What the plan will determine, and its postures" message=${html`<${PlanMessage} />`}
      scene=${html`<${PlanScene} />`} inspector=${inspector} drawer=${html`<${Postures} />`} />`;
}
