// Taught programs: zeros were entered at the controller, and positions are rewritten to keep their places.
import { html } from "htm/preact";
import { signal, useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { get, upload } from "../core/api.js";
import { route } from "../core/route.js";
import { attempt, files, freeName, inside, ofCalibration, refresh } from "../core/store.js";
import { sentence } from "../core/words.js";
import { zip } from "../core/zip.js";
import { Choice } from "../parts/Choice.js";
import { Form } from "../parts/Form.js";
import { Fold } from "../parts/Fold.js";
import { filesOf, into } from "../parts/heard.js";
import { Joint3 } from "../parts/Joint3.js";
import { TextField } from "../parts/TextField.js";
import { useWritten, Written } from "../parts/Written.js";

/** Endings of the languages whose positions are read. */
const endings = signal(/** @type {string[]} */ ([]));
/** What is typed for options that may be stated several times, one a line. */
const options = ofCalibration({ tool: "", frame: "", base: "", near: "", accept: "", j3: "" });

/** @typedef {{file: string, line: number, sentence: string, accepted?: boolean}} Line */
/**
 * What a conversion says where nothing is written.
 * @param {{answer: {refused: Line[], listed: Line[], to_state: string[]}}} props
 */
function Open({ answer }) {
  const open = answer.listed.filter((line) => !line.accepted);
  const rows = (/** @type {Line[]} */ lines) => html`
    <ul class="lines">
      ${lines.map((line) => html`<li>${`${line.file}:${line.line}: ${sentence(line.sentence)}`}</li>`)}</ul>`;
  return html`
    ${answer.refused.length > 0 && html`<p>Refused, so nothing is written:</p>${rows(answer.refused)}`}
    ${answer.to_state.length > 0 && html`
      <p>To be stated:</p><ul class="lines">${answer.to_state.map((option) => html`<li>${option}</li>`)}</ul>`}
    ${open.length > 0 && html`<p>Look at these lines, which stay as they are, and accept them:</p>${rows(open)}`}`;
}

/** @param {{run: string}} props */
export function MyPrograms({ run }) {
  const program = useSignal(""), out = useSignal("");
  const { made, onSubmit } = useWritten();
  useEffect(() => {
    attempt(async () => {
      if (!endings.value.length) {
        endings.value = (await get("/api/languages")).flatMap((/** @type {{endings: string[]}} */ language) =>
          language.endings);
      }
    });
  },
    []);
  const proposed = program.value && freeName(program.value.replace(/\.\w+$/, "-converted"));
  const send = (/** @type {File[]} */ sent) => attempt(async () => {
    const folder = sent.some((file) => file.webkitRelativePath);
    const read = sent.filter((file) =>
      [...endings.value, ".zip"].some((ending) => file.name.toLowerCase().endsWith(ending)));
    if (!read.length) return;
    /** @type {{name: string, content: Blob}} */
    let one = { name: read[0].name, content: read[0] };
    if (folder || read.length > 1) {
      const name = (/** @type {File} */ file) => file.webkitRelativePath.split("/").slice(1).join("/") || file.name;
      const all = await Promise.all(read.map(async (file) =>
        ({ name: name(file), content: new Uint8Array(await file.arrayBuffer()) })));
      one = { name: `${folder ? read[0].webkitRelativePath.split("/")[0] : "programs"}.zip`, content: zip(all) };
    }
    program.value = (await upload(freeName(`${inside(route.value.name)}${one.name}`), one.content)).file;
    made.value = null;
    await refresh();
  });
  const ask = () => {
    const to = out.value.trim() || proposed;
    const words = Object.entries(options.value)
      .flatMap(([name, text]) =>
        text.split("\n").map((one) => one.trim()).filter(Boolean).map((one) => `--${name}=${one}`));
    return { words: ["positions", "keep", `--out=${to}`, `--run=${run}`, ...words, program.value],
      files: [`${to}/positions.html`, `${to}/audit.json`] };
  };
  /** @param {keyof typeof options.value} name @param {string} label @param {string} example */
  const text = (name, label, example) => html`
    <${TextField} label=${label} value=${options.value[name]} placeholder=${example} onValue=${options.at(name)} />`;
  const answer = made.value?.job.state.value.answer;
  const converted = (answer?.files ?? []).map((/** @type {{file: string}} */ one) =>
    `${made.value?.files[1].replace(/audit\.json$/, one.file)}`);
  return html`
    <${Form} class="program" onSubmit=${onSubmit(ask)}>
      <p class="muted">The values above were entered at the controller: taught positions then bring the arm to other
        places. Here they are rewritten to keep their places. Statements and every other byte stay; what cannot be
        converted is refused, by line.</p>
      <p class="muted">Convert all programs of the arm, or they will disagree: send the folder of a backup, all files at
        once, or a zip.</p>
      <${Choice} label="Program of the folder" value=${program.value} none="choose a program"
        items=${files.value.filter((one) =>
          [...endings.value, ".zip"].some((ending) => one.path.toLowerCase().endsWith(ending)))
          .map((one) => [one.path, one.path])}
        onValue=${(/** @type {string} */ value) => { program.value = value; made.value = null; }} />
      <label><span class="label">or send files (${[...new Set(endings.value)].join(", ")}; of KRL .src, .dat and
        $config.dat, of FANUC SYSFRAME.VA too) or a zip</span>
        <input type="file" multiple accept=${[...endings.value, ".zip"].join(",")} onChange=${filesOf(send)} /></label>
      <label><span class="label">or send a folder</span>
        <input type="file" webkitdirectory onChange=${filesOf(send)} /></label>
      ${text("accept", "Lines that you have looked at, FILE:LINE", "JOB.LS:12")}
      <${Fold} title="What the program leaves open" kept><div class="fields">
        ${text("tool", "Tool, [NAME=]pose", "0,0,100,0,0,0")}${text("frame", "Frame, [NAME=]pose",
          "500,0,0,0,0,0")}${text("base", "Base of the arm in the world", "0,0,300,0,0,0")}
        ${text("near", "Joints near poses without a configuration", "0,-30,30,0,60,0")}
        <${Joint3} value=${options.value.j3} onValue=${options.at("j3")} />
      </div><//>
      <${TextField} label="New folder" value=${out.value} placeholder=${proposed} onValue=${into(out)} />
      ${answer?.converted === false && html`<${Open} answer=${answer} />`}
      <${Written} made=${made} button="Convert the positions" title="Converted positions" disabled=${!program.value}
        more=${converted} after="Load the files, and approach the position that the table names slowly first." />
    <//>`;
}
