// What a person takes hold of in the picture: the target, the flange, a box, a joint. The pointer and the keys.
import * as THREE from "three";
import { TransformControls } from "three/TransformControls.js";
import { thickness } from "./bodies.js";
import { emptied, solidObject } from "./solids.js";
import { turned } from "./turning.js";
import { across, apart, dot, minus, plus, rotated, times, unit } from "./vectors.js";

/** @typedef {import("./vectors.js").Vec} Vec */
/** @typedef {import("./types.js").Held} Held */
/**
 * @typedef {{joint: number, kind: string, before: number, value: number, less: number, name: string, lower: number,
 *   upper: number, start: Vec, pivot: Vec, axis: Vec, screen: {x: number, y: number, per: number}|null,
 *   posture: import("./types.js").ShownPosture}} JointDrag
 */

const CLICK_PX = 5;
const THINNEST = 10; // mm, of a box
const EDGE_ON = 0.25; // cosine between sight and axis below which the angle cannot be read off the plane

export class Grips {
  /** @param {import("./view.js").View} view */
  constructor(view) {
    this.view = view;
    /** @type {import("./types.js").Tools} */
    this.tools = {};
    /** @type {Held|null} */
    this.held = null;
    /** @type {JointDrag|null} */
    this.drag = null;
    /** @type {{x: number, y: number}|null} */
    this.pressed = null;
    this.ray = new THREE.Raycaster();
    this.grip = new THREE.Object3D();
    this.half = /** @type {Vec} */ ([1, 1, 1]);
    view.front.add(this.grip);
    this.gizmo = new TransformControls(view.camera, view.canvas);
    this.gizmo.size = 0.85;
    view.front.add(this.gizmo.getHelper());
    this.gizmo.addEventListener("change", () => view.invalidate());
    this.gizmo.addEventListener("dragging-changed", (event) => { view.orbit.enabled = !event.value; });
    this.gizmo.addEventListener("objectChange", () => this.gripped(false));
    this.gizmo.addEventListener("mouseUp", () => this.gripped(true));
    this.gizmo.addEventListener("mouseUp", () => this.sync());
    this.gone = new AbortController();
    const { signal } = this.gone;
    view.canvas.addEventListener("pointerdown", this.down.bind(this), { signal });
    view.canvas.addEventListener("pointermove", this.move.bind(this), { signal });
    for (const kind of /** @type {const} */ (["pointerup", "pointercancel"])) {
      view.canvas.addEventListener(kind, this.up.bind(this), { signal });
    }
  }

  dispose() {
    this.gone.abort();
    this.gizmo.detach();
    this.gizmo.dispose();
  }

  // ── held by the gizmo ───────────────────────────────────────────────────────────────────────

  /** What can be held, in the order in which a key goes through it. @returns {Held[]} */
  holdable() {
    const { scene } = this.view;
    if (!scene) return [];
    return [
      ...(this.tools.flange && this.view.posture() ? [/** @type {Held} */ ({ kind: "flange" })] : []),
      ...(this.tools.target ? scene.marks.map((mark) => /** @type {Held} */ ({ kind: "target", name: mark.name }))
        : []),
      ...(this.tools.boxes ? (scene.boxes || []).map((_, index) => /** @type {Held} */ ({ kind: "box", index })) : []),
    ];
  }

  /** @param {Held|null} held */
  hold(held) {
    this.held = held;
    if (held) {
      this.gizmo.setMode("translate");
      this.gizmo.attach(this.grip);
      this.sync();
    } else this.gizmo.detach();
    this.view.acts.held?.(held);
    this.view.invalidate();
  }

  /** Moved, turned (the flange), or made larger (a box). @param {"translate"|"rotate"|"scale"} mode */
  setMode(mode) {
    this.gizmo.setMode(mode);
    this.view.invalidate();
  }

  /** Puts the gizmo to where what is held is now, unless it is being dragged. */
  sync() {
    const { scene } = this.view, { held, grip } = this;
    if (!held || !scene || this.gizmo.dragging) return;
    grip.scale.set(1, 1, 1);
    grip.quaternion.identity();
    if (held.kind === "target") {
      const mark = scene.marks.find(({ name }) => name === held.name);
      if (!mark) { this.hold(null); return; }
      grip.position.set(...mark.at);
    } else if (held.kind === "box") {
      const box = scene.boxes?.[held.index];
      if (!box) { this.hold(null); return; }
      grip.position.set(.../** @type {Vec} */ (box.min.map((v, i) => (v + box.max[i]) / 2)));
      this.half = /** @type {Vec} */ (box.max.map((v, i) => (v - box.min[i]) / 2));
    } else {
      const posture = this.view.posture();
      if (!posture) { this.hold(null); return; }
      grip.position.set(.../** @type {Vec} */ (posture.skeleton.at(-1)));
      const turn = this.flangeTurn(posture);
      if (turn) grip.quaternion.copy(turn);
    }
    this.gizmo.setSpace(held.kind === "flange" ? "local" : "world");
    grip.updateMatrixWorld();
  }

  /**
   * Orientation of the flange, from that of the last link; null where it is not known.
   * @param {import("./types.js").ShownPosture} posture
   */
  flangeTurn(posture) {
    const { scene } = this.view, first = scene?.arm.poses?.[0];
    if (!scene || !first?.quaternion_wxyz || !posture.links) return null;
    const turnOf = (/** @type {number[][]} */ rows) =>
      new THREE.Quaternion().setFromRotationMatrix(new THREE.Matrix4().set(rows[0][0], rows[0][1], rows[0][2], 0,
        rows[1][0], rows[1][1], rows[1][2], 0, rows[2][0], rows[2][1], rows[2][2], 0, 0, 0, 0, 1));
    const [w, x, y, z] = first.quaternion_wxyz;
    const last = /** @type {number[][]} */ (scene.arm.links.at(-1));
    const now = /** @type {number[][]} */ (posture.links.at(-1));
    return turnOf(now).multiply(turnOf(last).invert()).multiply(new THREE.Quaternion(x, y, z, w));
  }

  /** Says where what is held has been moved to. @param {boolean} done */
  gripped(done) {
    const { held, grip } = this, { acts, scene } = this.view, at = /** @type {Vec} */ (grip.position.toArray());
    if (!held || !scene) return;
    if (held.kind === "target") acts.target?.(held.name, at, done);
    else if (held.kind === "flange") {
      const { w, x, y, z } = grip.quaternion;
      const known = this.view.posture()
        && this.flangeTurn(/** @type {import("./types.js").ShownPosture} */ (this.view.posture()));
      acts.flange?.({ position_mm: at, quaternion_wxyz: known ? [w, x, y, z] : null }, done);
    } else {
      const box = scene.boxes?.[held.index];
      const half = this.half.map((v, i) => Math.max(THINNEST / 2, Math.abs(v * grip.scale.getComponent(i))));
      if (box) {
        acts.box?.(held.index,
          { ...box, min: /** @type {Vec} */ (at.map((v, i) => Math.round(v - half[i]))),
            max: /** @type {Vec} */ (at.map((v, i) => Math.round(v + half[i]))) },
          done);
      }
    }
  }

  /** Moves what is held by keys. @param {Vec} by mm */
  nudge(by) {
    if (!this.held) return;
    this.sync();
    this.grip.position.add(new THREE.Vector3(...by));
    this.gripped(true);
    this.view.invalidate();
  }

  // ── the pointer ─────────────────────────────────────────────────────────────────────────────

  /** @param {PointerEvent} event */
  aim(event) {
    const place = this.view.canvas.getBoundingClientRect();
    const flat = new THREE.Vector2(((event.clientX - place.left) / place.width) * 2 - 1,
      1 - ((event.clientY - place.top) / place.height) * 2);
    this.ray.setFromCamera(flat, this.view.camera);
  }

  /** What the ray meets first of some groups. @param {THREE.Object3D[]} groups */
  hit(groups) {
    const [first] = this.ray.intersectObjects(groups.filter((group) => group.visible), true);
    if (!first) return null;
    /** @type {THREE.Object3D|null} */
    let object = first.object;
    while (object && object.userData.joint === undefined && object.userData.target === undefined
      && object.userData.box === undefined && !(object instanceof THREE.InstancedMesh)) object = object.parent;
    return { ...first, of: object };
  }

  /** What is under the pointer: the arm or a target, else a box, which can be seen through. */
  under() {
    const { arm, mesh, marks } = this.view.parts;
    const boxes = marks.children.filter((child) => child.userData.box !== undefined);
    const solid = this.hit([arm, ...mesh.children, ...marks.children.filter((child) => !boxes.includes(child))]);
    return solid?.of ? solid : this.hit(boxes);
  }

  /** @param {PointerEvent} event */
  down(event) {
    this.pressed = event.isPrimary ? { x: event.clientX, y: event.clientY } : null;
    if (!event.isPrimary || event.button !== 0 || this.gizmo.dragging || this.gizmo.axis) return;
    this.aim(event);
    const found = this.tools.joints ? this.under() : null;
    const at = /** @type {Vec|undefined} */ (found?.point.toArray());
    if (at && found?.of?.userData.joint && this.begin(this.turning(found.of.userData, at), at, event)) {
      this.view.orbit.enabled = false;
      this.view.canvas.setPointerCapture(event.pointerId);
    }
  }

  /**
   * The joint that a grabbed body turns: its own, or for a link that would only roll about itself the one before.
   * @param {{joint?: number, body?: string}} body @param {Vec} at
   */
  turning({ joint = 1, body }, at) {
    const posture = this.view.posture(), reach = this.view.scene?.reach ?? 0;
    let k = joint;
    while (body !== "joint" && k > 1 && posture?.axes) {
      const arm = minus(at, posture.skeleton[k]), axis = posture.axes[k - 1];
      if (apart(arm, times(axis, dot(arm, axis))) > 1.6 * thickness(reach, k, posture.axes.length)) break;
      k -= 1;
    }
    return k;
  }

  /** Begins to turn a joint; whether it can be. @param {number} joint @param {Vec} at @param {PointerEvent} event */
  begin(joint, at, event) {
    const { scene, camera } = this.view, posture = this.view.posture(), limits = scene?.arm.joints[joint - 1];
    const value = posture?.joints?.[joint - 1];
    if (!scene || !posture?.axes || !limits || value === undefined) return false;
    const pivot = posture.skeleton[joint], axis = posture.axes[joint - 1];
    const eye = unit(minus(/** @type {Vec} */ (camera.position.toArray()), pivot));
    const arm = minus(at, pivot), start = minus(arm, times(axis, dot(arm, axis)));
    let screen = null;
    if (limits.kind === "prismatic" || Math.abs(dot(eye, axis)) < EDGE_ON || apart(start, [0, 0, 0]) < 1) {
      // Along the picture: where the grabbed point goes for a degree (a millimetre).
      const next = limits.kind === "prismatic" ? plus(at, axis) : plus(pivot, rotated(arm, axis, Math.PI / 180));
      const [a, b] = [this.view.flat(at), this.view.flat(next)];
      const way = a && b ? { x: b.x - a.x, y: b.y - a.y } : { x: 1, y: 0 }, per = Math.hypot(way.x, way.y);
      const least = limits.kind === "prismatic" ? 0.02 : 0.8; // px, so that a point near the axis does not race
      screen = per > 1e-3 ? { x: way.x / per, y: way.y / per, per: Math.max(per, least) } : { x: 1, y: 0, per: 2 };
    }
    // Limits hold as the pendant counts and between the links.
    const less = value - (posture.counted?.[joint - 1] ?? value);
    const [lowest, highest] = scene.arm.ranges?.[joint - 1] ?? [-Infinity, Infinity];
    this.drag = { joint, kind: limits.kind, before: value, value, less,
      name: scene.arm.pendant?.names[joint - 1] ?? `J${joint}`, lower: Math.max(lowest, limits.lower + less),
      upper: Math.min(highest, limits.upper + less), start: unit(start), pivot, axis, screen, posture };
    this.from = { x: event.clientX, y: event.clientY };
    this.swept = 0;
    this.showArc();
    return true;
  }

  /** @param {PointerEvent} event */
  move(event) {
    const { drag, view } = this;
    if (!drag) {
      if (event.pointerType === "mouse" && !event.buttons) this.hover(event);
      return;
    }
    const by = this.swing(drag, event);
    drag.value = Math.max(drag.lower, Math.min(drag.upper, drag.before + by));
    view.drawArm(turned(drag.posture, drag.joint, drag.value - drag.before, drag.kind));
    this.showArc();
    view.acts.joint?.(drag.joint, drag.value, false);
    view.invalidate();
  }

  /**
   * A posture that has come while a joint is dragged, with that joint where the pointer has it by now.
   * @param {import("./types.js").ShownPosture|null} posture
   */
  dragged(posture) {
    const { drag } = this, value = posture?.joints?.[drag ? drag.joint - 1 : 0];
    if (!drag || !posture?.axes || value === undefined || Math.abs(drag.value - value) < 1e-6) return posture;
    return turned(posture, drag.joint, drag.value - value, drag.kind);
  }

  /** By how much the joint is turned since it was grabbed. @param {JointDrag} drag @param {PointerEvent} event */
  swing(drag, event) {
    const from = /** @type {{x: number, y: number}} */ (this.from);
    if (drag.screen) {
      return ((event.clientX - from.x) * drag.screen.x + (event.clientY - from.y) * drag.screen.y) / drag.screen.per;
    }
    this.aim(event);
    const plane = new THREE.Plane().setFromNormalAndCoplanarPoint(new THREE.Vector3(...drag.axis),
      new THREE.Vector3(...drag.pivot));
    const met = this.ray.ray.intersectPlane(plane, new THREE.Vector3());
    if (!met) return this.swept || 0;
    const way = unit(minus(/** @type {Vec} */ (met.toArray()), drag.pivot));
    const side = rotated(drag.start, drag.axis, Math.PI / 2);
    const angle = THREE.MathUtils.radToDeg(Math.atan2(dot(way, side), dot(way, drag.start)));
    // The turn that is nearest to the one before: past a half turn it goes on.
    this.swept = angle + 360 * Math.round(((this.swept || 0) - angle) / 360);
    return this.swept;
  }

  /** The range of the joint, and where it is in it. */
  showArc() {
    const { drag, view } = this, { arc } = view.parts;
    emptied(arc);
    if (!drag || !view.scene) return;
    const reach = view.scene.reach, radius = 0.17 * reach;
    const [lower, upper] = [drag.lower - drag.before, drag.upper - drag.before];
    if (drag.kind === "prismatic") {
      const ends = /** @type {Vec[]} */ ([lower, upper].map((by) => plus(drag.pivot, times(drag.axis, by))));
      arc.add(solidObject({ shape: "line", points: ends, tone: "identified", wide: 2 }, view.materials, reach));
      return;
    }
    const [u] = apart(drag.start, [0, 0, 0]) > 0.5 ? [drag.start] : across(drag.axis);
    const at = (/** @type {number} */ degrees) =>
      plus(drag.pivot, times(rotated(u, drag.axis, (degrees * Math.PI) / 180), radius));
    const span = Math.min(upper - lower, 360);
    const points = Array.from({ length: 49 }, (_, i) => at(lower + (span * i) / 48));
    const stop = drag.value <= drag.lower || drag.value >= drag.upper;
    arc.add(solidObject({ shape: "patch", points: span < 360 ? [drag.pivot, ...points] : points,
      tone: stop ? "weak" : "identified", see: 0.16 },
      view.materials, reach));
    arc.add(solidObject({ shape: "line", points: [drag.pivot, at(drag.value - drag.before)],
      tone: stop ? "weak" : "identified", wide: 2.4 },
      view.materials, reach));
  }

  /** The name of what is dragged, with its value. */
  names() {
    const { drag, view } = this;
    if (!drag) return [];
    const unitOf = drag.kind === "prismatic" ? "\u00a0mm" : "°";
    const shown = (/** @type {number} */ v, /** @type {number} */ digits) => v.toFixed(digits).replace("-", "−");
    const [now, lower, upper] = [drag.value, drag.lower, drag.upper].map((v) => v - drag.less);
    const text = `${drag.name}: ${shown(now, 1)}${unitOf} (${shown(lower, 0)} to ${shown(upper, 0)})`;
    return [{ at: drag.pivot, text, tone: view.colours.identified, rank: 0, bold: true }];
  }

  /** @param {PointerEvent} event */
  up(event) {
    const { drag, pressed, view } = this;
    const still = pressed && Math.hypot(event.clientX - pressed.x, event.clientY - pressed.y) < CLICK_PX;
    this.pressed = null;
    if (drag) {
      this.drag = null;
      this.showArc();
      view.orbit.enabled = true;
      if (!still) view.acts.joint?.(drag.joint, drag.value, true);
      view.invalidate();
    }
    if (still && event.type === "pointerup" && event.button === 0 && !this.gizmo.axis) this.click(event);
  }

  /** @param {PointerEvent} event */
  click(event) {
    const { view } = this;
    this.aim(event);
    const found = this.under()?.of, scene = view.scene;
    if (!scene) return;
    if (found?.userData.target !== undefined
      && this.tools.target) this.hold({ kind: "target", name: found.userData.target });
    else if (found?.userData.box !== undefined
      && this.tools.boxes) this.hold({ kind: "box", index: found.userData.box });
    else if (found?.userData.joint === scene.arm.joints.length && this.tools.flange) this.hold({ kind: "flange" });
    else if (!found) {
      const pale = this.hit([view.pale.group]), list = pale?.of && view.pale.of.get(pale.of);
      if (pale && list && pale.instanceId !== undefined) view.acts.choose?.(list[pale.instanceId]);
      else if (this.held) this.hold(null);
    }
  }

  /** @param {PointerEvent} event */
  hover(event) {
    this.aim(event);
    const found = this.under()?.of?.userData;
    const held = found
      && ((found.joint && this.tools.joints) || (found.target !== undefined && this.tools.target)
        || (found.box !== undefined && this.tools.boxes));
    this.view.canvas.classList.toggle("over", Boolean(held));
  }
}
