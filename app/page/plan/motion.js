// The arm moves along a null-space direction: how it can be off without any measurement showing it.
import { computed, signal } from "@preact/signals";
import { answer, arm, chosen, plan } from "../core/editing.js";
import { moved } from "../scene/turning.js";
import { dot, minus, plus, times } from "../scene/vectors.js";

const STEPS = 6; // poses to each side

/** @typedef {import("../scene/vectors.js").Vec} Vec */
/** @typedef {import("../scene/view.js").Motion & {direction: number}} Moving */
const played = signal({ direction: -1, of: /** @type {unknown} */ (null) });

/**
 * The direction that is shown, and its frames: of the plan as it is, not as it was before an edit.
 * @type {import("@preact/signals").ReadonlySignal<Moving | null>}
 */
export const motion = computed(() => {
  const { direction, of } = played.value, body = arm.value, along = answer.value?.null_motion[direction];
  const place = answer.value?.scene[chosen.value];
  if (of !== plan.value || !body || !place || !along) return null;
  const frames = Array.from({ length: 2 * STEPS + 1 }, (_, i) => {
    const share = (i - STEPS) / STEPS, by = along.joints_deg.map((v) => share * v);
    const there = (/** @type {Vec | null | undefined} */ tool) =>
      moved({ ...place, tool }, by, body.joints.map((joint) => joint.kind));
    const now = there(place.tool), from = now.tool;
    if (!place.beam || !from) return now;
    // Laser and flange are one rigid body; the beam ends nearest to the moved target.
    const ray = minus(/** @type {Vec} */ (there(place.beam[1]).tool), from);
    const target = plus(place.target, /** @type {Vec} */ (["x", "y", "z"].map((axis) =>
      share * (along.others[`${place.target_name}.${axis}`] ?? 0))));
    return { ...now, beam: [from, plus(from, times(ray, Math.max(0, dot(minus(target, from), ray) / dot(ray, ray))))] };
  });
  return { direction, frames, period_s: 2.4 };
});

/** Shows a direction until it is asked for again, or another posture (-1: none). @param {number} direction */
export const play = (direction) => {
  played.value = { direction: motion.value?.direction === direction ? -1 : direction, of: plan.value };
};

/** Whether a direction moves a joint. @param {number} direction */
export const moves = (direction) => Boolean(answer.value?.null_motion?.[direction]?.joints_deg.some((v) => v !== 0));
