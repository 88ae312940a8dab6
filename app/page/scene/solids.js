// Solids (bodies.js) as objects of three.js. Unit geometries are shared, a solid is one of them stretched.
import * as THREE from "three";

/** @typedef {import("./vectors.js").Vec} Vec */
/** @typedef {import("./bodies.js").Solid} Solid */
/** @typedef {import("./bodies.js").Tone} Tone */

const UP = new THREE.Vector3(0, 1, 0);
const vector = (/** @type {Vec} */ v) => new THREE.Vector3(...v);

/** @type {Map<string, THREE.BufferGeometry>} */
const shapes = new Map();
/** @param {string} name @param {() => THREE.BufferGeometry} make */
function shape(name, make) {
  let made = shapes.get(name);
  if (!made) shapes.set(name, (made = make()));
  return made;
}

/**
 * A cylinder of length 1 along y, radius 1 at its start and `taper` at its end.
 * @param {number} taper @param {number} sides
 */
const cylinder = (taper, sides) =>
  shape(`rod ${taper} ${sides}`, () => new THREE.CylinderGeometry(taper, 1, 1, sides, 1));
/** @param {number} sides */
const sphere = (sides) => shape(`ball ${sides}`, () => new THREE.SphereGeometry(1, sides, Math.max(6, sides / 2)));

/** @param {import("./bodies.js").Rod} rod @param {THREE.Matrix4} into */
function rodMatrix({ from, to, radius }, into) {
  const a = vector(from), b = vector(to), way = b.clone().sub(a), long = way.length() || 1e-9;
  const turn = new THREE.Quaternion().setFromUnitVectors(UP, way.divideScalar(long));
  return into.compose(a.add(b).multiplyScalar(0.5), turn, new THREE.Vector3(radius, long, radius));
}

/** Materials by tone, recoloured together. */
export class Materials {
  constructor() {
    /** @type {Map<string, {tone: Tone|"panel", material: THREE.Material & {color: THREE.Color}}>} */
    this.all = new Map();
    /** @type {import("./colours.js").Colours|null} */
    this.colours = null;
  }

  /** @param {import("./colours.js").Colours} colours */
  recolour(colours) {
    this.colours = colours;
    for (const { tone, material } of this.all.values()) material.color.set(colours[tone]);
  }

  /**
   * @template {THREE.Material & {color: THREE.Color}} M
   * @param {string} kind @param {Tone|"panel"} tone @param {number} see @param {() => M} make @returns {M}
   */
  of(kind, tone, see, make) {
    const key = `${kind} ${tone} ${see}`;
    let entry = this.all.get(key);
    if (!entry) {
      const material = make();
      if (see < 1) Object.assign(material, { transparent: true, opacity: see, depthWrite: false });
      if (this.colours) material.color.set(this.colours[tone]);
      this.all.set(key, (entry = { tone, material }));
    }
    return /** @type {M} */ (entry.material);
  }

  /** Lit from a side. @param {Tone} tone @param {number} [see] */
  solid(tone, see = 1) {
    return this.of("solid", tone,
      see, () =>
        new THREE.MeshPhongMaterial({ shininess: 24, specular: 0x1a1a1a,
          side: see < 1 ? THREE.DoubleSide : THREE.FrontSide }));
  }

  /** With a face for each triangle. @param {Tone} tone */
  faceted(tone) {
    return this.of("faceted", tone,
      1, () =>
        new THREE.MeshPhongMaterial({ shininess: 16, specular: 0x111111, flatShading: true, side: THREE.DoubleSide }));
  }

  /** As bright everywhere. @param {Tone} tone @param {number} [see] */
  plain(tone, see = 1) {
    return this.of("plain", tone, see, () => new THREE.MeshBasicMaterial({ side: THREE.DoubleSide }));
  }

  /** @param {Tone} tone @param {number} [see] */
  line(tone, see = 1) {
    return this.of("line", tone, see, () => new THREE.LineBasicMaterial());
  }

  dispose() {
    for (const { material } of this.all.values()) material.dispose();
  }
}

/**
 * One solid as an object. Lines are thin rods, so that their width does not depend on the graphics card.
 * @param {Solid} solid @param {Materials} materials @param {number} reach
 * @returns {THREE.Object3D}
 */
export function solidObject(solid, materials, reach) {
  const see = solid.see ?? 1;
  /** @type {THREE.Object3D} */
  let object;
  if (solid.shape === "rod") {
    const taper = Math.round(((solid.tip ?? solid.radius) / solid.radius) * 50) / 50;
    object = new THREE.Mesh(cylinder(taper, 26), materials.solid(solid.tone, see));
    rodMatrix(solid, object.matrix);
  } else if (solid.shape === "ball") {
    object = new THREE.Mesh(sphere(20), materials.solid(solid.tone, see));
    object.matrix.makeScale(solid.radius, solid.radius, solid.radius).setPosition(...solid.at);
  } else if (solid.shape === "block") object = blockObject(solid, materials, see);
  else if (solid.shape === "cone") {
    object = new THREE.Mesh(shape("cone", () =>
      new THREE.ConeGeometry(1, 1, 40, 1, true).rotateX(Math.PI).translate(0, 0.5, 0)),
      materials.plain(solid.tone, see));
    const turn = new THREE.Quaternion().setFromUnitVectors(UP, vector(solid.along));
    object.matrix.compose(vector(solid.apex), turn, new THREE.Vector3(solid.radius, solid.length, solid.radius));
  } else if (solid.shape === "patch") object = patchObject(solid, materials, see);
  else object = lineObject(solid, materials, reach);
  object.matrixAutoUpdate = false;
  Object.assign(object.userData, { joint: solid.joint, body: solid.tone });
  return object;
}

/** @param {import("./bodies.js").Block} block @param {Materials} materials @param {number} see */
function blockObject({ at, axes, half, tone }, materials, see) {
  const box = shape("block", () => new THREE.BoxGeometry(2, 2, 2));
  const object = new THREE.Mesh(box, see < 1 ? materials.plain(tone, 0.14) : materials.solid(tone));
  const [x, y, z] = axes.map((axis, i) => vector(axis).multiplyScalar(Math.max(half[i], 1e-6)));
  object.matrix.makeBasis(x, y, z).setPosition(...at);
  if (see < 1) {
    const edges = new THREE.LineSegments(shape("edges", () => new THREE.EdgesGeometry(box)), materials.line(tone));
    edges.raycast = () => {};
    object.add(edges);
  }
  return object;
}

/** @param {import("./bodies.js").Patch} patch @param {Materials} materials @param {number} see */
function patchObject({ points, tone }, materials, see) {
  const geometry = new THREE.BufferGeometry().setFromPoints(points.map(vector));
  geometry.setIndex(points.slice(2).flatMap((_, i) => [0, i + 1, i + 2]));
  const object = new THREE.Mesh(geometry, materials.plain(tone, see));
  const rim = new THREE.LineLoop(new THREE.BufferGeometry().setFromPoints(points.map(vector)), materials.line(tone));
  rim.raycast = () => {};
  object.add(rim);
  object.userData.single = true;
  return object;
}

/** @param {import("./bodies.js").Line} line @param {Materials} materials @param {number} reach */
function lineObject({ points, tone, wide = 1, dashed }, materials, reach) {
  const group = new THREE.Group(), radius = 0.0011 * reach * wide, material = materials.plain(tone);
  for (let i = 0; i + 1 < points.length; i++) {
    const from = vector(points[i]), to = vector(points[i + 1]), long = from.distanceTo(to);
    if (long < 1e-6) continue;
    const parts = dashed ? Math.min(60, Math.max(2, Math.round(long / (0.03 * reach)))) : 1;
    for (let k = 0; k < parts; k++) {
      const ends = [k / parts, (k + (dashed ? 0.5 : 1)) / parts].map((share) =>
        /** @type {Vec} */ (from.clone().lerp(to, share).toArray()));
      const mesh = new THREE.Mesh(cylinder(1, 8), material);
      rodMatrix({ shape: "rod", from: ends[0], to: ends[1], radius, tone }, mesh.matrix);
      mesh.matrixAutoUpdate = false;
      group.add(mesh);
    }
  }
  return group;
}

/** Removes all that a group holds, with the geometries that are nobody else's. @param {THREE.Object3D} group */
export function emptied(group) {
  group.traverse((object) => {
    if (object.userData.single && object instanceof THREE.Mesh) {
      object.geometry.dispose();
      for (const child of object.children) if (child instanceof THREE.LineLoop) child.geometry.dispose();
    }
  });
  group.clear();
}

// Lit by vertex: with a hundred arms the light of every pixel is what software takes longest for.
const PALE_VERTEX = `varying vec3 shade;
void main() {
  vec3 way = normalize(mat3(instanceMatrix) * normal);
  float light = 0.86 + 0.26 * dot(way, normalize(vec3(-0.45, -0.6, 1.0)));
  shade = pow(instanceColor * light, vec3(1.0 / 2.2));
  gl_Position = projectionMatrix * viewMatrix * instanceMatrix * vec4(position, 1.0);
}`;
const PALE_FRAGMENT = "varying vec3 shade; void main() { gl_FragColor = vec4(shade, 1.0); }";

/** @param {boolean} coarse */
const paleRod = (coarse) =>
  shape(`pale rod ${coarse}`, () => new THREE.CylinderGeometry(0.9, 1, 1, coarse ? 5 : 12, 1, true));

/**
 * Many pale arms at once: two instanced meshes, of rods and of balls, each instance in a colour of its own.
 * `of` says which posture an instance belongs to.
 */
export class PaleArms {
  constructor() {
    this.group = new THREE.Group();
    /** @type {Map<THREE.Object3D, number[]>} */
    this.of = new Map();
    this.material = new THREE.ShaderMaterial({ vertexShader: PALE_VERTEX, fragmentShader: PALE_FRAGMENT });
  }

  /** @param {{index: number, solids: Solid[], colour: string}[]} arms */
  show(arms) {
    for (const child of this.group.children) if (child instanceof THREE.InstancedMesh) child.dispose();
    this.group.clear();
    this.of.clear();
    const matrix = new THREE.Matrix4(), colour = new THREE.Color();
    const geometries = { rod: paleRod(false), ball: shape("pale ball", () => new THREE.SphereGeometry(1, 12, 8)) };
    for (const kind of /** @type {const} */ (["rod", "ball"])) {
      const list = arms.flatMap((arm) =>
        arm.solids.filter((solid) => solid.shape === kind).map((solid) => ({ arm, solid })));
      if (!list.length) continue;
      const mesh = new THREE.InstancedMesh(geometries[kind], this.material, list.length);
      list.forEach(({ arm, solid }, i) => {
        if (solid.shape === "rod") rodMatrix(solid, matrix);
        else if (solid.shape === "ball")
          matrix.makeScale(solid.radius, solid.radius, solid.radius).setPosition(...solid.at);
        mesh.setMatrixAt(i, matrix);
        mesh.setColorAt(i, colour.set(arm.colour));
      });
      mesh.computeBoundingSphere();
      mesh.name = kind;
      this.of.set(mesh, list.map(({ arm }) => arm.index));
      this.group.add(mesh);
    }
  }

  /** Without balls, and rods of few sides, while a view moves that software draws. @param {boolean} coarse */
  setCoarse(coarse) {
    for (const mesh of this.group.children) {
      if (mesh.name === "ball") mesh.visible = !coarse;
      else if (mesh instanceof THREE.InstancedMesh) mesh.geometry = paleRod(coarse);
    }
  }

  dispose() {
    this.show([]);
    this.material.dispose();
  }
}

/** Thin lines, one draw call for all. @param {Vec[][]} lines @param {THREE.LineBasicMaterial} material */
export function thinLines(lines, material) {
  const points = lines.flatMap((line) => line.slice(1).flatMap((p, i) => [vector(line[i]), vector(p)]));
  const object = new THREE.LineSegments(new THREE.BufferGeometry().setFromPoints(points), material);
  object.userData.own = true;
  return object;
}

/** @param {import("./types.js").LinkMesh} mesh */
export function meshGeometry({ vertices, faces }) {
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.Float32BufferAttribute(vertices.flat(), 3));
  geometry.setIndex(faces.flat());
  return geometry;
}

/** @param {number[][]} rows 3 × 4 @param {THREE.Matrix4} into */
export const poseMatrix = (rows, into) => into.fromArray([...rows.flat(), 0, 0, 0, 1]).transpose();
