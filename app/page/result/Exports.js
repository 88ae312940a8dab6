// The offsets as files for controllers and programs: written by the command, which refuses what may not be entered and
// says why.
import { html } from "htm/preact";
import { useSignal } from "@preact/signals";
import { calibration, freeName, typedIn } from "../core/store.js";
import { Fields, useForms, wordsOf } from "../parts/Fields.js";
import { Fold } from "../parts/Fold.js";
import { Form } from "../parts/Form.js";
import { Cards, into, TextField } from "../parts/Controls.js";
import { useWritten, Written } from "../parts/Written.js";

/** @typedef {import("answers").CommandForm} CommandForm */

const typed = typedIn();

/** @param {{run: string}} props */
export function Exports({ run }) {
  const form = useSignal(""), file = useSignal(""), { made, carryOut } = useWritten(), all = useForms("export");
  if (!all.length) return html`<p class="muted">…</p>`;
  // Those of the arm's maker, or where it has none those for every arm; what is for other arms is folded.
  const ofMaker = all.filter((one) => one.vendor !== null && one.vendor === calibration.value?.maker);
  const first = ofMaker.length ? ofMaker : all.filter((one) => one.vendor === null);
  const others = all.filter((one) => !first.includes(one));
  const chosen = all.find((one) => one.name === form.value) ?? first[0];
  const ending = chosen.files[0].replace(/^.*\./, "");
  const proposed = freeName(`${run.replace(/\.[^./]*$/, "")}-${chosen.name}.${ending}`);
  const to = file.value.trim() || proposed;
  const write = () =>
    carryOut([...chosen.command, run, `--out=${to}`, ...wordsOf(chosen.fields, typed.value)], [to]);
  const cards = (/** @type {CommandForm[]} */ list) => html`
    <${Cards} name="format" value=${chosen.name} onValue=${onForm}
      items=${list.map((one) => ({ value: one.name, title: one.name, about: one.about }))} />`;
  const onForm = (/** @type {string} */ name) => { form.value = name; typed.clear(); made.value = null; };
  return html`
    <${Form} class="exports" onSubmit=${write}>
      <fieldset class="cards">
        <legend class="label">${ofMaker.length ? `For ${ofMaker[0].maker}` : "For every arm"}</legend>
        ${cards(first)}</fieldset>
      <${Fold} title="Other formats" open=${others.includes(chosen)}>
        <fieldset class="cards"><legend class="unseen">Other formats</legend>
          ${cards(others)}</fieldset><//>
      <${Fields} key=${chosen.name} fields=${chosen.fields} values=${typed.value} onValue=${typed.set}>
        <div class="wide">
          <${TextField} label="New file" value=${file.value} placeholder=${proposed} onValue=${into(file)} /></div><//>
      <${Written} made=${made} button=${`Export as ${chosen.name}`} title=${`Export of ${to}`} />
    <//>`;
}
