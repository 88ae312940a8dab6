// What the scene shows of a run: the arm where it is sent, its beam, and the plan's postures.
import { computed, effect, signal } from "@preact/signals";
import { getFile, post, Refused } from "../core/api.js";
import { moved } from "../scene/turning.js";
import { run } from "./running.js";

/** @typedef {import("../scene/types.js").Scene3D} Scene3D */
/** @typedef {import("../core/editing.js").Checked} Checked */
/** @typedef {import("answers").DrawnArm} DrawnArm */
/** @typedef {import("../scene/types.js").ShownPosture} ShownPosture */

const MOVING_MS = 90; // an arm that is sent elsewhere is seen going there
const NEAR = 0.05; // degrees or mm

/** The plan of the run, checked. */
export const planned = signal(/** @type {{of: string, robot: DrawnArm, checked: Checked} | null} */ (null));
/** What can carry a plan out. */
export const offered = signal(/** @type {{of: string, rigs: import("answers").RigForm[]} | null} */ (null));
let wanted = "";

/** What the pictures need of a plan. @param {string} file @param {string | null} version of the file */
export async function preparePlan(file, version) {
  const now = `${file} ${version}`;
  if (!file || now === wanted) return;
  wanted = now;
  planned.value = null;
  try {
    const found = await getFile("plan", file);
    if (wanted === now) offered.value = { of: file, rigs: found.rigs };
    const asked = { plan: found.plan, file: found.file, scene: true, links: true };
    const checked = /** @type {Checked} */ (await post("/api/check", asked));
    if (wanted === now) planned.value = { of: file, robot: found.robot, checked };
  } catch (error) {
    if (!(error instanceof Refused)) throw error; // the run goes on without a picture
  }
}

/** The unit of each offset. */
export const units = computed(() =>
  Object.fromEntries((planned.value?.checked.parameters ?? []).map((row) => [row.name, row.unit])));

const postures = computed(() => (planned.value?.checked.scene ?? [])
  .map((posture, i) => ({ ...posture, name: `measurement ${i}`, beam: null, joints: posture.joints_deg })));

/** Where the arm is drawn now, on its way to where it was sent. */
const joints = signal(/** @type {number[] | null} */ (null));
let moving = 0;
effect(() => {
  const sent = run.value.arm;
  if (!sent) { joints.value = null; return; }
  const still = joints.peek() === null || matchMedia("(prefers-reduced-motion: reduce)").matches;
  if (still) joints.value = sent.joints_deg;
  else if (!moving) move(performance.now());
});

// One step of the way at each frame, however often the arm is sent elsewhere meanwhile.
/** @param {number} before */
function move(before) {
  moving = requestAnimationFrame((now) => {
    moving = 0;
    const to = run.peek().arm?.joints_deg, at = joints.peek();
    if (!to || !at || at.length !== to.length) return;
    const share = 1 - Math.exp(-(now - before) / MOVING_MS);
    const near = Math.max(...to.map((v, i) => Math.abs(v - at[i]))) < NEAR;
    joints.value = near ? to : to.map((v, i) => at[i] + share * (v - at[i]));
    if (!near) move(now);
  });
}

/** The arm as it was sent. @type {import("@preact/signals").ReadonlySignal<ShownPosture | null>} */
const arm = computed(() => {
  const sent = run.value.arm, plan = planned.value, now = joints.value;
  if (!sent || !plan || !now) return null;
  const start = postures.value[0], kinds = plan.robot.joints.map((joint) => joint.kind);
  /** @type {ShownPosture} */
  const shown = start?.axes && start.joints
    ? moved({ ...start, tool: null }, now.map((v, i) => v - /** @type {number[]} */ (start.joints)[i]), kinds)
    : { name: "", skeleton: sent.arm };
  const there = now === sent.joints_deg;
  return { ...shown, name: `measurement ${sent.shot}`, skeleton: there ? sent.arm : shown.skeleton,
    tool: there ? sent.beam[0] : null, beam: there && sent.lit && sent.beam.length > 1 ? sent.beam : null, joints: now,
    reaches: true, violations: [] };
});

/** @type {import("@preact/signals").ReadonlySignal<{scene: Scene3D, chosen: number | null} | null>} */
export const picture = computed(() => {
  const plan = planned.value;
  if (!plan) return null;
  const now = arm.value, list = now ? [...postures.value, now] : postures.value;
  return { scene: { of: `run ${plan.of}`, reach: plan.robot.reach_mm, arm: plan.robot, postures: list,
    marks: plan.checked.marks }, chosen: now ? list.length - 1 : null };
});
