// Solids from geometry: an arm from its joints and axes, instruments from their marks. Base frame, mm, z up.
import { across, apart, between, cross, dot, length, minus, plus, rotated, times, unit } from "./vectors.js";

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
 * @typedef {"psd"|"tracker"|"plane"|"sphere"|"ballbar"|"dial"|"pose"|"point"} MarkKind
 * @typedef {{kind: MarkKind, name: string, at: Vec, normal?: Vec|null, size?: number|null, radius?: number|null, acceptance_deg?: number|null, outline?: Vec[]|null, lines?: Vec[][]|null, state?: string|null}} Mark
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
    if (!own || plain) {
      solids.push({ shape: "ball", at, radius: radius * (plain ? 1 : 1.15), tone: plain ? "link" : "joint", joint: k });
      continue;
    }
    if (kinds[k - 1] === "prismatic") {
      solids.push({ shape: "block", at, axes: [...across(own), own], half: [1.35 * radius, 1.35 * radius, 1.7 * radius], tone: "joint", joint: k });
      continue;
    }
    if (k === 1 && Math.abs(own[2]) > 0.99 && covered(at, reach, below)) continue; // within the foot
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

/** The lines of light and sight. @param {{beam?: Vec[]|null, sights?: Vec[][]|null, reaches?: boolean}} posture @returns {Line[]} */
export function lineBodies({ beam, sights, reaches = true }) {
  /** @type {Line[]} */
  const lines = (sights || []).map((points) => ({ shape: "line", points, tone: "identified", wide: 1 }));
  if (beam) lines.push({ shape: "line", points: beam, tone: reaches ? "identified" : "weak", wide: 1.6, dashed: !reaches });
  return lines;
}

// What is not determined is a cross, what is held a square: a shape and a word, not a colour alone.
/** @param {Mark} mark @returns {Tone} */
export const markTone = (mark) => (mark.state === "undetermined" ? "unidentifiable" : mark.state === "held" ? "held" : "identified");

/**
 * Instruments and targets. What is smaller than can be seen beside the arm is drawn larger, about its true place.
 * @param {Mark} mark @param {number} reach @param {number} floor height of the floor
 * @returns {Solid[]}
 */
export function markBodies(mark, reach, floor) {
  const at = mark.at, small = 0.014 * reach, tone = markTone(mark);
  const normal = unit(mark.normal || [0, 0, 1]), [right, up] = across(normal);
  /** @type {Solid[]} */
  const solids = (mark.lines || []).map((points) => ({ shape: "line", points, tone: "held", wide: 1.2 }));
  const outline = mark.outline && mark.outline.length > 1 ? mark.outline : null;
  const kinds = {
    psd: () => {
      const face = Math.max(mark.size || 0, 2.4 * small), half = face / 2;
      if (!mark.normal) return [...point(at, small, tone)];
      const back = minus(at, times(normal, 0.55 * half));
      const cone = mark.acceptance_deg ? [acceptance(at, normal, mark.acceptance_deg, 0.2 * reach)] : [];
      return [
        { shape: "block", at: back, axes: [right, up, normal], half: [1.5 * half, 1.5 * half, 0.5 * half], tone: "instrument" },
        { shape: "block", at, axes: [right, up, normal], half: [half, half, 0.07 * half], tone },
        ...cone,
      ];
    },
    tracker: () => {
      const head = 0.05 * reach, foot = /** @type {Vec} */ ([at[0], at[1], Math.min(floor, at[2] - 4 * head)]);
      const neck = /** @type {Vec} */ ([at[0], at[1], at[2] - 1.5 * head]);
      const legs = [0, 1, 2].map((k) => {
        const turn = (k * 2 * Math.PI) / 3 + 0.5, wide = 0.35 * (neck[2] - foot[2]) + head;
        return { shape: "rod", from: neck, to: [at[0] + wide * Math.cos(turn), at[1] + wide * Math.sin(turn), foot[2]], radius: 0.16 * head, tip: 0.12 * head, tone: "instrument" };
      });
      return [
        { shape: "ball", at, radius: 0.85 * head, tone: "instrument" },
        { shape: "rod", from: neck, to: [at[0], at[1], at[2] - 0.5 * head], radius: 0.75 * head, tone: "instrument" },
        { shape: "ball", at, radius: 0.3 * head, tone },
        ...legs,
      ];
    },
    plane: () => {
      const side = Math.max(mark.size || 0, 0.12 * reach) / 2;
      const corners = outline || [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([x, y]) => plus(at, plus(times(right, x * side), times(up, y * side))));
      return [{ shape: "patch", points: corners, tone: "held", see: 0.32 }, ...(mark.normal ? [arrow(at, normal, 0.06 * reach, tone)] : [])];
    },
    sphere: () => [{ shape: "ball", at, radius: Math.max(mark.radius || 0, small), tone: "held" }],
    ballbar: () => {
      const end = outline ? /** @type {Vec} */ (outline.at(-1)) : null, ball = Math.max(mark.radius || 0, 1.1 * small);
      return [
        { shape: "ball", at, radius: ball, tone },
        { shape: "rod", from: minus(at, [0, 0, 3 * ball]), to: minus(at, [0, 0, 0.5 * ball]), radius: 1.2 * ball, tip: 0.9 * ball, tone: "instrument" },
        ...(end ? [{ shape: "rod", from: at, to: end, radius: 0.35 * ball, tone: "tool" }, { shape: "ball", at: end, radius: ball, tone }] : []),
      ];
    },
    dial: () => {
      const wide = 2.2 * small, middle = minus(at, times(normal, 3.2 * wide));
      return [
        { shape: "rod", from: minus(at, times(normal, 2.4 * wide)), to: at, radius: 0.16 * wide, tip: 0.1 * wide, tone: "tool" },
        { shape: "rod", from: minus(middle, times(right, 0.25 * wide)), to: plus(middle, times(right, 0.25 * wide)), radius: wide, tone: "instrument" },
        { shape: "rod", from: plus(middle, times(right, 0.25 * wide)), to: plus(middle, times(right, 0.3 * wide)), radius: 0.85 * wide, tone: "face" },
      ];
    },
    pose: () => [arrow(at, right, 0.07 * reach, "misfit"), arrow(at, up, 0.07 * reach, "held"), arrow(at, normal, 0.07 * reach, "identified")],
    point: () => point(at, small, tone),
  };
  solids.push(.../** @type {Solid[]} */ ((kinds[mark.kind] || kinds.point)()));
  if (outline && !["plane", "ballbar"].includes(mark.kind)) solids.push({ shape: "line", points: outline, tone: "held", wide: 1.2 });
  return solids;
}

/** @param {Vec} at @param {number} small @param {Tone} tone @returns {Solid[]} */
function point(at, small, tone) {
  const hairs = /** @type {Vec[]} */ ([[1, 0, 0], [0, 1, 0], [0, 0, 1]]).map((way) => (
    { shape: "line", points: [minus(at, times(way, 2.6 * small)), plus(at, times(way, 2.6 * small))], tone, wide: 1.2 }));
  return /** @type {Solid[]} */ ([{ shape: "ball", at, radius: small, tone }, ...hairs]);
}

/** @param {Vec} at @param {Vec} normal @param {number} degrees half angle @param {number} long @returns {Cone} */
const acceptance = (at, normal, degrees, long) => {
  const half = (Math.min(degrees, 80) * Math.PI) / 180;
  return { shape: "cone", apex: at, along: normal, length: long * Math.cos(half), radius: long * Math.sin(half), tone: "identified", see: 0.16 };
};

/** @param {Vec} at @param {Vec} way @param {number} long @param {Tone} tone @returns {Line} */
const arrow = (at, way, long, tone) => ({ shape: "line", points: [at, plus(at, times(way, long))], tone, wide: 2 });

/** @param {{min: Vec, max: Vec, touched?: boolean}} box @returns {Block} */
export const boxBody = ({ min, max, touched }) => ({
  shape: "block", at: between(min, max, 0.5), axes: [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
  half: /** @type {Vec} */ (max.map((v, i) => (v - min[i]) / 2)), tone: touched ? "unidentifiable" : "muted", see: 0.3,
});

/** @param {{min: Vec, max: Vec}} box @returns {Vec[]} */
export const boxCorners = ({ min, max }) => [0, 1, 2, 3, 4, 5, 6, 7].map((k) => /** @type {Vec} */ ([0, 1, 2].map((i) => (k & (1 << i) ? max : min)[i])));

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

/**
 * A floor of about ten lines each way: its round step, and lowest and highest x, lowest and highest y.
 * @param {Vec} low @param {Vec} high @param {number} reach
 */
export function floorGrid(low, high, reach) {
  const wide = Math.max(high[0] - low[0], high[1] - low[1], reach), rough = wide / 8, power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((k) => k * power).find((s) => s >= rough) || rough;
  const bounds = [0, 1].map((i) => [(low[i] + high[i] - wide) / 2, (low[i] + high[i] + wide) / 2].map((v, k) => (k ? Math.ceil(v / step) : Math.floor(v / step)) * step));
  return { step, bounds };
}
