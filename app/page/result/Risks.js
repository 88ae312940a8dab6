// What is exported although something speaks against it.
import { html } from "htm/preact";
import { Check } from "../parts/Check.js";

/** @type {[string, string][]} */
const ALTHOUGH = [
  ["--allow-weak", "Although an offset is only weakly observable"],
  ["--allow-displaced", "Although a target seems to have moved"],
  ["--allow-assumed", "Although an offset is only as good as what is assumed"],
  ["--unvalidated", "Although the model does not describe the measurements"],
];

/** @param {{flags: import("@preact/signals").Signal<string[]>}} props */
export const Risks = ({ flags }) => html`${ALTHOUGH.map(([flag, text]) => html`
  <${Check} key=${flag} on=${flags.value.includes(flag)} onTurn=${(/** @type {boolean} */ on) => {
    flags.value = [...flags.value.filter((one) => one !== flag), ...(on ? [flag] : [])];
  }}>${text}<//>`)}`;
