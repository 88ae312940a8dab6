// Bodies on a 2D canvas, the far ones first: the picture where there is no WebGL, and that of a report.
import { channels, mixed } from "./colours.js";
import { across, between, cross, dot, length, minus, plus, times, unit } from "./vectors.js";

/** @typedef {import("./vectors.js").Vec} Vec */
/** @typedef {import("./bodies.js").Solid} Solid */
/** @typedef {import("./colours.js").Colours} Colours */
/** @typedef {{azimuth: number, elevation: number, zoom: number}} FlatView degrees */
/** @typedef {{vertices: Vec[], faces: number[][], shades?: number[]}} FlatMesh */
/** @typedef {(p: Vec) => [number, number, number]} Seen px right, px down, mm towards the eye */

export const FIRST_VIEW = { azimuth: -62, elevation: 20, zoom: 1 }; // over y < 0
const EYE = 5; // radii of the scene: a mild perspective
const LIGHT = unit([-0.35, -0.55, 0.82]);

/** @param {FlatView} view @returns {{right: Vec, up: Vec, towards: Vec}} */
export function flatBasis(view) {
  const a = (view.azimuth * Math.PI) / 180, e = (view.elevation * Math.PI) / 180;
  const [ca, sa, ce, se] = [Math.cos(a), Math.sin(a), Math.cos(e), Math.sin(e)];
  return { right: [-sa, ca, 0], up: [-se * ca, -se * sa, ce], towards: [ce * ca, ce * sa, se] };
}

/**
 * What maps points to a picture of `wide` × `high` px, so that `points` fit in at the first view, with bodies of
 * `thick` mm about them.
 * @param {Vec[]} points @param {{wide: number, high: number}} room @param {FlatView} view @param {number} thick
 * @returns {{seen: Seen, perMm: (near: number) => number, basis: {right: Vec, up: Vec, towards: Vec}, radius: number}}
 */
export function flatCamera(points, room, view, thick) {
  const low = /** @type {Vec} */ ([0, 1, 2].map((i) => points.reduce((a, p) => Math.min(a, p[i]), Infinity)));
  const high = /** @type {Vec} */ ([0, 1, 2].map((i) => points.reduce((a, p) => Math.max(a, p[i]), -Infinity)));
  const centre = between(low, high, 0.5);
  const radius = points.reduce((a, p) => Math.max(a, length(minus(p, centre))), 1), eye = EYE * radius;
  const project = (/** @type {ReturnType<typeof flatBasis>} */ basis, /** @type {Vec} */ p) => {
    const way = minus(p, centre), near = dot(basis.towards, way), size = eye / (eye - near);
    return [dot(basis.right, way) * size, -dot(basis.up, way) * size, near];
  };
  const first = flatBasis(FIRST_VIEW), flat = points.map((p) => project(first, p));
  const span = [0, 1].map((i) => [flat.reduce((a, q) => Math.min(a, q[i]), Infinity), flat.reduce((a, q) => Math.max(a, q[i]), -Infinity)]);
  const middle = span.map(([a, b]) => (a + b) / 2), size = span.map(([a, b]) => b - a + 2 * thick + 1);
  const scale = view.zoom * Math.min((room.wide - 70) / size[0], (room.high - 50) / size[1]);
  const basis = flatBasis(view);
  return {
    basis,
    radius,
    perMm: (near) => (scale * eye) / (eye - near),
    seen: (p) => {
      const [x, y, near] = project(basis, p);
      return [room.wide / 2 + (x - middle[0]) * scale, room.high / 2 + (y - middle[1]) * scale, near];
    },
  };
}

/** How bright a face is that looks along `normal`, 0 to 1. @param {Vec} normal */
const lit = (normal) => 0.5 + 0.5 * Math.max(-0.4, dot(normal, LIGHT));

/** @param {string} colour @param {number} by 1: as it is @param {boolean} dark */
function shaded(colour, by, dark) {
  const low = dark ? 0.42 : 0.58, factor = low + (1.08 - low) * Math.max(0, Math.min(1, by));
  return `rgb(${channels(colour).map((v) => Math.min(255, Math.round(v * factor))).join(" ")})`;
}

/** The light that falls on a mesh's triangles where it is seen from does not change: found once. @param {FlatMesh} mesh */
function shades(mesh) {
  mesh.shades ??= mesh.faces.map((face) => {
    const [a, b, c] = face.map((k) => mesh.vertices[k]);
    return 0.45 + 0.55 * Math.abs(dot(unit(cross(minus(b, a), minus(c, a))), LIGHT));
  });
  return mesh.shades;
}

/** A drawing of bodies, in the order of their nearness. */
export class FlatPen {
  /** @param {CanvasRenderingContext2D} pen @param {ReturnType<typeof flatCamera>} camera @param {Colours} colours */
  constructor(pen, camera, colours) {
    this.pen = pen;
    this.camera = camera;
    this.colours = colours;
    /** @type {{near: number, draw: () => void}[]} */
    this.pieces = [];
  }

  /** @param {Vec[]} points @param {number} wide px @param {string} colour @param {number[]} [dash] */
  line(points, wide, colour, dash = []) {
    this.trace(points.map(this.camera.seen));
    this.pen.setLineDash(dash);
    this.pen.lineWidth = wide;
    this.pen.strokeStyle = colour;
    this.pen.stroke();
  }

  /** @param {number[][]} flat */
  trace(flat) {
    this.pen.beginPath();
    for (const p of flat) this.pen.lineTo(p[0], p[1]);
  }

  /**
   * Adds solids to what `flush` draws. `pale`: their colours, towards the ground.
   * @param {Solid[]} solids @param {number} [pale]
   */
  add(solids, pale = 0) {
    for (const solid of solids) {
      if ("detail" in solid && solid.detail) continue;
      const tone = pale ? mixed(this.colours[solid.tone], this.colours.panel, pale) : this.colours[solid.tone];
      const add = { rod: this.rod, ball: this.ball, block: this.block, cone: this.cone, patch: this.patch, line: this.lines }[solid.shape];
      add.call(this, /** @type {never} */ (solid), tone, solid.see ?? 1);
    }
  }

  /** @param {number} near @param {number} see @param {() => void} draw */
  piece(near, see, draw) {
    this.pieces.push({ near, draw: () => { this.pen.globalAlpha = see; draw(); } });
  }

  flush() {
    this.pen.lineCap = this.pen.lineJoin = "round";
    for (const { draw } of this.pieces.sort((a, b) => a.near - b.near)) draw();
    this.pieces = [];
    this.pen.globalAlpha = 1;
  }

  /** @param {number[][]} flat @param {string|CanvasGradient} fill @param {string} [edge] */
  area(flat, fill, edge) {
    this.trace(flat);
    this.pen.closePath();
    this.pen.fillStyle = fill;
    this.pen.fill();
    this.pen.setLineDash([]);
    this.pen.lineWidth = 0.7;
    this.pen.strokeStyle = edge || fill;
    this.pen.stroke();
  }

  /** @param {import("./bodies.js").Rod} rod @param {string} tone @param {number} see */
  rod({ from, to, radius, tip = radius, lift = 0 }, tone, see) {
    const { seen, basis } = this.camera, way = unit(minus(to, from)), [u, v] = across(way), dark = this.colours.dark;
    const round = Array.from({ length: 20 }, (_, i) => plus(times(u, Math.cos((i * Math.PI) / 10)), times(v, Math.sin((i * Math.PI) / 10))));
    const rims = [[from, radius], [to, tip]].map(([at, r]) => round.map((w) => seen(plus(/** @type {Vec} */ (at), times(w, /** @type {number} */ (r))))));
    const aside = unit(cross(way, basis.towards)), [a, b] = [seen(from), seen(to)];
    const nearer = dot(way, basis.towards) > 0 ? 1 : 0;
    this.piece((a[2] + b[2]) / 2 + lift, see, () => {
      const [p, q] = [seen(plus(from, times(aside, radius))), seen(minus(from, times(aside, radius)))];
      const colour = this.pen.createLinearGradient(p[0], p[1], q[0], q[1]);
      for (let i = 0; i <= 4; i++) {
        const c = Math.cos((i * Math.PI) / 4), s = Math.sin((i * Math.PI) / 4);
        const facing = unit(minus(basis.towards, times(way, dot(way, basis.towards))));
        colour.addColorStop(i / 4, shaded(tone, lit(plus(times(aside, c), times(facing, s))), dark));
      }
      this.area(hull([...rims[0], ...rims[1]]), colour, shaded(tone, 0, dark));
      this.area(rims[nearer], shaded(tone, lit(times(way, nearer ? 1 : -1)), dark));
    });
  }

  /** @param {import("./bodies.js").Ball} ball @param {string} tone @param {number} see */
  ball({ at, radius }, tone, see) {
    const [x, y, near] = this.camera.seen(at), r = radius * this.camera.perMm(near), dark = this.colours.dark;
    this.piece(near, see, () => {
      const colour = this.pen.createRadialGradient(x - 0.35 * r, y - 0.4 * r, 0.1 * r, x, y, r);
      for (const [stop, light] of [[0, 1], [0.6, 0.7], [1, 0.25]]) colour.addColorStop(stop, shaded(tone, light, dark));
      this.pen.beginPath();
      this.pen.arc(x, y, Math.max(r, 1.5), 0, 7);
      this.pen.fillStyle = colour;
      this.pen.fill();
    });
  }

  /** @param {import("./bodies.js").Block} block @param {string} tone @param {number} see */
  block({ at, axes, half }, tone, see) {
    const { seen, basis } = this.camera;
    axes.forEach((normal, i) => {
      const sign = dot(normal, basis.towards) > 0 ? 1 : -1, [j, k] = [(i + 1) % 3, (i + 2) % 3];
      const middle = plus(at, times(normal, sign * half[i]));
      const corners = [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([a, b]) => seen(plus(middle, plus(times(axes[j], a * half[j]), times(axes[k], b * half[k])))));
      this.piece(seen(middle)[2], see, () => this.area(corners, shaded(tone, lit(times(normal, sign)), this.colours.dark)));
    });
  }

  /** @param {import("./bodies.js").Cone} cone @param {string} tone @param {number} see */
  cone({ apex, along, length: long, radius }, tone, see) {
    const [u, v] = across(along), end = plus(apex, times(along, long)), { seen } = this.camera;
    const rim = Array.from({ length: 28 }, (_, i) => seen(plus(end, plus(times(u, radius * Math.cos((i * Math.PI) / 14)), times(v, radius * Math.sin((i * Math.PI) / 14))))));
    this.piece(seen(end)[2], see, () => {
      this.area(hull([seen(apex), ...rim]), tone);
      this.area(rim, tone);
    });
  }

  /** @param {import("./bodies.js").Patch} patch @param {string} tone @param {number} see */
  patch({ points }, tone, see) {
    const flat = points.map(this.camera.seen);
    this.piece(flat.reduce((a, p) => a + p[2], 0) / flat.length, 1, () => {
      this.pen.globalAlpha = see;
      this.area(flat, tone);
      this.pen.globalAlpha = 1;
      this.line([...points, points[0]], 1.6, tone);
    });
  }

  /** @param {import("./bodies.js").Line} line @param {string} tone @param {number} see */
  lines({ points, wide = 1, dashed }, tone, see) {
    this.piece(this.camera.seen(between(points[0], /** @type {Vec} */ (points.at(-1)), 0.5))[2], see, () => this.line(points, wide * 1.5, tone, dashed ? [2, 6] : []));
  }

  /** @param {FlatMesh} mesh */
  mesh(mesh) {
    const flat = mesh.vertices.map(this.camera.seen), light = shades(mesh), tone = this.colours.link;
    mesh.faces.forEach((face, i) => {
      const corners = face.map((k) => flat[k]);
      this.piece((corners[0][2] + corners[1][2] + corners[2][2]) / 3, 1, () => this.area(corners, shaded(tone, light[i], this.colours.dark)));
    });
  }
}

/** The convex hull of flat points, by Andrew's monotone chain. @param {number[][]} points */
export function hull(points) {
  const sorted = [...points].sort((a, b) => a[0] - b[0] || a[1] - b[1]);
  const half = (/** @type {number[][]} */ list) => {
    /** @type {number[][]} */
    const chain = [];
    for (const p of list) {
      while (chain.length > 1 && turn(chain[chain.length - 2], chain[chain.length - 1], p) <= 0) chain.pop();
      chain.push(p);
    }
    return chain.slice(0, -1);
  };
  return [...half(sorted), ...half(sorted.reverse())];
}
/** @param {number[]} a @param {number[]} b @param {number[]} c */
const turn = (a, b, c) => (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
