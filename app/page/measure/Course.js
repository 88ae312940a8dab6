// u of each offset by measurement, on one logarithmic axis, with its tolerance as a line. What is not determined has no
// point.
import { html } from "htm/preact";
import { named, spread, unitSign, withUnit } from "../core/words.js";
import { Plot, power } from "../parts/Plot.js";

/** @typedef {import("./events.js").CoursePoint} CoursePoint */

const TONES = ["identified", "weak", "unidentifiable", "misfit", "held", "muted", "ink"];
const LEGEND_PX = 66; // three lines of it: the values where the cursor is, else the newest
const DASHES = [[], [6, 3], [2, 3]]; // the same colours again, for more joints than colours

/**
 * The lines of the tolerances: one where all are the same.
 * @param {string[]} names @param {Record<string, number>} tolerances @param {(name: string) => string} unit
 */
function linesOf(names, tolerances, unit) {
  /** @type {Map<string, {value: number, of: string[]}>} */
  const lines = new Map();
  for (const name of names.filter((one) => tolerances[one] !== undefined)) {
    const text = withUnit(`${Number(tolerances[name].toPrecision(6))}`, unit(name));
    lines.set(text, { value: tolerances[name], of: [...(lines.get(text)?.of ?? []), name] });
  }
  return [...lines].map(([text, { value, of }]) =>
    ({ value, text, label: `tolerance${lines.size > 1 ? ` of ${of.map(named).join(", ")}` : ""}` }));
}

/** @param {{rows: CoursePoint[], tolerances: Record<string, number>, units: Record<string, string>}} props */
export function Course({ rows, tolerances, units }) {
  const names = Object.keys(rows.at(-1)?.std ?? {});
  const unit = (/** @type {string} */ name) => units[name] ?? "deg", lines = linesOf(names, tolerances, unit);
  const signs = [...new Set(names.map((name) => unitSign(unit(name))))].join(" or ");
  /** @type {import("uplot").AlignedData} */
  const data = [rows.map((row) => row.recorded),
    ...names.map((name) => rows.map((row) => (row.std[name] ? row.std[name] : null))),
    ...lines.map(({ value }) => rows.map(() => value))];
  const shown = (/** @type {string} */ name, /** @type {number | null} */ std) =>
    (std === null ? "not determined" : spread(std, unit(name)));
  /** The value where the cursor is, else the newest. @param {string} name @returns {import("uplot").Series.Value} */
  const newest = (name) => (plotted, v, of, at) => shown(name, (at === null ? plotted.data[of].at(-1) : v) ?? null);
  /** @type {Parameters<typeof Plot>[0]["options"]} */
  const options = (tone, axis) => ({
    cursor: { y: false }, legend: { live: true },
    scales: { x: { time: false }, y: { distr: 3 } },
    axes: [{ ...axis, label: "measurements", labelSize: 18, size: 26, incrs: [1, 2, 5, 10, 20, 50, 100] },
      { ...axis, label: `u, ${signs}`, labelSize: 18, size: 52,
        values: (_, ticks) => ticks.map(power) }],
    series: [
      { label: "measurements", value: (plotted, v) => v ?? plotted.data[0].at(-1) },
      ...names.map((name, i) =>
        ({ label: named(name), stroke: tone(TONES[i % TONES.length]),
          dash: DASHES[Math.floor(i / TONES.length) % DASHES.length], width: 1.6,
          points: { show: rows.length < 40, size: 5 }, value: newest(name) })),
      ...lines.map(({ label, text }) =>
        ({ label, stroke: tone("ink"), dash: [8, 4], width: 1, points: { show: false }, value: () => text })),
    ],
  });
  const says = `Standard uncertainty of each offset after 1 to ${rows.at(-1)?.recorded ?? 0} measurements. `
    + "The numbers are in the table.";
  return html`
    <figure class="course"><figcaption>Standard uncertainty u by measurement; dashed: tolerance</figcaption>
      ${names.length > 0 && html`<${Plot} class="course-plot" data=${data} options=${options} says=${says}
        shape=${JSON.stringify([names, names.map(unit), lines.map(({ label, text }) => label + text)])}
        tall=${(/** @type {HTMLElement} */ room) => Math.max(room.clientHeight - LEGEND_PX, 90)} />`}</figure>`;
}
