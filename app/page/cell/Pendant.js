// The flange's pose at a posture, in the forms of the makers' pendants: to hold the model against the arm.
import { html } from "htm/preact";
import { useEffect, useMemo } from "preact/hooks";
import { useSignal } from "@preact/signals";
import { latest, post } from "../core/api.js";
import { chosen, file, jointsOf, plan, robotFrom } from "../core/editing.js";
import { failed } from "../core/store.js";
import { fixed, withUnit } from "../core/words.js";
import { Joint3 } from "../parts/Controls.js";
import { Joints } from "../parts/Joints.js";
import { Table } from "../parts/Table.js";

/** @param {number} digits @param {string} unit @param {number[] | null} of */
const cells = (digits, unit, of) => (of ?? []).map((v) => withUnit(fixed(v, digits), unit)).join(", ");

/**
 * The rows that `zerobeam robot` prints.
 * @param {import("answers").ShownPose} pose @returns {[string, string, string][]}
 */
const forms = (pose) => [
  ["X, Y, Z", cells(2, "mm", pose.xyz_mm), "all"],
  ["q1, q2, q3, q4", cells(5, "", pose.quaternion_wxyz), "ABB"],
  ["A, B, C", cells(3, "deg", pose.abc_deg), "KUKA"],
  ["W, P, R", cells(3, "deg", pose.rpy_deg), "FANUC, roll pitch yaw"],
  ["rx, ry, rz", cells(4, "rad", pose.rotation_vector_rad), "UR"],
  ["Rx, Ry, Rz", cells(3, "deg", pose.rx_ry_rz_deg), "Stäubli"],
  ["A, B, C (ZYZ)", cells(3, "deg", pose.zyz_deg), "Doosan; O, A, T of Kawasaki"],
];

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
  const { poses: [pose], joints, pendant } = found.value, given = values.value;
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
    ${pose.outside.length > 0 && html`
      <p class="notes">Beyond the limits: ${pose.outside.map((j) => pendant.names[j - 1]).join(", ")}</p>`}
    <${Table} name="Pose of the flange"><tbody>${forms(pose).map(([name, text, used]) => html`
      <tr><th scope="row">${name}</th><td class="copy">${text}</td><td class="muted">${used}</td></tr>`)}</tbody><//>
    <${Table} name="Joint table"
      heads=${["joint", "name", "kind", ["lower", "right"], ["upper", "right"], ["top speed", "right"]]}>
      <tbody>${joints.map((joint, i) => html`
        <tr><th scope="row">${pendant.names[i]}</th><td>${joint.name}</td><td>${joint.kind}</td>
          ${[joint.lower, joint.upper].map((v) => html`
            <td class="right">${withUnit(String(Number(v.toFixed(2))), joint.unit)}</td>`)}
        <td class="right">
          ${joint.speed === null ? "not stated"
            : `${withUnit(String(Number(joint.speed.toFixed(2))), joint.unit)}/s`}</td></tr>`)}</tbody><//>`;
}
