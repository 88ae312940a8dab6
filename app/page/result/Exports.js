// The offsets as files for controllers and programs: written by the command, which refuses what may not be entered and says why.
import { html } from "htm/preact";
import { useEffect } from "preact/hooks";
import { signal, useSignal } from "@preact/signals";
import { get } from "../core/api.js";
import { calibration, failed, files, freeName } from "../core/store.js";
import { Choice } from "../parts/Choice.js";
import { Form } from "../parts/Form.js";
import { TextField } from "../parts/TextField.js";
import { useWritten, Written } from "../parts/Written.js";
import { Risks } from "./Risks.js";

/** @typedef {{flag: string, help: string, choices: string[], file: boolean, default: string | null}} ExportOption */
/** @typedef {{name: string, maker: string, vendor: string | null, about: string, ending: string, options: ExportOption[]}} ExportForm */

/** @type {import("@preact/signals").Signal<ExportForm[] | null>} */
const forms = signal(null);

/** @param {ExportOption} option */
const labelOf = ({ flag }) => flag.replace(/^--/, "").replaceAll("-", " ").replace(/^./, (first) => first.toUpperCase());

/** @param {{run: string}} props */
export function Exports({ run }) {
  const form = useSignal(""), file = useSignal(""), without = useSignal(""), flags = useSignal(/** @type {string[]} */ ([])), options = useSignal(/** @type {Record<string, string>} */ ({}));
  const { made, onSubmit } = useWritten();
  useEffect(() => { if (forms.value === null) get("/api/exports").then((found) => { forms.value = found; }, failed); }, []);
  const all = forms.value;
  if (all === null) return html`<p class="muted">…</p>`;
  // The maker of this arm comes first.
  const own = all.find((one) => one.vendor !== null && one.vendor === calibration.value?.maker)?.maker;
  const makers = [...new Set(all.map((one) => one.maker))].sort((a, b) => Number(b === own) - Number(a === own));
  const chosen = all.find((one) => one.name === form.value) ?? all.find((one) => one.maker === makers[0]) ?? all[0];
  const proposed = freeName(`${run.replace(/\.[^./]*$/, "")}-${chosen.name}.${chosen.ending}`);
  const ask = () => {
    const to = file.value.trim() || proposed;
    const stated = chosen.options.filter(({ flag }) => options.value[flag]?.trim()).map(({ flag }) => `${flag}=${options.value[flag].trim()}`);
    return { words: ["export", chosen.name, run, `--out=${to}`, ...flags.value, ...stated, ...without.value.split(/[\s,]+/).filter(Boolean).map((name) => `--without=${name}`)], files: [to] };
  };
  const names = files.value.filter((one) => /\.(cfg|conf|txt|ya?ml)$/i.test(one.path)).map((one) => /** @type {[string, string]} */ ([one.path, one.path]));
  return html`
    <${Form} class="exports" onSubmit=${onSubmit(ask)}>
      <div class="fields">
        <div class="wide"><${Choice} label="Form" value=${chosen.name} groups=${makers.map((of) => [of, all.filter((one) => one.maker === of).map((one) => [one.name, `${one.name}: ${one.about}`])])} onValue=${(/** @type {string} */ value) => { form.value = value; options.value = {}; made.value = null; }} /></div>
        <p class="muted">${chosen.about}</p>
        ${chosen.options.map((option) => {
          const value = options.value[option.flag] ?? "", set = (/** @type {string} */ next) => { options.value = { ...options.value, [option.flag]: next }; };
          return html`<div class="wide" key=${chosen.name + option.flag}>
            ${option.choices.length || option.file ? html`<${Choice} label=${labelOf(option)} value=${value} none="not stated" groups=${[["", option.file ? names : option.choices.map((one) => [one, one])]]} onValue=${set} />`
              : html`<${TextField} label=${labelOf(option)} value=${value} placeholder=${option.default ?? ""} onValue=${set} />`}
            <span class="help">${option.help}</span></div>`;
        })}
        <div class="wide"><${TextField} label="New file" value=${file.value} placeholder=${proposed} onValue=${(/** @type {string} */ value) => { file.value = value; }} /></div>
        <div class="wide"><${TextField} label="Without" value=${without.value} placeholder="delta2, delta3" onValue=${(/** @type {string} */ value) => { without.value = value; }} /></div>
        <${Risks} flags=${flags} />
      </div>
      <${Written} made=${made} button="Export" title=${`Export of ${run}`} />
    <//>`;
}
