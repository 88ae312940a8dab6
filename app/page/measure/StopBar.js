// As long as a run is under way: what it is, and the button that ends it, at the foot of every step.
import { html } from "htm/preact";
import { useEffect } from "preact/hooks";
import { calibrationOf, toJob } from "../core/route.js";
import { attempt } from "../core/store.js";
import { findRunning, followedFile, run, stop, stopping, underWay } from "./running.js";

export function StopBar() {
  useEffect(() => { attempt(findRunning); }, []);
  useEffect(() => {
    const pressed = (/** @type {KeyboardEvent} */ event) => {
      if (event.key !== "Escape" || !underWay.value) return;
      event.preventDefault();
      stop();
    };
    addEventListener("keydown", pressed);
    return () => removeEventListener("keydown", pressed);
  }, []);
  if (!underWay.value) return null;
  const seen = run.value, file = followedFile.value;
  const text = stopping.value || (seen.file ? `${seen.recorded.length} of ${seen.postures} recorded` : "A run begins");
  return html`
    <div class="stop-bar" role="region" aria-label="Run under way">
      <p>${!stopping.value && seen.file && html`
        <a href=${toJob(calibrationOf(file), "measure", file)}>Run ${file}</a>: `}${text}</p>
      <button type="button" class="stop" aria-keyshortcuts="Escape" disabled=${stopping.value !== ""}
        onClick=${stop}>Stop</button>
    </div>`;
}
