// u of each offset by measurement, on one logarithmic axis, with its tolerance as a line. What is not determined has no point.
import { html } from "htm/preact";
import { useEffect, useRef } from "preact/hooks";
import { named, spread, withUnit } from "../core/words.js";

/** @typedef {import("./events.js").CoursePoint} CoursePoint */

const TONES = ["identified", "weak", "unidentifiable", "misfit", "held", "muted", "ink"];
const LEGEND_PX = 66; // three lines of it: the values where the cursor is, else the newest
const DASHES = [[], [6, 3], [2, 3]]; // the same colours again, for more joints than colours

/** The lines of the tolerances: one where all are the same. @param {string[]} names @param {Record<string, number>} tolerances @param {(name: string) => string} unit */
function linesOf(names, tolerances, unit) {
  /** @type {Map<string, {value: number, of: string[]}>} */
  const lines = new Map();
  for (const name of names.filter((one) => tolerances[one] !== undefined)) {
    const text = withUnit(`${Number(tolerances[name].toPrecision(6))}`, unit(name));
    lines.set(text, { value: tolerances[name], of: [...(lines.get(text)?.of ?? []), name] });
  }
  return [...lines].map(([text, { value, of }]) => ({ value, text, label: `tolerance${lines.size > 1 ? ` of ${of.map(named).join(", ")}` : ""}` }));
}

/** @param {{rows: CoursePoint[], tolerances: Record<string, number>, units: Record<string, string>}} props */
export function Course({ rows, tolerances, units }) {
  const box = useRef(/** @type {HTMLDivElement | null} */ (null)), names = Object.keys(rows.at(-1)?.std ?? {});
  const unit = (/** @type {string} */ name) => units[name] ?? "deg", lines = linesOf(names, tolerances, unit);
  const plot = useRef(/** @type {any} */ (null)), latest = useRef({ rows, lines });
  latest.current = { rows, lines };
  const table = () => {
    const now = latest.current;
    return [now.rows.map((row) => row.recorded), ...names.map((name) => now.rows.map((row) => (row.std[name] ? row.std[name] : null))), ...now.lines.map(({ value }) => now.rows.map(() => value))];
  };
  const shown = (/** @type {string} */ name, /** @type {number | null} */ std) => (std === null ? "not determined" : spread(std, unit(name)));
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
        width: Math.max(parent.clientWidth, 120), height: Math.max(parent.clientHeight - LEGEND_PX, 90), cursor: { y: false }, legend: { live: true },
        scales: { x: { time: false }, y: { distr: 3 } },
        axes: [{ ...axis, label: "", size: 30, incrs: [1, 2, 5, 10, 20, 50, 100] }, { ...axis, size: 64, values: (/** @type {any} */ _, /** @type {number[]} */ ticks) => ticks.map((v) => (v === null || !/^1/.test(v.toExponential()) ? "" : `${Number(v.toPrecision(1))}`)) }],
        series: [
          { label: "measurements", value: (/** @type {any} */ plotted, /** @type {number | null} */ v) => v ?? plotted.data[0].at(-1) },
          ...names.map((name, i) => ({ label: named(name), stroke: colour(TONES[i % TONES.length]), dash: DASHES[Math.floor(i / TONES.length) % DASHES.length], width: 1.6, points: { show: latest.current.rows.length < 40, size: 5 }, value: (/** @type {any} */ plotted, /** @type {number | null} */ v, /** @type {number} */ of, /** @type {number | null} */ at) => shown(name, at === null ? plotted.data[of].at(-1) : v) })),
          ...latest.current.lines.map(({ label, text }) => ({ label, stroke: colour("ink"), dash: [8, 4], width: 1, points: { show: false }, value: () => text })),
        ],
      }, /** @type {any} */ (table()), parent);
      sizes?.disconnect();
      sizes = new ResizeObserver(() => plot.current?.setSize({ width: Math.max(parent.clientWidth, 120), height: Math.max(parent.clientHeight - LEGEND_PX, 90) }));
      sizes.observe(parent);
    };
    make();
    dark.addEventListener("change", make);
    return () => { gone = true; dark.removeEventListener("change", make); sizes?.disconnect(); plot.current?.destroy(); plot.current = null; };
  }, [names.join(), lines.map(({ label, text }) => label + text).join(), names.map(unit).join()]);
  useEffect(() => { plot.current?.setData(table()); }, [rows, lines.map(({ value }) => value).join()]);
  return html`<div class="course-plot" ref=${box} role="img" aria-label=${`Standard uncertainty of each offset after 1 to ${rows.at(-1)?.recorded ?? 0} measurements. The numbers are in the table.`}></div>`;
}
