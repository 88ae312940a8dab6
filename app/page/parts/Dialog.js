// A question that stands above the page until it is answered.
import { html } from "htm/preact";
import { useEffect, useRef } from "preact/hooks";

/** @param {{title: string, onClose: () => void, children?: unknown}} props `onClose`: Escape, or the button */
export function Dialog({ title, onClose, children }) {
  const element = useRef(/** @type {HTMLDialogElement | null} */ (null));
  useEffect(() => { if (!element.current?.open) element.current?.showModal(); }, []);
  return html`
    <dialog ref=${element} aria-labelledby="dialog-title"
      onCancel=${(/** @type {Event} */ event) => { event.preventDefault(); onClose(); }}>
      <h2 id="dialog-title">${title}</h2>
      ${children}
    </dialog>`;
}
