// What the format may be told besides columns.
import { html } from "htm/preact";
import { sources } from "./command.js";
import { Check } from "../parts/Check.js";
import { columns, factsOf, format, listed, optionOf, set, shown, values } from "./formats.js";
import { recordings } from "./sources.js";
import { value as heard } from "../parts/heard.js";

/** @typedef {import("./types.js").Found} Found */

/** Which points are measurements: all that have joints, where nothing is left out. @param {{found: Found}} props */
function Points({ found }) {
  if (!found.points.length) return null; // those of a plan's program say themselves what they are
  const stated = values.value["--points"];
  const on = (/** @type {{name: string, joints: boolean}} */ point) =>
    (stated ? stated.split(",").includes(point.name) : point.joints);
  const turn = (/** @type {string} */ name, /** @type {boolean} */ checked) => {
    const names = found.points.filter((point) => (point.name === name ? checked : on(point)))
      .map((point) => point.name);
    set("--points", names.length === found.points.length ? "" : names.join(","));
  };
  return html`
    <fieldset class="points" data-option="--points"><legend>Points that are measurements</legend>
      ${found.points.map((point) => html`
        <${Check} key=${point.name} on=${on(point)} onTurn=${(/** @type {boolean} */ now) => turn(point.name, now)}>
          ${point.name}${point.joints ? "" : " (no joint values: Cartesian, or not taught)"}<//>`)}
    </fieldset>`;
}

/** @param {{option: string, found: Found, joints: Found}} props */
function Option({ option, found, joints }) {
  const own = factsOf(option), table = own.of === "joints" ? joints : found, help = `help-${option.replace(/^-+/, "")}`;
  const value = values.value[option] ?? "";
  if (own.points) return html`<${Points} found=${found} />`;
  if (optionOf(option)?.box) {
    const turned = (/** @type {boolean} */ on) => set(option, on ? "true" : "");
    return html`<${Check} data-option=${option} on=${Boolean(value)} onTurn=${turned}>${own.label}<//>`;
  }
  const named = format.value === "points" && own.words === columns; // a remark may name the columns of such a table
  const about = named ? [own.help, listed(table)].filter(Boolean).join("; ") : own.about ? own.about(table) : own.help;
  const tables = recordings.value.filter((row) =>
    row.found?.columns.length && (row.path === value || sources.value.length > 1))
    .map((row) => /** @type {[string, string]} */ ([row.path, row.path]));
  const words = option === "--joints" ? tables : named ? undefined : own.words?.(table);
  return html`
    <div data-option=${option}>
      <label><span class="label">${own.label}</span>
        ${words ? html`
          <select value=${value || (own.none ? "" : words[0]?.[0] ?? "")} aria-describedby=${about && help}
            onChange=${heard((text) => set(option, text))}>
            ${own.none && html`<option value="" selected=${!value}>${own.none}</option>`}
            ${words.map(([word, text], i) => html`
              <option value=${word} selected=${word === value || (!value && !own.none && i === 0)}>${text}</option>`)}
          </select>`
          : html`<input type="text" autocomplete="off" spellcheck=${false} value=${value}
            aria-describedby=${about && help} onInput=${heard((text) => set(option, text.trim()))} />`}
      </label>
      ${about && html`<span class="help" id=${help}>${about}</span>`}
    </div>`;
}

export function Options() {
  const found = sources.value[0]?.found;
  const joints = recordings.value.find((row) => row.path === values.value["--joints"])?.found ?? found;
  if (!found || !joints || !shown.value.length) return null;
  return html`
    <div class="fields options">
      ${shown.value.map((option) => html`
        <${Option} key=${`${format.value} ${option}`} option=${option} found=${found} joints=${joints} />`)}</div>`;
}
