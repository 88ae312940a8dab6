// A program corrected by what a run determined: for controllers whose joints' zeros cannot be set.
import { html } from "htm/preact";
import { signal, useSignal } from "@preact/signals";
import { downloadOf, upload } from "../core/api.js";
import { begin, over, well } from "../core/jobs.js";
import { route } from "../core/route.js";
import { attempt, files, freeName, inside, refresh } from "../core/store.js";
import { Choice } from "../parts/Choice.js";
import { Fold } from "../parts/Fold.js";
import { JobProgress } from "../parts/JobProgress.js";
import { Notes } from "./Notes.js";
import { TextField } from "../parts/TextField.js";

const PROGRAM = /\.(mod|src|dat|ls|script)$/i;
const RISKS = { "allow-weak": "Weakly observable offsets, too", "allow-displaced": "Although a target seems to have moved", unvalidated: "In spite of a misfit" };

/** What is typed for options that may be stated several times, one a line. */
const options = signal({ tool: "", frame: "", near: "", leave: "", call: "", j3: "", without: "" });
const risks = signal(/** @type {string[]} */ ([]));

/** @param {{run: string}} props */
export function Program({ run }) {
  const program = useSignal(""), out = useSignal("");
  /** @type {import("@preact/signals").Signal<{job: import("../core/jobs.js").Followed, out: string} | null>} */
  const made = useSignal(null);
  const proposed = program.value && freeName(program.value.replace(/(\.\w+)$/, "-corrected$1"));
  const send = (/** @type {FileList | null} */ list) => attempt(async () => {
    for (const file of list ?? []) program.value = (await upload(freeName(`${inside(route.value.name)}${file.name}`), file)).file;
    await refresh();
  });
  const set = (/** @type {Partial<typeof options.value>} */ more) => { options.value = { ...options.value, ...more }; };
  const write = (/** @type {Event} */ event) => {
    event.preventDefault();
    attempt(async () => {
      const to = out.value.trim() || proposed;
      const words = Object.entries(options.value).flatMap(([name, text]) => text.split("\n").map((one) => one.trim()).filter(Boolean).map((one) => `--${name}=${one}`));
      const job = await begin(["export", "program", `--out=${to}`, ...words, ...risks.value.map((one) => `--${one}`), run, program.value]);
      made.value = { job, out: to };
      if (well(await job.ended)) await refresh();
    });
  };
  const text = (/** @type {keyof typeof options.value} */ name, /** @type {string} */ label, /** @type {string} */ example) => html`<${TextField} label=${label} value=${options.value[name]} placeholder=${example} onValue=${(/** @type {string} */ value) => set({ [name]: value })} />`;
  return html`
    <form class="program" onSubmit=${write}>
      <p class="muted">Where the controller takes no offsets: the targets of a program are changed, so that the arm reaches what the program means. All else stays as it is; a statement that is not understood is refused, by line.</p>
      <p class="muted">Correct calculated targets only: targets that were taught on this arm hold its offsets already. Tool and user frames that the program names by number are stated below.</p>
      <${Choice} label="Program of the folder" value=${program.value} none="choose a program" groups=${[["", files.value.filter((one) => PROGRAM.test(one.path)).map((one) => [one.path, one.path])]]} onValue=${(/** @type {string} */ value) => { program.value = value; made.value = null; }} />
      <label><span class="label">or send one: .mod, .src with .dat, .ls, .script</span><input type="file" multiple accept=".mod,.src,.dat,.ls,.script" onChange=${(/** @type {any} */ event) => send(event.target.files)} /></label>
      <${Fold} title="Tool, frame, targets to leave"><div class="fields">
        ${text("tool", "Tool, [NAME=]pose", "0,0,100,0,0,0")}${text("frame", "Frame, [NAME=]pose", "500,0,0,0,0,0")}${text("near", "Joints near targets without a configuration", "0,-30,30,0,60,0")}
        ${text("leave", "Leave this target", "P[3]")}${text("call", "Routine that moves nothing", "GRIP")}${text("without", "Without this offset", "delta4")}
        <${Choice} label="FANUC: joint 3 is counted from" value=${options.value.j3} none="as the robot file states" groups=${[["", [["ground", "the ground"], ["link", "link 2"]]]]} onValue=${(/** @type {string} */ j3) => set({ j3 })} />
        ${Object.entries(RISKS).map(([name, label]) => html`<label class="check" key=${name}><input type="checkbox" checked=${risks.value.includes(name)} onChange=${() => { risks.value = risks.value.includes(name) ? risks.value.filter((one) => one !== name) : [...risks.value, name]; }} /> ${label}</label>`)}
      </div><//>
      <${TextField} label="New file" value=${out.value} placeholder=${proposed} onValue=${(/** @type {string} */ value) => { out.value = value; }} />
      <p class="bar"><button class="main" disabled=${!program.value || (made.value !== null && !over(made.value.job.state.value))}>Correct the program</button></p>
      ${made.value && html`<${JobProgress} job=${made.value.job} title="Corrected program">
        <p><a class="button" href=${downloadOf(made.value.out)} download>Download ${made.value.out.replace(/^.*\//, "")}</a></p>
        <${Notes} job=${made.value.job} />
        <p class="muted">The new joints are not checked against limits and obstacles. Try the program at reduced speed.</p><//>`}
    </form>`;
}
