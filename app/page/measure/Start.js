// How a plan is to be carried out: by a simulation, by hand, by a robot.
import { html } from "htm/preact";
import { signal, useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { get } from "../core/api.js";
import { hasEdits, saveEdits, wrong } from "../core/editing.js";
import { calibrationOf, go, route, toJob } from "../core/route.js";
import { attempt, calibration, freeName, ofCalibration, ofKind } from "../core/store.js";
import { Choice } from "../parts/Choice.js";
import { Fold } from "../parts/Fold.js";
import { Form, Submit } from "../parts/Form.js";
import { Joint3 } from "../parts/Joint3.js";
import { NumberField } from "../parts/NumberField.js";
import { TextField } from "../parts/TextField.js";
import { outOf } from "../core/jobs.js";
import { start } from "./running.js";

const USUAL = {
  rig: "simulated", cell: "", seed: /** @type {number | null} */ (0), camera: true, units: "deg", j3: "", host: "", speed: /** @type {number | null} */ (0.25), sensors: "", user: "",
  scheme: "", address: "",
  port: /** @type {number | null} */ (80), egmPort: /** @type {number | null} */ (6510), sensorPort: /** @type {number | null} */ (6520), laser: "Local/DRV_1/zb_laser", closing: false, adaptive: false, tolerance: /** @type {number | null} */ (null),
};
const chosen = ofCalibration(USUAL);

/** The words of the command; what is left as it is usual is not stated. @param {typeof USUAL} now @param {string} plan @param {string} out */
export function words(now, plan, out) {
  const list = ["run", `--out=${out}`, `--rig=${now.rig === "live" ? `${now.scheme}://${now.address.trim()}` : now.rig}`];
  const add = (/** @type {string} */ option, /** @type {keyof typeof USUAL} */ key) => { if (now[key] !== USUAL[key] && now[key] !== null && now[key] !== "") list.push(`${option}=${now[key]}`); };
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
    for (const [option, key] of /** @type {[string, keyof typeof USUAL][]} */ ([["--host", "host"], ["--sensors", "sensors"], ["--user", "user"]])) add(option, key);
    list.push(`--speed=${now.speed ?? USUAL.speed}`, `--port=${now.port ?? USUAL.port}`, `--egm-port=${now.egmPort ?? USUAL.egmPort}`, `--sensor-port=${now.sensorPort ?? USUAL.sensorPort}`, `--laser=${now.laser || USUAL.laser}`);
  }
  if (now.closing) list.push("--closing");
  if (now.adaptive) {
    list.push("--adaptive");
    add("--tolerance", "tolerance");
  }
  return [...list, plan];
}

/** Of the makers' protocols by which joints are read. @typedef {{scheme: string, vendor: string | null, maker: string, port: number, options: string[]}} LiveForm */
/** @type {import("@preact/signals").Signal<LiveForm[] | null>} */
const live = signal(null);

/** Where the joints are read: nothing is connected before an address was typed. @param {{now: typeof USUAL, set: (more: Partial<typeof USUAL>) => void}} props */
function Live({ now, set }) {
  useEffect(() => { if (live.value === null) attempt(async () => { live.value = await get("/api/live"); }); }, []);
  const forms = live.value ?? [], form = forms.find((one) => one.scheme === now.scheme);
  useEffect(() => {
    const usual = forms.find((one) => one.vendor !== null && one.vendor === calibration.value?.maker) ?? forms[0];
    if (!form && usual) set({ scheme: usual.scheme });
  }, [forms.length]);
  const options = form?.options.length ? `; options behind ?: ${form.options.map((one) => `${one}=`).join(", ")}` : "";
  return html`
    <${Choice} label="Controller of" value=${now.scheme} groups=${[["", forms.map((one) => [one.scheme, `${one.maker} (${one.scheme}://)`])]]} onValue=${(/** @type {string} */ scheme) => set({ scheme })} />
    <div><${TextField} label="Controller’s address" value=${now.address} onValue=${(/** @type {string} */ address) => set({ address })} /><span class="help">host, or host:port (usual: ${form?.port ?? ""})${options}</span></div>
    <${Joint3} value=${now.j3} onValue=${(/** @type {string} */ j3) => set({ j3 })} />
    <${Choice} label="Sensors" value=${now.sensors} none="each posture is confirmed here" groups=${[["", ofKind("sensors").map((one) => [one, one])]]} onValue=${(/** @type {string} */ sensors) => set({ sensors })} />
    <p class="muted wide">The controller’s program, or a person at the pendant, moves the arm. The joints are read there where you confirm a posture; moving or stale ones are refused.</p>`;
}

/** @param {{plan: string, onPlan: (plan: string) => void}} props */
export function Start({ plan, onPlan }) {
  const now = chosen.value, file = useSignal(""), password = useSignal(""), busy = useSignal(false);
  const set = (/** @type {Partial<typeof USUAL>} */ more) => { chosen.value = { ...now, ...more }; };
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
  const port = (/** @type {string} */ label, /** @type {"port" | "egmPort" | "sensorPort"} */ key) => html`<${NumberField} label=${label} value=${now[key]} whole least=${1} most=${65535} onValue=${(/** @type {number | null} */ value) => set({ [key]: value })} />`;
  const check = (/** @type {string} */ label, /** @type {"camera" | "closing" | "adaptive"} */ key) => html`<label class="check wide"><input type="checkbox" checked=${now[key]} onChange=${() => set({ [key]: !now[key] })} /> ${label}</label>`;
  const files = (/** @type {string} */ kind) => /** @type {[string, [string, string][]][]} */ ([["", ofKind(kind).map((one) => [one, one])]]);
  const unready = busy.value || !plan || (now.rig === "live" && !(now.scheme && now.address.trim()));
  if (!plans.length) return html`<p>A run needs a plan. <a href=${toJob(route.value.name, "plan")}>Make one</a></p>`;
  return html`
    <${Form} class="start" aria-label="Start a run" onSubmit=${(/** @type {Event} */ event) => { event.preventDefault(); begin(edited); }}>
      <fieldset class="rigs"><legend class="label">What carries the plan out</legend>
        ${[["simulated", "Simulation"], ["manual", "By hand"], ["live", "By hand, joints read from the controller"], ["abb", "ABB robot"]].map(([rig, text]) => html`<label class="check" key=${rig}><input type="radio" name="rig" value=${rig} checked=${now.rig === rig} onChange=${() => set({ rig })} /> ${text}</label>`)}
      </fieldset>
      <div class="fields">
        <div class="wide"><${Choice} label="Plan" value=${plan} groups=${[["", plans.map((one) => [one, one])]]} onValue=${onPlan} /></div>
        <div class="wide"><${TextField} label="Run file" value=${file.value} placeholder=${proposed} onValue=${(/** @type {string} */ value) => { file.value = value; }} /></div>
        ${now.rig === "simulated" && html`
          <${Choice} label="Cell" value=${now.cell} none="an ordinary one" groups=${files("cell")} onValue=${(/** @type {string} */ cell) => set({ cell })} />
          <${NumberField} label="Random seed" value=${now.seed} whole least=${0} onValue=${(/** @type {number | null} */ seed) => set({ seed })} />
          ${check("Camera", "camera")}`}
        ${now.rig === "manual" && html`
          <${Choice} label="Angles in" value=${now.units} groups=${[["", [["deg", "degrees"], ["rad", "radians"]]]]} onValue=${(/** @type {string} */ units) => set({ units })} />
          <${Joint3} value=${now.j3} onValue=${(/** @type {string} */ j3) => set({ j3 })} />`}
        ${now.rig === "live" && html`<${Live} now=${now} set=${set} />`}
        ${now.rig === "abb" && html`
          <${TextField} label="Controller’s address" value=${now.host} placeholder="192.168.125.1" onValue=${(/** @type {string} */ host) => set({ host })} />
          <${NumberField} label="Share of the joints’ top speeds" value=${now.speed} least=${0.01} most=${1} onValue=${(/** @type {number | null} */ speed) => set({ speed })} />
          <${TextField} label="User" value=${now.user} placeholder="Default User" onValue=${(/** @type {string} */ user) => set({ user })} />
          <${TextField} label="Password" secret value=${password.value} onValue=${(/** @type {string} */ value) => { password.value = value; }} />
          <${Choice} label="Sensors" value=${now.sensors} none="those of the simulated controller" groups=${files("sensors")} onValue=${(/** @type {string} */ sensors) => set({ sensors })} />`}
      </div>
      <${Fold} title="Order, closing measurement${now.rig === "abb" ? ", ports" : ""}" kept><div class="fields">
        ${check("Measure the first posture again at the end", "closing")}
        ${check("Adaptive: choose the next posture by the measurements, end when u is small enough", "adaptive")}
        ${now.adaptive && html`<${NumberField} label="u that is enough, ° or mm" value=${now.tolerance} optional least=${0} placeholder="the plan’s" onValue=${(/** @type {number | null} */ tolerance) => set({ tolerance })} />`}
        ${now.rig === "abb" && html`
          ${port("Port of Robot Web Services", "port")}${port("Own UDP port for EGM", "egmPort")}${port("Port of PSD and camera", "sensorPort")}
          <${TextField} label="Output of the laser" value=${now.laser} onValue=${(/** @type {string} */ laser) => set({ laser })} />`}
      </div><//>
      ${edited && html`<p class="notes-line" role="status">${plan} has changes that are not saved.</p>`}
      <p class="bar">
        <${Submit} disabled=${unready}>${edited ? "Save the plan. " : ""}${{ simulated: "Start the simulation", manual: "Start", live: "Start: connects to the controller", abb: "Start: asks before the robot moves" }[now.rig]}<//>
        ${edited && html`<button type="button" disabled=${unready} onClick=${() => begin(false)}>Start by the plan as it was saved</button>`}
      </p>
    <//>`;
}
