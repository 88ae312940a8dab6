// Solids of instruments, targets and obstacles. Base frame, mm, z up.
import { across, between, minus, plus, times, unit } from "./vectors.js";

/** @typedef {import("./vectors.js").Vec} Vec */
/** @typedef {import("./bodies.js").Solid} Solid */
/** @typedef {import("./bodies.js").Tone} Tone */
/** @typedef {import("./bodies.js").Block} Block */
/** @typedef {import("./bodies.js").Cone} Cone */
/** @typedef {import("./bodies.js").Line} Line */
/**
 * @typedef {"psd"|"tracker"|"plane"|"sphere"|"ballbar"|"dial"|"pose"|"point"} MarkKind
 * @typedef {{kind: MarkKind, name: string, at: Vec, normal?: Vec|null, size?: number|null, radius?: number|null, acceptance_deg?: number|null, outline?: Vec[]|null, lines?: Vec[][]|null, state?: string|null}} Mark
 */

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
