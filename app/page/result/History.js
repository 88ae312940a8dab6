// The results of one arm over time: a table, each offset with its expanded uncertainty as a trend, and the pages of the
// drift.
import { html } from "htm/preact";
import { useSignal } from "@preact/signals";
import { pageOf } from "../core/api.js";
import { well } from "../core/jobs.js";
import { typedIn } from "../core/store.js";
import { calibrationOf, toJob } from "../core/route.js";
import { counted, estimateOf, expandedOf, expandedWord, marked, named, unitSign } from "../core/words.js";
import { Check, into, TextField } from "../parts/Controls.js";
import { Fields, useForms, wordsOf } from "../parts/Fields.js";
import { Form, Submit } from "../parts/Form.js";
import { useCommand } from "../parts/JobProgress.js";
import { history } from "./state.js";
import { Table } from "../parts/Table.js";
import { Plot } from "../parts/Plot.js";

/** @typedef {import("answers").BriefRun} BriefRun */
/** @typedef {import("answers").BriefResult} BriefResult */

const AT_ONCE = 80; // files of one command

const byDate = (/** @type {BriefRun} */ a, /** @type {BriefRun} */ b) =>
  (a.when ?? "").localeCompare(b.when ?? "") || a.file.localeCompare(b.file);

/** Numbers that the measurements support: none of a misfit. @param {BriefResult} result */
const offsets = (result) => (result.offsets ?? []).map((row) => {
  const name = named(row.name).split(" ")[0];
  if (row.status === "unvalidated") return `${name} unvalidated`;
  if (row.estimate === null || row.std === null) return `${name} not determined`;
  return `${name} ${estimateOf(row, 2)} ± ${expandedOf(row, 2)}${row.status === "weak" ? ` ${marked("weak")}` : ""}`;
}).join(", ");

/** @param {{serial: string | null, run: string | null}} props */
export function History({ serial, run }) {
  const known = history.value;
  if (known === null) return html`<p class="muted">…</p>`;
  const runs = known.runs.filter((one) => (serial ? one.serial === serial : one.file === run)).sort(byDate);
  const stated = new Set(runs.map((one) => one.robot)).size === 1 ? runs : [];
  /**
   * Of each offset that two results or more determine.
   * @type {Map<string, {when: string, file: string, unit: string, estimate: number, std: number}[]>}
   */
  const points = new Map();
  for (const one of serial ? stated : []) {
    for (const row of one.results[0]?.offsets ?? []) {
      if (row.estimate === null || row.std === null || !["identified", "weak"].includes(row.status)) continue;
      points.set(row.name, [...(points.get(row.name) ?? []),
        { when: one.when ?? "", file: one.file, unit: row.unit, estimate: row.estimate, std: row.std }]);
    }
  }
  return html`
    <p class="muted">
      ${serial ? `Serial number ${serial}: ${counted(runs.length, "run")} of this folder.`
        : "This run states no serial number: the results of an arm are gathered by it."}</p>
    <${Table} name="Runs of this arm" of="history" heads=${["run", "date", "verdict", `offsets, ± ${expandedWord(2)}`]}>
      <tbody>${runs.map((one) => {
        const result = one.results[0], error = one.error ?? result?.error;
        return html`
          <tr key=${one.file}>
            <th scope="row">
              <a
                href=${toJob(calibrationOf(one.file), "result", result && !result.error ? result.file : one.file)}>
                ${one.file}</a></th>
            <td>${one.when ?? ""}</td>
            <td class=${error ? "misfit" : result?.grade ?? "muted"}>${error ?? result?.words ?? "no report"}</td>
            <td>${result ? offsets(result) : ""}</td></tr>`;
      })}</tbody><//>
    <div class="trends">
      ${[...points].filter(([, own]) => own.length > 1)
        .map(([name, own]) => html`<${Trend} key=${name} name=${name} points=${own} />`)}</div>
    <${Drift} serial=${serial} />`;
}

/** @typedef {{when: string, file: string, unit: string, estimate: number, std: number}} Point */

const HEIGHT = 150;

/** @param {{name: string, points: Point[]}} props */
function Trend({ name, points }) {
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

const typed = typedIn({ "--as-of": new Intl.DateTimeFormat("sv").format(new Date()) });

/**
 * The newest result of each run is put into a history, whose pages say which changes are real and when the next
 * calibration is due.
 * @param {{serial: string | null}} props
 */
function Drift({ serial }) {
  const all = useSignal(!serial), db = useSignal("history.sqlite"), folder = useSignal(""), page = useSignal("");
  const [form] = useForms("history"), { busy, carryOut, progress } = useCommand();
  const stated = (history.value?.runs ?? []).filter((run) =>
    run.serial && run.when && run.results.some((one) => !one.error));
  const files = stated.map((run) => /** @type {BriefResult} */ (run.results.find((one) => !one.error)).file);
  const of = all.value ? null : serial, arms = new Set(stated.map((run) => run.serial));
  const proposed = of ? `history-${of.replace(/[^A-Za-z0-9_]+/g, "-").slice(0, 40)}` : "history";
  const make = async () => {
    page.value = "";
    for (let at = 0; at < files.length; at += AT_ONCE) {
      const part = files.slice(at, at + AT_ONCE);
      const add = ["history", "add", ...part, `--db=${db.value}`, "--replace"];
      if (!well(await carryOut(add, `${counted(part.length, "result")} into ${db.value}`))) return;
    }
    const to = (folder.value.trim() || proposed).replace(/\/+$/, "");
    const report = [...form.command, `--db=${db.value}`, ...wordsOf(form.fields, typed.value), `--out=${to}`,
      ...(of ? ["--", of] : [])];
    if (!well(await carryOut(report, of ? `The page of ${of}` : "The pages of all arms"))) return;
    page.value = `${to}/${of ? "arm" : "fleet"}.html`;
  };
  return html`
    <h3>Drift, and the next calibration</h3>
    <p class="muted">The newest result of each run is put into a history, a database in this folder. Its pages say which
      changes of the offsets are real, and when the next calibration is
      due. ${files.length
        ? `${counted(files.length, "result")} of ${counted(arms.size, "arm")}, with serial number and date.`
        : "No result here has a run that states a serial number and a date."}</p>
    ${form && html`<${Form} class="drift" onSubmit=${make}>
      ${serial && html`<${Check} on=${all.value} onTurn=${into(all)}>All arms<//>`}
      <${Fields} fields=${form.fields} values=${typed.value} onValue=${typed.set}>
        <${TextField} label="Database" value=${db.value} onValue=${into(db)} />
        <${TextField} label="Folder of the pages" value=${folder.value} placeholder=${proposed}
          onValue=${into(folder)} /><//>
      <p class="bar"><${Submit} main=${false} disabled=${!files.length || busy}>${form.label}<//></p>
      ${progress(page.value && html`
        <p><a class="button" href=${pageOf(page.value)} target="_blank" rel="noopener">Open the page</a></p>`)}
    <//>`}`;
}
