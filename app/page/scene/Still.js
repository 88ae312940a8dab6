// The scene without WebGL: flat, from the same bodies. Turned by the buttons and keys, not by hand.
import { html } from "htm/preact";
import { useEffect, useRef } from "preact/hooks";
import { armBodies, floorLines, jointLabels, lineBodies, toolBodies } from "./bodies.js";
import { coloursOf } from "./colours.js";
import { extent, floorOf } from "./extent.js";
import { FIRST_VIEW, FlatPen, flatCamera } from "./flat.js";
import { drawLabels } from "./labels.js";
import { boxBody, markBodies, markTone } from "./marks.js";
import { plus, times } from "./vectors.js";

/** @typedef {import("./vectors.js").Vec} Vec */
/** @typedef {import("./types.js").Scene3D} Scene3D */

/**
 * @param {HTMLCanvasElement} canvas @param {Scene3D} scene @param {number} chosen
 * @param {boolean} ghosts @param {import("./flat.js").FlatView} view
 */
function drawStill(canvas, scene, chosen, ghosts, view) {
  const pen = canvas.getContext("2d"), room = { wide: canvas.clientWidth, high: canvas.clientHeight };
  const ratio = devicePixelRatio;
  if (!pen || !room.wide) return;
  Object.assign(canvas, { width: Math.round(room.wide * ratio), height: Math.round(room.high * ratio) });
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  const points = extent(scene), colours = coloursOf(canvas);
  const camera = flatCamera(points, room, view, 0.06 * scene.reach);
  const flat = new FlatPen(pen, camera, colours);
  const floor = floorOf(scene), kinds = scene.arm.joints.map((joint) => joint.kind);
  const corner = (/** @type {(...v: number[]) => number} */ pick) =>
    /** @type {Vec} */ ([0, 1, 2].map((i) => pick(...points.map((p) => p[i]))));
  for (const line of floorLines(corner(Math.min), corner(Math.max), scene.reach, floor)) flat.line(line, 1,
    colours.line);
  const own = scene.postures[chosen];
  for (const posture of ghosts || !own ? scene.postures : []) {
    if (posture === own) continue;
    flat.line(posture.skeleton, own ? 1.5 : 3, own ? colours.line : colours.muted);
    for (const line of lineBodies(posture)) flat.line(line.points, 0.8, own ? colours.line : colours[line.tone]);
  }
  for (const mark of scene.marks) flat.add(markBodies(mark, scene.reach, floor));
  for (const box of scene.boxes || []) flat.add([boxBody(box)]);
  if (own) {
    flat.add([...armBodies(own, scene.reach, { below: scene.arm.mounting.below_base_mm, kinds }),
      ...toolBodies(/** @type {Vec} */ (own.skeleton.at(-1)), own.tool, own.beam, scene.reach), ...lineBodies(own)]);
  }
  for (const { at, by, tone } of scene.vectors?.items || []) {
    flat.add([{ shape: "line", points: [at, plus(at, times(by, scene.vectors?.factor ?? 1))], tone, wide: 1.5 }]);
  }
  flat.flush();
  /** @param {Vec} at @param {string} text @param {string} tone @param {number} rank */
  const label = (at, text, tone, rank) => {
    const [x, y] = camera.seen(at);
    return { x, y, text, tone, rank, bold: rank < 4 };
  };
  drawLabels(pen, [
    ...scene.marks.map((mark) => label(mark.at, mark.name, colours[markTone(mark)], 1)),
    ...(own ? jointLabels(own.skeleton).map(({ at, text }) => label(at, text, colours.ink, 3)) : []),
  ], room, colours.panel);
}

/**
 * @param {{scene: Scene3D, chosen: number, ghosts: boolean, label: string,
 *   view: import("@preact/signals").Signal<import("./flat.js").FlatView>}} props
 */
export function Still({ scene, chosen, ghosts, label, view }) {
  const canvas = useRef(/** @type {HTMLCanvasElement|null} */ (null)), now = view.value;
  useEffect(() => {
    const drawn = () => { if (canvas.current) drawStill(canvas.current, scene, chosen, ghosts, now); };
    const dark = matchMedia("(prefers-color-scheme: dark)"), size = new ResizeObserver(drawn);
    dark.addEventListener("change", drawn);
    if (canvas.current) size.observe(canvas.current);
    drawn();
    return () => { size.disconnect(); dark.removeEventListener("change", drawn); };
  }, [scene, chosen, ghosts, now]);
  return html`<canvas ref=${canvas} class="scene-picture" tabindex="0" role="img" aria-label=${label}></canvas>`;
}

export { FIRST_VIEW };
