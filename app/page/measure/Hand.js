// A run by hand: where the arm is to go next, as the pendant counts it, and the field for what the pendant shows there.
import { html } from "htm/preact";
import { useEffect, useRef } from "preact/hooks";
import { useSignal } from "@preact/signals";
import { attempt, say } from "../core/store.js";
import { fixed, unitSign } from "../core/words.js";
import { numbered } from "./events.js";
import { answer, run } from "./running.js";

const PATIENCE_MS = 2000; // until values that bring no answer count as too few
/** @type {Record<string, string>} */
const ANSWERS = { yes: "Record it all the same", rad: "They are radians", metres: "They are metres" };
/** @type {Record<string, number>} */
const DIGITS = { rad: 4, pulse: 0 };
/** The server asks by the numbers of files. @param {string} word */
const answerText = (word) => ANSWERS[word] ?? `It is measurement ${numbered(Number(word.slice(3)))}`;

/** @param {import("./events.js").Asked} asked */
const title = (asked) => `Posture ${asked.done + 1} of ${Math.max(asked.postures, asked.done + 1)}: measurement ${numbered(asked.shot)}${asked.shot >= asked.postures ? ", closing" : ""}, ${asked.reads.length ? "" : "target "}${asked.target}${of(asked)}`;

/** Instrument and reflector, where there are several. @param {{instrument: string | null, reflector: string | null}} part */
const of = ({ instrument, reflector }) => [instrument && `, instrument ${instrument}`, reflector && `, reflector ${reflector}`].filter(Boolean).join("");

/** @param {import("./events.js").Entered[]} reads */
const readings = (reads) => reads.map(({ words }) => `the ${words}`).join(" and ");

/** What is typed next. @param {import("./events.js").Asked} asked @param {import("./events.js").ReadingAsked | null} reading */
const wanted = (asked, reading) => reading
  ? `Leave the arm where it is, and type ${readings(reading.reads)}${of(reading)}.`
  : `Move the arm there, ${asked.act}, and paste the joint values that the pendant shows.${asked.reads.length + asked.also.length ? " What the instrument reads is asked for next." : ""}`;

/** @param {{asked: import("./events.js").Asked, reading: import("./events.js").ReadingAsked | null, doubt: import("./events.js").Doubt | null}} props */
export function Hand({ asked, reading, doubt }) {
  const field = useRef(/** @type {HTMLTextAreaElement | null} */ (null)), text = useSignal(""), short = useSignal(false);
  useEffect(() => {
    text.value = "";
    field.current?.focus();
    say(reading ? wanted(asked, reading) : title(asked));
  }, [asked, reading]);
  useEffect(() => { short.value = false; if (doubt) field.current?.focus(); }, [doubt]);
  const send = (/** @type {string} */ line) => {
    if (!line.trim()) return;
    attempt(() => answer(line));
    const before = run.value;
    setTimeout(() => {
      const now = run.value;
      short.value = text.value !== "" && now.asked === before.asked && now.reading === before.reading && now.doubt === before.doubt && now.recorded.length === before.recorded.length;
    }, PATIENCE_MS);
  };
  const problem = doubt ? (doubt.kind === "help" ? doubt.found : `Not recorded: ${doubt.found}.`) : short.value ? reading ? "No such reading was taken." : "The values of some joints are still missing: paste the others, too." : "";
  return html`
    <form class="hand" aria-label="The next posture" onSubmit=${(/** @type {Event} */ event) => { event.preventDefault(); send(text.value); }}>
      <h2 class="asked-title">${title(asked)}</h2>
      <ul class="asked" aria-label="Joints as planned, in the pendant’s counting">
        ${asked.pendant.map((joint) => html`<li key=${joint.name}><b>${joint.name}</b> ${fixed(joint.value, DIGITS[joint.unit] ?? 2)}<small>${unitSign(joint.unit)}</small></li>`)}
      </ul>
      <label class="label" for="hand-line">${wanted(asked, reading)}</label>
      <textarea id="hand-line" ref=${field} rows="2" value=${text.value} autocomplete="off" autocapitalize="off" spellcheck=${false} aria-invalid=${Boolean(problem)} aria-describedby="hand-doubt"
        onInput=${(/** @type {any} */ event) => { text.value = event.target.value; short.value = false; }}
        onKeyDown=${(/** @type {KeyboardEvent} */ event) => { if (event.key === "Enter" && !event.shiftKey) { event.preventDefault(); send(text.value); } }}></textarea>
      <div id="hand-doubt" role="alert">${problem && html`<p class="error">${problem}</p>`}
        ${doubt !== null && doubt.answers.length > 0 && html`<div class="bar">${doubt.answers.map((word) => html`<button type="button" key=${word} onClick=${() => send(word)}>${answerText(word)}</button>`)}</div>`}
      </div>
      <p class="bar">
        <button class="main">Record</button>
        ${[["skip", "Skip this posture"], ["redo", "Repeat the last"], ["pause", "Go on later"]].map(([word, label]) => html`<button type="button" key=${word} onClick=${() => send(word)}>${label}</button>`)}
      </p>
    </form>`;
}
