// The flange's pose at a posture, in the forms of the makers' pendants: to hold the model against the arm.
import { html } from "htm/preact";
import { useEffect, useMemo } from "preact/hooks";
import { useSignal } from "@preact/signals";
import { latest, post } from "../core/api.js";
import { chosen, file, jointsOf, plan, robotFrom } from "../core/editing.js";
import { failed } from "../core/store.js";
import { Joint3 } from "../parts/Controls.js";
import { Joints } from "../parts/Joints.js";

export function Pendant() {
  const values = useSignal(/** @type {number[] | null} */ (null)), j3 = useSignal("pendant");
  const found = useSignal(/** @type {import("answers").DrawnArm | null} */ (null));
  const content = plan.value, planned = content === null ? null : jointsOf(content, chosen.value);
  // As the plan has them they are counted from link to link; what is typed is as the pendant counts.
  const ask = useMemo(() => latest(
    () => null,
    () => post("/api/robot", { robot: robotFrom(plan.value?.robot ?? "", file.value), j3: j3.value,
      ...(values.value ? { joints_deg: values.value } : { joints_deg: planned, as_in_files: true }) }),
    (answer) => {
      found.value = answer;
      values.value ??= [...answer.poses[0].counted_deg];
    },
    failed,
  ), []);
  useEffect(() => { ask(); }, [values.value, j3.value]);
  if (!found.value || !values.value) return html`<p class="muted">…</p>`;
  const { poses: [pose] } = found.value, given = values.value;
  return html`
    <p class="muted">The flange in the base frame, without a tool. Compare it with the pendant at the same joint
      values.</p>
    <${Joint3} value=${j3.value} usual="pendant"
      onValue=${(/** @type {string} */ value) => { values.value = null; j3.value = value; }} />
    <${Joints} arm=${found.value} values=${given} beyond=${given.map((_, i) => pose.outside.includes(i + 1))}
      onJoint=${(/** @type {number} */ joint, /** @type {number} */ value) => {
        values.value = given.map((one, i) => (i === joint - 1 ? value : one));
      }} />
    <p><button type="button" onClick=${() => { values.value = given.map(() => 0); }}>All to zero</button></p>
    <div dangerouslySetInnerHTML=${{ __html: found.value.pose }} />`;
}
