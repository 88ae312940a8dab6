// The step Measure: a plan carried out by a simulation, by hand or by a robot, and what is seen of it.
import { html } from "htm/preact";
import { useEffect, useRef } from "preact/hooks";
import { useSignal } from "@preact/signals";
import { getFile } from "../core/api.js";
import { over } from "../core/jobs.js";
import { calibrationOf, go, route, toJob } from "../core/route.js";
import { addressed, attempt, calibration, failed, versionOf } from "../core/store.js";
import { expandedWord, named, spread, withUnit } from "../core/words.js";
import { Fold } from "../parts/Fold.js";
import { useSince } from "../parts/JobProgress.js";
import { into } from "../parts/Controls.js";
import { Message } from "../parts/Message.js";
import { Workspace } from "../parts/Workspace.js";
import { Scene } from "../scene/Scene.js";
import { Course } from "./Course.js";
import { Hand } from "./Hand.js";
import { CameraPicture, Face, Residuals, Trace } from "./Pictures.js";
import { offered, picture, planned, preparePlan, units } from "./picture.js";
import { answer, command, earlier, fetchEarlier, followedFile, here, listUnfinished, missing, now, progress, remarks,
  run, settled, state, underWay } from "./running.js";
import { Start } from "./Start.js";
import { Unfinished } from "./Unfinished.js";

/** @param {{text: string}} props */
function Confirm({ text }) {
  const no = useRef(/** @type {HTMLButtonElement | null} */ (null));
  useEffect(() => no.current?.focus(), []); // not what moves: who presses Enter by habit moves nothing
  return html`
    <div class="confirm" role="alertdialog" aria-labelledby="confirm-title" aria-describedby="confirm-text">
      <h2 id="confirm-title">The robot is about to move</h2>
      <p id="confirm-text">${text}</p>
      <p>Stop, or Escape, ends the run and stops the motion. It is no emergency stop.</p>
      <p class="bar">
        <button type="button" class="main" onClick=${() => attempt(() => answer("yes"))}>Move the robot</button>
        <button type="button" ref=${no} onClick=${() => attempt(() => answer("no"))}>Do not move</button></p>
    </div>`;
}

/** Where the run is, or what came of it: the server's message once there is one. */
function Now() {
  const at = state.value, seen = run.value, since = useSince(at);
  if (!at) return null;
  const words = now(at, seen, settled.value), notes = remarks(at, seen);
  const rest = html`
    <progress max="1" value=${at.share} aria-label="Measurements done"></progress>
    <p class="muted time">${progress(at, seen, since)}</p>
    <ul class="notes">${notes.map((note) => html`<li>${named(note)}</li>`)}</ul>`;
  if (seen.end) {
    return html`
      <${Message} verdict=${seen.end.verdict} message=${seen.end.message} action=${seen.end.action ?? null}
        simulated=${seen.rig === "simulated"}>
        <p class="now">
          ${words} <a class="button"
            href=${toJob(route.value.name, "result", followedFile.value)}>Open the result</a></p>
        ${notes.length > 0 && html`<ul class="notes">${notes.map((note) => html`<li>${named(note)}</li>`)}</ul>`}<//>`;
  }
  return html`
    <section class="verdict held run-now" aria-label="The run">
      <p class="now" role="status">
        ${words}${seen.rig === "simulated" && html` <strong class="simulated">SIMULATED</strong>`}</p>
      ${rest}</section>`;
}

/** A run file that is on the disk: what it holds. @param {{found: import("answers").RunSoFar | null}} props */
function Record({ found }) {
  if (!found) return null;
  const count = found.recorded.length, of = found.postures ? ` of ${found.postures}` : "";
  const said = `${count}${of} ${count === 1 ? "measurement is" : "measurements are"} kept in ${found.file}.`;
  return html`
    <section class="verdict held run-now" aria-label="The run">
      <p class="now">
        ${said}${found.origin === "simulated" && html` <strong class="simulated">SIMULATED</strong>`}
        ${" "}<a class="button" href=${toJob(route.value.name, "result", found.file)}>Open the result</a></p>
    ${found.headline && html`<p>${named(found.headline)}</p>`}
    <ul class="notes">${found.notes.map((note) => html`<li>${named(note)}</li>`)}</ul></section>`;
}

/**
 * `consistent`: nothing contradicts the model; else no tolerance is reached, however small u is.
 * @param {{point: import("./events.js").CoursePoint | null, tolerances: Record<string, number>,
 *   consistent: boolean}} props
 */
function Known({ point, tolerances, consistent }) {
  if (!point) return html`<p class="muted">No measurement yet.</p>`;
  /** @param {number | null} std @param {number | undefined} tolerance @param {string} unit */
  const against = (std, tolerance, unit) => {
    if (std === null || tolerance === undefined) return "";
    if (!consistent) return "not claimed";
    return std <= tolerance ? "reached" : `above ${withUnit(`${Number(tolerance.toPrecision(6))}`, unit)}`;
  };
  const row = (/** @type {string} */ name, /** @type {number | null} */ std) => {
    const unit = units.value[name] ?? "deg", expanded = point.expanded[name];
    return html`<tr key=${name} data-of=${name}><th scope="row">${named(name)}</th>
      <td class="right u">${std === null ? "not determined yet" : spread(std, unit)}</td>
      <td class="right">${expanded === null ? "" : spread(expanded, unit)}</td>
      <td>${against(std, tolerances[name], unit)}</td></tr>`;
  };
  const factors = Object.entries(point.std).flatMap(([name, std]) => (std ? (point.expanded[name] ?? 0) / std : []));
  const expanded = factors.length ? expandedWord(Math.max(...factors)) : "U";
  return html`
    <table class="known">
      <thead>
        <tr><th scope="col">offset</th><th scope="col" class="right">u</th>
          <th scope="col" class="right">${expanded}</th><th scope="col">tolerance of u</th></tr></thead>
      <tbody>${Object.entries(point.std).map(([name, std]) => row(name, std))}</tbody></table>`;
}

/** The course of u, the residuals, and what has happened, the newest first.
 * @param {{rows: import("./events.js").CoursePoint[], tolerances: Record<string, number>,
 *   residuals: Record<string, number>, suspect: number | null, lines: import("./events.js").Line[]}} props */
function Drawer({ rows, tolerances, residuals, suspect, lines }) {
  return html`
    <div class="run-drawer">
      ${rows.length > 0 ? html`<${Course} rows=${rows} tolerances=${tolerances} units=${units.value} />`
        : html`<p class="muted centred">u of each offset will be drawn here from the first measurement on.</p>`}
      <figure class="residuals"><figcaption>Normalised residual by measurement</figcaption>
        <${Residuals} residuals=${residuals} suspect=${suspect} /></figure>
      <ol class="run-lines" tabindex="0"
        aria-label="Measurements so far, the newest first">
        ${[...lines].reverse()
          .map((line, i) => html`
            <li key=${lines.length - i} class=${line.bad ? "bad" : ""}><b>${line.shot}</b> ${line.text}</li>`)}</ol>
    </div>`;
}

/** Follows the address: a run file to look at (where it is not the one that is followed), or a plan to carry out. */
function useAddress() {
  const record = useSignal(/** @type {import("answers").RunSoFar | null} */ (null));
  const { name } = route.value, file = addressed.value, plans = calibration.value?.files.plan ?? [];
  const plan = useSignal(/\.ya?ml$/.test(file) ? file : "");
  const isRun = /\.jsonl?$/.test(file);
  useEffect(() => {
    record.value = null;
    if (/\.ya?ml$/.test(file)) plan.value = file;
    if (!file && here.value && underWay.value) go(toJob(name, "measure", followedFile.value), { replace: true });
    if (!isRun || file === followedFile.value) return;
    attempt(async () => {
      const found = await getFile("run", file);
      if (addressed.value !== file || followedFile.value === file) return;
      record.value = found;
      if (found.plan) plan.value = found.plan;
    });
  }, [name, file, followedFile.value]);
  return { stated: plan.value || plans[0] || "", record: record.value };
}

export function Measure() {
  const { stated, record } = useAddress(), { name } = route.value, file = addressed.value;
  const at = state.value, seen = run.value;
  const following = at !== null && here.value && (underWay.value || !file || file === followedFile.value);
  const picked = useSignal(""), looked = useSignal(0);
  const plan = following && command.value.length ? /** @type {string} */ (command.value.at(-1))
    : picked.value || stated;
  const version = versionOf(plan);
  useEffect(() => { preparePlan(plan, version).catch(failed); }, [plan, version]);
  useEffect(() => { attempt(listUnfinished); }, []);
  const resumed = following && seen.recorded.length > 0 && !seen.course.length && !over(at);
  useEffect(() => { if (resumed) fetchEarlier(); }, [resumed]);

  const confirming = following && seen.confirm !== null && at.asks === "confirm";
  const byHand = following && seen.asked !== null && at.asks === "lines" && at.state === "running" && !seen.end;
  const rows = following
    ? [...earlier.value.filter((row) => !seen.course.length || row.recorded < seen.course[0].recorded), ...seen.course]
    : record?.course ?? [];
  const kept = following ? seen : record, enough = following ? seen.tolerance : null, point = rows.at(-1) ?? null;
  const offsets = point ? Object.keys(point.std) : [];
  // An adaptive run ends at a u of its own, whatever counts as identified.
  const tolerances = enough === null ? (following ? seen.tolerances : kept?.tolerance) ?? {}
    : Object.fromEntries(offsets.map((offset) => [offset, enough]));
  const shown = picture.value;
  const scene = shown && planned.value?.of === plan
    ? html`<${Scene} scene=${shown.scene} chosen=${following && shown.chosen !== null ? shown.chosen : looked.value}
      onChoose=${following && shown.chosen !== null ? undefined : into(looked)}
        caption=${following && shown.chosen !== null
          ? `The arm as it was sent${seen.arm?.lit ? ", with the beam as it is believed to be" : ""}.`
          : "The plan’s postures, as the servo will leave them."} />`
    : plan ? html`<p class="muted centred">…</p>`
    : html`
      <p class="muted centred nothing">
        ${record ? "The plan of this run is not here: its postures are not drawn."
          : "No plan to carry out yet."}</p>`;
  const inspector = html`
    ${missing.value && html`<p class="error" role="alert">${missing.value}</p>`}
    ${underWay.value && !following && html`
      <p class="elsewhere">
        ${followedFile.value
          ? html`
            A run of another calibration is under way: <a
              href=${toJob(calibrationOf(followedFile.value), "measure", followedFile.value)}>
              ${followedFile.value}</a>.`
          : "A run is under way."} Another
        one can begin once it has ended.</p>`}
    ${confirming && html`<${Confirm} text=${seen.confirm} />`}
    ${byHand && html`
      <${Hand} asked=${seen.asked} reading=${seen.reading} doubt=${seen.doubt}
        suspect=${seen.suspect} live=${seen.rig === "live"} />`}
    ${!underWay.value && html`
      <${Unfinished} /><h2>${following ? "Another run" : "Carry the plan out"}</h2>
      <${Start} plan=${plan} rigs=${offered.value?.of === plan ? offered.value.rigs : null}
        onPlan=${(/** @type {string} */ value) => {
          picked.value = value;
          if (file) go(toJob(name, "measure", value), { replace: true });
        }} />`}
    ${following && seen.rig !== "manual" && seen.rig !== "live" && (underWay.value || seen.trace.length > 0) && html`
      <div class="watch">
      <figure><figcaption>Spot from the centre</figcaption><${Trace} trace=${seen.trace} /></figure>
      <figure><figcaption>Spot on the PSD</figcaption>
        <${Face} trace=${seen.trace} kept=${seen.kept} size=${seen.size} /></figure>
      ${seen.camera && html`
        <figure class="camera"><figcaption>Camera</figcaption><${CameraPicture} seen=${seen.camera} /></figure>`}
    </div>`}
    ${(following || rows.length > 0) && html`
      <h2>Standard uncertainty of each offset</h2>
      <${Known} point=${point} tolerances=${tolerances} consistent=${kept?.consistent ?? true} />`}
    ${following && html`
      <${Fold} title="Log"><pre class="log" tabindex="0" aria-label="Log">${at.log.join("\n")}</pre><//>`}`;
  return html`
    <${Workspace} name="The run" message=${following ? html`<${Now} />` : html`<${Record} found=${record} />`}
      scene=${scene}
      inspector=${html`<div class=${byHand ? "by-hand" : ""}>${inspector}</div>`}
      drawer=${following || rows.length
        ? html`
          <${Drawer} rows=${rows} tolerances=${tolerances} residuals=${kept?.residuals ?? {}}
            suspect=${following ? seen.suspect?.shot ?? null : null} lines=${following ? seen.lines : []} />`
        : null} />`;
}
