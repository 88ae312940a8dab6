// Another plan by the command `plan`: the best of many candidate postures, or a pattern of the paper.
import { html } from "htm/preact";
import { useSignal } from "@preact/signals";
import { getFile, put, Refused } from "../core/api.js";
import { answer, chosen, plan } from "../core/editing.js";
import { well } from "../core/jobs.js";
import { calibrationOf, goOn, route, toJob } from "../core/route.js";
import { calibration, freeName, inside, ofCalibration, ofKind, typedIn } from "../core/store.js";
import { sentence } from "../core/words.js";
import { Choice, into, TextField } from "../parts/Controls.js";
import { Fields, useForms, wordsOf } from "../parts/Fields.js";
import { Form, Submit } from "../parts/Form.js";
import { useCommand } from "../parts/JobProgress.js";

/** @typedef {import("../core/editing.js").PlanContent} PlanContent */

const OF_PLAN = " "; // the header of the plan that is open: no file has this name
const kind = ofCalibration("optimal"), typed = typedIn();

/** What all measurements have in common, as a header file beside the plan states it. @param {PlanContent} content */
function headerOf(content) {
  const { schema, postures_deg, constraints, targets, ...header } = content;
  const names = Object.keys(targets ?? {});
  return names.length === 1 && ["psd", "socket"].includes(names[0]) ? { ...header, targets } : header;
}

/** The header of the plan that is open, as a file: a new one, or the same. @param {string} out */
async function headerFile(out) {
  const name = out.replace(/\.ya?ml$/, "-header.yaml"), header = headerOf(/** @type {PlanContent} */ (plan.value));
  try {
    await put("/api/header", { file: name, header });
  } catch (error) {
    if (!(error instanceof Refused) || error.status === 0) throw error;
    const same = await getFile("header", name).catch(() => null);
    if (JSON.stringify(same?.header) !== JSON.stringify(header)) throw error;
  }
  return name;
}

export function Making() {
  const headers = [...(plan.value ? [[OF_PLAN, "of the plan that is open"]] : []),
    ...[...new Set([...(calibration.value?.files.header ?? []), ...ofKind("header")])].map((one) => [one, one])];
  const header = useSignal(headers[0]?.[0] ?? ""), out = useSignal(""), forms = useForms("plan");
  const { busy, carryOut, progress } = useCommand(), lines = useSignal(/** @type {string[]} */ ([]));
  const form = forms.find((one) => one.name === kind.value);
  const proposed = freeName(`${inside(route.value.name)}plan.yaml`);
  // Where the target of the posture is that is looked at, unless another place is stated.
  const there = answer.value?.scene?.[chosen.value]?.target.map((v) => Number(v.toFixed(3))).join(",");
  if (!headers.length) {
    return html`
      <p class="muted">A plan needs a header (robot, instrument and noise). Begin with
        a <a href="#/new">new calibration</a>.</p>`;
  }
  if (!form) return html`<p class="muted">…</p>`;
  const make = async () => {
    const from = route.value, to = out.value.trim() || proposed;
    lines.value = [];
    const values = there && !typed.value["--target"] ? { ...typed.value, "--target": there } : typed.value;
    const stating = header.value === OF_PLAN ? await headerFile(to) : header.value;
    const ended = await carryOut([...form.command, `--header=${stating}`, `--out=${to}`,
      ...wordsOf(form.fields, values)], "Making the plan");
    if (!well(ended) || !ended.answer) return;
    lines.value = [...ended.answer.said, ...(ended.answer.removed ? [ended.answer.removed] : [])];
    if (ended.answer.plan !== null) goOn(from, toJob(calibrationOf(to), "plan", to));
  };
  return html`
    <${Form} class="making" onSubmit=${make}>
      <div class="fields told">
        <${Choice} label="Kind" value=${kind.value} items=${forms.map((one) => [one.name, one.label])}
          onValue=${into(kind)} />
        <${Choice} label="Header" value=${header.value} items=${headers} onValue=${into(header)} /></div>
      <${Fields} key=${form.name} fields=${form.fields} values=${typed.value} onValue=${typed.set}
        usual=${there ? { "--target": there } : {}} title="Constraints and search">
        <${TextField} label="New file" value=${out.value} placeholder=${proposed} onValue=${into(out)} /><//>
      <p class="bar"><${Submit} disabled=${busy}>Make the plan<//></p>
      ${progress()}
      <ul class="lines">${lines.value.map((line) => html`<li>${sentence(line)}</li>`)}</ul>
    <//>`;
}
