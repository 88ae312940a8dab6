// The scene of a calibration: the arm in its postures, what it sees, what may be moved; in WebGL, or flat without it.
import { useSignal } from "@preact/signals";
import { html } from "htm/preact";
import { useEffect, useMemo, useRef } from "preact/hooks";
import { Solid } from "./Solid.js";
import { FIRST_VIEW, Still } from "./Still.js";

/** @typedef {import("./types.js").SceneActs} SceneActs */
/** @typedef {import("./types.js").Held} Held */

const STEP_MM = 10; // that a key moves what is held
const FLAT = "A flat picture: this browser has no WebGL.";

/** What draws in three dimensions in this browser; null where nothing does. */
function drawnBy() {
  try {
    const context = new OffscreenCanvas(1, 1).getContext("webgl2");
    const facts = context?.getExtension("WEBGL_debug_renderer_info");
    const name = context && String(facts ? context.getParameter(facts.UNMASKED_RENDERER_WEBGL) : "");
    context?.getExtension("WEBGL_lose_context")?.loseContext();
    return name;
  } catch {
    return null;
  }
}

/** @param {Held} held */
const heldName = (held) =>
  (held.kind === "target" ? held.name : held.kind === "flange" ? "flange" : `box ${held.index + 1}`);

/** @typedef {{name: string, says: string, from: {azimuth: number, elevation: number}}} Side */

/** @type {Side[]} */
const SIDES = [
  { name: "X", says: "+x", from: { azimuth: 0, elevation: 0 } },
  { name: "−X", says: "−x", from: { azimuth: 180, elevation: 0 } },
  { name: "Y", says: "+y", from: { azimuth: 90, elevation: 0 } },
  { name: "−Y", says: "−y", from: { azimuth: -90, elevation: 0 } },
  { name: "Z", says: "above", from: { azimuth: -90, elevation: 90 } },
  { name: "−Z", says: "below", from: { azimuth: -90, elevation: -90 } },
];

/**
 * Its faces are no stops of the keyboard: the keys X, Y and Z of the picture do the same.
 * @param {{turn: import("@preact/signals").Signal<string>, onSide: (side: Side) => void}} props
 */
function Cube({ turn, onSide }) {
  return html`<div class="scene-cube" role="group" aria-label="View cube">
    <div class="turned" style=${{ transform: turn.value }}>
      ${SIDES.map((side, i) => html`
        <button type="button" class=${`side${i}`} tabindex="-1" aria-label=${`${side.name}: view from ${side.says}`}
          onClick=${() => onSide(side)}>${side.name}</button>`)}
    </div>
  </div>`;
}

/**
 * @param {{scene: import("./types.js").Scene3D, chosen: number, tools?: import("./types.js").Tools,
 *   motion?: import("./view.js").Motion|null, caption?: unknown, label?: string,
 *   onChoose?: (index: number) => void, onTarget?: SceneActs["target"], onFlange?: SceneActs["flange"],
 *   onJoint?: SceneActs["joint"], onBox?: SceneActs["box"]}} props
 */
export function Scene({ scene, chosen, tools = {}, motion = null, caption, label, onChoose, onTarget, onFlange, onJoint,
  onBox }) {
  const make = useSignal(/** @type {import("./Solid.js").Make|null} */ (null)), flat = useSignal(false);
  const ghosts = useSignal(false), held = useSignal(/** @type {Held|null} */ (null)), mode = useSignal("translate");
  const turn = useSignal(""), still = useSignal(FIRST_VIEW);
  const view = useRef(/** @type {import("./view.js").View|null} */ (null));
  const latest = useRef({ onChoose, onTarget, onFlange, onJoint, onBox });
  latest.current = { onChoose, onTarget, onFlange, onJoint, onBox };
  useEffect(() => {
    const by = drawnBy();
    if (by === null) flat.value = true;
    else import("./view.js")
      .then(({ View }) => {
        make.value = (...of) => new View(...of, /swiftshader|llvmpipe|software|basic render/i.test(by));
      },
      () => { flat.value = true; });
  }, []);
  /** @type {SceneActs} */
  const acts = useMemo(() => ({
    choose: (index) => latest.current.onChoose?.(index),
    target: (...of) => latest.current.onTarget?.(...of),
    flange: (...of) => latest.current.onFlange?.(...of),
    joint: (...of) => latest.current.onJoint?.(...of),
    box: (...of) => latest.current.onBox?.(...of),
    held: (now) => { held.value = now; mode.value = "translate"; },
    turned: (matrix) => { if (turn.value !== matrix) turn.value = matrix; },
  }), []);

  const count = scene.postures.length;
  const choose = (/** @type {number} */ index) => onChoose?.(((index % count) + count) % count);
  const turned = (/** @type {number} */ azimuth, /** @type {number} */ elevation) => {
    const { value } = still;
    if (flat.value) still.value = { ...value, azimuth: value.azimuth + azimuth,
      elevation: Math.max(-85, Math.min(89, value.elevation + elevation)) };
    else view.current?.turn(azimuth, elevation);
  };
  const zoom = (/** @type {number} */ by) => {
    if (flat.value) still.value = { ...still.value, zoom: Math.max(0.3, Math.min(12, still.value.zoom * by)) };
    else view.current?.zoom(by);
  };
  const side = (/** @type {Side} */ { from }) => {
    if (flat.value) still.value = { ...still.value, ...from };
    else view.current?.fit(from);
  };
  const hold = (/** @type {Held|null} */ next) => view.current?.grips.hold(next);
  const through = () => {
    const list = view.current?.grips.holdable() || [];
    const now = list.findIndex((one) => JSON.stringify(one) === JSON.stringify(held.value));
    hold(list[now + 1] || null);
  };
  const shape = (/** @type {"translate"|"rotate"|"scale"} */ next) => {
    mode.value = next;
    view.current?.grips.setMode(next);
  };
  const acting = {
    previous: () => choose(chosen - 1),
    next: () => choose(chosen + 1),
    others: () => { ghosts.value = !ghosts.value; },
    fit: () => (flat.value ? (still.value = FIRST_VIEW) : view.current?.fit()),
    reset: () => side({ name: "", says: "", from: FIRST_VIEW }),
  };

  /** @param {KeyboardEvent} event */
  const key = (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || !(event.target instanceof HTMLCanvasElement)) return;
    const nudge = (/** @type {import("./vectors.js").Vec} */ by) => () => view.current?.grips.nudge(by);
    /** @type {Record<string, () => unknown>} */
    const keys = {
      ArrowLeft: () => turned(-6, 0), ArrowRight: () => turned(6, 0), ArrowUp: () => turned(0, 6),
      ArrowDown: () => turned(0, -6),
      "+": () => zoom(1.25), "=": () => zoom(1.25), "-": () => zoom(0.8), 0: acting.reset, f: acting.fit,
      ...(count > 1 ? { a: acting.others, ...(onChoose ? { n: acting.next, p: acting.previous } : {}) } : {}),
      x: () => side(SIDES[0]), X: () => side(SIDES[1]), y: () => side(SIDES[2]), Y: () => side(SIDES[3]),
      z: () => side(SIDES[4]), Z: () => side(SIDES[5]),
      g: through,
      ...(held.value ? {
        Escape: () => hold(null),
        ...(event.shiftKey ? {
          ArrowRight: nudge([STEP_MM, 0, 0]), ArrowLeft: nudge([-STEP_MM, 0, 0]), ArrowUp: nudge([0, STEP_MM, 0]),
          ArrowDown: nudge([0, -STEP_MM, 0]),
          PageUp: nudge([0, 0, STEP_MM]), PageDown: nudge([0, 0, -STEP_MM]),
        } : {}),
      } : {}),
    };
    const act = keys[event.key];
    if (!act) return;
    act();
    event.preventDefault();
    if (event.key !== "Escape") event.stopPropagation(); // Escape stops a run, too
  };

  const name = label
    || `${scene.arm.name}${scene.postures[chosen] ? `, ${scene.postures[chosen].name}` : ""}, above a floor grid`;
  const grabbable = Boolean(tools.flange || tools.target || tools.boxes) && !flat.value;
  const ready = make.value;
  return html`<figure class="scene" onKeyDown=${key}>
    <div class="scene-frame">
      ${flat.value
        ? html`<${Still} scene=${scene} chosen=${chosen} ghosts=${ghosts.value} label=${name} view=${still} />` : null}
      ${ready && !flat.value
        ? html`
          <${Solid} make=${ready} scene=${scene} chosen=${chosen} ghosts=${ghosts.value} tools=${tools} motion=${motion}
            acts=${acts} label=${name}
            onView=${(/** @type {import("./view.js").View|null} */ made) => { view.current = made; }}
            onNone=${() => { flat.value = true; }} />
        <${Cube} turn=${turn} onSide=${side} />` : null}
      ${held.value ? html`<div class="scene-held" role="group" aria-label="What is held">
        <output>${heldName(held.value)}</output>
        <button type="button" aria-pressed=${mode.value === "translate"}
          onClick=${() => shape("translate")}>Move</button>
        ${held.value.kind === "flange"
          ? html`
            <button type="button" aria-pressed=${mode.value === "rotate"}
              onClick=${() => shape("rotate")}>Rotate</button>`
          : null}
        ${held.value.kind === "box"
          ? html`
            <button type="button" aria-pressed=${mode.value === "scale"} onClick=${() => shape("scale")}>Size</button>`
          : null}
        <button type="button" onClick=${() => hold(null)}>Release</button>
      </div>` : null}
      <div class="scene-tools" role="group" aria-label="View">
        ${count > 1 && onChoose
          ? html`<button type="button" aria-label="Previous posture" onClick=${acting.previous}>‹</button>
        <output aria-live="polite">${chosen + 1} of ${count}</output>
        <button type="button" aria-label="Next posture" onClick=${acting.next}>›</button>` : null}
        ${count > 1 ? html`<button type="button" aria-pressed=${ghosts.value} onClick=${acting.others}>Others</button>`
          : null}
        <button type="button" class="zoom" aria-label="Zoom out" onClick=${() => zoom(0.8)}>−</button>
        <button type="button" class="zoom" aria-label="Zoom in" onClick=${() => zoom(1.25)}>+</button>
        <button type="button" onClick=${acting.fit}>Fit</button>
        ${grabbable ? html`<button type="button" aria-pressed=${held.value !== null} onClick=${through}>Grab</button>`
          : null}
      </div>
    </div>
    <figcaption>${caption} ${flat.value ? FLAT : null}</figcaption>
  </figure>`;
}
