// A new calibration: arm, instrument, and where the target is. The server has the defaults, makes the plan and checks
// it.
import { html } from "htm/preact";
import { useEffect, useMemo } from "preact/hooks";
import { useSignal } from "@preact/signals";
import { get, latest, post, Refused } from "../core/api.js";
import { well } from "../core/jobs.js";
import { goOn, route, toJob } from "../core/route.js";
import { failed, freeName, ofKind, refresh, robots } from "../core/store.js";
import { MOUNTED, mountedWords } from "../core/mounting.js";
import { fixed, sentence } from "../core/words.js";
import { Cards, Choice, into, NumberField, TextField, Vector } from "../parts/Controls.js";
import { Fold } from "../parts/Fold.js";
import { Form, Submit } from "../parts/Form.js";
import { useCommand } from "../parts/JobProgress.js";

/** The built-in arms by maker, then robot files of the folder. @returns {[string, [string, string][]][]} */
function robotGroups() {
  const makers = [...new Set(robots.value.map((one) => one.vendor ?? "other"))].sort();
  /** @type {[string, [string, string][]][]} */
  const groups = makers.map((maker) =>
    [maker,
      robots.value.filter((one) => (one.vendor ?? "other") === maker).map((one) => [one.name, one.model ?? one.name])]);
  return [...groups,
    ["files of this folder", ofKind("robot").filter((path) => !path.endsWith(".urdf")).map((path) => [path, path])]];
}

/**
 * Takes a calibration back whose plan was not made; says what is left.
 * @param {{name: string, version: string}} made
 */
async function withdrawn({ name, version }) {
  try {
    await post("/api/calibrations/withdraw", { name, version });
    return "Nothing is left in the folder. Change the entries, and make the plan again.";
  } catch (error) {
    if (!(error instanceof Refused)) throw error;
    return `The folder ${name} is left, with a header and without a plan.`;
  }
}

export function New() {
  const choices = useSignal(/** @type {import("answers").CalibrationChoices | null} */ (null));
  const robot = useSignal(""), instrument = useSignal(""), place = useSignal(""), name = useSignal("");
  const serial = useSignal("");
  const point = useSignal(/** @type {(number | null)[]} */ ([null, null, null]));
  const measurements = useSignal(/** @type {number | null} */ (null));
  const wrong = useSignal(/** @type {Refused | null} */ (null)), sent = useSignal("");
  const lines = useSignal(/** @type {string[]} */ ([]));
  const proposal = useSignal(/** @type {import("answers").CalibrationProposal | null} */ (null));
  /** How the instrument is mounted where that is not as assumed. */
  const mounted = useSignal(/** @type {Record<string, number[]>} */ ({}));
  const { busy, carryOut, progress } = useCommand();
  useEffect(() => { get("/api/calibrations/choices").then((found) => {
    choices.value = found;
    instrument.value = found.instruments[0].name;
    place.value = found.places[0].kind;
  }, failed); }, []);
  const propose = useMemo(() => latest(
    () => robot.value + instrument.value,
    () => (robot.value && instrument.value
      ? post("/api/calibrations/proposal", { robot: robot.value, instrument: instrument.value })
      : Promise.resolve(null)),
    (found) => { proposal.value = found; },
    () => {}, // what is wrong with the robot is said once a plan is made
  ), []);
  useEffect(() => { proposal.value = null; mounted.value = {}; propose(); }, [robot.value, instrument.value]);
  if (choices.value === null) return html`<p class="muted">…</p>`;
  const { instruments, places } = choices.value;
  const proposed = freeName(robot.value.replace(/^.*\//, "").replace(/\.\w+$/, "") || "calibration");
  const at_mm = (/** @type {string} */ kind) => {
    const at = proposal.value?.places.find((one) => one.kind === kind)?.at_mm;
    return at && `x, y, z = ${at.map((v) => fixed(v, 0)).join(", ")} mm in the base frame`;
  };
  const assumed = proposal.value?.mounted ?? {}, mounting = Object.entries({ ...assumed, ...mounted.value });
  const entries = () => ({
    name: name.value.trim() || proposed, robot: robot.value, instrument: instrument.value,
    place: { kind: place.value, ...(place.value === "point" ? { point_mm: point.value } : {}) },
    mounted: mounted.value,
    ...(serial.value.trim() ? { serial: serial.value.trim() } : {}),
    ...(measurements.value ? { measurements: measurements.value } : {}),
  });
  const make = async () => {
    const from = route.value, stated = entries();
    wrong.value = null;
    lines.value = [];
    sent.value = JSON.stringify(stated);
    try {
      const made = await post("/api/calibrations", stated);
      const ended = await carryOut(made.command, "Making the plan");
      if (well(ended) && ended.answer?.plan) {
        goOn(from, toJob(made.name, "plan"));
        return;
      }
      const left = ended.gone ? "" : await withdrawn(made);
      lines.value = ["No plan was made", ...(ended.answer?.said ?? []),
        ...(ended.answer?.removed ? [ended.answer.removed] : []), left].filter(Boolean);
      await refresh();
    } catch (error) {
      if (!(error instanceof Refused)) throw error;
      wrong.value = error;
    }
  };
  // What was refused is of what was sent: another entry is not refused before it is sent.
  const refusal = sent.value === JSON.stringify(entries()) ? wrong.value : null;
  const at = (/** @type {string} */ key) => (refusal?.key[0] === key ? refusal.text : "");
  const known = ["name", "robot", "serial"].includes(String(refusal?.key[0]));
  return html`
    <${Form} class="new" onSubmit=${make}>
      <fieldset><legend><b>1</b> Which arm?</legend>
        <${Choice} label="Robot" value=${robot.value} groups=${robotGroups()} none="choose an arm"
          onValue=${into(robot)} />
        ${at("robot") && html`<p class="error" role="alert">${at("robot")}</p>`}
        <p class="muted">Not in the list: put its robot file or URDF into the folder; <code>zerobeam robot</code> shows
          what is expected.</p>
      </fieldset>
      <fieldset class="cards"><legend><b>2</b> Which instrument?</legend>
        <${Cards} name="instrument" value=${instrument.value} onValue=${into(instrument)}
          items=${instruments.map((one) => ({ value: one.name, title: one.words, about: one.about }))} />
      </fieldset>
      <fieldset class="cards"><legend><b>3</b> Where is the target?</legend>
        <${Cards} name="place" value=${place.value} onValue=${into(place)}
          items=${places.map((one) => ({ value: one.kind, title: one.words, about: at_mm(one.kind) }))} />
        ${place.value === "point" && html`
          <div class="fields">
            <${Vector} label="Target" unit="mm" values=${point.value} onValue=${into(point)} /></div>`}
      </fieldset>
      ${mounting.length > 0 && html`
        <p>${Object.keys(mounted.value).length ? "On the flange"
          : "Assumed on the flange"}: ${mountedWords(Object.fromEntries(mounting))},
          in the flange frame. The plan depends on it.</p>
        <${Fold} key=${`${robot.value} ${instrument.value}`} title="Mounted otherwise" kept><div class="fields">
          ${mounting.map(([key, values]) => html`
            <${Vector} key=${key} label=${MOUNTED[key]?.[0] ?? key} unit=${MOUNTED[key]?.[1] ?? ""} values=${values}
              onValue=${(/** @type {number[]} */ next) => { mounted.value = { ...mounted.value, [key]: next }; }} />`)}
        </div><//>`}
      <${Fold} title="Name, serial number, number of measurements" kept>
        <div class="fields">
          <${TextField} label="Name of the calibration" value=${name.value} placeholder=${proposed} error=${at("name")}
            sent onValue=${into(name)} />
          <${TextField} label="Serial number of the arm" value=${serial.value} error=${at("serial")} sent
            onValue=${into(serial)} />
          <${NumberField} label="Measurements" value=${measurements.value} optional whole least=${2}
            placeholder="as few as are enough" onValue=${into(measurements)} />
        </div>
      <//>
      ${refusal && !known && html`<p class="error" role="alert">${refusal.text}</p>`}
      ${at("name") && html`<p class="error" role="alert">${at("name")}</p>`}
      <p class="bar"><${Submit} disabled=${busy || !robot.value}>Make the plan<//>
        ${!robot.value && html`<span class="muted">Choose an arm first.</span>`}</p>
      ${progress()}
      <ul class="lines" role="alert">${lines.value.map((line) => html`<li>${sentence(line)}</li>`)}</ul>
    <//>`;
}
