// An arm in another posture, from its points and axes alone.
import { apart, minus, plus, rotated, times } from "./vectors.js";

/** @typedef {import("./vectors.js").Vec} Vec */
/** @typedef {import("./bodies.js").Arm} Arm */

/**
 * The arm with joint `k` (from 1) further by `by`, degrees or mm: what is behind it goes along. Exact.
 * @template {Arm & {links?: number[][][]|null, tool?: Vec|null, beam?: Vec[]|null, sights?: Vec[][]|null}} Posture
 * @param {Posture} posture @param {number} k @param {number} by @param {string} [kind]
 * @returns {Posture} without beam and sights: where these end the arm alone does not say
 */
export function turned(posture, k, by, kind = "revolute") {
  const axes = /** @type {Vec[]} */ (posture.axes), axis = axes[k - 1], pivot = posture.skeleton[k], angle = (by * Math.PI) / 180;
  const turn = (/** @type {Vec} */ way) => (kind === "prismatic" ? way : rotated(way, axis, angle));
  const move = (/** @type {Vec} */ p) => (kind === "prismatic" ? plus(p, times(axis, by)) : plus(pivot, turn(minus(p, pivot))));
  const pose = (/** @type {number[][]} */ rows) => {
    const columns = [0, 1, 2, 3].map((c) => /** @type {Vec} */ (rows.map((row) => row[c])));
    const moved = [...columns.slice(0, 3).map(turn), move(columns[3])];
    return [0, 1, 2].map((r) => moved.map((column) => column[r]));
  };
  return {
    ...posture,
    skeleton: posture.skeleton.map((p, i) => (i > k ? move(p) : p)),
    axes: axes.map((a, i) => (i >= k ? turn(a) : a)),
    links: posture.links ? posture.links.map((rows, i) => (i >= k ? pose(rows) : rows)) : posture.links,
    tool: posture.tool ? move(posture.tool) : posture.tool,
    beam: null,
    sights: [],
  };
}

/**
 * The arm with every joint further by `by[i]`, degrees or mm.
 * @template {Arm & {links?: number[][][]|null, tool?: Vec|null, beam?: Vec[]|null, sights?: Vec[][]|null}} Posture
 * @param {Posture} posture @param {number[]} by @param {string[]} [kinds]
 * @returns {Posture}
 */
export function moved(posture, by, kinds = []) {
  let now = posture;
  for (let k = by.length; k >= 1; k--) if (by[k - 1]) now = turned(now, k, by[k - 1], kinds[k - 1]);
  return now;
}

/** How far apart two postures of one arm are: the farthest pair of its points. @param {Arm} a @param {Arm} b */
export const postureDistance = (a, b) => Math.max(...a.skeleton.map((p, i) => (b.skeleton[i] ? apart(p, b.skeleton[i]) : 0)));
