// Joints as the arm's pendant counts, names and orders them, in degrees (mm). The server says how: `less_joint2`.

/**
 * @typedef {{names: string[], order: number[], unit: string, less_joint2: number[], joint3: "link" | "ground",
 *   stated: boolean}} Counting
 * @typedef {{pendant: Counting, joints: {name: string, unit: string, lower: number, upper: number}[],
 *   ranges: number[][]}} CountedArm
 *   limits of `joints` are as the pendant counts, `ranges` with joint 3 from link 2
 */

/**
 * Joint values of a file, as the pendant counts them.
 * @param {CountedArm} arm @param {number[]} joints joint 3 from link 2
 */
export const counted = ({ pendant: { less_joint2 } }, joints) =>
  joints.map((value, i) => (less_joint2[i] ? value - less_joint2[i] * joints[1] : value));

/**
 * Joint values of a file, after one of them was set as the pendant counts: the others stay as the pendant shows them.
 * @param {CountedArm} arm @param {number[]} joints @param {number} joint from 1 @param {number} value
 */
export function withCounted({ pendant: { less_joint2 } }, joints, joint, value) {
  const turned = joint === 2 ? value - joints[1] : 0;
  return joints.map((before, i) =>
    (i === joint - 1 ? value + (less_joint2[i] ? less_joint2[i] * joints[1] : 0) : before + less_joint2[i] * turned));
}

/**
 * Which of them are beyond a limit: as the pendant counts, or between the links.
 * @param {CountedArm} arm @param {number[]} joints
 */
export function beyond(arm, joints) {
  const shown = counted(arm, joints);
  const outside = (/** @type {number} */ value, /** @type {number} */ lower, /** @type {number} */ upper) =>
    value < lower - 1e-9 || value > upper + 1e-9;
  return joints.map((value, i) =>
    outside(shown[i], arm.joints[i].lower, arm.joints[i].upper) || outside(value, arm.ranges[i][0], arm.ranges[i][1]));
}

const UNITS = { rad: "radians", pulse: "pulses" };

/** What a reader of the values must know. @param {CountedArm} arm @returns {string[]} */
export function remarks({ pendant: { joint3, stated, unit } }) {
  return [
    joint3 === "ground"
      ? "As the pendant shows them: joint 3 from the ground. The plan’s file has it from link 2, which is J2 + J3."
      : stated ? "" : "The robot file does not state what the pendant counts joint 3 from: here it is from link 2.",
    unit in UNITS ? `Values are in degrees; the pendant shows ${UNITS[/** @type {keyof typeof UNITS} */ (unit)]}.` : "",
  ].filter(Boolean);
}
