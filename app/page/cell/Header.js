// Instrument, noise and geometry of a plan, as fields: what is stated for each joint or link alone is left to the file.
import { html } from "htm/preact";
import { fixed, unitSign } from "../core/words.js";
import { title, unitOf } from "../import/schema.js";
import { Check, NumberField, heard } from "../parts/Controls.js";
import { problemAt, state, stated } from "./keys.js";

/** @typedef {import("./keys.js").Key} Key */

/** A number, or a vector of three. @param {{label: string, at: Key, unit: string}} props */
function Value({ label, at, unit }) {
  const value = stated(at);
  if (typeof value === "number") {
    return html`
      <${NumberField} label=${label} unit=${unit} value=${value} error=${problemAt(at)}
        onValue=${(/** @type {number} */ given) => state(at, given)} />`;
  }
  if (!Array.isArray(value)) return null;
  if (value.length !== 3) return html`<p class="muted">${label}: stated for each joint in the file.</p>`;
  return ["x", "y", "z"].map((axis, i) => html`
    <${NumberField} key=${axis} label=${`${label} ${axis}`} unit=${unit} value=${value[i]}
      error=${i === 0 ? problemAt(at) : ""} onValue=${(/** @type {number} */ given) => state([...at, i], given)} />`);
}

/** What carries out the measurements: every part of it that is stated as a number, a vector or yes and no. */
export function Instrument() {
  const several = stated(["instruments"]), alone = stated(["tool"]) ? [["tool"]] : [];
  const parts = several ? Object.keys(several).map((name) => ["instruments", name]) : alone;
  return html`${parts.map((at) => {
    const own = /** @type {import("./keys.js").Part} */ (stated(at));
    return html`
      <h3 key=${at.join()}>${[several ? at[1] : "", own.kind].filter(Boolean).join(": ")}</h3>
      <div class="fields">${Object.keys(own).filter((key) => key !== "kind").map((key) => (typeof own[key] === "boolean"
        ? html`<${Check} key=${key} on=${own[key]}
          onTurn=${(/** @type {boolean} */ on) => state([...at, key], on)}>${title(key)}<//>`
        : html`<${Value} key=${key} label=${title(key)} at=${[...at, key]} unit=${unitOf(key)} />`))}</div>`;
  })}`;
}

export function Noise() {
  return html`
    <div class="fields">
      ${Object.keys(stated(["noise"]) ?? {})
        .map((key) => html`
          <${Value} key=${key} label=${title(key)} at=${["noise", key]} unit=${unitOf(key)} />`)}</div>`;
}

/**
 * A logarithmic slider from a hundredth of the usual tolerance to ten times of it.
 * @param {{label: string, name: string, usual: number, unit: string}} props
 */
function Tolerance({ label, name, usual, unit }) {
  const at = ["geometry", "tolerance", name], value = stated(at) ?? usual, sign = unitSign(unit);
  if (typeof value !== "number") return html`<p class="muted">${label}: stated for each link in the file.</p>`;
  return html`
    <label class="tolerance wide"><span class="label">${label}: ${value} ${sign}</span>
      <input type="range" min=${Math.log10(usual) - 2} max=${Math.log10(usual) + 1} step="0.05"
        value=${Math.log10(value)}
        aria-label=${label} aria-valuetext=${`${value} ${unit}`}
        onInput=${heard((power) => state(at, Number((10 ** Number(power)).toPrecision(2))))} />
    </label>`;
}

export function Geometry() {
  const deviates = stated(["geometry"]) !== "exact";
  return html`
    <${Check} on=${deviates} onTurn=${(/** @type {boolean} */ on) => state(["geometry"], on ? undefined : "exact")}>
      The arm deviates from its nominal geometry, within tolerances<//>
    ${problemAt(["geometry"]) && html`<p class="error" role="alert">${problemAt(["geometry"])}</p>`}
    ${deviates && html`
      <div class="fields"><${Tolerance} label="Tolerance of lengths" name="length_mm" usual=${0.3} unit="mm" />
        <${Tolerance} label="Tolerance of angles" name="angle_deg" usual=${0.1} unit="deg" /></div>`}
    ${!deviates && html`
      <p class="muted">Every dimension counts as exact: an arm that is ${fixed(0.3, 1)} mm off somewhere will not be
        known as such.</p>`}`;
}
