// A form: its fields say here what they refuse or lack, and its button does nothing while one of them does.
import { html } from "htm/preact";
import { createContext } from "preact";
import { useContext, useEffect, useMemo, useRef } from "preact/hooks";
import { useSignal } from "@preact/signals";

/** @typedef {{says: string, field: import("preact").RefObject<HTMLInputElement>}} Fault what is wrong, and where */
/** @type {import("preact").Context<Map<object, Fault> | null>} */
const Faults = createContext(/** @type {Map<object, Fault> | null} */ (null));

/** @param {{onSubmit: (event: Event) => void, children?: unknown, [attribute: string]: unknown}} props */
export function Form({ children, onSubmit, ...attributes }) {
  const faults = useMemo(() => new Map(), []);
  return html`<${Faults.Provider} value=${faults}><form ...${attributes} onSubmit=${onSubmit}>${children}</form><//>`;
}

/**
 * Says to the form of a field what is wrong with it; "" for nothing.
 * @param {string} says @returns {import("preact").RefObject<HTMLInputElement>} for the field
 */
export function useFault(says) {
  const faults = useContext(Faults), field = useRef(/** @type {HTMLInputElement | null} */ (null));
  useEffect(() => {
    if (says) faults?.set(field, { says, field });
    return () => { faults?.delete(field); };
  }, [faults, says]);
  return field;
}

/** The button of a form. @param {{disabled?: boolean, main?: boolean, children?: unknown}} props */
export function Submit({ disabled = false, main = true, children }) {
  const faults = useContext(Faults), problem = useSignal("");
  const check = (/** @type {Event} */ event) => {
    const [fault] = faults?.values() ?? [], fold = fault?.field.current?.closest("details");
    problem.value = fault?.says ?? "";
    if (!fault) return;
    event.preventDefault();
    if (fold) fold.open = true;
    fault.field.current?.focus();
  };
  return html`
    <button class=${main ? "main" : ""} disabled=${disabled} onClick=${check}>${children}</button>
    ${problem.value && html`<span class="error" role="alert">${problem.value}. Nothing was begun.</span>`}`;
}
