// The step Cell: what does not change from posture to posture. Robot, instrument, noise, targets, constraints,
// obstacles.
import { html } from "htm/preact";
import { arm, file } from "../core/editing.js";
import { PlanBar, PlanMessage, PlanScene, usePlanStep } from "../plan/Plan.js";
import { Fold } from "../parts/Fold.js";
import { Workspace } from "../parts/Workspace.js";
import { Obstacles } from "./Obstacles.js";
import { Pendant } from "./Pendant.js";
import { Stated } from "./Stated.js";
import { Targets } from "./Targets.js";

function Robot() {
  if (arm.value === null) return html`<p class="muted">The robot cannot be read.</p>`;
  const { vendor, model, name, about } = arm.value;
  return html`
    <p><b>${[vendor, model ?? name].filter(Boolean).join(", ")}</b></p>
    <${Fold} title="Joints, mounting and counting"><div dangerouslySetInnerHTML=${{ __html: about }} /><//>`;
}

export function Cell() {
  const instead = usePlanStep(html`<p class="muted">The cell is stated in the plan's file.</p>`);
  if (instead !== null) return instead;
  const inspector = html`
    <${PlanBar} />
    <h2>Robot</h2><${Robot} />
    <${Fold} title="Check it against the pendant"><${Pendant} key=${file.value} /><//>
    <h2>Targets</h2><${Targets} />
    <h2>Instrument, noise, geometry and constraints</h2>
    <${Stated} key=${file.value} keys=${["tool", "instruments", "noise", "geometry", "constraints"]} />
    <${Fold} title="Obstacles"><${Obstacles} /><//>`;
  return html`
    <${Workspace} name="Robot, instrument, targets and obstacles" message=${html`<${PlanMessage} />`}
      scene=${html`<${PlanScene} caption="The cell. Targets and obstacles are dragged where they stand." />`}
      inspector=${inspector} />`;
}
