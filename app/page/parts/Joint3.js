// How the pendant counts joint 3: `usual` is what the robot file states.
import { html } from "htm/preact";
import { Choice } from "./Choice.js";

/** @param {{value: string, onValue: (value: string) => void, usual?: string}} props */
export const Joint3 = ({ value, onValue, usual = "" }) => html`
  <${Choice} label="Joint 3 is counted from" value=${value}
    items=${[[usual, "as the robot file states"], ["link", "link 2"], ["ground", "the ground (FANUC)"]]}
    onValue=${onValue} />`;
