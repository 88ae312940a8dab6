// Runs that have not reached their end, to go on with.
import { html } from "htm/preact";
import { useSignal } from "@preact/signals";
import { calibrationOf, goOn, route, toJob } from "../core/route.js";
import { attempt } from "../core/store.js";
import { start, unfinished } from "./running.js";
import { into, TextField } from "../parts/Controls.js";

/** @param {{one: import("./running.js").Unfinished}} props */
function Item({ one }) {
  const password = useSignal(""), address = useSignal(""), busy = useSignal(false), resume = one.resume;
  // The folder may come from anybody: where the controller is has to be typed again, and the other options are shown.
  const { controller } = one, abb = controller === "abb", where = address.value.trim();
  const options = (resume ?? []).filter((word) => word.startsWith("--") && !/^--(resume$|out=|rig=)/.test(word))
    .join(" ");
  const facts = [
    one.recorded && `${one.recorded.length}${one.postures ? ` of ${one.postures}` : ""} recorded.`,
    one.torn && "The last line is torn and will be left out.", one.why_not,
  ].filter(Boolean).join(" ");
  const again = () => {
    if (!resume) return;
    const from = route.value;
    busy.value = true;
    attempt(async () => {
      await start(controller ? [...resume.slice(0, -1), `${abb ? "--host" : "--rig"}=${where}`, ...resume.slice(-1)]
        : resume,
        password.value);
      goOn(from, toJob(calibrationOf(one.file), "measure", one.file), { replace: true, sure: true });
    }).finally(() => { busy.value = false; });
  };
  return html`
    <li><p>${one.file} <small class="muted">${facts}</small></p>
      ${controller && options && html`<p class="muted">Resumes with the options that the folder has: ${options}</p>`}
      ${resume && html`<div class="bar">
        ${abb && html`
          <${TextField} label=${`Password of the controller, for ${one.file}`} secret value=${password.value}
            onValue=${into(password)} />`}
        ${controller && html`
          <${TextField} label=${`Address of the controller, for ${one.file}`} value=${address.value}
            placeholder=${abb ? "HOST" : `${controller}://HOST`} onValue=${into(address)} />`}
        <button type="button" aria-label=${`Resume ${one.file}`}
          disabled=${busy.value || Boolean(controller && !(abb ? where : where.includes("://")))}
          onClick=${again}>Resume</button>
      </div>`}
    </li>`;
}

export function Unfinished() {
  const { name } = route.value, own = unfinished.value.filter((one) => calibrationOf(one.file) === name);
  const others = unfinished.value.filter((one) => calibrationOf(one.file) !== name);
  return html`
    ${own.length > 0 && html`
      <h2>Runs that have not reached their end</h2>
      <ul class="unfinished">${own.map((one) => html`<${Item} key=${one.file} one=${one} />`)}</ul>`}
    ${others.length > 0 && html`
      <p class="muted elsewhere">Runs of other calibrations that have not reached their
        end: ${others.map((one, i) => html`
          ${i > 0 && ", "}
          <a key=${one.file} href=${toJob(calibrationOf(one.file), "measure", one.file)}>${one.file}</a>`)}</p>`}`;
}
