// The plan as it is edited, as a file of the person's own: also where the folder cannot take it.
import { html } from "htm/preact";
import { file, plan } from "../core/editing.js";

/** @param {import("preact").TargetedMouseEvent<HTMLAnchorElement>} event */
function download(event) {
  const content = new Blob([`${JSON.stringify(plan.value, null, 1)}\n`],
    { type: "application/yaml" }); // JSON is YAML too
  const address = URL.createObjectURL(content);
  event.currentTarget.href = address;
  setTimeout(() => URL.revokeObjectURL(address), 10_000);
}

export const DownloadDraft = () => html`
  <a class="button" href="#" download=${file.value.replace(/^.*\//, "")} onClick=${download}>Download the plan</a>`;
