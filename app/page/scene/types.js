// What a scene shows. Base frame, mm, z up; joints in degrees (mm of a prismatic one).

/** @typedef {import("./vectors.js").Vec} Vec */
/** @typedef {import("./marks.js").Mark} Mark */

/**
 * The answer of POST /api/robot, as far as it is drawn.
 * @typedef {Pick<import("answers").DrawnArm, "name" | "skeleton" | "axes" | "links" | "joints" | "mounting"> &
 *   Partial<Pick<import("answers").DrawnArm, "reach_mm" | "ranges" | "pendant" | "poses">>} DrawnArm
 */

/**
 * The arm in one posture, with what it sees.
 * @typedef {object} ShownPosture
 * @property {string} name
 * @property {Vec[]} skeleton
 * @property {Vec[]|null} [axes]
 * @property {number[][][]|null} [links]
 * @property {Vec|null} [tool] laser or tip
 * @property {Vec[]|null} [beam] two points
 * @property {Vec[][]|null} [sights] lines to what is measured
 * @property {boolean} [reaches]
 * @property {boolean} [blocked] the arm or a box is in the way of beam or sight
 * @property {string[]} [violations]
 * @property {number[]} [joints] of the posture, for the limits while a joint is dragged
 * @property {number[]} [counted] the same as the pendant counts
 */

/** @typedef {{name: string, min: Vec, max: Vec, touched?: boolean}} Box */
/** @typedef {import("answers").LinkMesh} LinkMesh */
/**
 * @typedef {{factor: number, items: {at: Vec, by: Vec, tone: import("./bodies.js").Tone}[]}} Vectors `by` is drawn
 *   `factor` times as long
 */
/** @typedef {{at: Vec, size: number, tone: import("./bodies.js").Tone}} Cloud a ball */

/**
 * @typedef {object} Scene3D
 * @property {string} of what is shown: as long as it is the same the camera stays
 * @property {number} reach of the arm
 * @property {DrawnArm} arm
 * @property {LinkMesh[]} [meshes] of a URDF
 * @property {ShownPosture[]} postures
 * @property {Mark[]} marks
 * @property {Box[]} [boxes]
 * @property {Vectors} [vectors]
 * @property {Cloud[]} [clouds]
 */

/**
 * What a person may take hold of.
 * @typedef {{target?: boolean, flange?: boolean, joints?: boolean, boxes?: boolean}} Tools
 */
/** What is held. @typedef {{kind: "target", name: string} | {kind: "flange"} | {kind: "box", index: number}} Held */
/** @typedef {{position_mm: Vec, quaternion_wxyz: [number, number, number, number]|null}} FlangePose */

/**
 * What a scene does for the page around it.
 * @typedef {object} SceneActs
 * @property {(index: number) => void} [choose]
 * @property {(name: string, at: Vec, done: boolean) => void} [target]
 * @property {(pose: FlangePose, done: boolean) => void} [flange]
 * @property {(joint: number, value: number, done: boolean) => void} [joint] from 1
 * @property {(index: number, box: Box, done: boolean) => void} [box]
 * @property {(held: Held|null) => void} [held]
 * @property {(turn: string) => void} [turned] the CSS matrix of the view cube
 */

export {};
