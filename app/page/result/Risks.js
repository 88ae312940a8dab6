// What is exported although something speaks against it.
import { html } from "htm/preact";

/** @type {[string, string][]} */
const ALTHOUGH = [["--allow-weak", "Although an offset is only weakly observable"], ["--allow-displaced", "Although a target seems to have moved"], ["--allow-assumed", "Although an offset is only as good as what is assumed"], ["--unvalidated", "Although the model does not describe the measurements"]];

/** @param {{flags: import("@preact/signals").Signal<string[]>}} props */
export const Risks = ({ flags }) => html`${ALTHOUGH.map(([flag, text]) => html`<label class="check" key=${flag}><input type="checkbox" checked=${flags.value.includes(flag)} onChange=${() => { flags.value = flags.value.includes(flag) ? flags.value.filter((one) => one !== flag) : [...flags.value, flag]; }} /> ${text}</label>`)}`;
