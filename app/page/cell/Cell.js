// The step Cell: what does not change from posture to posture. Robot, instrument, noise, targets, constraints,
// obstacles.
import { html } from "htm/preact";
import { arm, file, plan } from "../core/editing.js";
import { fixed, withUnit } from "../core/words.js";
import { Making } from "../plan/Making.js";
import { PlanBar, PlanMessage, PlanScene, useAddressedPlan, usePlanKeys } from "../plan/Plan.js";
import { Fold } from "../parts/Fold.js";
import { Workspace } from "../parts/Workspace.js";
import { Constraints } from "./Constraints.js";
import { Geometry, Instrument, Noise } from "./Header.js";
import { Obstacles } from "./Obstacles.js";
import { Pendant } from "./Pendant.js";
import { Targets } from "./Targets.js";

function Robot() {
  if (arm.value === null) return html`<p class="muted">The robot cannot be read.</p>`;
  const { vendor, model, name, joints, reach_mm, pendant, mounting } = arm.value;
  return html`
    <p><b>${[vendor, model ?? name].filter(Boolean).join(", ")}</b>: ${joints.length} joints,
      reach ${fixed(reach_mm, 0)} mm from the axis of joint 1.
      ${pendant.joint3 === "ground" ? " Joint 3 is counted from the ground: the angle between links 2 and 3 is J2 + J3."
        : " Joint 3 is counted from link 2."}
      ${mounting.below_base_mm === null ? " The mounting face is not stated."
        : ` The mounting face is at z = ${withUnit(String(-mounting.below_base_mm), "mm")} of the base frame.`}</p>`;
}

export function Cell() {
  const state = useAddressedPlan();
  usePlanKeys();
  if (state === "none") {
    return html`
      <div class="alone"><h2>No plan yet</h2><p class="muted">The cell is stated in the plan's file.</p>
        <${Making} /></div>`;
  }
  if (state !== "open" || plan.value === null) {
    return html`
      <p class="muted centred" role="status">${state === "opening" ? "…" : "The plan could not be opened."}</p>`;
  }
  const inspector = html`
    <${PlanBar} />
    <h2>Robot</h2><${Robot} />
    <${Fold} title="Check it against the pendant"><${Pendant} key=${file.value} /><//>
    <h2>Targets</h2><${Targets} />
    <h2>Instrument</h2><${Instrument} />
    <${Fold} title="Noise"><${Noise} /><//>
    <${Fold} title="Geometry of the arm"><${Geometry} /><//>
    <${Fold} title="Constraints of the measurements"><${Constraints} /><//>
    <${Fold} title="Obstacles"><${Obstacles} /><//>`;
  return html`
    <${Workspace} name="Robot, instrument, targets and obstacles" message=${html`<${PlanMessage} />`}
      scene=${html`<${PlanScene} caption="The cell. Targets and obstacles are dragged where they stand." />`}
      inspector=${inspector} />`;
}
