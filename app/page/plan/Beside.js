// The plan beside another plan of the folder.
import { html } from "htm/preact";
import { useSignal } from "@preact/signals";
import { getFile, post } from "../core/api.js";
import { answer, file } from "../core/editing.js";
import { attempt, ofKind } from "../core/store.js";
import { marked, named, SHAPES, spread } from "../core/words.js";
import { Choice } from "../parts/Controls.js";
import { Table } from "../parts/Table.js";

/** @param {import("answers").CheckAnswer} found */
const offsets = (found) => found.parameters.filter((row) => row.group === "offset" && !row.held);
/** @typedef {import("answers").CheckedParameter} Row */
/** @param {Row} row */
const number = (row) =>
  `${SHAPES[row.status] ?? ""} ${row.std === null ? "not determined" : spread(row.std, row.unit)}`;

export function Beside() {
  const other = useSignal(/** @type {{name: string, found: import("answers").CheckAnswer} | null} */ (null));
  const choose = (/** @type {string} */ name) => attempt(async () => {
    other.value = null;
    if (!name) return;
    const { plan } = await getFile("plan", name);
    other.value = { name, found: await post("/api/check", { plan, file: name }) };
  });
  const mine = answer.value, their = other.value;
  const theirs = new Map(their ? offsets(their.found).map((row) => [row.name, row]) : []);
  const ratio = (/** @type {Row} */ row, /** @type {Row | undefined} */ before) => {
    if (!before || before.unit !== row.unit) return "";
    if (row.std !== null && before.std !== null) return `× ${Number((row.std / before.std).toPrecision(2))}`;
    return row.status === before.status ? "" : `${before.status} → ${row.status}`;
  };
  return html`
    <${Choice} label="Other plan" value=${their?.name ?? ""} none="choose a plan"
      items=${ofKind("plan").filter((one) => one !== file.value)} onValue=${choose} />
    ${mine && their && html`
      <${Table} name="Two plans"
        heads=${["offset", ["this plan", "right"], [their.name.replace(/^.*\//, ""), "right"], ["to this", "right"]]}>
      <tbody>
        ${offsets(mine).map((row) => {
          const their = theirs.get(row.name);
          return html`
            <tr><th scope="row">${named(row.name)}</th><td class=${`right u ${row.status}`}>${number(row)}</td>
              <td class="right">${their ? number(their) : "—"}</td><td class="right">${ratio(row, their)}</td></tr>`;
        })}
        <tr><th scope="row">verdict</th><td class="right">${marked(mine.verdict).trim()}</td>
          <td class="right">${marked(their.found.verdict).trim()}</td><td></td></tr>
        <tr><th scope="row">measurements</th><td class="right">${mine.postures.length}</td>
          <td class="right">${their.found.postures.length}</td><td></td></tr>
      </tbody><//>`}`;
}
