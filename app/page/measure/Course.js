// u of each offset by measurement, on one logarithmic axis, with the tolerance as a line. What is not determined has no point.
import { html } from "htm/preact";
import { useEffect, useRef } from "preact/hooks";
import { named } from "../core/words.js";

/** @typedef {import("./events.js").CoursePoint} CoursePoint */

const TONES = ["identified", "weak", "unidentifiable", "misfit", "held", "muted", "ink"];
const LINE_PX = 26, ENTRY_PX = 165; // of the legend
const DASHES = [[], [6, 3], [2, 3]]; // the same colours again, for more joints than colours

/** @param {{rows: CoursePoint[], tolerance: number | null, unit: string}} props */
export function Course({ rows, tolerance, unit }) {
  const box = useRef(/** @type {HTMLDivElement | null} */ (null)), names = Object.keys(rows.at(-1)?.std ?? {});
  const plot = useRef(/** @type {any} */ (null)), latest = useRef({ rows, tolerance });
  latest.current = { rows, tolerance };
  const table = () => {
    const now = latest.current;
    return [now.rows.map((row) => row.recorded), ...names.map((name) => now.rows.map((row) => (row.std[name] ? row.std[name] : null))), now.rows.map(() => now.tolerance)];
  };
  const size = (/** @type {HTMLElement} */ { clientWidth, clientHeight }) => ({ width: Math.max(clientWidth, 120), height: Math.max(clientHeight - 10 - LINE_PX * Math.ceil(((names.length + 2) * ENTRY_PX) / Math.max(clientWidth, ENTRY_PX)), 90) });
  /** Where the pointer is, else of the last measurement. @param {any} plot @param {number | null} value @param {number} series @param {number | null} at */
  const pointed = (plot, value, series, at) => (at === null ? plot.data[series].at(-1) ?? null : value);
  const dark = matchMedia("(prefers-color-scheme: dark)");
  useEffect(() => {
    let gone = false;
    /** @type {ResizeObserver | null} */
    let sizes = null;
    const make = async () => {
      const { default: UPlot } = await import("uplot");
      const parent = box.current;
      if (gone || !parent || !names.length) return;
      const style = getComputedStyle(parent), colour = (/** @type {string} */ name) => style.getPropertyValue(`--${name}`).trim();
      const axis = { stroke: colour("muted"), grid: { stroke: colour("line"), width: 1 }, ticks: { stroke: colour("line"), width: 1 }, font: "12px IBM Plex Sans" };
      plot.current?.destroy();
      plot.current = new UPlot({
        ...size(parent), cursor: { y: false }, legend: { live: true },
        scales: { x: { time: false }, y: { distr: 3 } },
        axes: [{ ...axis, label: "", size: 30, incrs: [1, 2, 5, 10, 20, 50, 100] }, { ...axis, size: 64, values: (/** @type {any} */ _, /** @type {number[]} */ ticks) => ticks.map((v) => (v === null || !/^1/.test(v.toExponential()) ? "" : `${Number(v.toPrecision(1))}`)) }],
        series: [
          { label: "measurements", value: (/** @type {any} */ ...of) => `${pointed(of[0], of[1], of[2], of[3]) ?? "–"}` },
          ...names.map((name, i) => ({ label: named(name), stroke: colour(TONES[i % TONES.length]), dash: DASHES[Math.floor(i / TONES.length) % DASHES.length], width: 1.6, points: { show: latest.current.rows.length < 40, size: 5 }, value: (/** @type {any} */ ...of) => { const v = pointed(of[0], of[1], of[2], of[3]); return v === null ? "not determined" : `${Number(v.toPrecision(2))} ${unit}`; } })),
          { label: "tolerance", stroke: colour("ink"), dash: [8, 4], width: 1, points: { show: false }, show: latest.current.tolerance !== null },
        ],
      }, /** @type {any} */ (table()), parent);
      sizes?.disconnect();
      sizes = new ResizeObserver(() => plot.current?.setSize(size(parent)));
      sizes.observe(parent);
    };
    make();
    dark.addEventListener("change", make);
    return () => { gone = true; dark.removeEventListener("change", make); sizes?.disconnect(); plot.current?.destroy(); plot.current = null; };
  }, [names.join(), tolerance !== null, unit]);
  useEffect(() => { plot.current?.setData(table()); }, [rows, tolerance]);
  return html`<div class="course-plot" ref=${box} role="img" aria-label=${`Standard uncertainty of each offset after 1 to ${rows.at(-1)?.recorded ?? 0} measurements. The numbers are in the table.`}></div>`;
}
