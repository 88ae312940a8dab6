// What is not needed at first: folded, and made only once it is opened.
import { html } from "htm/preact";
import { useSignal } from "@preact/signals";

/**
 * @param {{title: string, open?: boolean, kept?: boolean, children?: unknown}} props
 *   `kept`: what was typed in it stays once it is folded again
 */
export function Fold({ title, open = false, kept = false, children }) {
  const opened = useSignal(open), ever = useSignal(open);
  const toggled = (/** @type {import("preact").TargetedEvent<HTMLDetailsElement>} */ { currentTarget }) => {
    opened.value = currentTarget.open;
    ever.value ||= opened.value;
  };
  return html`
    <details class="fold" open=${opened.value} onToggle=${toggled}><summary>${title}</summary>
      ${(opened.value || (kept && ever.value)) && children}
    </details>`;
}
