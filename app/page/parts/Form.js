// A form: its fields say here what they refuse or lack, and its button does nothing while one of them does. What the
// server refuses of what was sent is said at its field.
import { html } from "htm/preact";
import { createContext } from "preact";
import { useContext, useEffect, useMemo, useRef } from "preact/hooks";
import { signal, useSignal } from "@preact/signals";
import { Refused } from "../core/api.js";
import { attempt } from "../core/store.js";

/** @typedef {import("preact").RefObject<HTMLInputElement>} FieldRef */
/** @typedef {{says: string, field: FieldRef}} Fault what is wrong, and where */
/**
 * @typedef {{faults: Map<object, Fault>, claimed: Set<string>,
 *   refused: import("@preact/signals").Signal<Refused | null>}} FormFacts
 *   `claimed`: the options that have a field
 */
/** @type {import("preact").Context<FormFacts | null>} */
const Facts = createContext(/** @type {FormFacts | null} */ (null));

/** @param {{onSubmit: () => Promise<unknown>, children?: unknown, [attribute: string]: unknown}} props */
export function Form({ children, onSubmit, ...attributes }) {
  const facts = useMemo(() => /** @type {FormFacts} */ ({ faults: new Map(), claimed: new Set(),
    refused: signal(null) }), []);
  const submitted = (/** @type {Event} */ event) => {
    event.preventDefault();
    facts.refused.value = null;
    attempt(async () => {
      try {
        await onSubmit();
      } catch (error) {
        if (!(error instanceof Refused) || error.key[0] !== "command") throw error;
        facts.refused.value = error;
      }
    });
  };
  return html`<${Facts.Provider} value=${facts}><form ...${attributes} onSubmit=${submitted}>${children}</form><//>`;
}

/** What the server refuses of an option, in words; "" for nothing. @param {string} flag */
export function useRefusal(flag) {
  const facts = useContext(Facts);
  useEffect(() => {
    facts?.claimed.add(flag);
    return () => { facts?.claimed.delete(flag); };
  }, [facts, flag]);
  const refused = facts?.refused.value;
  return { text: refused?.key[1] === flag ? refused.text : "",
    forget: () => { if (facts?.refused.value) facts.refused.value = null; } };
}

/**
 * Says to the form of a field what is wrong with it; "" for nothing.
 * @param {string} says @returns {FieldRef} for the field
 */
export function useFault(says) {
  const faults = useContext(Facts)?.faults, field = useRef(/** @type {HTMLInputElement | null} */ (null));
  useEffect(() => {
    if (says) faults?.set(field, { says, field });
    return () => { faults?.delete(field); };
  }, [faults, says]);
  return field;
}

/** The button of a form. @param {{disabled?: boolean, main?: boolean, children?: unknown}} props */
export function Submit({ disabled = false, main = true, children }) {
  const facts = useContext(Facts), problem = useSignal(""), refused = facts?.refused.value;
  const check = (/** @type {Event} */ event) => {
    const [fault] = facts?.faults.values() ?? [], fold = fault?.field.current?.closest("details");
    problem.value = fault?.says ?? "";
    if (!fault) return;
    event.preventDefault();
    if (fold) fold.open = true;
    fault.field.current?.focus();
  };
  const elsewhere = refused && !facts?.claimed.has(String(refused.key[1])) ? refused.text : "";
  return html`
    <button class=${main ? "main" : ""} disabled=${disabled} onClick=${check}>${children}</button>
    ${(problem.value || elsewhere) && html`
      <span class="error" role="alert">${problem.value || elsewhere}. Nothing was begun.</span>`}`;
}
