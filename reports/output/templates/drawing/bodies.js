// Solids from geometry: an arm from its joints and axes, its tool, its lines of sight. Base frame, mm, z up.
import { across, apart, cross, dot, length, minus, plus, times, unit } from "./vectors.js";

/** @typedef {import("./vectors.js").Vec} Vec */
/** @typedef {"link"|"joint"|"base"|"flange"|"tool"|"face"|"instrument"|"line"|"muted"|"ink"|"identified"|"weak"|"unidentifiable"|"held"|"misfit"} Tone */
/**
 * A part of a body. `joint` is the joint (from 1) that it belongs to, `see` how opaque it is (default 1). A flat
 * drawing leaves a `detail` out, and takes a part with `lift` to be so much nearer, mm.
 * @typedef {{shape: "rod", from: Vec, to: Vec, radius: number, tip?: number, tone: Tone, joint?: number, see?: number, lift?: number, detail?: boolean}} Rod
 * @typedef {{shape: "ball", at: Vec, radius: number, tone: Tone, joint?: number, see?: number}} Ball
 * @typedef {{shape: "block", at: Vec, axes: [Vec, Vec, Vec], half: Vec, tone: Tone, joint?: number, see?: number}} Block
 * @typedef {{shape: "cone", apex: Vec, along: Vec, length: number, radius: number, tone: Tone, joint?: number, see?: number}} Cone
 * @typedef {{shape: "patch", points: Vec[], tone: Tone, joint?: number, see?: number}} Patch
 * @typedef {{shape: "line", points: Vec[], tone: Tone, wide?: number, dashed?: boolean, joint?: number, see?: number}} Line
 * @typedef {Rod|Ball|Block|Cone|Patch|Line} Solid
 * @typedef {{skeleton: Vec[], axes?: Vec[]|null}} Arm points base, joints, flange; a unit vector for each joint
 */

const ONE_PLACE = 15; // mm: joints nearer to each other than this share one label
const NEARLY_PARALLEL = 0.05; // sine of the angle below which two axes have no common normal to draw along

/** Radius of the link behind joint `k` of `n`. @param {number} reach @param {number} k @param {number} n */
export const thickness = (reach, k, n) => reach * (0.056 - (0.03 * k) / Math.max(n, 1));

/**
 * The corners of a link between two joints: along the first axis, along the common normal, along the second axis.
 * A link is built like that; the straight line between the joints would cut through the air.
 * @param {Vec} from @param {Vec} to @param {Vec|null} first @param {Vec|null} second
 * @returns {Vec[]}
 */
export function route(from, to, first, second) {
  const way = minus(to, from), far = length(way);
  if (!first || far < 1e-6) return [from, to];
  const along = dot(way, first), turn = second ? length(cross(first, second)) : 0;
  /** @type {Vec[]} */
  let inner = [plus(from, times(first, along))];
  if (second && turn >= NEARLY_PARALLEL) {
    // way = s first + normal + t second, the normal across both axes
    const c = dot(first, second), a = along, b = dot(way, second), rest = 1 - c * c;
    const s = (a - c * b) / rest, t = (b - c * a) / rest;
    if (Math.abs(s) + Math.abs(t) < 2.5 * far) inner = [plus(from, times(first, s)), minus(to, times(second, t))];
  }
  const corners = [from];
  for (const corner of [...inner, to]) if (apart(corner, /** @type {Vec} */ (corners.at(-1))) > 1e-3 * far) corners.push(corner);
  return corners.length > 1 ? corners : [from, to];
}

/**
 * An arm as links and joints. `below` is how far the mounting face is below the base frame's origin (null: not known).
 * `plain`: no more than its links, for arms that stay pale.
 * @param {Arm} arm @param {number} reach
 * @param {{below?: number|null, kinds?: string[], plain?: boolean}} [how]
 * @returns {Solid[]}
 */
export function armBodies(arm, reach, { below = null, kinds = [], plain = false } = {}) {
  const points = arm.skeleton, axes = arm.axes || null, n = points.length - 2;
  /** @type {Solid[]} */
  const solids = [];
  const thick = (/** @type {number} */ k) => thickness(reach, k, n);
  const axis = (/** @type {number} */ k) => (axes && k >= 1 && k <= n ? axes[k - 1] : null);
  /** @type {Vec[][]} */
  const routes = points.slice(1).map((to, k) => route(points[k], to, axis(k), axis(k + 1)));
  if (!plain) solids.push(...foot(routes, thick(0), reach, below));
  routes.forEach((corners, k) => {
    const joint = Math.max(k, 1);
    corners.slice(1).forEach((to, i) => {
      const from = corners[i], sliding = kinds[k - 1] === "prismatic" && i === 0;
      if (apart(from, to) < 0.02 * thick(k)) return;
      const radius = thick(k) * (sliding ? 0.6 : 1), last = i === corners.length - 2;
      solids.push({ shape: "rod", from, to, radius, tip: last && !sliding ? Math.min(radius, thick(k + 1) * 1.06) : radius, tone: "link", joint });
      if (i > 0) solids.push({ shape: "ball", at: from, radius: thick(k), tone: "link", joint });
    });
  });
  for (let k = 1; k <= n; k++) {
    const at = points[k], own = axis(k), radius = thick(k - 1);
    if (k === 1 && !plain && (!own || Math.abs(own[2]) > 0.99) && covered(at, reach, below)) continue; // within the foot
    if (!own || plain) {
      solids.push({ shape: "ball", at, radius: radius * (plain ? 1 : 1.15), tone: plain ? "link" : "joint", joint: k });
      continue;
    }
    if (kinds[k - 1] === "prismatic") {
      solids.push({ shape: "block", at, axes: [...across(own), own], half: [1.35 * radius, 1.35 * radius, 1.7 * radius], tone: "joint", joint: k });
      continue;
    }
    const [inward, outward] = [direction(routes, k - 1, -1), direction(routes, k, 0)];
    const inLine = [inward, outward].some((way) => way && Math.abs(dot(way, own)) > 0.99);
    const half = inLine ? 0.4 * radius : 1.32 * radius, wide = inLine ? 1.16 * radius : 1.08 * radius;
    solids.push({ shape: "rod", from: minus(at, times(own, half)), to: plus(at, times(own, half)), radius: wide, tone: "joint", joint: k, lift: 2 * radius });
    if (inLine) solids.push({ shape: "ball", at, radius, tone: "link", joint: k });
    else {
      const [start, end] = [minus(at, times(own, half * 1.06)), plus(at, times(own, half * 1.06))];
      solids.push({ shape: "rod", from: start, to: end, radius: 0.72 * radius, tone: "link", joint: k, detail: true });
    }
  }
  if (!plain) {
    const end = points[n + 1], wide = thick(n), way = axis(n) || direction(routes, n, -1) || [0, 0, 1];
    const out = dot(minus(end, points[n]), way) < 0 ? times(way, -1) : way;
    solids.push({ shape: "rod", from: minus(end, times(out, 0.5 * wide)), to: end, radius: 1.12 * wide, tone: "flange", joint: n });
  }
  return solids;
}

/**
 * Which way a link leaves its joint (`at` 0) or comes to the next (-1); null where it has no length.
 * @param {Vec[][]} routes @param {number} k @param {0|-1} at
 */
function direction(routes, k, at) {
  const corners = routes[k];
  if (!corners) return null;
  const [from, to] = at === 0 ? corners.slice(0, 2) : corners.slice(-2);
  return apart(from, to) < 1e-6 ? null : unit(minus(to, from));
}

/** @param {Vec} at @param {number} reach @param {number|null} below */
const covered = (at, reach, below) => at[2] + (below ?? 0) < 0.12 * reach;

/** Mounting face, pedestal, and the casing below joint 2. @param {Vec[][]} routes @param {number} radius @param {number} reach @param {number|null} below @returns {Solid[]} */
function foot(routes, radius, reach, below) {
  const base = routes[0][0], floor = /** @type {Vec} */ ([base[0], base[1], -(below ?? 0)]);
  const height = Math.max(...(routes[1] || routes[0]).slice(0, 2).map((p) => p[2]), 0);
  const plate = 0.016 * reach, casing = Math.max(height * 0.45, plate) - floor[2] > plate ? Math.max(height * 0.45, plate) : floor[2] + 2 * plate;
  const side = 1.62 * radius;
  return [
    { shape: "block", at: plus(floor, [0, 0, plate / 2]), axes: [[1, 0, 0], [0, 1, 0], [0, 0, 1]], half: [side, side, plate / 2], tone: "base" },
    { shape: "rod", from: plus(floor, [0, 0, plate]), to: [base[0], base[1], casing], radius: 1.45 * radius, tip: 1.2 * radius, tone: "base", lift: 3 * radius },
  ];
}

/**
 * What is fixed to the flange: a rod to where the laser (or the tip) is, and the laser along its beam.
 * @param {Vec} flange @param {Vec|null|undefined} tool @param {Vec[]|null|undefined} beam @param {number} reach
 * @returns {Solid[]}
 */
export function toolBodies(flange, tool, beam, reach) {
  if (!tool || apart(flange, tool) < 1e-6) return [];
  const radius = 0.0085 * reach;
  /** @type {Solid[]} */
  const solids = [{ shape: "rod", from: flange, to: tool, radius: radius * 0.8, tone: "tool" }];
  if (beam) {
    const way = unit(minus(beam[1], beam[0]));
    solids.push({ shape: "rod", from: minus(tool, times(way, 4.2 * radius)), to: tool, radius: 1.35 * radius, tone: "tool" });
  } else solids.push({ shape: "ball", at: tool, radius: 1.1 * radius, tone: "tool" });
  return solids;
}

/**
 * The lines of light and sight; red where something is in the way of them.
 * @param {{beam?: Vec[]|null, sights?: Vec[][]|null, reaches?: boolean, blocked?: boolean}} posture @returns {Line[]}
 */
export function lineBodies({ beam, sights, reaches = true, blocked = false }) {
  const free = blocked ? "misfit" : "identified";
  /** @type {Line[]} */
  const lines = (sights || []).map((points) => ({ shape: "line", points, tone: free, wide: 1 }));
  if (beam) lines.push({ shape: "line", points: beam, tone: reaches ? free : "weak", wide: 1.6, dashed: !reaches });
  return lines;
}

/**
 * Names of the joints where they are; joints at one place share one (a wrist: J4, 5, 6).
 * @param {Vec[]} skeleton @returns {{at: Vec, text: string}[]}
 */
export function jointLabels(skeleton) {
  /** @type {{at: Vec, text: string}[]} */
  const labels = [];
  skeleton.slice(1, -1).forEach((at, i) => {
    const near = labels.find((label) => apart(label.at, at) < ONE_PLACE);
    if (near) near.text += `, ${i + 1}`;
    else labels.push({ at, text: `J${i + 1}` });
  });
  return labels;
}

/**
 * A floor of about ten lines each way at the height `z`, a round step apart.
 * @param {Vec} low @param {Vec} high @param {number} reach @param {number} z @returns {Vec[][]}
 */
export function floorLines(low, high, reach, z) {
  const wide = Math.max(high[0] - low[0], high[1] - low[1], reach), rough = wide / 8, power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((k) => k * power).find((s) => s >= rough) || rough;
  const [xs, ys] = [0, 1].map((i) => {
    const [first, last] = [-wide, wide].map((by) => (low[i] + high[i] + by) / 2 / step);
    return Array.from({ length: Math.ceil(last) - Math.floor(first) + 1 }, (_, k) => (Math.floor(first) + k) * step);
  });
  const [x0, x1, y0, y1] = [xs[0], xs[xs.length - 1], ys[0], ys[ys.length - 1]];
  return [...xs.map((x) => /** @type {Vec[]} */ ([[x, y0, z], [x, y1, z]])), ...ys.map((y) => /** @type {Vec[]} */ ([[x0, y, z], [x1, y, z]]))];
}
