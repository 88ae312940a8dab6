// Points and directions of three numbers.

/** @typedef {[number, number, number]} Vec */

/** @param {Vec} a @param {Vec} b @returns {Vec} */
export const plus = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
/** @param {Vec} a @param {Vec} b @returns {Vec} */
export const minus = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
/** @param {Vec} a @param {number} by @returns {Vec} */
export const times = (a, by) => [a[0] * by, a[1] * by, a[2] * by];
/** @param {Vec} a @param {Vec} b */
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
/** @param {Vec} a @param {Vec} b @returns {Vec} */
export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
/** @param {Vec} a */
export const length = (a) => Math.hypot(a[0], a[1], a[2]);
/** @param {Vec} a @param {Vec} b */
export const apart = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
/** @param {Vec} a @returns {Vec} of length 1, or z where `a` has none. */
export function unit(a) {
  const size = length(a);
  return size > 1e-12 ? times(a, 1 / size) : [0, 0, 1];
}
/** @param {Vec} from @param {Vec} to @param {number} share @returns {Vec} */
export const between = (from, to, share) => plus(from, times(minus(to, from), share));

/** @param {Vec} along a unit vector @returns {[Vec, Vec]} two unit vectors across it, with it right-handed. */
export function across(along) {
  /** @type {Vec} */
  const aside = Math.abs(along[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0];
  const first = unit(cross(aside, along));
  return [first, cross(along, first)];
}

/** Rodrigues' formula. @param {Vec} a @param {Vec} axis a unit vector @param {number} angle rad @returns {Vec} */
export function rotated(a, axis, angle) {
  const c = Math.cos(angle), s = Math.sin(angle);
  return plus(plus(times(a, c), times(cross(axis, a), s)), times(axis, dot(axis, a) * (1 - c)));
}
