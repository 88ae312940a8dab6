// The button of a form: it does nothing while a number is refused or missing, and says which.
import { html } from "htm/preact";
import { useSignal } from "@preact/signals";

/** The first field of a form that is refused or lacks its number. @param {HTMLFormElement} form */
const faulty = (form) => /** @type {HTMLInputElement | null} */ (form.querySelector("input[aria-invalid=true], input[data-needed]"));

/** @param {{disabled?: boolean, main?: boolean, children?: unknown}} props */
export function Submit({ disabled = false, main = true, children }) {
  const problem = useSignal("");
  const check = (/** @type {any} */ event) => {
    const field = faulty(event.currentTarget.form);
    problem.value = "";
    if (!field) return;
    event.preventDefault();
    const fold = field.closest("details"), said = field.closest("label")?.querySelector(".error")?.textContent;
    if (fold) fold.open = true;
    field.focus();
    problem.value = `${field.getAttribute("aria-label") ?? ""}: ${said || "a number is missing"}.`;
  };
  return html`<button class=${main ? "main" : ""} disabled=${disabled} onClick=${check}>${children}</button>${problem.value && html`<span class="error" role="alert">${problem.value} Nothing was begun.</span>`}`;
}
