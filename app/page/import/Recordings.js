// The files of an import: dropped, chosen, or of the folder; what each is, and where they are put.
import { html } from "htm/preact";
import { useSignal } from "@preact/signals";
import { bytes } from "../core/words.js";
import { calibrationOf, toJob } from "../core/route.js";
import { files, home, attempt } from "../core/store.js";
import { Choice, filesOf, into as setting, TextField } from "../parts/Controls.js";
import { choose, into, leaveOut, name, nameWrong, proposed, rows, send, take, useExisting } from "./sources.js";

/** @typedef {import("./sources.js").Row} Row */

const NEVER = /\.(html|pdf|svg|png|jpe?g|nc|db|sqlite3?|zip)$/i; // what no import reads
const OURS = ["run", "plan", "result", "robot", "header", "cell", "sensors", "obstacles"];

/**
 * Where the name of a file is taken: another name, or the file that is there.
 * @param {{row: Row, taken: {content: Blob, name: string}}} props
 */
function Another({ row, taken }) {
  const as = useSignal(taken.name), there = files.value.some((file) => file.path === row.path);
  return html`
    <div class="actions">
      <p class="muted">
        ${there ? "The folder has a file of this name, and nothing is replaced." : "The file was not written."}</p>
      <${TextField} label="Name in the folder" value=${as.value} onValue=${setting(as)} />
      <button type="button" onClick=${() => send(row, taken.content, as.value.trim())}>Send under this name</button>
      ${there && html`<button type="button" onClick=${() => useExisting(row)}>Use the file of the folder</button>`}
    </div>`;
}

/** @param {{row: Row}} props */
function About({ row }) {
  if (row.busy) return html`<small>being read…</small>`;
  if (row.found === null) return null;
  const folder = calibrationOf(row.path);
  const to = row.found.kind === "run" ? toJob(folder, "result", row.path)
    : row.found.kind === "plan" ? toJob(folder, "plan", row.path) : "";
  return html`
    <small>
      ${row.found.count}; ${bytes(row.found.bytes)}${to ? html` <a href=${to}>Open it</a>`
        : row.found.form === "ours" ? ": nothing to import" : ""}</small>`;
}

export function Recordings() {
  const over = useSignal(false);
  const hover = (/** @type {boolean} */ on) =>
    (/** @type {Event} */ event) => { event.preventDefault(); over.value = on; };
  // Beside a page lies what belongs to it: tables and JSON of a report, a study, a comparison.
  const made = new Set(files.value.filter((file) => file.path.endsWith(".html")).map((file) => calibrationOf(file.path))
    .filter((folder) => folder !== "."));
  const others = files.value.filter((file) =>
    !OURS.includes(file.kind) && !NEVER.test(file.path) && !made.has(calibrationOf(file.path)))
    .map((file) => /** @type {[string, string]} */ ([file.path, file.path]));
  const known = (home.value?.calibrations ?? []).map((one) =>
    /** @type {[string, string]} */ ([one.name, one.name === "." ? "this folder" : one.name]));
  if (into.value && !known.some(([one]) => one === into.value)) known.push([into.value, into.value]);
  return html`
    <section aria-labelledby="import-files">
      <h2 id="import-files">1. Recordings</h2>
      <div class=${`drop${over.value ? " over" : ""}`} onDragEnter=${hover(true)} onDragOver=${hover(true)}
        onDragLeave=${hover(false)}
        onDrop=${(/** @type {DragEvent} */ event) => {
          hover(false)(event);
          attempt(() => take([...event.dataTransfer?.files ?? []]));
        }}>
        <p>Drop files here: tables (CSV, Excel, logs), points of a tracker or CMM, ROS bags, programs and points of a
          controller.</p>
        <div class="fields">
          <label><span class="label">Choose files</span>
            <input type="file" multiple onChange=${filesOf((given) => attempt(() => take(given)))} /></label>
          <${Choice} label="Or a file of the folder" value="" groups=${[["files of this folder", others]]}
            none="choose a file" onValue=${(/** @type {string} */ path) => path && attempt(() => choose(path))} />
          <${Choice} label="Calibration" value=${into.value} groups=${[["calibrations of the folder", known]]}
            none="a new one" onValue=${setting(into)} />
          ${!into.value && html`
            <${TextField} label="Its name" value=${name.value} placeholder=${proposed.value} error=${nameWrong.value}
              onValue=${(/** @type {string} */ value) => { nameWrong.value = ""; name.value = value; }} />`}
        </div>
      </div>
      <ul class="recordings" aria-label="Recordings">
        ${rows.value.map((row) => html`
          <li key=${row.path} data-file=${row.path} aria-busy=${row.busy}>
            <p><span class="name">${row.path}</span> <${About} row=${{ ...row }} /></p>
            <button type="button" aria-label=${`Leave out ${row.path}`}
              onClick=${() => leaveOut(row)}>Leave out</button>
            ${row.fault && html`<p class="error" role="alert">${row.fault}</p>`}
            ${row.taken && html`<${Another} row=${row} taken=${row.taken} />`}
          </li>`)}
      </ul>
    </section>`;
}
