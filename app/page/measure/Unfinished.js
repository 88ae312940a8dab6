// Runs that have not reached their end, to go on with.
import { html } from "htm/preact";
import { useSignal } from "@preact/signals";
import { go, route, toJob } from "../core/route.js";
import { attempt } from "../core/store.js";
import { start, unfinished } from "./running.js";

/** @param {{one: import("./running.js").Unfinished}} props */
function Item({ one }) {
  const password = useSignal(""), address = useSignal(""), busy = useSignal(false), resume = one.resume;
  // The folder may come from anybody: where a run was connected to is typed again.
  const live = resume?.find((word) => /^--rig=\w+:\/\//.test(word));
  const facts = [
    one.recorded && `${one.recorded.length}${one.postures ? ` of ${one.postures}` : ""} recorded.`,
    one.torn && "The last line is torn and will be left out.", one.why_not,
  ].filter(Boolean).join(" ");
  const again = () => {
    if (!resume) return;
    busy.value = true;
    attempt(async () => {
      await start(resume.map((word) => (word === live ? `--rig=${address.value.trim()}` : word)), password.value);
      go(toJob(route.value.name, "measure", one.file), { replace: true, sure: true });
    }).finally(() => { busy.value = false; });
  };
  return html`
    <li><p>${one.file} <small class="muted">${facts}</small></p>
      ${resume && html`<div class="bar">
        ${resume.includes("--rig=abb") && html`<input type="password" autocomplete="off" class="grow" aria-label=${`Password of the controller, for ${one.file}`} placeholder="Password" value=${password.value} onInput=${(/** @type {any} */ event) => { password.value = event.target.value; }} />`}
        ${live && html`<input type="text" autocomplete="off" spellcheck=${false} class="grow" aria-label=${`Address of the controller, for ${one.file}`} placeholder=${`${live.slice(6).split("://")[0]}://HOST`} value=${address.value} onInput=${(/** @type {any} */ event) => { address.value = event.target.value; }} />`}
        <button type="button" aria-label=${`Resume ${one.file}`} disabled=${busy.value || Boolean(live && !address.value.includes("://"))} onClick=${again}>Resume</button>
      </div>`}
    </li>`;
}

export function Unfinished() {
  if (!unfinished.value.length) return null;
  return html`<h2>Runs that have not reached their end</h2><ul class="unfinished">${unfinished.value.map((one) => html`<${Item} key=${one.file} one=${one} />`)}</ul>`;
}
