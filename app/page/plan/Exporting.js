// The saved plan as a program for a controller, or as a sheet for the person at the robot.
import { html } from "htm/preact";
import { useSignal } from "@preact/signals";
import { file, save, unsaved } from "../core/editing.js";
import { calibrationOf } from "../core/route.js";
import { freeName, inside, ofCalibration, typedIn } from "../core/store.js";
import { Choice, into, TextField } from "../parts/Controls.js";
import { Fields, useForms, wordsOf } from "../parts/Fields.js";
import { Form } from "../parts/Form.js";
import { useWritten, Written } from "../parts/Written.js";

const form = ofCalibration("pdf");
const typed = typedIn();

/** A file's name without its folder and ending. @param {string} name */
const stemOf = (name) => name.replace(/^.*\//, "").replace(/\.[^.]*$/, "");

/** The files of a form, the first of which is called so. @param {string[]} files @param {string} to */
function filesOf([first, ...others], to) {
  const folder = inside(calibrationOf(to));
  return [to,
    ...others.map((name) =>
      folder + (stemOf(name) === stemOf(first) ? stemOf(to) + name.slice(name.lastIndexOf(".")) : name))];
}

export function Exporting() {
  const forms = useForms("export plan"), out = useSignal(""), { made, carryOut } = useWritten();
  const chosen = forms.find((one) => one.name === form.value);
  if (!chosen) return null;
  // A controller may allow letters, digits and _ only in a program's name.
  const proposed = chosen.name === "pdf" ? freeName(file.value.replace(/\.ya?ml$/, ".pdf"))
    : freeName(inside(calibrationOf(file.value)) + chosen.files[0], "");
  const write = async () => {
    const to = out.value.trim() || proposed, words = wordsOf(chosen.fields, typed.value), name = file.value;
    if (unsaved.value && !(await save())) return;
    await carryOut([...chosen.command, name, `--out=${to}`, ...words], filesOf(chosen.files, to));
  };
  return html`
    <${Form} onSubmit=${write}>
      <div class="fields">
        <div class="wide">
          <${Choice} label="Form" value=${chosen.name} items=${forms.map((one) => [one.name, one.label])}
            onValue=${(/** @type {string} */ value) => { form.value = value; made.value = null; }} /></div></div>
      <${Fields} key=${chosen.name} fields=${chosen.fields} values=${typed.value} onValue=${typed.set}>
        <${TextField} label="New file" value=${out.value} placeholder=${proposed} onValue=${into(out)} /><//>
      <${Written} made=${made} button=${unsaved.value ? "Save and export" : "Export"} title="Export of the plan" />
    <//>`;
}
