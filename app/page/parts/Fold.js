// What is not needed at first: folded, and made only once it is opened.
import { html } from "htm/preact";
import { useSignal } from "@preact/signals";

/** @param {{title: string, open?: boolean, kept?: boolean, children?: unknown}} props `kept`: what was typed in it stays once it is folded again */
export function Fold({ title, open = false, kept = false, children }) {
  const opened = useSignal(open), ever = useSignal(open);
  return html`<details class="fold" open=${opened.value} onToggle=${(/** @type {any} */ event) => { opened.value = event.target.open; ever.value ||= opened.value; }}><summary>${title}</summary>${(opened.value || (kept && ever.value)) && children}</details>`;
}
