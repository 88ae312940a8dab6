// How a plan is to be carried out: by a simulation, by hand, by a robot.
import { html } from "htm/preact";
import { signal, useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { get } from "../core/api.js";
import { hasEdits, saveEdits, wrong } from "../core/editing.js";
import { calibrationOf, go, route, toJob } from "../core/route.js";
import { attempt, calibration, freeName, ofCalibration, ofKind } from "../core/store.js";
import { Check } from "../parts/Check.js";
import { Choice } from "../parts/Choice.js";
import { Fold } from "../parts/Fold.js";
import { Form, Submit } from "../parts/Form.js";
import { into } from "../parts/heard.js";
import { Joint3 } from "../parts/Joint3.js";
import { NumberField } from "../parts/NumberField.js";
import { TextField } from "../parts/TextField.js";
import { outOf } from "../core/jobs.js";
import { start } from "./running.js";

/** @typedef {number | null} Stated null: an empty field */
const USUAL = {
  rig: "simulated", cell: "", seed: /** @type {Stated} */ (0), camera: true, units: "deg", j3: "",
  host: "", speed: /** @type {Stated} */ (0.25), sensors: "", user: "", scheme: "", address: "",
  port: /** @type {Stated} */ (80), egmPort: /** @type {Stated} */ (6510), sensorPort: /** @type {Stated} */ (6520),
  laser: "Local/DRV_1/zb_laser", closing: false, adaptive: false, tolerance: /** @type {Stated} */ (null),
};
const chosen = ofCalibration(USUAL);

/**
 * The words of the command; what is left as it is usual is not stated.
 * @param {typeof USUAL} now @param {string} plan @param {string} out
 */
export function words(now, plan, out) {
  const list = ["run", `--out=${out}`,
    `--rig=${now.rig === "live" ? `${now.scheme}://${now.address.trim()}` : now.rig}`];
  const add = (/** @type {string} */ option, /** @type {keyof typeof USUAL} */ key) => {
    if (now[key] !== USUAL[key] && now[key] !== null && now[key] !== "") list.push(`${option}=${now[key]}`);
  };
  if (now.rig === "simulated") {
    add("--cell", "cell");
    list.push(`--seed=${now.seed ?? 0}`);
    if (!now.camera) list.push("--no-camera");
  } else if (now.rig === "live") {
    add("--j3", "j3");
    add("--sensors", "sensors");
  } else if (now.rig === "manual") {
    add("--units", "units");
    add("--j3", "j3");
  } else {
    add("--host", "host");
    add("--sensors", "sensors");
    add("--user", "user");
    list.push(`--speed=${now.speed ?? USUAL.speed}`, `--port=${now.port ?? USUAL.port}`,
      `--egm-port=${now.egmPort ?? USUAL.egmPort}`,
      `--sensor-port=${now.sensorPort ?? USUAL.sensorPort}`, `--laser=${now.laser || USUAL.laser}`);
  }
  if (now.closing) list.push("--closing");
  if (now.adaptive) {
    list.push("--adaptive");
    add("--tolerance", "tolerance");
  }
  return [...list, plan];
}

/** The makers' protocols by which joints are read. */
const live = signal(/** @type {import("answers").LiveForm[] | null} */ (null));

/**
 * Where the joints are read: nothing is connected before an address was typed.
 * @param {{now: typeof USUAL, set: (more: Partial<typeof USUAL>) => void}} props
 */
function Live({ now, set }) {
  useEffect(() => { if (live.value === null) attempt(async () => { live.value = await get("/api/live"); }); }, []);
  const maker = calibration.value?.maker ?? null; // another maker's protocol reads no joints of this arm
  const forms = (live.value ?? []).filter(({ vendor }) => vendor === null || maker === null || vendor === maker);
  const form = forms.find((one) => one.scheme === now.scheme);
  useEffect(() => {
    const usual = forms.find(({ vendor }) => vendor !== null && vendor === maker) ?? forms[0];
    if (!form && usual) set({ scheme: usual.scheme });
  }, [forms.length]);
  const options = form?.options.length ? `; options behind ?: ${form.options.map((one) => `${one}=`).join(", ")}` : "";
  return html`
    <${Choice} label="Controller of" value=${now.scheme}
      items=${forms.map((one) => [one.scheme, `${one.maker} (${one.scheme}://)`])}
      onValue=${chosen.at("scheme")} />
    <div>
      <${TextField} label="Controller’s address" value=${now.address} onValue=${chosen.at("address")} />
      <span class="help">host, or host:port (usual: ${form?.port ?? ""})${options}</span>
    </div>
    <${Joint3} value=${now.j3} onValue=${chosen.at("j3")} />
    <${Choice} label="Sensors" value=${now.sensors} none="each posture is confirmed here" items=${ofKind("sensors")}
      onValue=${chosen.at("sensors")} />
    <p class="muted wide">The controller’s program, or a person at the pendant, moves the arm.
      The joints are read there where you confirm a posture; moving or stale ones are refused.</p>`;
}

const BEGINS = {
  simulated: "Start the simulation", manual: "Start", live: "Start: connects to the controller",
  abb: "Start: asks before the robot moves",
};

/**
 * @param {{plan: string, offered: import("answers").OfferedRun | null, onPlan: (plan: string) => void}} props
 *   `offered` null: not read yet
 */
export function Start({ plan, offered, onPlan }) {
  const file = useSignal(""), password = useSignal(""), busy = useSignal(false);
  const set = (/** @type {Partial<typeof USUAL>} */ more) => { chosen.value = { ...chosen.value, ...more }; };
  // What was chosen for another plan holds as far as it can serve this one.
  const rig = offered?.rigs.find(({ name }) => name === chosen.value.rig)?.name ?? "simulated";
  const servo = offered?.servo ?? false, closing = offered?.closing ?? false;
  const now = { ...chosen.value, rig, closing: closing && chosen.value.closing,
    adaptive: servo && chosen.value.adaptive,
    ...(servo ? {} : { cell: "", camera: true }) };
  const plans = [...new Set([...(calibration.value?.files.plan ?? []), ...(plan ? [plan] : [])])];
  const proposed = plan ? freeName(plan.replace(/\.[^./]*$/, "-run.jsonl")) : "";
  const edited = hasEdits(plan);
  /** @param {boolean} saving whether the changes of the plan are saved before */
  const begin = (saving) => {
    busy.value = true;
    const list = words(now, plan, file.value.trim() || proposed);
    attempt(async () => {
      if (saving && !(await saveEdits(plan))) {
        if (wrong.value) throw wrong.value;
        return; // the file was changed elsewhere: both are shown, and one is chosen
      }
      await start(list, password.value);
      password.value = file.value = "";
      const out = outOf(list);
      go(toJob(calibrationOf(out), "measure", out), { replace: true, sure: true });
    }).finally(() => { busy.value = false; });
  };
  /** @param {string} label @param {"port" | "egmPort" | "sensorPort" | "seed" | "speed" | "tolerance"} key */
  const number = (label, key, more = {}) => html`
    <${NumberField} label=${label} value=${now[key]} onValue=${chosen.at(key)} ...${more} />`;
  const port = { whole: true, least: 1, most: 65535 };
  /** @param {string} label @param {"camera" | "closing" | "adaptive"} key */
  const check = (label, key) => html`<${Check} wide on=${now[key]} onTurn=${chosen.at(key)}>${label}<//>`;
  const unready = busy.value || !plan || offered === null || (rig === "live" && !(now.scheme && now.address.trim()));
  if (!plans.length) return html`<p>A run needs a plan. <a href=${toJob(route.value.name, "plan")}>Make one</a></p>`;
  return html`
    <${Form} class="start" aria-label="Start a run"
      onSubmit=${(/** @type {Event} */ event) => { event.preventDefault(); begin(edited); }}>
      <fieldset class="rigs"><legend class="label">What carries the plan out</legend>
        ${offered?.rigs.map(({ name, words }) => html`
          <label class="check" key=${name}>
            <input type="radio" name="rig" value=${name} checked=${rig === name}
              onChange=${() => set({ rig: name })} /> ${words}</label>`)}
      </fieldset>
      <div class="fields">
        <div class="wide"><${Choice} label="Plan" value=${plan} items=${plans} onValue=${onPlan} /></div>
        <div class="wide">
          <${TextField} label="Run file" value=${file.value} placeholder=${proposed} onValue=${into(file)} /></div>
        ${rig === "simulated" && html`
          ${servo && html`<${Choice} label="Cell" value=${now.cell} none="an ordinary one" items=${ofKind("cell")}
            onValue=${chosen.at("cell")} />`}
          ${number("Random seed", "seed", { whole: true, least: 0 })}
          ${servo && check("Camera", "camera")}`}
        ${rig === "manual" && html`
          <${Choice} label="Angles in" value=${now.units} items=${[["deg", "degrees"], ["rad", "radians"]]}
            onValue=${chosen.at("units")} />
          <${Joint3} value=${now.j3} onValue=${chosen.at("j3")} />`}
        ${rig === "live" && html`<${Live} now=${now} set=${set} />`}
        ${rig === "abb" && html`
          <${TextField} label="Controller’s address" value=${now.host} placeholder="192.168.125.1"
            onValue=${chosen.at("host")} />
          ${number("Share of the joints’ top speeds", "speed", { least: 0.01, most: 1 })}
          <${TextField} label="User" value=${now.user} placeholder="Default User" onValue=${chosen.at("user")} />
          <${TextField} label="Password" secret value=${password.value} onValue=${into(password)} />
          <${Choice} label="Sensors" value=${now.sensors} none="those of the simulated controller"
            items=${ofKind("sensors")}
            onValue=${chosen.at("sensors")} />`}
      </div>
      ${(servo || closing) && html`
        <${Fold} title="Order, closing measurement${rig === "abb" ? ", ports" : ""}" kept><div class="fields">
        ${closing && check("Measure the first posture again at the end", "closing")}
        ${servo && check("Adaptive: choose the next posture by the measurements, end when u is small enough",
          "adaptive")}
        ${now.adaptive
          && number("u that is enough, ° or mm", "tolerance", { optional: true, least: 0, placeholder: "the plan’s" })}
        ${rig === "abb" && html`
          ${number("Port of Robot Web Services", "port", port)}${number("Own UDP port for EGM", "egmPort", port)}
          ${number("Port of PSD and camera", "sensorPort", port)}
          <${TextField} label="Output of the laser" value=${now.laser} onValue=${chosen.at("laser")} />`}
      </div><//>`}
      ${edited && html`<p class="notes-line" role="status">${plan} has changes that are not saved.</p>`}
      <p class="bar">
        <${Submit} disabled=${unready}>${edited ? "Save the plan. " : ""}${BEGINS[rig]}<//>
        ${edited && html`
          <button type="button" disabled=${unready}
            onClick=${() => begin(false)}>Start by the plan as it was saved</button>`}
      </p>
    <//>`;
}
