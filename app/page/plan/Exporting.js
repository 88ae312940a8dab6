// The saved plan as a program for a controller, or as a sheet for the person at the robot.
import { html } from "htm/preact";
import { signal, useSignal } from "@preact/signals";
import { file, save, unsaved } from "../core/editing.js";
import { freeName } from "../core/store.js";
import { Choice } from "../parts/Choice.js";
import { Joint3 } from "../parts/Joint3.js";
import { NumberField } from "../parts/NumberField.js";
import { TextField } from "../parts/TextField.js";
import { useWritten, Written } from "../parts/Written.js";

/** Of each form what it is called, the endings of its files, and the options that it takes. @type {Record<string, [string, string[], string[]]>} */
const FORMS = {
  pdf: ["sheet for the person at the robot (PDF)", ["pdf"], ["j3"]],
  rapid: ["RAPID (ABB)", ["mod"], ["speed", "zone", "tool"]], urscript: ["URScript (Universal Robots)", ["script"], ["speed", "zone"]], krl: ["KRL (KUKA)", ["src", "dat"], ["speed", "zone", "tool"]],
  fanuc: ["TP program (FANUC)", ["ls"], ["speed", "zone", "tool", "j3", "register"]], robodk: ["RoboDK (Python)", ["py"], ["speed", "zone", "j3"]], ros: ["ROS JointTrajectory", ["yaml"], ["speed"]], csv: ["table (CSV)", ["csv"], ["j3"]],
};
const form = signal("pdf");
/** @type {import("@preact/signals").Signal<Record<string, string | number | null>>} */
const options = signal({});

export function Exporting() {
  const [, endings, taken] = FORMS[form.value], out = useSignal("");
  const { made, onSubmit } = useWritten();
  const stem = file.value.replace(/\.ya?ml$/, ""), folder = stem.slice(0, stem.lastIndexOf("/") + 1);
  const proposed = freeName(`${form.value === "pdf" ? stem : folder + stem.slice(folder.length).replace(/\W/g, "_")}.${endings[0]}`);
  const set = (/** @type {Record<string, string | number | null>} */ more) => { options.value = { ...options.value, ...more }; };
  const ask = async () => {
    if (unsaved.value && !(await save())) return null;
    const to = out.value.trim() || proposed;
    const words = taken.flatMap((name) => (options.value[name] === undefined || options.value[name] === null || options.value[name] === "" ? [] : [`--${name}=${options.value[name]}`]));
    return { words: ["export", "plan", form.value, file.value, `--out=${to}`, ...words], files: endings.map((ending) => to.replace(/\.[^./]*$/, `.${ending}`)) };
  };
  const number = (/** @type {string} */ label, /** @type {string} */ name, /** @type {any} */ more = {}) => taken.includes(name) && html`<${NumberField} label=${label} optional least=${0} value=${options.value[name]} onValue=${(/** @type {number | null} */ value) => set({ [name]: value })} ...${more} />`;
  return html`
    <form onSubmit=${onSubmit(ask)}>
      <div class="fields">
        <div class="wide"><${Choice} label="Form" value=${form.value} groups=${[["", Object.entries(FORMS).map(([name, [text]]) => [name, text])]]} onValue=${(/** @type {string} */ value) => { form.value = value; made.value = null; }} /></div>
        ${number("Speed", "speed", { unit: "°/s", placeholder: "10" })}${number("Rounding, mm or %", "zone", { placeholder: "0" })}
        ${taken.includes("tool") && html`<${TextField} label="Tool of the controller" value=${String(options.value.tool ?? "")} onValue=${(/** @type {string} */ tool) => set({ tool })} />`}
        ${taken.includes("j3") && html`<${Joint3} value=${String(options.value.j3 ?? "")} onValue=${(/** @type {string} */ j3) => set({ j3 })} />`}
        ${number("First register", "register", { whole: true, placeholder: "1" })}
        <${TextField} label="New file" value=${out.value} placeholder=${proposed} onValue=${(/** @type {string} */ value) => { out.value = value; }} />
      </div>
      <${Written} made=${made} button=${unsaved.value ? "Save and export" : "Export"} title="Export of the plan" />
    </form>`;
}
