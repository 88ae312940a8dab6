// The offsets as files for controllers and programs: written by the command, which refuses what may not be entered and
// says why.
import { html } from "htm/preact";
import { useEffect } from "preact/hooks";
import { signal, useSignal } from "@preact/signals";
import { get } from "../core/api.js";
import { calibration, failed, files, freeName } from "../core/store.js";
import { flagWords } from "../core/words.js";
import { Choice } from "../parts/Choice.js";
import { Fold } from "../parts/Fold.js";
import { Form } from "../parts/Form.js";
import { into } from "../parts/heard.js";
import { TextField } from "../parts/TextField.js";
import { useWritten, Written } from "../parts/Written.js";
import { Risks } from "./Risks.js";

/** @typedef {import("answers").FormField} ExportOption */
/** @typedef {import("answers").ExportForm} ExportForm */

const forms = signal(/** @type {ExportForm[] | null} */ (null));

/** Forms to choose one of. @param {{list: ExportForm[], chosen: ExportForm, onForm: (name: string) => void}} props */
const Formats = ({ list, chosen, onForm }) => list.map((one) => html`
  <label class="option" key=${one.name}>
    <input type="radio" name="format" value=${one.name} checked=${one === chosen} onChange=${() => onForm(one.name)} />
    <b>${one.name}</b><span>${one.about}</span>
  </label>`);

/** What a form may be told. @param {{option: ExportOption, value: string, onValue: (value: string) => void}} props */
function Stated({ option, value, onValue }) {
  const names = files.value.map((one) => one.path).filter((path) => /\.(cfg|conf|txt|ya?ml)$/i.test(path));
  const words = option.file ? names : option.choices;
  return html`
    <div class="wide">
      ${words.length || option.file
        ? html`<${Choice} label=${flagWords(option.flag)} value=${value} none="not stated" items=${words}
          onValue=${onValue} />`
        : html`<${TextField} label=${flagWords(option.flag)} value=${value} placeholder=${option.default ?? ""}
          onValue=${onValue} />`}
      <span class="help">${option.help}</span>
    </div>`;
}

/** @param {{run: string}} props */
export function Exports({ run }) {
  const form = useSignal(""), file = useSignal(""), without = useSignal("");
  const flags = useSignal(/** @type {string[]} */ ([]));
  const options = useSignal(/** @type {Record<string, string>} */ ({}));
  const { made, onSubmit } = useWritten();
  useEffect(() => { if (forms.value === null) get("/api/exports").then(into(forms), failed); }, []);
  const all = forms.value;
  if (all === null) return html`<p class="muted">…</p>`;
  // Those of the arm's maker, or where it has none those for every arm; what is for other arms is folded.
  const ofMaker = all.filter((one) => one.vendor !== null && one.vendor === calibration.value?.maker);
  const first = ofMaker.length ? ofMaker : all.filter((one) => one.vendor === null);
  const others = all.filter((one) => !first.includes(one));
  const chosen = all.find((one) => one.name === form.value) ?? first[0];
  const proposed = freeName(`${run.replace(/\.[^./]*$/, "")}-${chosen.name}.${chosen.ending}`);
  const to = file.value.trim() || proposed;
  const ask = () => {
    const stated = chosen.options.filter(({ flag }) => options.value[flag]?.trim())
      .map(({ flag }) => `${flag}=${options.value[flag].trim()}`);
    const left = without.value.split(/[\s,]+/).filter(Boolean).map((name) => `--without=${name}`);
    return { words: ["export", chosen.name, run, `--out=${to}`, ...flags.value, ...stated, ...left], files: [to] };
  };
  const onForm = (/** @type {string} */ name) => { form.value = name; options.value = {}; made.value = null; };
  return html`
    <${Form} class="exports" onSubmit=${onSubmit(ask)}>
      <fieldset class="cards">
        <legend class="label">${ofMaker.length ? `For ${ofMaker[0].maker}` : "For every arm"}</legend>
        <${Formats} list=${first} chosen=${chosen} onForm=${onForm} /></fieldset>
      <${Fold} title="Other formats" open=${others.includes(chosen)}>
        <fieldset class="cards"><legend class="unseen">Other formats</legend>
          <${Formats} list=${others} chosen=${chosen} onForm=${onForm} /></fieldset><//>
      <div class="fields">
        ${chosen.options.map((option) => html`
          <${Stated} key=${chosen.name + option.flag} option=${option} value=${options.value[option.flag] ?? ""}
            onValue=${(/** @type {string} */ next) => {
              options.value = { ...options.value, [option.flag]: next };
            }} />`)}
        <div class="wide">
          <${TextField} label="New file" value=${file.value} placeholder=${proposed} onValue=${into(file)} /></div>
        <div class="wide">
          <${TextField} label="Offsets to leave out" value=${without.value} placeholder="delta2, delta3"
            onValue=${into(without)} /></div>
        <${Risks} flags=${flags} />
      </div>
      <${Written} made=${made} button=${`Export as ${chosen.name}`} title=${`Export of ${to}`} />
    <//>`;
}
