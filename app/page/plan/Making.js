// Another plan by the command `plan`: the best of many candidate postures, or a pattern of the paper.
import { html } from "htm/preact";
import { useSignal } from "@preact/signals";
import { getFile, put, Refused } from "../core/api.js";
import { parsedList } from "../core/decimal.js";
import { answer, chosen, plan } from "../core/editing.js";
import { well } from "../core/jobs.js";
import { calibrationOf, goOn, route, toJob } from "../core/route.js";
import { attempt, calibration, failed, freeName, inside, ofCalibration, ofKind } from "../core/store.js";
import { sentence } from "../core/words.js";
import { Choice } from "../parts/Choice.js";
import { Fold } from "../parts/Fold.js";
import { Form, Submit } from "../parts/Form.js";
import { useCommand } from "../parts/JobProgress.js";
import { NumberField } from "../parts/NumberField.js";
import { TextField } from "../parts/TextField.js";
import { into } from "../parts/heard.js";

/** @typedef {import("../core/editing.js").PlanContent} PlanContent */

const OF_PLAN = " "; // the header of the plan that is open: no file has this name

/** What is asked for; null: not stated. */
const wish = ofCalibration({
  kind: "optimal", target: /** @type {(number | null)[]} */ ([null, null, null]),
  shots: /** @type {number | null} */ (null), repeat: /** @type {number | null} */ (null),
  tolerance: /** @type {number | null} */ (null), most: /** @type {number | null} */ (30),
  criterion: "A", candidates: /** @type {number | null} */ (10000), facing: "0, 0, 1",
  acceptance: /** @type {number | null} */ (60), shortest: /** @type {number | null} */ (200),
  longest: /** @type {number | null} */ (2000),
  margin: /** @type {number | null} */ (5), obstacles: "", seed: /** @type {number | null} */ (0),
});

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

/** @param {string} header @param {string} out @param {number[] | null} target @returns {string[]} */
function words(header, out, target) {
  const now = wish.value, best = now.kind === "optimal";
  /** @type {[string, unknown][]} */
  const options = [["--header", header], ["--out", out], ["--target", target?.join(",")]];
  if (!best || now.tolerance === null) options.push(["--shots", now.shots]);
  options.push(["--repeat", now.repeat]);
  if (best) {
    if (now.tolerance !== null) options.push(["--tolerance", now.tolerance], ["--max-shots", now.most]);
    options.push(["--criterion", now.criterion], ["--candidates", now.candidates],
      ["--facing", now.facing.trim() === "any" ? "any" : parsedList(now.facing)?.join(",")],
      ["--acceptance", now.acceptance],
      ["--beam", now.shortest === null || now.longest === null ? null : `${now.shortest},${now.longest}`],
      ["--margin", now.margin], ["--obstacles", now.obstacles], ["--seed", now.seed]);
  }
  return ["plan", now.kind,
    ...options.filter(([, value]) => value !== "" && value !== null && value !== undefined)
      .map(([name, value]) => `${name}=${value}`)];
}

export function Making() {
  const headers = [...(plan.value ? [[OF_PLAN, "of the plan that is open"]] : []),
    ...[...new Set([...(calibration.value?.files.header ?? []), ...ofKind("header")])].map((one) => [one, one])];
  const header = useSignal(headers[0]?.[0] ?? ""), out = useSignal("");
  const { busy, carryOut, progress } = useCommand();
  const lines = useSignal(/** @type {string[]} */ ([]));
  const now = wish.value, best = now.kind === "optimal";
  const set = (/** @type {Partial<typeof wish.value>} */ more) => { wish.value = { ...wish.value, ...more }; };
  const proposed = freeName(`${inside(route.value.name)}plan.yaml`);
  const there = answer.value?.scene?.[chosen.value]?.target;
  if (!headers.length) {
    return html`
      <p class="muted">A plan needs a header (robot, instrument and noise). Begin with
        a <a href="#/new">new calibration</a>.</p>`;
  }
  const make = (/** @type {Event} */ event) => {
    event.preventDefault();
    const from = route.value;
    attempt(async () => {
      lines.value = [];
      const to = out.value.trim() || proposed;
      const stated = now.target.every((one) => one !== null) ? /** @type {number[]} */ (now.target)
        : there ? there.map((/** @type {number} */ v) => Number(v.toFixed(3))) : null;
      const stating = header.value === OF_PLAN ? await headerFile(to) : header.value;
      const ended = await carryOut(words(stating, to, stated), "Making the plan");
      if (!well(ended) || !ended.answer) return;
      lines.value = [...ended.answer.said, ...(ended.answer.removed ? [ended.answer.removed] : [])];
      if (ended.answer.plan !== null) goOn(from, toJob(calibrationOf(to), "plan", to));
    }).catch(failed);
  };
  const number = (/** @type {string} */ label, /** @type {keyof typeof wish.value} */ key, more = {}) => html`
    <${NumberField} label=${label} value=${now[key]} optional onValue=${wish.at(key)} ...${more} />`;
  return html`
    <${Form} class="making" onSubmit=${make}>
      <div class="fields">
        <${Choice} label="Kind" value=${now.kind}
          items=${[["optimal", "optimal"], ["x", "X-Pattern"], ["y", "Y-Pattern"]]} onValue=${wish.at("kind")} />
        <${Choice} label="Header" value=${header.value} items=${headers} onValue=${into(header)} />
        ${number("Measurements", "shots", { whole: true, least: 2, placeholder: "as usual" })}
        ${best && number("… or as few as reach u, °", "tolerance", { least: 0 })}
        ${number("Again at the end", "repeat", { whole: true, least: 0, placeholder: "2" })}
        ${["x", "y", "z"].map((axis, i) => html`
          <${NumberField} label=${`Target ${axis}`} unit="mm" optional=${now.target.every((one) => one === null)}
            value=${now.target[i]} placeholder=${there ? String(Math.round(there[i])) : "the header's"}
            onValue=${(/** @type {number | null} */ value) =>
              set({ target: now.target.map((one, k) => (k === i ? value : one)) })} />`)}
        <${TextField} label="New file" value=${out.value} placeholder=${proposed} onValue=${into(out)} />
      </div>
      ${best && html`<${Fold} title="Constraints and search" kept><div class="fields">
        <${TextField} label="Normal of the target, or any" value=${now.facing}
          error=${now.facing.trim() === "any" || parsedList(now.facing)?.length === 3 ? ""
            : "allowed: three numbers, or any"}
          onValue=${wish.at("facing")} />
        ${number("Largest angle to it", "acceptance", { unit: "°" })}${number("Shortest beam", "shortest",
          { unit: "mm" })}${number("Longest beam", "longest", { unit: "mm" })}${number("Margin to limits", "margin",
          { unit: "°", least: 0 })}
        <${Choice} label="Obstacles" value=${now.obstacles} none="none" items=${ofKind("obstacles")}
          onValue=${wish.at("obstacles")} />
        <${Choice} label="Criterion" value=${now.criterion}
          items=${[["A", "A: mean variance"], ["D", "D: generalised variance"], ["E", "E: largest variance"]]}
          onValue=${wish.at("criterion")} />
        ${number("At most, with u", "most", { whole: true, least: 2 })}${number("Candidates", "candidates",
          { whole: true, least: 10 })}${number("Random seed", "seed", { whole: true, least: 0 })}
      </div><//>`}
      <p class="bar"><${Submit} disabled=${busy}>Make the plan<//></p>
      ${progress()}
      <ul class="lines">${lines.value.map((line) => html`<li>${sentence(line)}</li>`)}</ul>
    <//>`;
}
