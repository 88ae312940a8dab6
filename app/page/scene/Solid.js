// The canvas of the scene in WebGL, and the names over it.
import { html } from "htm/preact";
import { useEffect, useRef } from "preact/hooks";

/** @typedef {import("./view.js").View} View */
/**
 * @typedef {(canvas: HTMLCanvasElement, names: HTMLCanvasElement, acts: import("./types.js").SceneActs) => View} Make
 */

/**
 * @param {{make: Make, scene: import("./types.js").Scene3D, chosen: number, ghosts: boolean,
 *   tools: import("./types.js").Tools,
 *   motion: import("./view.js").Motion|null, acts: import("./types.js").SceneActs, label: string,
 *   onView: (view: View|null) => void, onNone: () => void}} props
 */
export function Solid({ make, scene, chosen, ghosts, tools, motion, acts, label, onView, onNone }) {
  const canvas = useRef(/** @type {HTMLCanvasElement|null} */ (null));
  const names = useRef(/** @type {HTMLCanvasElement|null} */ (null));
  const view = useRef(/** @type {View|null} */ (null));
  useEffect(() => {
    if (!canvas.current || !names.current) return undefined;
    /** @type {View} */
    let made;
    try {
      made = make(canvas.current, names.current, acts);
    } catch {
      onNone();
      return undefined;
    }
    const size = new ResizeObserver(() => made.resize());
    view.current = made;
    size.observe(canvas.current);
    made.resize();
    onView(made);
    document.fonts?.ready.then(() => made.invalidate());
    return () => { size.disconnect(); onView(null); view.current = null; made.dispose(); };
  }, []);
  useEffect(() => view.current?.show(scene, chosen, ghosts, tools, motion), [scene, chosen, ghosts, tools, motion]);
  return html`
    <canvas ref=${canvas} class="scene-picture" tabindex="0" role="img" aria-label=${label}></canvas>
    <canvas ref=${names} class="scene-names" aria-hidden="true"></canvas>`;
}
