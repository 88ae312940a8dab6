// The postures as a strip: what each is, and what the plan would be without it.
import { html } from "htm/preact";
import { useEffect, useRef } from "preact/hooks";
import { computed, signal } from "@preact/signals";
import { latest, post } from "../core/api.js";
import { counted } from "../core/counting.js";
import { answer, arm, change, chosen, file, jointsOf, pending, plan } from "../core/editing.js";
import { failed } from "../core/store.js";
import { fixed, named, WORDS } from "../core/words.js";
import { LEAST_OFF_MM } from "./picture.js";

const MOST = 30; // postures that are left out one by one; of more only the chosen one is
const AT_ONCE = 4; // in one answer: a check that comes meanwhile waits for no more
const REST_MS = 300; // without an edit

/** @typedef {import("answers").WithoutPosture} Rest */
/** What the plan is without each of its postures, by its number. */
const without = signal(/** @type {Map<number, import("answers").WithoutPosture | null>} */ (new Map()));
const ask = latest(() => plan.value, async () => {
  const content = plan.value;
  if (content === null || answer.value === null || pending.value) return null;
  const count = content.postures_deg.length, rows = [];
  const postures = count <= MOST ? Array.from({ length: count }, (_, i) => i) : [chosen.value];
  while (postures.length) {
    rows.push(...await post("/api/without", { plan: content, postures: postures.splice(0, AT_ONCE),
      file: file.value }));
    if (plan.value !== content) return null;
  }
  return rows;
}, (rows) => { without.value = new Map(rows.map((row) => [row.posture, row.rest])); }, failed);

/** The offsets that the plan determines. */
const determined = computed(() =>
  answer.value?.parameters.filter((row) => row.group === "offset" && !row.held && row.std !== null) ?? []);

/**
 * How many times larger their uncertainty is without a posture, at the most; Infinity where one is lost.
 * @param {Rest | null | undefined} rest
 */
const loss = (rest) =>
  (rest ? Math.max(1, ...determined.value.map((row) => (rest.std[row.name] ?? Infinity) / (row.std ?? Infinity)))
    : null);

/** @param {Rest} rest */
const lost = (rest) => determined.value.filter((row) => rest.std[row.name] === null).map((row) => named(row.name));

/**
 * What a posture adds, by what the plan is without it (null: no measurement, undefined: not known yet).
 * @param {Rest | null | undefined} rest @param {number | null} factor
 */
function whatAdds(rest, factor) {
  if (rest === null) return "gives what no other gives";
  if (!rest || factor === null) return "";
  if (factor === Infinity) return `without it: ${lost(rest).join(", ")} not determined`;
  const other = rest.verdict === answer.value?.verdict ? "" : `, ${WORDS[rest.verdict].toLowerCase()}`;
  return `without it: u × ${factor < 1.005 ? "1.00" : Number(factor.toPrecision(3))}${other}`;
}

const rows = computed(() => (plan.value?.postures_deg ?? []).map((posture, i) => {
  const again = Array.isArray(posture) || posture.again === undefined ? "" : `, posture ${posture.again} again`;
  const scene = answer.value?.scene[i], off = answer.value?.postures[i], rest = without.value.get(i);
  const factor = loss(rest);
  const misses = !scene ? "" : !off?.hit ? "the target cannot be hit" : !scene.reaches ? "target behind the laser"
    : scene.violations[0] ?? "";
  const share = factor === null ? Number(rest === null) : Math.min(1, Math.log2(factor));
  const beside = off?.hit && off.off_mm >= LEAST_OFF_MM ? `${fixed(off.off_mm, 1)} mm beside the target before aiming`
    : "";
  return { i, target: `${scene?.target_name ?? ""}${again}`, misses, adds: whatAdds(rest, factor), share, off: beside };
}));

/** A posture beside the chosen one; `turn` degrees at joint 1, so that it adds something. @param {number} turn */
const another = (turn) => change(null, (content) => {
  const i = chosen.value, copy = structuredClone(content.postures_deg[i]);
  const upper = arm.value?.joints[0].upper ?? Infinity;
  const joints = Array.isArray(copy) ? copy : copy.joints_deg;
  if (!Array.isArray(copy)) delete copy.again;
  joints[0] += (joints[0] + turn > upper ? -1 : 1) * turn;
  content.postures_deg.splice(i + 1, 0, copy);
  chosen.value = i + 1;
});
/** @param {number} by */
const move = (by) => change(null, (content) => {
  const i = chosen.value, [posture] = content.postures_deg.splice(i, 1);
  content.postures_deg.splice(i + by, 0, posture);
  chosen.value = i + by;
});
const drop = () => change(null, (content) => { content.postures_deg.splice(chosen.value, 1); });

/**
 * Joint values in words, as the pendant shows them.
 * @param {import("../core/counting.js").CountedArm} body @param {number[]} joints
 */
const jointsIn = (body, joints) => {
  const shown = counted(body, joints);
  return body.pendant.order.map((k) => `${body.pendant.names[k - 1]} ${fixed(shown[k - 1], 1)}`).join(", ");
};

/**
 * Scroll a strip so that one of its items is seen. Not by `scrollIntoView`, which Tab would go on from.
 * @param {HTMLElement | null} strip @param {Element | undefined} item
 */
const shownWithin = (strip, item) => {
  if (!strip || !item) return;
  const seen = strip.getBoundingClientRect(), box = item.getBoundingClientRect();
  strip.scrollLeft += Math.min(0, box.left - seen.left) + Math.max(0, box.right - seen.right);
  strip.scrollTop += Math.min(0, box.top - seen.top) + Math.max(0, box.bottom - seen.bottom);
};

export function Postures() {
  const count = rows.value.length, i = chosen.value, strip = useRef(/** @type {HTMLOListElement | null} */ (null));
  useEffect(() => { shownWithin(strip.current, strip.current?.children[i]); }, [i]);
  useEffect(() => {
    const rest = pending.value ? 0 : setTimeout(ask, REST_MS);
    return () => clearTimeout(rest);
  }, [answer.value, pending.value, count > MOST ? i : 0]);
  return html`
    <div class="strip-head">
      <h2 id="postures-title">${count} measurements</h2>
      <div class="bar" role="toolbar" aria-label="Measurements">
        <button type="button" onClick=${() => another(15)}>Add</button>
        <button type="button" onClick=${() => another(0)}>Duplicate</button>
        <button type="button" disabled=${count < 2} onClick=${drop}>Remove</button>
        <button type="button" disabled=${!i} aria-label="Move to the left" onClick=${() => move(-1)}>‹ Move</button>
        <button type="button" disabled=${i >= count - 1} aria-label="Move to the right"
          onClick=${() => move(1)}>Move ›</button>
      </div>
    </div>
    <ol class="strip" ref=${strip} aria-labelledby="postures-title">
      ${rows.value.map((row) => html`
        <li key=${row.i}>
          <button type="button" class=${row.misses ? "misses" : ""} aria-current=${row.i === i ? "true" : undefined}
            onClick=${() => { chosen.value = row.i; }}
            title=${plan.value && arm.value ? jointsIn(arm.value, jointsOf(plan.value, row.i)) : ""}>
          <b>${row.i}</b> <span class="of">${row.target}</span>
          <meter min="0" max="1" value=${row.share} aria-label="What it adds"></meter>
          ${[row.misses || row.off, row.misses ? "" : row.adds].filter(Boolean)
            .map((line) => html`<small>${line}</small>`)}
        </button></li>`)}
    </ol>`;
}
