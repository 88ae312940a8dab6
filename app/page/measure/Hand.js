// A run by hand: where the arm is to go next, as the pendant counts it, and the fields for what pendant and instrument
// show there.
import { html } from "htm/preact";
import { useEffect, useRef } from "preact/hooks";
import { useSignal } from "@preact/signals";
import { ALLOWED, numbersOf, parsed } from "../core/decimal.js";
import { attempt, say } from "../core/store.js";
import { capital, unitSign } from "../core/words.js";
import { answer, run } from "./running.js";
import { heard } from "../parts/Controls.js";

const PATIENCE_MS = 2000; // until values that bring no answer count as too few

/**
 * The numbers of a reading; null where it is not so many, or could be misread.
 * @param {import("answers").EnteredReading} read @param {string} text
 */
export function readingOf(read, text) {
  const numbers = read.numbers === 1 ? [parsed(text)] : numbersOf(text);
  return numbers?.length === read.numbers && !numbers.includes(null) ? numbers : null;
}

/**
 * @param {{asked: import("answers").PostureRequested, reading: import("answers").ReadingRequested | null,
 *   doubt: import("answers").Doubted | null, suspect: import("answers").Suspected | null, live: boolean}} props
 *   `reading`: what is read, once the joints are taken; `suspect`: a measurement that contradicts the others;
 *   `live`: the joints are read from the controller
 */
export function Hand({ asked, reading, doubt, suspect, live }) {
  const field = useRef(/** @type {HTMLTextAreaElement | null} */ (null));
  const first = useRef(/** @type {HTMLInputElement | null} */ (null));
  const text = useSignal(""), texts = useSignal(/** @type {Record<string, string>} */ ({})), problem = useSignal("");
  const heading = (reading ?? asked).title, reads = live && reading === null ? [] : (reading ?? asked).reads;
  const focus = () => (reading === null ? field : first).current?.focus();
  useEffect(() => {
    text.value = problem.value = "";
    texts.value = {};
    focus();
  }, [asked, reading?.shot]);
  useEffect(() => { say(heading); }, [asked, heading]);
  useEffect(() => { problem.value = ""; if (doubt || reading !== null) focus(); }, [doubt, reading]);
  const send = (/** @type {string} */ line) => {
    if (!line.trim() && !(live && reading === null)) return;
    attempt(() => answer(line));
    const before = run.value;
    setTimeout(() => {
      const now = run.value;
      if (text.value && now.asked === before.asked && now.doubt === before.doubt && now.reading === before.reading
        && now.recorded.length === before.recorded.length) {
        problem.value = "The values of some joints are still missing: paste the others, too.";
      }
    }, PATIENCE_MS);
  };
  const record = () => {
    const typed = reads.filter((read) => texts.value[read.key]?.trim());
    const wrong = (reading !== null || typed.length ? reads : []).find((read) =>
      readingOf(read, texts.value[read.key] ?? "") === null);
    const several = `allowed are ${wrong?.numbers} numbers such as 1234.5 or 1234,5, with spaces between them`;
    const allowed = wrong?.numbers === 1 ? `allowed is ${ALLOWED}` : several;
    problem.value = wrong ? `${capital(wrong.words)}: ${allowed}.` : "";
    if (wrong) return;
    const numbers = typed.flatMap((read) => readingOf(read, texts.value[read.key])).join(" ");
    send(reading !== null ? numbers : text.value.trim() && numbers ? `${text.value.trim()} | ${numbers}` : text.value);
  };
  const enter = (/** @type {KeyboardEvent} */ event) => {
    if (event.key === "Enter" && !event.shiftKey) { event.preventDefault(); record(); }
  };
  const words = problem.value
    || (doubt === null ? "" : doubt.kind === "help" ? doubt.found : `Not recorded: ${doubt.found}.`);
  const choices = Object.entries({ ...doubt?.choices, ...suspect?.choices });
  return html`
    <form class="hand" aria-label="The next posture"
      onSubmit=${(/** @type {Event} */ event) => { event.preventDefault(); record(); }}>
      <h2 class="asked-title">${heading}</h2>
      ${reading === null ? html`
        <ul class="asked" aria-label="Joints as planned, in the pendant’s counting">
          ${asked.pendant.map((joint) => html`
            <li key=${joint.name}><b>${joint.name}</b> ${joint.text}
            <small>${unitSign(joint.unit)}</small></li>`)}
        </ul>
        ${live ? html`<p>Move the arm there, ${asked.act}, let it rest, and record: its joints are read.</p>`
          : html`
            <label class="label" for="hand-line">Move the arm there, ${asked.act}, and paste the joint values that the
              pendant shows.</label>
        <textarea id="hand-line" ref=${field} rows="2" value=${text.value} autocomplete="off" autocapitalize="off"
          spellcheck=${false} aria-invalid=${Boolean(words)} aria-describedby="hand-doubt"
          onInput=${heard((line) => { text.value = line; problem.value = ""; })} onKeyDown=${enter}></textarea>`}`
      : html`<p>The joint values are taken. Enter what the instrument reads there.</p>`}
      ${reads.map((read, i) => html`
        <label class="text" key=${read.key}><span class="label">${capital(read.words)}</span>
          <input type="text" ref=${i === 0 ? first : null} inputmode=${read.numbers === 1 ? "decimal" : "text"}
            value=${texts.value[read.key] ?? ""} autocomplete="off" spellcheck=${false} aria-describedby="hand-doubt"
            onInput=${heard((line) => { texts.value = { ...texts.value, [read.key]: line }; problem.value = ""; })}
              onKeyDown=${enter} /></label>`)}
      <div id="hand-doubt" role="alert">${words && html`<p class="error">${words}</p>`}
        ${choices.length > 0 && html`
          <div class="bar">
            ${choices.map(([word, does]) => html`
              <button type="button" key=${word} onClick=${() => send(word)}>${capital(does)}</button>`)}</div>`}
      </div>
      <p class="bar">
        <button class="main">Record</button>
        ${[["skip", "Skip this posture"], ["redo", "Repeat the last"],
          ["pause", "Go on later"]].map(([word, label]) => html`
          <button type="button" key=${word} onClick=${() => send(word)}>${label}</button>`)}
      </p>
    </form>`;
}
