// A program corrected by what a run determined: for controllers whose joints' zeros cannot be set.
import { html } from "htm/preact";
import { signal, useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { get, Refused, upload } from "../core/api.js";
import { route } from "../core/route.js";
import { attempt, files, freeName, inside, refresh } from "../core/store.js";
import { capital } from "../core/words.js";
import { Choice } from "../parts/Choice.js";
import { Fold } from "../parts/Fold.js";
import { Joint3 } from "../parts/Joint3.js";
import { TextField } from "../parts/TextField.js";
import { useWritten, Written } from "../parts/Written.js";
import { Risks } from "./Risks.js";

/** Endings of the languages that are corrected, as the makers have them. */
const endings = signal(/** @type {string[]} */ ([]));

/** What is typed for options that may be stated several times, one a line. */
const options = signal({ tool: "", frame: "", near: "", leave: "", call: "", j3: "", without: "" });
/** What is typed for the tools and frames that the program names, by `PoseToState`. @type {import("@preact/signals").Signal<Record<string, string>>} */
const typed = signal({});
const risks = signal(/** @type {string[]} */ ([]));

/** @typedef {{what: "tool" | "frame", name: string, form: string}} PoseToState */
const poseKey = (/** @type {PoseToState} */ pose) => `${pose.what} ${pose.name}`;

/** @param {{run: string}} props */
export function Program({ run }) {
  const program = useSignal(""), out = useSignal("");
  const { made, onSubmit } = useWritten();
  useEffect(() => { attempt(async () => { if (!endings.value.length) endings.value = (await get("/api/languages")).flatMap((/** @type {{endings: string[]}} */ language) => language.endings); }); }, []);
  /** @type {import("@preact/signals").Signal<PoseToState[]>} */
  const poses = useSignal([]);
  useEffect(() => {
    const name = program.value;
    poses.value = [];
    if (name) get(`/api/program?file=${encodeURIComponent(name)}&run=${encodeURIComponent(run)}`).then((/** @type {PoseToState[]} */ found) => { if (program.value === name) poses.value = found; }, (error) => {
      if (!(error instanceof Refused)) throw error; // then the command says why
    });
  }, [program.value]);
  const proposed = program.value && freeName(program.value.replace(/(\.\w+)$/, "-corrected$1"));
  const send = (/** @type {FileList | null} */ list) => attempt(async () => {
    for (const file of list ?? []) program.value = (await upload(freeName(`${inside(route.value.name)}${file.name}`), file)).file;
    await refresh();
  });
  const set = (/** @type {Partial<typeof options.value>} */ more) => { options.value = { ...options.value, ...more }; };
  const ask = () => {
    const to = out.value.trim() || proposed;
    const words = Object.entries(options.value).flatMap(([name, text]) => text.split("\n").map((one) => one.trim()).filter(Boolean).map((one) => `--${name}=${one}`));
    const stated = poses.value.flatMap((pose) => { const text = typed.value[poseKey(pose)]?.trim(); return text ? [`--${pose.what}=${pose.name && `${pose.name}=`}${text}`] : []; });
    return { words: ["export", "program", `--out=${to}`, ...stated, ...words, ...risks.value, run, program.value], files: [to] };
  };
  const text = (/** @type {keyof typeof options.value} */ name, /** @type {string} */ label, /** @type {string} */ example) => html`<${TextField} label=${label} value=${options.value[name]} placeholder=${example} onValue=${(/** @type {string} */ value) => set({ [name]: value })} />`;
  return html`
    <form class="program" onSubmit=${onSubmit(ask)}>
      <p class="muted">Where the controller takes no offsets: the targets of a program are changed, so that the arm reaches what the program means. All else stays as it is; a statement that is not understood is refused, by line.</p>
      <p class="muted">Correct calculated targets only: targets that were taught on this arm hold its offsets already. Of tools and frames that the program names by number only, the poses are entered below.</p>
      <${Choice} label="Program of the folder" value=${program.value} none="choose a program" groups=${[["", files.value.filter((one) => endings.value.some((ending) => one.path.toLowerCase().endsWith(ending))).map((one) => [one.path, one.path])]]} onValue=${(/** @type {string} */ value) => { program.value = value; made.value = null; }} />
      <label><span class="label">or send one (${[...new Set(endings.value)].join(", ")}; of KRL .src and .dat)</span><input type="file" multiple accept=${endings.value.join(",")} onChange=${(/** @type {any} */ event) => send(event.target.files)} /></label>
      ${poses.value.map((pose) => html`<${TextField} key=${poseKey(pose)} label=${`${capital(poseKey(pose).trim())}: ${pose.form}`} value=${typed.value[poseKey(pose)] ?? ""} onValue=${(/** @type {string} */ value) => { typed.value = { ...typed.value, [poseKey(pose)]: value }; }} />`)}
      <${Fold} title="Other tools and frames, targets to leave" kept><div class="fields">
        ${text("tool", "Tool, [NAME=]pose", "0,0,100,0,0,0")}${text("frame", "Frame, [NAME=]pose", "500,0,0,0,0,0")}${text("near", "Joints near targets without a configuration", "0,-30,30,0,60,0")}
        ${text("leave", "Leave this target", "P[3]")}${text("call", "Routine that moves nothing", "GRIP")}${text("without", "Without this offset", "delta4")}
        <${Joint3} value=${options.value.j3} onValue=${(/** @type {string} */ j3) => set({ j3 })} />
        <${Risks} flags=${risks} />
      </div><//>
      <${TextField} label="New file" value=${out.value} placeholder=${proposed} onValue=${(/** @type {string} */ value) => { out.value = value; }} />
      <${Written} made=${made} button="Correct the program" title="Corrected program" disabled=${!program.value} after="The new joints are not checked against limits and obstacles. Try the program at reduced speed." />
    </form>`;
}
