// The arm moves along a null-space direction: how it can be off without any measurement showing it.
import { computed, signal } from "@preact/signals";
import { post } from "../core/api.js";
import { answer, chosen, file, plan, robotFrom } from "../core/editing.js";
import { attempt } from "../core/store.js";

const STEPS = 6; // poses to each side

/** @typedef {[number, number, number]} Vec */
/** @typedef {import("../scene/view.js").Motion & {direction: number}} Moving */
const played = signal(/** @type {{of: unknown, motion: Moving | null}} */ ({ of: null, motion: null }));
/** Which direction is shown, and its frames: of the plan as it is, not as it was before an edit. */
export const motion = computed(() => (played.value.of === plan.value ? played.value.motion : null));
export const stopMotion = () => { played.value = { of: null, motion: null }; };

const minus = (/** @type {number[]} */ a, /** @type {number[]} */ b) => a.map((v, i) => v - b[i]);
const dot = (/** @type {number[]} */ a, /** @type {number[]} */ b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (/** @type {number[]} */ a, /** @type {number[]} */ b) =>
  [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];

/** v turned by a unit quaternion, or turned back. @param {number[] | null} quaternion @param {number[]} v */
function turned(quaternion, v, back = false) {
  const [w, x, y, z] = quaternion ?? [1, 0, 0, 0];
  const q = back ? [-x, -y, -z] : [x, y, z];
  const t = cross(q, v).map((c) => 2 * c), u = cross(q, t);
  return v.map((c, i) => c + w * t[i] + u[i]);
}

/** Shows a direction until it is asked for again. @param {number} direction */
export const play = (direction) => attempt(async () => {
  if (motion.value?.direction === direction) { stopMotion(); return; }
  const content = plan.value, place = answer.value?.scene[chosen.value], along = answer.value?.null_motion[direction];
  if (content === null || !place || !along) return;
  const shares = Array.from({ length: 2 * STEPS + 1 }, (_, i) => (i - STEPS) / STEPS);
  const robot = robotFrom(content.robot, file.value);
  const arms = await Promise.all(shares.map((share) =>
    post("/api/robot", { robot, joints_deg: place.joints_deg.map((v, i) => v + share * along.joints_deg[i]) })));
  const rest = arms[STEPS].poses[0];
  // Laser and flange are one rigid body; the beam ends nearest to the moved target.
  const tool = turned(rest.quaternion_wxyz, minus(place.tool, rest.xyz_mm), true);
  const beam = place.beam && turned(rest.quaternion_wxyz, minus(place.beam[1], place.beam[0]), true);
  const frames = arms.map((arm, i) => {
    const pose = arm.poses[0], from = turned(pose.quaternion_wxyz, tool).map((v, k) => v + pose.xyz_mm[k]);
    if (!beam) return { skeleton: arm.skeleton, axes: arm.axes, links: arm.links, tool: from, beam: null };
    const target = place.target.map((v, k) => v + shares[i] * (along.others[`${place.target_name}.${"xyz"[k]}`] ?? 0));
    const ray = turned(pose.quaternion_wxyz, beam), length = Math.max(0, dot(minus(target, from), ray) / dot(ray, ray));
    return { skeleton: arm.skeleton, axes: arm.axes, links: arm.links, tool: from,
      beam: [from, from.map((v, k) => v + length * ray[k])] };
  });
  played.value = { of: content,
    motion: /** @type {Moving} */ (/** @type {unknown} */ ({ direction, frames, period_s: 2.4 })) };
});

/** Whether a direction moves a joint. @param {number} direction */
export const moves = (direction) => Boolean(answer.value?.null_motion?.[direction]?.joints_deg.some((v) => v !== 0));
