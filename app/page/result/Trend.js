// An offset over time, with its expanded uncertainty (k = 2) as a band.
import { html } from "htm/preact";
import { expandedWord, named, unitSign } from "../core/words.js";
import { Plot } from "../parts/Plot.js";
import { estimateOf, expandedOf } from "./numbers.js";

/** @typedef {{when: string, file: string, unit: string, estimate: number, std: number}} Point */

const HEIGHT = 150;

/** @param {{name: string, points: Point[]}} props */
export function Trend({ name, points }) {
  const times = points.map(({ when }) => Date.parse(when));
  const timed = times.every(Number.isFinite) && new Set(times).size === times.length;
  const text = points.map((point) => {
    const row = { ...point, status: "" };
    return `${point.when || point.file}: ${estimateOf(row, 2)} ± ${expandedOf(row, 2)}`;
  }).join("; ");
  /** @type {Parameters<typeof Plot>[0]["options"]} */
  const options = (tone, axis) => {
    const line = tone("identified"), edge = { stroke: line, width: 1, dash: [3, 3], points: { show: false } };
    return {
      legend: { show: false }, cursor: { show: false }, scales: { x: { time: timed } },
      axes: [{ ...axis, size: 34,
        ...(timed ? {} : { values: (_, splits) => splits.map((v) => (Number.isInteger(v) ? `run ${v + 1}` : "")) }) },
        { ...axis, size: 56 }],
      series: [{}, { stroke: line, width: 2, points: { show: true, size: 7, fill: line } }, edge, edge],
      bands: [{ series: [2, 3], fill: `${line}22` }],
    };
  };
  return html`
    <figure class="trend">
      <${Plot} shape=${text} options=${options} tall=${() => HEIGHT} says=${`${named(name)}: ${text}`}
        data=${[timed ? times.map((time) => time / 1000) : points.map((_, i) => i), points.map((p) => p.estimate),
          points.map((p) => p.estimate + 2 * p.std), points.map((p) => p.estimate - 2 * p.std)]} />
      <figcaption>${named(name)}, ${unitSign(points[0].unit)}, with ${expandedWord(2)}</figcaption></figure>`;
}
