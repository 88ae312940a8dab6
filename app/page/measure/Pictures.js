// The servo's trace, the spot on the PSD, the camera's picture, the residuals. Their numbers are in texts, too.
import { html } from "htm/preact";
import { useEffect, useRef } from "preact/hooks";
import { fixed } from "../core/words.js";

/** @typedef {import("./events.js").Spot} Spot */

const SIDE = 200;
const path = (/** @type {number[][]} */ points) => points.map(([x, y]) => `${x.toFixed(1)},${y.toFixed(1)}`).join(" ");

/** Distance of the spot from the centre, by step of the servo. @param {{trace: Spot[]}} props */
export function Trace({ trace }) {
  const left = 44, top = 10, right = SIDE - 8, bottom = SIDE - 24;
  if (!trace.length) {
    return html`
      <svg viewBox="0 0 ${SIDE} ${SIDE}" role="img"
        aria-label="No step of the servo yet.">
        <text x=${SIDE / 2} y=${SIDE / 2} text-anchor="middle">no step yet</text></svg>`;
  }
  const offs = trace.map((spot) => fixed(spot.off_mm, 4));
  const logs = trace.map((spot) => Math.log10(Math.max(spot.off_mm, 1e-6)));
  const low = Math.floor(Math.min(...logs)), high = Math.max(low + 1, Math.ceil(Math.max(...logs)));
  const at = (/** @type {number} */ log) => bottom - ((log - low) / (high - low)) * (bottom - top);
  const points = logs.map((log, i) =>
    [left + (logs.length < 2 ? 0 : (i / (logs.length - 1)) * (right - left)), at(log)]);
  return html`
    <svg viewBox="0 0 ${SIDE} ${SIDE}" role="img"
      aria-label=${`Distance of the spot from the centre by step: ${offs.join(", ")} mm.`}>
      ${Array.from({ length: high - low + 1 }, (_, i) => low + i)
        .map((k) => html`
          <line class="grid" x1=${left} x2=${right} y1=${at(k)} y2=${at(k)} />
          <text x=${left - 5} y=${at(k) + 3} text-anchor="end">${fixed(10 ** k, Math.max(0, -k))}</text>`)}
      <polyline class="course" points=${path(points)} />
      ${points.map(([cx, cy]) => html`<circle class="spot" cx=${cx} cy=${cy} r="3" />`)}
      <text x="2" y="9">mm</text>
      <text x=${(left + right) / 2} y=${SIDE - 6} text-anchor="middle">step 1 to ${trace.length}</text>
    </svg>`;
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

/** @param {{seen: import("./events.js").Camera}} props */
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

const WIDE = 240, TALL = 160, MOST_NUMBERS = 12;

/**
 * The normalised residual of each measurement at the fit to those so far.
 * @param {{residuals: import("./events.js").Residuals, suspect: number | null}} props
 */
export function Residuals({ residuals, suspect }) {
  const bars = Object.entries(residuals).map(([shot, size]) => ({ shot: Number(shot), size }));
  if (!bars.length) return html`<p class="muted">None yet: there is no fit of the measurements so far.</p>`;
  const left = 26, top = 12, right = WIDE - 6, bottom = TALL - 20;
  const most = Math.max(2, Math.ceil(Math.max(...bars.map(({ size }) => size))));
  /** @param {{shot: number, size: number}} bar */
  const said = ({ shot, size }) => `measurement ${shot}: ${fixed(size, 2)}`;
  const step = (right - left) / bars.length, every = Math.ceil(bars.length / MOST_NUMBERS);
  const y = (/** @type {number} */ v) => bottom - (v / most) * (bottom - top);
  return html`
    <svg viewBox="0 0 ${WIDE} ${TALL}" role="img"
      aria-label=${`Normalised residuals: ${bars.map(said).join(", ")}.`}>
      ${[0, most / 2, most].map((v) => html`
        <line class="grid" x1=${left} x2=${right} y1=${y(v)} y2=${y(v)} />
        <text x=${left - 5} y=${y(v) + 4} text-anchor="end">${Number(v.toFixed(1))}</text>`)}
      ${bars.map(({ shot, size }, i) => html`
        <rect key=${shot} class=${shot === suspect ? "size suspect" : "size"} data-shot=${shot}
          x=${left + (i + 0.15) * step} width=${0.7 * step} y=${y(size)}
          height=${bottom - y(size)}><title>${`measurement ${shot}: ${fixed(size, 2)}`}</title></rect>
        ${i % every === 0 && html`
          <text x=${left + (i + 0.5) * step} y=${TALL - 6} text-anchor="middle">${shot}</text>`}`)}
    </svg>`;
}
