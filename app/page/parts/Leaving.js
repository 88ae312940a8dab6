// Before a calibration is left whose plan has unsaved changes: they are saved, kept as a draft, or given up.
import { html } from "htm/preact";
import { signal } from "@preact/signals";
import { discard, file, save } from "../core/editing.js";
import { go } from "../core/route.js";
import { Dialog } from "./Dialog.js";

/** Where to go; "" where nobody leaves. */
export const leaving = signal("");

export function Leaving() {
  const to = leaving.value;
  if (!to) return null;
  const leave = () => { leaving.value = ""; go(to, { sure: true }); };
  const stay = () => { leaving.value = ""; };
  return html`
    <${Dialog} title="The plan has changes that are not saved" onClose=${stay}>
      <p>${file.value}. As a draft they stay in this browser, and are there when the plan is opened again.</p>
      <p class="bar">
        <button type="button" class="main"
          onClick=${async () => { if (await save()) leave(); else stay(); }}>Save</button>
        <button type="button" onClick=${leave}>Leave them as a draft</button>
        <button type="button" onClick=${() => { discard(); leave(); }}>Discard</button>
        <button type="button" onClick=${stay}>Stay</button>
      </p>
    <//>`;
}
