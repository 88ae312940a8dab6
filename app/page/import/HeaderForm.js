// A new header as a form, made from its JSON Schema: checked as it is filled in, saved as a file.
import { html } from "htm/preact";
import { useEffect, useMemo, useRef } from "preact/hooks";
import { useSignal } from "@preact/signals";
import { get, latest, post, put, Refused } from "../core/api.js";
import { failed, freeName, inside, refresh, robots, say } from "../core/store.js";
import { TextField } from "../parts/Controls.js";
import { keyOf, nearest, places } from "../parts/schema.js";
import { Group } from "../parts/StatedParts.js";
import { beginning, pick } from "./header.js";
import { ensureFolder, folder } from "./sources.js";

/** @typedef {import("../parts/schema.js").Schema} Schema */

export function HeaderForm() {
  const schema = useSignal(/** @type {Schema | null} */ (null));
  const content = useSignal(structuredClone(beginning.value));
  const typed = useSignal(""), state = useSignal(""), fault = useSignal(""), fileFault = useSignal("");
  const errors = useSignal(/** @type {Record<string, string>} */ ({}));
  const box = useRef(/** @type {HTMLElement | null} */ (null));
  useEffect(() => { get("/api/header/schema").then((found) => { schema.value = found; }, failed); }, []);
  const file = typed.value.trim() || freeName(`${inside(folder.value)}header.yaml`);

  /** An error is shown at the innermost place that its key leads to. @param {Refused} error */
  function refuse(error) {
    const near = schema.value && error.key[0] === "header"
      ? nearest(schema.value, content.value, error.key.slice(1)) : "";
    errors.value = near ? { [near]: error.text } : {};
    fileFault.value = error.key[0] === "file" ? error.text : "";
    fault.value = near || fileFault.value ? "" : error.text;
    state.value = "";
  }

  const check = useMemo(() => latest(
    () => null,
    async () => {
      const header = content.peek();
      // Before robot, instrument and noise are stated there is nothing to check.
      const begun = header.robot !== undefined && header.noise !== undefined
        && (header.tool !== undefined || header.instruments !== undefined);
      return begun ? post("/api/header/check", { file: "header.yaml", header }) : null;
    },
    (found) => {
      errors.value = {};
      fault.value = "";
      state.value = `${found.robot}, ${found.joints} joints. Not saved yet. ${found.notes.join(" ")}`;
    },
    refuse,
  ), []);

  const save = async () => {
    const root = schema.value;
    if (root === null) return;
    const missing = places(root, root, content.value).filter((one) => one.missing);
    if (missing.length) {
      errors.value = Object.fromEntries(missing.map(({ path }) => [keyOf(path), "This must be stated."]));
      const first = `[data-key="${CSS.escape(keyOf(missing[0].path))}"] :is(input, select)`;
      /** @type {HTMLElement | null | undefined} */ (box.current?.querySelector(first))?.focus();
      return;
    }
    try {
      if (!typed.value.trim()) await ensureFolder();
      const done = await put("/api/header", { file, header: content.value });
      await refresh();
      say(`Saved as ${done.file}.`);
      await pick(done.file, false);
    } catch (error) {
      if (!(error instanceof Refused)) throw error;
      refuse(error);
      state.value = "Not saved.";
    }
  };
  const root = schema.value;
  if (root === null) return html`<p class="muted">…</p>`;
  const form = {
    root, errors: errors.value, lists: { robot: robots.value.map((one) => one.name) },
    touched: (/** @type {string} */ key) => {
      if (key in errors.value) {
        errors.value = Object.fromEntries(Object.entries(errors.value).filter(([one]) => one !== key));
      }
    },
  };
  return html`
    <div class="header-form" ref=${box}>
      <p class="muted">Fields without a value take the default that they show.</p>
      <${Group} form=${form} schema=${root} path=${[]} value=${content.value}
        onValue=${(/** @type {typeof content.value | undefined} */ value) => {
          content.value = value ?? {};
          state.value = "Not saved yet.";
          check();
        }} />
      ${fault.value && html`<p class="fault" role="alert">${fault.value}</p>`}
      <div class="bar">
        <${TextField} label="Save as" value=${typed.value || file} error=${fileFault.value}
          onValue=${(/** @type {string} */ value) => { fileFault.value = ""; typed.value = value; }} />
        <button type="button" class="main" onClick=${save}>Save header</button>
        <span class="muted" role="status">${state.value}</span>
      </div>
    </div>`;
}
