// The saved plan as a program for a controller, or as a sheet for the person at the robot.
import { html } from "htm/preact";
import { useEffect } from "preact/hooks";
import { signal, useSignal } from "@preact/signals";
import { get } from "../core/api.js";
import { file, save, unsaved } from "../core/editing.js";
import { failed, freeName, ofCalibration } from "../core/store.js";
import { Choice } from "../parts/Choice.js";
import { Form } from "../parts/Form.js";
import { Joint3 } from "../parts/Joint3.js";
import { NumberField } from "../parts/NumberField.js";
import { TextField } from "../parts/TextField.js";
import { useWritten, Written } from "../parts/Written.js";
import { into } from "../parts/heard.js";

/** @typedef {import("answers").PlanForm} PlanForm */

const forms = signal(/** @type {PlanForm[] | null} */ (null));
const form = ofCalibration("pdf");
const options = ofCalibration(/** @type {Record<string, string | number | null>} */ ({}));

/** A file's name without its folder and ending. @param {string} name */
const stemOf = (name) => name.replace(/^.*\//, "").replace(/\.[^.]*$/, "");

/** The files of a form, the first of which is called so. @param {PlanForm} one @param {string} to */
function filesOf(one, to) {
  const folder = to.slice(0, to.lastIndexOf("/") + 1), [first, ...others] = one.files;
  return [to,
    ...others.map((name) =>
      folder + (stemOf(name) === stemOf(first) ? stemOf(to) + name.slice(name.lastIndexOf(".")) : name))];
}

export function Exporting() {
  useEffect(() => {
    if (forms.value === null) get("/api/plan-exports").then((answer) => { forms.value = answer; }, failed);
  },
    []);
  const chosen = forms.value?.find((one) => one.name === form.value), out = useSignal("");
  const { made, onSubmit } = useWritten();
  if (!forms.value || !chosen) return null;
  const taken = chosen.options, folder = file.value.slice(0, file.value.lastIndexOf("/") + 1);
  // A controller may allow letters, digits and _ only in a program's name.
  const proposed = chosen.name === "pdf" ? freeName(file.value.replace(/\.ya?ml$/, ".pdf"))
    : freeName(folder + chosen.files[0], "");
  const ask = async () => {
    if (unsaved.value && !(await save())) return null;
    const to = out.value.trim() || proposed;
    const words = taken.flatMap((name) =>
      (options.value[name] === undefined || options.value[name] === null || options.value[name] === "" ? []
        : [`--${name}=${options.value[name]}`]));
    return { words: ["export", "plan", chosen.name, file.value, `--out=${to}`, ...words], files: filesOf(chosen, to) };
  };
  const number = (/** @type {string} */ label, /** @type {string} */ name, more = {}) =>
    taken.includes(name) && html`
      <${NumberField} label=${label} optional least=${0} value=${options.value[name]} onValue=${options.at(name)}
        ...${more} />`;
  return html`
    <${Form} onSubmit=${onSubmit(ask)}>
      <div class="fields">
        <div class="wide">
          <${Choice} label="Form" value=${chosen.name} items=${forms.value.map((one) => [one.name, one.label])}
            onValue=${(/** @type {string} */ value) => { form.value = value; made.value = null; }} /></div>
        ${number("Speed", "speed", { unit: "°/s", placeholder: "10" })}${number("Rounding, mm or %", "zone",
          { placeholder: "0" })}
        ${taken.includes("tool") && html`
          <${TextField} label="Tool of the controller" value=${String(options.value.tool ?? "")}
            onValue=${options.at("tool")} />`}
        ${taken.includes("j3") && html`
          <${Joint3} value=${String(options.value.j3 ?? "")} onValue=${options.at("j3")} />`}
        ${number("First register", "register", { whole: true, placeholder: "1" })}
        ${taken.includes("listener") && html`
          <${TextField} label="Joints also sent to" value=${String(options.value.listener ?? "")}
            placeholder="HOST:PORT" onValue=${options.at("listener")} />`}
        <${TextField} label="New file" value=${out.value} placeholder=${proposed} onValue=${into(out)} />
      </div>
      <${Written} made=${made} button=${unsaved.value ? "Save and export" : "Export"} title="Export of the plan" />
    <//>`;
}
