// All calibrations of the folder: searched and sorted, and how to begin one.
import { html } from "htm/preact";
import { computed, signal, useSignal } from "@preact/signals";
import { post } from "../core/api.js";
import { lostDrafts } from "../core/editing.js";
import { well } from "../core/jobs.js";
import { goOn, route, toImport, toJob } from "../core/route.js";
import { attempt, home } from "../core/store.js";
import { counted } from "../core/words.js";
import { Choice, heard, into } from "../parts/Controls.js";
import { useCommand } from "../parts/JobProgress.js";
import { Drafts } from "./Drafts.js";

/** @typedef {import("../core/store.js").Calibration} Calibration */

const SEARCHED = "zerobeam:search";

/** What was searched for; a frame of another site, as a notebook has it, keeps nothing. */
function searched() {
  try { return sessionStorage.getItem(SEARCHED) ?? ""; } catch { return ""; }
}
function keepSearch() {
  try { sessionStorage.setItem(SEARCHED, search.value); } catch { /* as above */ }
}

const MOST = 100; // rows at first
const search = signal(searched());
const order = signal("newest");
/** @type {Record<string, (a: Calibration, b: Calibration) => number>} */
const ORDERS = {
  newest: (a, b) => b.modified.localeCompare(a.modified),
  name: (a, b) => a.name.localeCompare(b.name, undefined, { numeric: true }),
  robot: (a, b) => (a.model ?? a.robot ?? "").localeCompare(b.model ?? b.robot ?? "") || ORDERS.name(a, b),
  "next due": (a, b) => (a.due?.date ?? "9").localeCompare(b.due?.date ?? "9") || ORDERS.newest(a, b),
};
const RESULTS = ["pass", "weak", "degenerate", "misfit", "held"];

const shown = computed(() => {
  const words = search.value.toLowerCase().split(/\s+/).filter(Boolean);
  const text = (/** @type {Calibration} */ one) =>
    [one.name, one.robot, one.model, one.maker, one.serial, one.instrument, one.state.text, one.due?.text,
      ...one.files.run].join(" ")
      .toLowerCase();
  return (home.value?.calibrations ?? []).filter((one) => words.every((word) => text(one).includes(word)))
    .sort(ORDERS[order.value]);
});

/** Where a calibration goes on. @param {Calibration} one */
const next = (one) =>
  toJob(one.name,
    RESULTS.includes(one.state.kind) ? "result"
      : one.state.kind === "measuring" || one.state.kind === "measured" ? "measure" : "plan",
    one.state.file ?? "");

export function Home() {
  const all = useSignal(false);
  const rows = shown.value, total = home.value?.calibrations.length ?? 0;
  const { busy, carryOut, progress } = useCommand();
  const rehearse = () => attempt(async () => {
    const from = route.value;
    const example = await post("/api/example", {});
    if (well(await carryOut(example.command, "Rehearsal of the example"))) goOn(from, toJob(example.name, "measure"));
  });
  return html`
    <section class="begin" aria-label="Begin">
      <a class="card" href="#/new"><b>New calibration</b>
        <span>Arm, instrument, where the target is: a checked plan in one step.</span></a>
      <a class="card" href=${toImport()}><b>Import a recording</b>
        <span>Joint values of a controller, a table or a tracker’s points: a run, and its result.</span></a>
      <button type="button" class="card" onClick=${rehearse}
        disabled=${busy}><b>Rehearse the example</b>
        <span>A plan, a simulated robot and its measurements, without any file of yours.</span></button>
    </section>
    ${progress()}
    ${home.value !== null && html`<${Drafts} drafts=${lostDrafts()} />`}
    ${total === 0 ? html`<p class="muted">The folder holds no calibration yet.</p>` : html`
      <div class="bar" role="search">
        <label class="grow"><span class="label">Search</span>
          <input type="search" value=${search.value} placeholder="name, arm, serial number, verdict"
            onInput=${heard((text) => { search.value = text; keepSearch(); })} /></label>
        <${Choice} label="Sorted by" value=${order.value} items=${Object.keys(ORDERS)} onValue=${into(order)} />
      </div>
      <p class="muted" role="status">
        ${rows.length === total ? counted(total, "calibration")
          : `${rows.length} of ${counted(total, "calibration")}`}${home.value?.left_out
          ? `; ${home.value.left_out} files of the folder are not listed` : ""}</p>
      <ul class="calibrations">
        ${rows.slice(0, all.value ? rows.length : MOST).map((one) => html`
          <li key=${one.name}><a href=${next(one)}>
            <span class="name"><b>${one.name === "." ? "This folder" : one.name}</b>
              <small>
                ${[one.model ?? one.robot, one.serial && !one.serial.startsWith("none") && `No. ${one.serial}`,
                  one.instrument].filter(Boolean)
                  .join(" · ")}</small></span>
            <span class=${`state ${one.state.kind}`}><span>${one.state.text}</span>
              ${one.simulated && !RESULTS.includes(one.state.kind)
                && html`<small class="simulated">SIMULATED</small>`}</span>
            <span class=${`due${one.due?.overdue ? " overdue" : ""}`}>${one.due?.text ?? ""}</span>
            <time datetime=${one.modified}>${one.modified.slice(0, 16).replace("T", " ")}</time>
          </a></li>`)}
      </ul>
      ${rows.length > MOST && !all.value && html`
        <button type="button" onClick=${() => { all.value = true; }}>Show all ${rows.length}</button>`}`}`;
}
