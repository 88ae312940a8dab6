// Where the targets are: as the plan states it, else as the postures have it.
import { html } from "htm/preact";
import { answer, plan } from "../core/editing.js";
import { moveTarget } from "../plan/picture.js";
import { Vector } from "../parts/Controls.js";
import { problemAt } from "./keys.js";

export function Targets() {
  /** @type {Record<string, number[]>} */
  const nominal = {};
  for (const posture of answer.value?.scene ?? []) nominal[posture.target_name] ??= posture.target;
  for (const [name, target] of Object.entries(plan.value?.targets ?? {})) if (Array.isArray(target?.guess_mm))
    nominal[name] ??= target.guess_mm;
  return html`${Object.keys(nominal).map((name) => {
    const guess = plan.value?.targets?.[name]?.guess_mm, at = Array.isArray(guess) ? guess : nominal[name];
    return html`
      <fieldset class="target" key=${name}>
        <legend>
          <b>${name}</b> <span class="muted">
            ${guess ? "nominal place, as stated"
              : "nominal place, taken from the postures; the plan states none"}</span></legend>
        <div class="fields">
          <${Vector} unit="mm" digits=${3} values=${at} error=${problemAt(["targets", name])}
            onValue=${(/** @type {number[]} */ next) => moveTarget(name, next)} /></div>
      </fieldset>`;
  })}`;
}
