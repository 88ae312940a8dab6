// An offset over time, with its expanded uncertainty (k = 2) as a band.
import { html } from "htm/preact";
import { useEffect, useRef } from "preact/hooks";
import { failed } from "../core/store.js";
import { named, unitSign } from "../core/words.js";
import { estimateOf, expandedOf } from "./numbers.js";

/** @typedef {{when: string, file: string, unit: string, estimate: number, std: number}} Point */

const HEIGHT = 150;

/** @param {{name: string, points: Point[]}} props */
export function Trend({ name, points }) {
  const box = useRef(/** @type {HTMLDivElement | null} */ (null));
  const times = points.map(({ when }) => Date.parse(when));
  const timed = times.every(Number.isFinite) && new Set(times).size === times.length;
  const text = points.map((point) => {
    const row = { ...point, status: "" };
    return `${point.when || point.file}: ${estimateOf(row, 2)} ± ${expandedOf(row, 2)}`;
  }).join("; ");
  useEffect(() => {
    /** @type {import("uplot") | null} */
    let plot = null;
    let gone = false;
    import("uplot").then(({ default: UPlot }) => {
      const element = box.current;
      if (gone || element === null) return;
      const tone = (/** @type {string} */ of) => getComputedStyle(element).getPropertyValue(`--${of}`).trim();
      const line = tone("identified");
      const axis = { stroke: tone("muted"), grid: { stroke: tone("line"), width: 1 },
        ticks: { stroke: tone("line"), width: 1 } };
      const edge = { stroke: line, width: 1, dash: [3, 3], points: { show: false } };
      plot = new UPlot({
        width: element.clientWidth || 280, height: HEIGHT, legend: { show: false }, cursor: { show: false },
        scales: { x: { time: timed } },
        axes: [{ ...axis, size: 34,
          ...(timed ? {} : { values: (_, splits) => splits.map((v) => (Number.isInteger(v) ? `run ${v + 1}` : "")) }) },
          { ...axis, size: 56 }],
        series: [{}, { stroke: line, width: 2, points: { show: true, size: 7, fill: line } }, edge, edge],
        bands: [{ series: [2, 3], fill: `${line}22` }],
      }, [timed ? times.map((time) => time / 1000) : points.map((_, i) => i), points.map((p) => p.estimate),
        points.map((p) => p.estimate + 2 * p.std), points.map((p) => p.estimate - 2 * p.std)],
      element);
    }, failed);
    return () => { gone = true; plot?.destroy(); };
  }, [text]);
  return html`
    <figure class="trend"><div ref=${box} role="img" aria-label=${`${named(name)}: ${text}`}></div>
      <figcaption>${named(name)}, ${unitSign(points[0].unit)}, with U (k = 2)</figcaption></figure>`;
}
