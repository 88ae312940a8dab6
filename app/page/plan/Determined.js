// What the plan will determine: predicted u of each offset, and what cannot be determined, why, and what to do.
import { html } from "htm/preact";
import { answer, pending, wrong } from "../core/editing.js";
import { marked, named, sentence, spread } from "../core/words.js";
import { motion, moves, play } from "./motion.js";
import { Table } from "../parts/Table.js";

const MOST_TERMS = 6;

/** @typedef {import("answers").CheckedParameter} Row */
/** @param {Row} row */
const predicted = (row) =>
  (row.held ? "held" : row.std !== null && row.status !== "unidentifiable" ? spread(row.std, row.unit)
    : "not determined");
/** @param {Row} row */
const alone = (row) =>
  (row.held || row.status === "unidentifiable" ? "—" : row.data_std === null ? "infinite"
    : spread(row.data_std, row.unit));

/** @param {Record<string, number>} weights */
function combination(weights) {
  const terms = Object.entries(weights).sort((a, b) => Math.abs(b[1]) - Math.abs(a[1]));
  const words = terms.slice(0, MOST_TERMS).map(([name, weight], i) => {
    const size = Math.abs(weight), factor = size === 1 ? "" : `${Number(size.toPrecision(2))}\u00a0`;
    return `${weight < 0 ? "− " : i ? "+ " : ""}${factor}${named(name)}`;
  });
  return words.join(" ") + (terms.length > MOST_TERMS ? ` and ${terms.length - MOST_TERMS} smaller` : "");
}

/** @param {import("answers").NullDirection} direction */
function kind(direction) {
  if (direction.kind === "exact") return "exact null-space direction: no number of such measurements determines it";
  if (direction.kind === "optima") {
    return "not decided: the way from the best local optimum to another that explains the data as well";
  }
  if (direction.data_std === null || direction.data_std >= 1) {
    return "not resolvable at this noise level: the prior is more precise than the data";
  }
  return `weakly observable: its uncertainty is ${Number(direction.data_std.toPrecision(2))} of the prior`;
}

export function Determined() {
  const found = answer.value;
  if (wrong.value !== null && found === null) {
    return html`<p class="error" role="alert">Not checked: ${wrong.value.text}</p>`;
  }
  if (found === null) return html`<p class="muted" role="status">The plan is being checked.</p>`;
  const { worth, lines, over_target, outlook } = found.said, tolerated = new Set(found.said.tolerated);
  const directions = found.identifiability.null_space.map((one, i) => ({ one, i }))
    .filter(({ one }) => !Object.keys(one.combination).every((name) => tolerated.has(name)));
  return html`
    <div class=${`determined${pending.value ? " pending" : ""}`} aria-busy=${pending.value}>
      <${Table} name="What this plan will determine"
        heads=${["offset", ["predicted u", "right"], [worth.head, "right"], "status",
        ["without prior", "right"], ["prior", "right"]]}>
        <tbody>${found.parameters.filter((row) => !tolerated.has(row.name)).map((row) => html`
          <tr key=${row.name} class=${row.status} data-of=${row.name} title=${row.reason ? sentence(row.reason) : null}>
            <th scope="row">${named(row.name)}</th><td class="right u">${predicted(row)}</td>
            <td class="right">${worth.of[row.name] ?? ""}</td><td class="status">${marked(row.status)}</td>
            <td class="right">${alone(row)}</td><td class="right">${spread(row.prior_std, row.unit)}</td>
          </tr>`)}</tbody><//>
      ${outlook.length > 0 && html`
        <${Table} name=${outlook[0][0]} heads=${outlook[0].map((head, i) => (i ? [head, "right"] : head))}>
        <tbody>${outlook.slice(1)
          .map((row) => html`
            <tr key=${row[0]}><th scope="row">${row[0]}</th>
              ${row.slice(1).map((cell) => html`<td class="right">${cell}</td>`)}</tr>`)}</tbody><//>`}
      <ul class="lines">${[...lines, over_target].filter(Boolean).map((line) => html`<li>${line}</li>`)}</ul>
      <ul class="notes">
        ${[...found.notes ?? [], ...found.warnings].map((note) => html`<li>${sentence(note)}</li>`)}</ul>
      ${directions.length > 0 && html`<h2>What cannot be determined</h2>`}
      ${directions.map(({ one, i }) => html`
        <div class="direction" key=${i}>
          <p><b>${combination(one.combination)}</b> <span class="muted">${kind(one)}</span></p>
          <p>Why: ${named(one.reason ?? "")}.</p>
          <p>To do: ${named(one.remedy ?? "")}.</p>
          ${moves(i) && html`
            <button type="button" aria-pressed=${motion.value?.direction === i}
              onClick=${() => play(i)}>Move the arm along it</button>`}
        </div>`)}
    </div>`;
}
