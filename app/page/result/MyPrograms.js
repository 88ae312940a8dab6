// Taught programs: zeros were entered at the controller, and positions are rewritten to keep their places.
import { html } from "htm/preact";
import { useSignal } from "@preact/signals";
import { upload } from "../core/api.js";
import { route } from "../core/route.js";
import { attempt, files, freeName, inside, refresh, typedIn } from "../core/store.js";
import { sentence } from "../core/words.js";
import { Choice, filesOf, into, TextField } from "../parts/Controls.js";
import { Fields, useForms, wordsOf } from "../parts/Fields.js";
import { Form } from "../parts/Form.js";
import { useWritten, Written } from "../parts/Written.js";

const typed = typedIn();

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
  const program = useSignal(""), out = useSignal(""), [form] = useForms("positions"), { made, carryOut } = useWritten();
  if (!form) return html`<p class="muted">…</p>`;
  const endings = [...new Set(form.files)], read = [...endings, ".zip"];
  const isRead = (/** @type {string} */ name) => read.some((ending) => name.toLowerCase().endsWith(ending));
  const proposed = program.value && freeName(`${program.value.replace(/\.\w+$/, "")}-converted`);
  const choices = [...files.value.map((one) => one.path).filter(isRead), program.value];
  const send = (/** @type {File[]} */ sent) => attempt(async () => {
    const programs = sent.filter((file) => isRead(file.name)), [first] = programs;
    if (!first) return;
    const [folder] = first.webkitRelativePath.split("/"), several = folder !== "" || programs.length > 1;
    const to = freeName(inside(route.value.name) + (folder || (several ? "programs" : first.name)));
    for (const file of programs) {
      await upload(several ? `${to}/${file.webkitRelativePath.slice(folder.length + 1) || file.name}` : to, file);
    }
    program.value = to;
    made.value = null;
    await refresh();
  });
  const convert = async () => {
    const to = out.value.trim() || proposed;
    const words = wordsOf(form.fields, typed.value);
    await carryOut([...form.command, `--out=${to}`, `--run=${run}`, ...words, program.value],
      [`${to}/positions.html`, `${to}/audit.json`]);
  };
  const answer = made.value?.job.state.value.answer;
  const converted = (answer?.files ?? []).map((/** @type {{file: string}} */ one) =>
    `${made.value?.files[1].replace(/audit\.json$/, one.file)}`);
  return html`
    <${Form} class="program" onSubmit=${convert}>
      <p class="muted">The values above were entered at the controller: taught positions then bring the arm to other
        places. Here they are rewritten to keep their places. Statements and every other byte stay; what cannot be
        converted is refused, by line.</p>
      <p class="muted">Convert all programs of the arm, or they will disagree: send the folder of a backup, all files at
        once, or a zip.</p>
      <${Choice} label="Program of the folder" value=${program.value} none="choose a program"
        items=${[...new Set(choices)].filter(Boolean)}
        onValue=${(/** @type {string} */ value) => { program.value = value; made.value = null; }} />
      <label><span class="label">or send files (${endings.join(", ")}; of KRL .src, .dat and
        $config.dat, of FANUC SYSFRAME.VA too) or a zip</span>
        <input type="file" multiple accept=${read.join(",")} onChange=${filesOf(send)} /></label>
      <label><span class="label">or send a folder</span>
        <input type="file" webkitdirectory onChange=${filesOf(send)} /></label>
      <${Fields} fields=${form.fields} values=${typed.value} onValue=${typed.set}
        title="What the program leaves open">
        <${TextField} label="New folder" value=${out.value} placeholder=${proposed} onValue=${into(out)} /><//>
      ${answer?.converted === false && html`<${Open} answer=${answer} />`}
      <${Written} made=${made} button="Convert the positions" title="Converted positions" disabled=${!program.value}
        more=${converted} after="Load the files, and approach the position that the table names slowly first." />
    <//>`;
}
