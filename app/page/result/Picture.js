// The picture of a result: how far the TCP is off before and after, and the residuals where they were measured.
import { html } from "htm/preact";
import { useEffect } from "preact/hooks";
import { useSignal } from "@preact/signals";
import { post, Refused } from "../core/api.js";
import { robots } from "../core/store.js";
import { fixed } from "../core/words.js";
import { into, heard } from "../parts/Controls.js";
import { Scene } from "../scene/Scene.js";

/** @typedef {import("./state.js").Found} Found */
/** @typedef {"before" | "after" | "residuals"} What */

/** @type {[What, string][]} */
const WHAT = [["before", "TCP error at the measurements, nothing entered"],
  ["after", "TCP error at the measurements, values entered"], ["residuals", "Residuals"]];
const LENGTH = 0.12; // of the arm's reach: how long the longest vector is at first
const FACTORS = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000];
const LEAST_BALL = 0.006, BALL = 0.012; // of the arm's reach

const [BEFORE, AFTER, WEAK] = /** @type {const} */ (["misfit", "identified", "weak"]); // tones

/** @param {number[]} v */
const length = (v) => Math.hypot(...v);

/** The round factor that makes the longest vector well visible. @param {number} longest @param {number} reach */
const factorFor = (longest, reach) => FACTORS.findLast((factor) => factor * longest <= LENGTH * reach) ?? 1;

/** @param {{found: Found}} props */
export function Picture({ found }) {
  const what = useSignal(/** @type {What | null} */ (null)), stated = useSignal(/** @type {number | null} */ (null));
  const chosen = useSignal(0);
  const drawn = useSignal(/** @type {import("answers").DrawnArm | null} */ (null)), unknown = useSignal(false);
  useEffect(() => {
    unknown.value = !robots.value.some((one) => one.name === found.inputs.robot);
    if (unknown.value) return;
    post("/api/robot", { robot: found.inputs.robot }).then((arm) => { drawn.value = arm; },
      (error) => { if (!(error instanceof Refused)) throw error; unknown.value = true; });
  }, [found]);
  const arm = drawn.value, map = found.tcp_map ?? [], residuals = found.residuals ?? [];
  if (!arm) {
    return unknown.value ? html`<p class="muted centred">The arm of this result cannot be drawn here.</p>`
      : html`<p class="muted centred">…</p>`;
  }
  const reach = arm.reach_mm;
  const vectors = (/** @type {"before" | "after"} */ which) =>
    map.flatMap((one) => { const by = one[which]; return by ? [{ at: one.at, by }] : []; });
  const there = WHAT.filter(([one]) => (one === "residuals" ? residuals.length > 0 : vectors(one).length > 0));
  const now = what.value ?? there[0]?.[0] ?? null, items = now === "before" || now === "after" ? vectors(now) : [];
  // Before and after are drawn with one factor: else they could not be compared.
  const longest = Math.max(0, ...[...vectors("before"), ...vectors("after")].map((one) => length(one.by)));
  const factor = stated.value ?? factorFor(longest, reach), most = Math.max(1, ...residuals.map((one) => one.whitened));
  /** @type {import("../scene/types.js").Scene3D} */
  const scene = {
    of: `result ${found.file || found.run}`, reach,
    arm, marks: [],
    postures: (found.skeletons ?? [arm.skeleton]).map((skeleton, i) =>
      ({ name: `measurement ${found.residuals?.[i]?.shot ?? i}`, skeleton })),
    vectors: items.length ? { factor, items: items.map((one) => ({ ...one, tone: now === "before" ? BEFORE : AFTER })) }
      : undefined,
    clouds: now === "residuals"
      ? residuals.map((one) =>
        ({ at: one.at, size: reach * (LEAST_BALL + (BALL * one.whitened) / most),
          tone: one.whitened > 3 ? BEFORE : one.whitened > 2 ? WEAK : AFTER }))
      : undefined,
  };
  const sizes = items.map((one) => length(one.by)).sort((a, b) => a - b), median = sizes[Math.floor(sizes.length / 2)];
  const caption = html`
    ${there.length > 0 && html`
      <span class="shown" role="group" aria-label="What is drawn">
        ${there.map(([one, text]) => html`
          <button type="button" key=${one} aria-pressed=${one === now}
            onClick=${() => { what.value = one; }}>${text}</button>`)}</span>`}
    ${items.length > 0 && html`
      <label class="factor"><span class="label">Drawn ${factor} times as long</span>
        <input type="range" min="0" max=${FACTORS.length - 1} step="1" value=${Math.max(0, FACTORS.indexOf(factor))}
          aria-label="Factor of the vectors" aria-valuetext=${`${factor} times`}
          onInput=${heard((at) => { stated.value = FACTORS[Number(at)]; })} /></label>
      <span>At the postures measured: median ${fixed(median, 2)} mm,
        largest ${fixed(sizes[sizes.length - 1], 2)} mm. </span>`}
    ${now === "residuals" && html`
      <span>A ball for each measurement where its target is, larger with its normalised residual;
        largest ${fixed(most, 2)}. </span>`}
    ${found.tcp_why && html`<span>${found.tcp_why}</span>`}`;
  return html`
    <${Scene} scene=${scene} chosen=${chosen.value} onChoose=${into(chosen)} caption=${caption}
      label="The result in the workspace" />`;
}
