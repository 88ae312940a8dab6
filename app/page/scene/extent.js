// How far a scene goes, for the camera that is to see all of it.
import { boxCorners } from "./marks.js";

/** @typedef {import("./vectors.js").Vec} Vec */
/** @typedef {import("./types.js").Scene3D} Scene3D */

/** The height of the face that the arm is mounted on. @param {Scene3D} scene */
export const floorOf = (scene) => -(scene.arm.mounting.below_base_mm ?? 0);

/** All points that are to be seen, but for meshes. @param {Scene3D} scene @returns {Vec[]} */
export const extent = (scene) => [
  [0, 0, 0], [0, 0, floorOf(scene)], [0, 0, 0.3 * scene.reach], ...(scene.boxes || []).flatMap(boxCorners),
  ...scene.marks.flatMap(({ at, outline, kind }) =>
    [at, ...(outline || []), ...(kind === "tracker" ? [/** @type {Vec} */ ([at[0], at[1], floorOf(scene)])] : [])]),
  ...scene.postures.flatMap(({ skeleton, tool, beam, sights }) =>
    [...skeleton, ...(tool ? [tool] : []), ...(beam || []), ...(sights || []).flat()]),
];
