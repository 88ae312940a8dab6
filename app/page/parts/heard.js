// What a control says, handed on: to a function, or into a signal.

/** What is typed or chosen. @param {(value: string) => void} then @returns {(event: Event) => void} */
export const value = (then) => (event) => then(/** @type {HTMLInputElement} */ (event.target).value);

/** Whether it is ticked. @param {(on: boolean) => void} then @returns {(event: Event) => void} */
export const checked = (then) => (event) => then(/** @type {HTMLInputElement} */ (event.target).checked);

/** @template T @param {{value: T}} signal @returns {(value: T) => void} */
export const into = (signal) => (next) => { signal.value = next; };

/**
 * The files that are chosen; the same can be chosen again.
 * @param {(files: File[]) => void} then @returns {(event: Event) => void}
 */
export const filesOf = (then) => (event) => {
  const field = /** @type {HTMLInputElement} */ (event.target), files = [...field.files ?? []];
  field.value = "";
  then(files);
};
