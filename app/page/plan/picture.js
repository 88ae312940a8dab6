// What the scene shows of the plan that is open, and what is done to the plan in it.
import { computed, effect, signal } from "@preact/signals";
import { counted, withCounted } from "../core/counting.js";
import { latest, post, Refused } from "../core/api.js";
import { answer, arm, change, chosen, file, jointsOf, ofPlan, plan, robotFrom } from "../core/editing.js";
import { failed } from "../core/store.js";
import { fixed } from "../core/words.js";

/** @typedef {import("../scene/types.js").Scene3D} Scene3D */
/** @typedef {import("../scene/types.js").FlangePose} FlangePose */

/** From which on a posture is said to point beside its target. */
export const LEAST_OFF_MM = 0.05;

/** The meshes of the plan's URDF; undefined where it has none. */
export const meshes = signal(/** @type {import("answers").LinkMesh[] | undefined} */ (undefined));
/** What is left out of them. */
export const meshNotes = signal(/** @type {string[]} */ ([]));
let meshesOf = "";
effect(() => {
  const ref = plan.value?.robot, key = typeof ref === "object" ? JSON.stringify(robotFrom(ref, file.value)) : "";
  if (key === meshesOf) return;
  meshesOf = key;
  meshes.value = undefined;
  meshNotes.value = [];
  if (!key) return;
  post("/api/meshes", { robot: JSON.parse(key) }).then((found) => {
    if (meshesOf !== key) return;
    meshes.value = found.meshes;
    meshNotes.value = found.notes;
  }, (error) => {
    if (!(error instanceof Refused)) throw error;
    if (meshesOf === key) meshNotes.value = [error.text];
  });
});

/**
 * How far the chosen posture points beside its target before the wrist is rotated onto it, in words; "" where it does
 * not.
 */
export const aside = computed(() => {
  const posture = answer.value?.postures[chosen.value];
  if (!posture?.hit || posture.off_mm < LEAST_OFF_MM) return "";
  return `As stated, ${postureName(chosen.value)} points ${fixed(posture.off_mm, 1)} mm beside the target. `
    + "The picture shows it with the wrist rotated onto the target first.";
});

/** @param {number} i */
export const postureName = (i) => `measurement ${i}`;

/** As text, which is the same as long as they are. */
const obstacles = computed(() => JSON.stringify(plan.value?.constraints?.obstacles?.boxes ?? []));
/**
 * The value before where the new one is the same: only what has changed is drawn anew.
 * @template T @param {T | undefined} before @param {T} now @returns {T}
 */
const kept = (before, now) => (before && JSON.stringify(before) === JSON.stringify(now) ? before : now);
/** What was shown last. @type {Partial<Scene3D>} */
let last = {};

/** @type {import("@preact/signals").ReadonlySignal<Scene3D | null>} */
export const picture = computed(() => {
  const found = answer.value, body = arm.value;
  if (body === null || !found?.scene) return null;
  const boxes = /** @type {import("answers").Box[]} */ (JSON.parse(obstacles.value));
  return last = {
    of: `plan ${file.value} ${body.name}`,
    reach: body.reach_mm,
    arm: body,
    meshes: meshes.value,
    postures: found.scene.map((posture, i) => kept(last.postures?.[i],
      { ...posture, name: postureName(i), joints: posture.joints_deg, counted: counted(body, posture.joints_deg) })),
    marks: kept(last.marks, found.marks),
    boxes: kept(last.boxes,
      boxes.map(({ name, min_mm, max_mm }, i) =>
        ({ name, min: min_mm, max: max_mm, touched: found.touched_boxes[i] ?? false }))),
  };
});

const tenth = (/** @type {number} */ value) => Math.round(10 * value) / 10;

/** @param {string} name @param {number[]} at */
export const moveTarget = (name, at) => change(`targets/${name}`, (content) => {
  content.targets ??= {};
  content.targets[name] = { ...content.targets[name],
    guess_mm: /** @type {[number, number, number]} */ (at.map(tenth)) };
});

/** A joint as the pendant counts it. @param {number} joint from 1 @param {number} value */
export const setJoint = (joint, value) => {
  const i = chosen.value, body = arm.value;
  if (body !== null) {
    change(`joint/${i}/${joint}`, (content) => {
      const joints = jointsOf(content, i);
      withCounted(body, joints, joint, value).forEach((v, k) => { joints[k] = Number(v.toFixed(9)); });
    });
  }
};

/** A joint between its links, what it carries with it. @param {number} joint from 1 @param {number} value */
export const turnJoint = (joint, value) => {
  const i = chosen.value;
  change(`joint/${i}/${joint}`, (content) => { jointsOf(content, i)[joint - 1] = Number(value.toFixed(3)); });
};

/** @param {number} i @param {import("../scene/types.js").Box} box */
export const moveBox = (i, box) => change(`boxes/${i}`, (content) => {
  Object.assign(content.constraints?.obstacles?.boxes?.[i]
    ?? {}, { min_mm: box.min.map(Math.round), max_mm: box.max.map(Math.round) });
});

/** The pose that the flange is dragged to: the newest is asked for. @type {Partial<FlangePose> | null} */
let wanted = null;
/** What keeps the flange from where it is dragged. */
export const held = ofPlan("");
const askInverse = latest(
  () => `${chosen.value} of ${file.value}`,
  () => {
    const content = plan.value;
    if (wanted === null || content === null) return Promise.resolve(null);
    return post("/api/inverse", { robot: robotFrom(content.robot, file.value),
      joints_deg: jointsOf(content, chosen.value), ...wanted });
  },
  (found) => {
    const i = chosen.value;
    held.value = found.at_limit?.length
      ? `At the limit: ${found.at_limit.map((j) => arm.value?.pendant.names[j - 1] ?? `J${j}`).join(", ")}.`
      : found.reached ? "" : "The flange cannot be brought there.";
    if (found.reached) {
      change(`flange/${i}`, (content) => {
        found.joints_deg.forEach((v, j) => { jointsOf(content, i)[j] = Number(v.toFixed(3)); });
      });
    }
  },
  failed,
);

/** @param {FlangePose} pose */
export function moveFlange(pose) {
  wanted = { position_mm: pose.position_mm,
    ...(pose.quaternion_wxyz ? { quaternion_wxyz: pose.quaternion_wxyz } : {}) };
  askInverse();
}
