// The servo's trace, the spot on the PSD, the camera's picture, the residuals. Their numbers are in texts, too.
import { html } from "htm/preact";
import { useEffect, useRef } from "preact/hooks";
import { fixed } from "../core/words.js";
import { Plot, power } from "../parts/Plot.js";

/** @typedef {import("answers").SpotSeen} Spot */

const SIDE = 200;
const path = (/** @type {number[][]} */ points) => points.map(([x, y]) => `${x.toFixed(1)},${y.toFixed(1)}`).join(" ");

/** Distance of the spot from the centre, by step of the servo. @param {{trace: Spot[]}} props */
export function Trace({ trace }) {
  if (!trace.length) return html`<p class="muted">No step of the servo yet.</p>`;
  const offs = trace.map((spot) => spot.off_mm), says = offs.map((off) => fixed(off, 4)).join(", ");
  /** @type {Parameters<typeof Plot>[0]["options"]} */
  const options = (tone, axis) => ({
    legend: { show: false }, cursor: { show: false }, scales: { x: { time: false }, y: { distr: 3 } },
    axes: [{ ...axis, label: "step", labelSize: 16, size: 24, incrs: [1, 2, 5, 10, 20] },
      { ...axis, label: "mm", labelSize: 16, size: 46, values: (_, ticks) => ticks.map(power) }],
    series: [{}, { stroke: tone("identified"), width: 1.6, points: { show: true, size: 7, fill: tone("identified") } }],
  });
  return html`
    <${Plot} class="plotted" shape="" options=${options} tall=${() => SIDE}
      data=${[offs.map((_, i) => i + 1), offs.map((off) => Math.max(off, 1e-6))]}
      says=${`Distance of the spot from the centre by step: ${says} mm.`} />`;
}

/**
 * The spot on the face of the PSD, with where it was left at the measurements before.
 * @param {{trace: Spot[], kept: Spot[], size: number | null}} props
 */
export function Face({ trace, kept, size }) {
  const middle = SIDE / 2, half = middle - 14;
  const seen = trace.filter((spot) => spot.at_mm), last = seen.at(-1)?.at_mm;
  const at = (/** @type {Spot} */ spot) =>
    (spot.at_mm ?? [0, 0]).map((v, i) => middle + (i ? -1 : 1) * (v / ((size ?? 1) / 2)) * half);
  return html`
    <svg viewBox="0 0 ${SIDE} ${SIDE}" role="img"
      aria-label=${last && size
        ? `The spot is at x ${fixed(last[0], 4)} mm, y ${fixed(last[1], 4)} mm on a face of ${size} mm.`
        : "No spot on the PSD yet."}>
      <rect class="grid" x=${middle - half} y=${middle - half} width=${2 * half} height=${2 * half} />
      <line class="grid" x1=${middle - half} x2=${middle + half} y1=${middle} y2=${middle} />
      <line class="grid" y1=${middle - half} y2=${middle + half} x1=${middle} x2=${middle} />
      ${size && kept.filter((spot) => spot.at_mm)
        .map((spot) => html`<circle class="before" cx=${at(spot)[0]} cy=${at(spot)[1]} r="2" />`)}
      ${size && last && html`
        <polyline class="way" points=${path(seen.map(at))} />
        <circle class="spot" cx=${at(/** @type {Spot} */ (seen.at(-1)))[0]}
          cy=${at(/** @type {Spot} */ (seen.at(-1)))[1]} r="5" />
      <text x=${middle + half} y=${SIDE - 2} text-anchor="end">x ${fixed(last[0], 3)}, y ${fixed(last[1], 3)} mm;
        face ${size} mm</text>`}
    </svg>`;
}

/** @param {{seen: import("answers").PictureTaken}} props */
export function CameraPicture({ seen }) {
  const canvas = useRef(/** @type {HTMLCanvasElement | null} */ (null));
  useEffect(() => {
    const pen = canvas.current?.getContext("2d");
    if (!pen) return;
    const greys = atob(seen.grey), pixels = pen.createImageData(seen.width, seen.height);
    for (let i = 0; i < greys.length; i++) {
      const grey = greys.charCodeAt(i);
      pixels.data.set([grey, grey, grey, 255], 4 * i);
    }
    pen.putImageData(pixels, 0, 0);
  }, [seen]);
  return html`
    <canvas ref=${canvas} width=${seen.width} height=${seen.height} role="img"
      aria-label="What the camera saw last"></canvas>`;
}

/**
 * The normalised residual of each measurement at the fit to those so far.
 * @param {{residuals: Record<string, number>, suspect: number | null}} props
 */
export function Residuals({ residuals, suspect }) {
  const shots = Object.keys(residuals).map(Number), sizes = Object.values(residuals);
  if (!shots.length) return html`<p class="muted">None yet: there is no fit of the measurements so far.</p>`;
  /** @type {Parameters<typeof Plot>[0]["options"]} */
  const options = (tone, axis, Chart) => {
    const bars = (/** @type {string} */ name) =>
      ({ fill: tone(name), width: 0, paths: Chart.paths.bars?.({ size: [0.7, 40] }), points: { show: false } });
    return {
      legend: { show: false }, cursor: { show: false },
      scales: { x: { time: false, range: (_, low, high) => [low - 0.6, high + 0.6] },
        y: { range: (_, low, high) => [0, Math.max(2, high)] } },
      axes: [{ ...axis, size: 26, incrs: [1, 2, 5, 10, 20, 50], grid: { show: false } }, { ...axis, size: 34 }],
      series: [{}, bars("identified"), bars("misfit")],
    };
  };
  const says = shots.map((shot, i) => `measurement ${shot}: ${fixed(sizes[i], 2)}`).join(", ");
  return html`
    <${Plot} class="plotted" shape="" options=${options} says=${`Normalised residuals: ${says}.`}
      data=${[shots, sizes.map((size, i) => (shots[i] === suspect ? null : size)),
        sizes.map((size, i) => (shots[i] === suspect ? size : null))]}
      tall=${(/** @type {HTMLElement} */ room) => Math.max(room.clientHeight, 110)} />`;
}
