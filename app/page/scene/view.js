// The scene in three.js: camera, light, bodies, names. Drawn when something has changed, and not otherwise.
import * as THREE from "three";
import { OrbitControls } from "three/OrbitControls.js";
import { armBodies, floorLines, jointLabels, lineBodies, toolBodies } from "./bodies.js";
import { coloursOf, mixed } from "./colours.js";
import { Grips } from "./grips.js";
import { drawLabels } from "./labels.js";
import { Materials, PaleArms, emptied, meshGeometry, poseMatrix, solidObject, thinLines } from "./solids.js";
import { boxBody, boxCorners, markBodies, markTone } from "./marks.js";
import { postureDistance } from "./turning.js";
import { extent, floorOf } from "./extent.js";
import { minus, plus, times } from "./vectors.js";

/** @typedef {import("./vectors.js").Vec} Vec */
/** @typedef {import("./types.js").Scene3D} Scene3D */
/** @typedef {import("./types.js").ShownPosture} ShownPosture */
/** @typedef {import("./labels.js").Label} Label */
/**
 * @typedef {{frames: Pick<ShownPosture, "skeleton"|"axes"|"links"|"tool"|"beam">[], period_s: number}} Motion there
 *   and back in a period
 */

const MOST_PALE = 150; // postures that are drawn beside the chosen one
const THIN = 0.3; // of a full arm's thickness
const FIELD = 28; // degrees, upright
const FIRST = { azimuth: -62, elevation: 20 };
const SLOW_MS = 40; // a frame that takes longer is drawn coarser while the view moves
const PAUSE_MS = 700; // between frames that do not follow each other: the view is at rest
const COARSE = 0.5;
const OVER_HEAD = 0.002; // rad from the vertical, where the view would have no side that is up

/** @param {unknown[]|null} before @param {unknown[]} now */
const same = (before, now) =>
  before !== null && before.length === now.length && now.every((value, i) => value === before[i]);

export class View {
  /**
   * @param {HTMLCanvasElement} canvas @param {HTMLCanvasElement} overlay for the names
   * @param {import("./types.js").SceneActs} acts
   * @param {boolean} software whether WebGL has no graphics card: then smooth edges cost more than they are worth
   */
  constructor(canvas, overlay, acts, software) {
    this.canvas = canvas;
    this.overlay = overlay;
    this.acts = acts;
    this.pen = /** @type {CanvasRenderingContext2D} */ (overlay.getContext("2d"));
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: !software, alpha: false,
      powerPreference: "high-performance" });
    this.renderer.autoClear = false;
    this.renderer.info.autoReset = false;
    this.camera = new THREE.PerspectiveCamera(FIELD, 1, 1, 1e5);
    this.camera.up.set(0, 0, 1);
    this.materials = new Materials();
    this.behind = new THREE.Scene();
    this.front = new THREE.Scene();
    this.pale = new PaleArms();
    this.parts = { floor: new THREE.Group(), lines: new THREE.Group(), arm: new THREE.Group(), mesh: new THREE.Group(),
      marks: new THREE.Group(), more: new THREE.Group(), arc: new THREE.Group() };
    this.behind.add(this.parts.floor, this.parts.lines, this.pale.group);
    this.front.add(this.parts.arm, this.parts.mesh, this.parts.marks, this.parts.more, this.parts.arc);
    this.lights = [this.behind, this.front].map((scene) => this.light(scene));
    /** @type {Scene3D|null} */
    this.scene = null;
    /** @type {number|null} */
    this.chosen = null;
    this.ghosts = false;
    /** @type {Motion|null} */
    this.motion = null;
    /** @type {import("./types.js").LinkMesh[]|undefined} */
    this.meshes = undefined;
    /** What the pale arms were drawn for. @type {unknown[]|null} */
    this.shownPale = null;
    /** @type {unknown[]|null} */
    this.shownMarks = null;
    this.wide = this.high = 0;
    this.waiting = 0;
    this.coarse = false;
    this.last = 0;
    this.settling = 0;
    /** @type {number[]} */
    this.times = [];
    this.grips = new Grips(this);
    this.orbit = new OrbitControls(this.camera, canvas);
    Object.assign(this.orbit, { enableDamping: false, screenSpacePanning: true, zoomToCursor: true, zoomSpeed: 1.4,
      minPolarAngle: OVER_HEAD, maxPolarAngle: Math.PI - OVER_HEAD });
    this.orbit.addEventListener("change", () => this.viewed());
    this.orbit.addEventListener("end", () => this.settle());
    this.dark = matchMedia("(prefers-color-scheme: dark)");
    this.still = matchMedia("(prefers-reduced-motion: reduce)");
    this.recolour = this.recolour.bind(this);
    this.dark.addEventListener("change", this.recolour);
    this.colours = coloursOf(canvas);
    this.recolour();
  }

  /** @param {THREE.Scene} scene */
  light(scene) {
    const sun = new THREE.DirectionalLight(0xffffff, 1.9), sky = new THREE.HemisphereLight(0xffffff, 0x8a8f98, 1.75);
    sky.position.set(0, 0, 1);
    sun.position.set(-0.45, -0.6, 1);
    scene.add(sun, sky);
    return { sun, sky };
  }

  recolour() {
    this.colours = coloursOf(this.canvas);
    this.materials.recolour(this.colours);
    this.renderer.setClearColor(this.colours.panel);
    for (const { sky } of this.lights) sky.groundColor.set(this.colours.dark ? 0x4a5058 : 0x9aa0a8);
    this.shownPale = null;
    if (this.scene) this.drawPale(this.scene);
    this.invalidate();
  }

  // ── what is shown ───────────────────────────────────────────────────────────────────────────

  /**
   * @param {Scene3D} scene @param {number} chosen @param {boolean} ghosts whether the other postures are shown
   * @param {import("./types.js").Tools} tools @param {Motion|null} motion
   */
  show(scene, chosen, ghosts, tools, motion) {
    const anew = !this.scene || this.scene.of !== scene.of, unmeshed = !this.scene?.meshes;
    this.scene = scene;
    this.chosen = scene.postures[chosen] ? chosen : null;
    this.ghosts = ghosts;
    this.grips.tools = tools;
    if (anew) this.grips.hold(null);
    if (anew || (unmeshed && scene.meshes)) this.fit(); // meshes come later, and reach farther than the joints
    this.drawMarks(scene);
    this.drawPale(scene);
    this.drawArm(this.grips.dragged(this.posture()));
    this.drawMore(scene);
    this.grips.sync();
    this.play(motion);
    this.invalidate();
  }

  /** The posture that is drawn in full. @returns {ShownPosture|null} */
  posture() {
    return this.scene && this.chosen !== null ? this.scene.postures[this.chosen] : null;
  }

  /** @param {Pick<ShownPosture, "skeleton"|"axes"|"links"|"tool"|"beam"|"sights"|"reaches"|"blocked">|null} posture */
  drawArm(posture) {
    const { arm, mesh } = this.parts, scene = this.scene;
    emptied(arm);
    for (const child of mesh.children) child.visible = false;
    if (!posture || !scene) return;
    const meshed = this.drawMeshes(scene, posture);
    const kinds = scene.arm.joints.map((joint) => joint.kind);
    const solids = meshed ? [] : armBodies(posture, scene.reach, { below: scene.arm.mounting.below_base_mm, kinds });
    const flange = /** @type {Vec} */ (posture.skeleton.at(-1));
    solids.push(...toolBodies(flange, posture.tool, posture.beam, scene.reach), ...lineBodies(posture));
    if (posture.beam && posture.reaches !== false) {
      solids.push({ shape: "ball", at: posture.beam[1], radius: 0.005 * scene.reach, tone: "identified" });
    }
    for (const solid of solids) arm.add(solidObject(solid, this.materials, scene.reach));
  }

  /**
   * The links of a URDF where they are; whether there are any.
   * @param {Scene3D} scene @param {Pick<ShownPosture, "links">} posture
   */
  drawMeshes(scene, posture) {
    const { mesh } = this.parts;
    if (this.meshes !== scene.meshes) {
      for (const child of mesh.children) if (child instanceof THREE.Mesh) child.geometry.dispose();
      mesh.clear();
      for (const link of scene.meshes || []) {
        const object = new THREE.Mesh(meshGeometry(link), this.materials.faceted("link"));
        object.matrixAutoUpdate = false;
        Object.assign(object.userData, { link: link.link, joint: link.link || undefined });
        mesh.add(object);
      }
      this.meshes = scene.meshes;
    }
    if (!posture.links || !mesh.children.length) return false;
    for (const child of mesh.children) {
      const rows = posture.links[child.userData.link];
      child.visible = Boolean(rows);
      if (rows) poseMatrix(rows, child.matrix);
    }
    return true;
  }

  /** The other postures: the nearer to the chosen one, the stronger. @param {Scene3D} scene */
  drawPale(scene) {
    const all = scene.postures.map((posture, index) => ({ posture, index }));
    const others = this.ghosts || this.chosen === null ? all.filter(({ index }) => index !== this.chosen) : [];
    const key = [this.chosen, scene.reach, ...others.map(({ posture }) => posture)];
    if (same(this.shownPale, key)) return;
    this.shownPale = key;
    const own = this.posture(), { colours } = this, kinds = scene.arm.joints.map((joint) => joint.kind);
    const every = Math.max(1, others.length / MOST_PALE);
    const drawn = others.filter((_, i) => Math.floor(i / every) !== Math.floor((i - 1) / every));
    this.pale.show(drawn.map(({ posture, index }) => {
      const near = own ? Math.max(0, 1 - postureDistance(posture, own) / (0.6 * scene.reach)) : 0.6;
      const broken = posture.reaches === false || Boolean(posture.violations?.length);
      const tone = broken ? mixed(colours.link, colours.weak, 0.55) : colours.link;
      const solids = armBodies(posture, THIN * scene.reach, { kinds, plain: true });
      return { index, solids, colour: mixed(colours.panel, tone, own ? 0.35 + 0.4 * near : 0.7) };
    }));
    const { lines } = this.parts;
    for (const child of lines.children) if (child instanceof THREE.LineSegments) child.geometry.dispose();
    lines.clear();
    const see = own ? 0.28 : 0.6;
    const toneOf = (/** @type {ShownPosture} */ posture) =>
      (posture.blocked ? "misfit" : posture.reaches === false ? "weak" : "identified");
    for (const tone of /** @type {const} */ (["identified", "weak", "misfit"])) {
      const beams = drawn.filter(({ posture }) => toneOf(posture) === tone)
        .flatMap(({ posture }) => [...(posture.beam ? [posture.beam] : []), ...(posture.sights || [])]);
      if (beams.length) lines.add(thinLines(beams, this.materials.line(tone, see)));
    }
  }

  /** @param {Scene3D} scene */
  drawMarks(scene) {
    const { marks } = this.parts, key = [scene.marks, scene.boxes, scene.reach];
    if (same(this.shownMarks, key)) return;
    this.shownMarks = key;
    emptied(marks);
    for (const mark of scene.marks) {
      const group = new THREE.Group();
      for (const solid of markBodies(mark, scene.reach, floorOf(scene))) group.add(solidObject(solid, this.materials,
        scene.reach));
      group.userData.target = mark.name;
      marks.add(group);
    }
    (scene.boxes || []).forEach((box, i) => {
      const object = solidObject(boxBody(box), this.materials, scene.reach);
      object.userData.box = i;
      marks.add(object);
    });
  }

  /** Errors as arrows, clouds as balls. @param {Scene3D} scene */
  drawMore(scene) {
    const { more } = this.parts, { vectors, clouds = [] } = scene;
    emptied(more);
    for (const { at, by, tone } of vectors?.items || []) {
      const drawn = times(by, /** @type {import("./types.js").Vectors} */ (vectors).factor);
      const long = Math.hypot(...drawn);
      if (long < 1e-6) continue;
      const radius = 0.004 * scene.reach, end = plus(at, drawn), head = Math.min(0.45 * long, 6 * radius);
      const neck = minus(end, times(drawn, head / long));
      more.add(solidObject({ shape: "rod", from: at, to: neck, radius, tone }, this.materials, scene.reach));
      more.add(solidObject({ shape: "rod", from: neck, to: end, radius: 2.6 * radius, tip: 0.02 * radius, tone },
        this.materials, scene.reach));
    }
    for (const { at, size, tone } of clouds) more.add(solidObject({ shape: "ball", at, radius: size, tone },
      this.materials, scene.reach));
  }

  /** @param {Scene3D} scene @param {Vec[]} points */
  drawFloor(scene, points) {
    const { floor } = this.parts, low = /** @type {Vec} */ ([0, 1, 2].map((i) => Math.min(...points.map((p) => p[i]))));
    const high = /** @type {Vec} */ ([0, 1, 2].map((i) => Math.max(...points.map((p) => p[i]))));
    for (const child of floor.children) if (child instanceof THREE.LineSegments) child.geometry.dispose();
    emptied(floor);
    floor.add(thinLines(floorLines(low, high, scene.reach, floorOf(scene)), this.materials.line("line")));
    this.axis = 0.22 * scene.reach;
    for (const axis of /** @type {Vec[]} */ ([[1, 0, 0], [0, 1, 0], [0, 0, 1]]))
      floor.add(solidObject({ shape: "line", points: [[0, 0, 0], times(axis, this.axis)], tone: "muted", wide: 1.6 },
        this.materials, scene.reach));
  }

  // ── motion ──────────────────────────────────────────────────────────────────────────────────

  /** @param {Motion|null} motion */
  play(motion) {
    const before = this.motion;
    this.motion = motion;
    if (!motion) return;
    if (this.still.matches) this.drawArm(/** @type {ShownPosture} */ (motion.frames.at(-1)));
    else if (before !== motion) this.started = performance.now();
  }

  /** @param {number} now */
  advance(now) {
    const { motion } = this;
    if (!motion || this.still.matches) return;
    const phase = ((now - (this.started || 0)) / 1000 / motion.period_s) % 1;
    const there = phase < 0.5 ? 2 * phase : 2 - 2 * phase;
    const eased = (1 - Math.cos(Math.PI * there)) / 2;
    this.drawArm(motion.frames[Math.round(eased * (motion.frames.length - 1))]);
    this.invalidate();
  }

  // ── camera ──────────────────────────────────────────────────────────────────────────────────

  /** All points that are to be seen. @returns {Vec[]} */
  points() {
    const scene = this.scene;
    if (!scene) return [[0, 0, 0]];
    const points = extent(scene), links = this.posture()?.links;
    if (links) for (const { link, vertices } of (scene.meshes || []).filter((one) => links[one.link])) {
      const { min,
        max } = new THREE.Box3().setFromArray(vertices.flat())
          .applyMatrix4(poseMatrix(links[link], new THREE.Matrix4()));
      points.push(...boxCorners({ min: /** @type {Vec} */ (min.toArray()), max: /** @type {Vec} */ (max.toArray()) }));
    }
    return points;
  }

  /**
   * The view in which all fits in, from where it is looked now; at first from the side.
   * @param {{azimuth: number, elevation: number}} [from]
   */
  fit(from) {
    if (!this.scene || !this.wide) { this.unfitted = true; return; }
    const points = this.points(), margin = 0.06 * this.scene.reach;
    const low = new THREE.Vector3(...points[0]), high = low.clone();
    for (const p of points) { low.min(new THREE.Vector3(...p)); high.max(new THREE.Vector3(...p)); }
    this.drawFloor(this.scene, points);
    const centre = low.clone().add(high).multiplyScalar(0.5);
    const { azimuth, elevation } = from || (this.unfitted === false ? this.angles() : FIRST);
    const a = THREE.MathUtils.degToRad(azimuth);
    const e = THREE.MathUtils.clamp(THREE.MathUtils.degToRad(elevation), OVER_HEAD - Math.PI / 2,
      Math.PI / 2 - OVER_HEAD);
    const towards = new THREE.Vector3(Math.cos(e) * Math.cos(a), Math.cos(e) * Math.sin(a), Math.sin(e));
    const right = new THREE.Vector3(-Math.sin(a), Math.cos(a), 0), up = towards.clone().cross(right);
    const tall = Math.tan(THREE.MathUtils.degToRad(FIELD / 2)) * 0.88, broad = tall * (this.wide / this.high);
    const ways = points.map((p) => new THREE.Vector3(...p).sub(centre));
    // The middle of what is seen, then as near as all of it allows.
    for (let i = 0, far = 4 * this.scene.reach; i < 4; i++) {
      const span = [right, up].map((axis) => ways.map((way) => way.dot(axis) / (far - way.dot(towards))));
      const shift = span.map((list) => ((Math.min(...list) + Math.max(...list)) / 2) * far);
      const move = right.clone().multiplyScalar(shift[0]).add(up.clone().multiplyScalar(shift[1]));
      centre.add(move);
      for (const way of ways) way.sub(move);
      far = Math.max(...ways.map((way) =>
        Math.max((Math.abs(way.dot(right)) + margin) / broad, (Math.abs(way.dot(up)) + margin) / tall)
          + way.dot(towards)));
      this.far = far;
    }
    this.orbit.target.copy(centre);
    this.camera.position.copy(centre).addScaledVector(towards, this.far || 1);
    this.unfitted = false;
    this.orbit.update();
    this.viewed();
  }

  /** From where it is looked, degrees. */
  angles() {
    const way = this.camera.position.clone().sub(this.orbit.target).normalize();
    return { azimuth: THREE.MathUtils.radToDeg(Math.atan2(way.y, way.x)),
      elevation: THREE.MathUtils.radToDeg(Math.asin(Math.max(-1, Math.min(1, way.z)))) };
  }

  /** @param {number} azimuth @param {number} elevation degrees to turn by */
  turn(azimuth, elevation) {
    this.orbit.rotateLeft(-THREE.MathUtils.degToRad(azimuth));
    this.orbit.rotateUp(THREE.MathUtils.degToRad(elevation));
    this.settle();
  }

  /** @param {number} factor above 1: nearer */
  zoom(factor) {
    this.orbit.dollyIn(1 / factor);
    this.settle();
  }

  /** The camera has moved. */
  viewed() {
    const far = this.camera.position.distanceTo(this.orbit.target), size = this.scene ? this.scene.reach : 1000;
    this.camera.near = Math.max(far / 200, 1);
    this.camera.far = far + 30 * size;
    this.camera.updateProjectionMatrix();
    this.invalidate();
  }

  // ── drawing ─────────────────────────────────────────────────────────────────────────────────

  resize() {
    const { clientWidth: wide, clientHeight: high } = this.canvas;
    if (!wide || !high) return;
    Object.assign(this, { wide, high });
    this.camera.aspect = wide / high;
    this.camera.updateProjectionMatrix();
    const ratio = devicePixelRatio;
    Object.assign(this.overlay, { width: Math.round(wide * ratio), height: Math.round(high * ratio) });
    this.sized();
    if (this.unfitted !== false) this.fit();
    this.draw(performance.now());
  }

  sized() {
    this.pale.setCoarse(this.coarse);
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2) * (this.coarse ? COARSE : 1));
    this.renderer.setSize(this.wide, this.high, false);
  }

  invalidate() {
    if (this.waiting) return;
    this.waiting = requestAnimationFrame((now) => {
      this.waiting = 0;
      this.advance(now);
      this.draw(now);
    });
  }

  /** At rest again: as fine as the screen. */
  settle() {
    clearTimeout(this.settling);
    if (!this.coarse) return;
    this.settling = setTimeout(() => {
      this.coarse = false;
      this.last = -Infinity;
      this.sized();
      this.invalidate();
    }, PAUSE_MS);
  }

  /** Where frames come slowly one after the other, the picture is coarser until it is still. @param {number} now */
  pace(now) {
    const took = now - this.last;
    this.last = now;
    this.times = took > PAUSE_MS ? [] : [...this.times.slice(-2), took];
    if (!this.coarse && this.times.length > 2 && this.times.every((ms) => ms > SLOW_MS)) {
      this.coarse = true;
      this.sized();
    }
    if (this.coarse) this.settle();
  }

  /** @param {number} now */
  draw(now) {
    if (!this.wide) return;
    this.pace(now);
    const { renderer, camera } = this;
    renderer.info.reset();
    renderer.clear();
    renderer.render(this.behind, camera);
    renderer.clearDepth();
    renderer.render(this.front, camera);
    this.drawNames();
    const turn = new THREE.Matrix4().extractRotation(camera.matrixWorldInverse).elements; // of CSS, whose y goes down
    this.acts.turned?.(`matrix3d(${turn.map((v, i) => (i % 4 === 1 ? -v : v).toFixed(5)).join(",")})`);
  }

  /** Where a point is on the picture, px; null behind the eye. @param {Vec} p */
  flat(p) {
    const v = new THREE.Vector3(...p).project(this.camera);
    return v.z > 1 ? null : { x: ((v.x + 1) / 2) * this.wide, y: ((1 - v.y) / 2) * this.high };
  }

  /** @returns {{at: Vec, text: string, tone: string, rank: number, bold?: boolean}[]} */
  names() {
    const { scene, colours } = this, own = this.posture();
    if (!scene) return [];
    const words = { undetermined: ": not determined", held: ": held" };
    return [
      ...this.grips.names(),
      ...scene.marks.map((mark) =>
        ({ at: mark.at, text: mark.name + (words[/** @type {"held"} */ (mark.state)] || ""),
          tone: colours[markTone(mark)], rank: 1, bold: true })),
      ...(scene.boxes || []).map((box) =>
        ({ at: /** @type {Vec} */ (box.min.map((v, i) => (v + box.max[i]) / 2)),
          text: box.name + (box.touched ? ": touched" : ""), tone: box.touched ? colours.unidentifiable : colours.muted,
          rank: 2, bold: true })),
      ...(own && !this.motion
        ? jointLabels(own.skeleton).map(({ at, text }) => ({ at, text, tone: colours.ink, rank: 3, bold: true })) : []),
      ...["x", "y", "z"].map((text, i) =>
        ({ at: /** @type {Vec} */ ([0, 1, 2].map((k) => (k === i ? this.axis || 0 : 0))), text, tone: colours.muted,
          rank: 4 })),
    ];
  }

  drawNames() {
    const { pen, wide, high } = this, ratio = this.overlay.width / wide;
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, wide, high);
    const labels = this.names().flatMap(({ at, ...label }) => {
      const place = this.flat(at);
      return place ? [{ ...label, ...place }] : [];
    });
    drawLabels(pen, labels, { wide, high }, this.colours.panel);
  }

  dispose() {
    cancelAnimationFrame(this.waiting);
    clearTimeout(this.settling);
    this.dark.removeEventListener("change", this.recolour);
    this.grips.dispose();
    this.orbit.dispose();
    this.pale.dispose();
    this.materials.dispose();
    this.renderer.dispose();
  }
}
