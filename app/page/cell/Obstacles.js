// Obstacles of the cell, a constraint of the plan: boxes and floor, taken from a file or written to one.
import { html } from "htm/preact";
import { useSignal } from "@preact/signals";
import { getFile, put } from "../core/api.js";
import { answer, change, chosen, file as opened, plan } from "../core/editing.js";
import { attempt, freeName, inside, ofCalibration, ofKind, refresh, say, versionOf } from "../core/store.js";
import { route } from "../core/route.js";
import { Choice, into, NumberField, TextField, Vector } from "../parts/Controls.js";
import { problemAt, state, stated } from "./keys.js";

const SIZE = 200; // mm, of a new box
/** @type {Record<string, "mounting" | null | number>} */
const FLOORS = { mounting: "mounting", none: null, height: 0 };
const AT = ["constraints", "obstacles"];
const file = ofCalibration("");

const add = () => change(null, (content) => {
  const at = (answer.value?.scene?.[chosen.value]?.target ?? [500, 0, 500]).map(Math.round);
  const obstacles = (content.constraints ??= {}).obstacles ??= {};
  const corner = (/** @type {number} */ by) => /** @type {[number, number, number]} */ (at.map((v) => v + by));
  (obstacles.boxes ??= []).push({ name: `box ${obstacles.boxes.length + 1}`, min_mm: corner(-SIZE / 2),
    max_mm: corner(SIZE / 2) });
});
const take = (/** @type {string} */ name) => attempt(async () => {
  const of = opened.value;
  file.value = name;
  const found = name ? await getFile("obstacles", name) : null;
  if (found !== null && of === opened.value) state(AT, found.obstacles);
});
const drop = (/** @type {number} */ i) =>
  change(null, (content) => { content.constraints?.obstacles?.boxes?.splice(i, 1); });

export function Obstacles() {
  const content = plan.value?.constraints?.obstacles, name = useSignal("");
  const proposed = file.value || freeName(`${inside(route.value.name)}obstacles.yaml`);
  const save = () => attempt(async () => {
    const to = name.value.trim() || proposed, of = route.value.name;
    const done = await put("/api/obstacles", { file: to, obstacles: stated(AT) },
      to === file.value ? versionOf(to) : null);
    file.set(done.file, of);
    say(`Saved as ${done.file}.`);
    await refresh();
  });
  const floor = content
    && (typeof content.floor_mm === "number" ? "height" : content.floor_mm === null ? "none" : "mounting");
  return html`
    <div class="bar">
      <${Choice} label="Take those of a file" value=${file.value} none="choose a file" items=${ofKind("obstacles")}
        onValue=${take} />
      <button type="button" onClick=${add}>Add a box</button>
      ${content && html`<button type="button" onClick=${() => state(AT, undefined)}>Without obstacles</button>`}
    </div>
    ${problemAt(AT) && html`<p class="error" role="alert">${problemAt(AT)}</p>`}
    ${content && html`
      <div class="fields">
        <${Choice} label="Floor" value=${floor}
          items=${[["mounting", "the arm's mounting face"], ["height", "at a height"], ["none", "none"]]}
          onValue=${(/** @type {string} */ where) => state([...AT, "floor_mm"], FLOORS[where], true)} />
        ${floor === "height" && html`
          <${NumberField} label="Its height, base frame" unit="mm" value=${content.floor_mm}
            onValue=${(/** @type {number} */ value) => state([...AT, "floor_mm"], value)} />`}
        <${NumberField} label="Radius of the links" unit="mm" optional least=${0} placeholder="5 % of the arm"
          value=${content.thickness_mm}
          onValue=${(/** @type {number | null} */ value) => state([...AT, "thickness_mm"], value)} />
      </div>
      ${(content.boxes ?? []).map((box, i) => html`
        <fieldset class="box" key=${i}>
          <legend>Box ${i + 1}${answer.value?.touched_boxes?.[i] ? html`: <b class="error">touched</b>` : ""}</legend>
          <div class="fields">
            <div class="wide">
              <${TextField} label="Name" value=${box.name}
                onValue=${(/** @type {string} */ value) => state([...AT, "boxes", i, "name"], value)} /></div>
            ${/** @type {const} */ ([["min_mm", "lowest"], ["max_mm", "highest"]]).map(([key, word]) => html`
              <${Vector} key=${key} label=${word} unit="mm" values=${box[key]}
                onValue=${(/** @type {number[]} */ next) => state([...AT, "boxes", i, key], next)} />`)}
          </div>
          <button type="button" onClick=${() => drop(i)}>Remove</button>
        </fieldset>`)}
      <div class="bar"><${TextField} label="File" value=${name.value} placeholder=${proposed} onValue=${into(name)} />
        <button type="button" onClick=${save}>Save the obstacles</button></div>`}`;
}
