// Robot, tool and noise: a header or a measured plan of the folder, or a new header.
import { html } from "htm/preact";
import { ofKind } from "../core/store.js";
import { Choice } from "../parts/Choice.js";
import { about, chosen, editCopy, headerFault, headerFile, NEW, pick } from "./header.js";
import { HeaderForm } from "./HeaderForm.js";

export function HeaderChoice() {
  const named = (/** @type {string} */ kind) =>
    ofKind(kind).map((path) => /** @type {[string, string]} */ ([path, path]));
  return html`
    <section aria-labelledby="import-header">
      <h2 id="import-header">2. Robot, tool and noise</h2>
      <div class="fields">
        <${Choice} label="Header or plan" value=${headerFile.value} none="choose"
          groups=${[["new", [[NEW, "fill in a new header"]]], ["headers of the folder", named("header")],
            ["measured plans of the folder", named("plan")]]}
          onValue=${(/** @type {string} */ file) => pick(file, ofKind("plan").includes(file))} />
      </div>
      ${chosen.value && html`
        <p class="chosen">${about(chosen.value)}</p>
        <p><button type="button" onClick=${editCopy}>Make a new header from this one</button></p>`}
      ${headerFault.value && html`<p class="error" role="alert">${headerFault.value}</p>`}
      ${headerFile.value === NEW && html`<${HeaderForm} />`}
    </section>`;
}
