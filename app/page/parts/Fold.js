// What is not needed at first: folded, and made only once it is opened.
import { html } from "htm/preact";
import { useSignal } from "@preact/signals";

/** @param {{title: string, open?: boolean, children?: unknown}} props */
export function Fold({ title, open = false, children }) {
  const opened = useSignal(open);
  return html`<details class="fold" open=${opened.value} onToggle=${(/** @type {any} */ event) => { opened.value = event.target.open; }}><summary>${title}</summary>${opened.value && children}</details>`;
}
