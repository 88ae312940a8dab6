// The plan beside another plan of the folder.
import { html } from "htm/preact";
import { useSignal } from "@preact/signals";
import { getFile, post } from "../core/api.js";
import { answer, file } from "../core/editing.js";
import { attempt, ofKind } from "../core/store.js";
import { marked, named, SHAPES, spread } from "../core/words.js";
import { Choice } from "../parts/Choice.js";

/** @param {any} found */
const offsets = (found) => found.parameters.filter((/** @type {any} */ row) => row.group === "offset" && !row.held);
/** @param {any} row */
const number = (row) => `${SHAPES[row.status] ?? ""} ${row.std === null ? "not determined" : spread(row.std, row.unit)}`;

export function Beside() {
  const other = useSignal(/** @type {{name: string, found: any} | null} */ (null));
  const choose = (/** @type {string} */ name) => attempt(async () => {
    other.value = null;
    if (!name) return;
    const { plan } = await getFile("plan", name);
    other.value = { name, found: await post("/api/check", { plan, file: name }) };
  });
  const mine = answer.value, their = other.value;
  /** @type {Map<string, any>} */
  const theirs = new Map(their ? offsets(their.found).map((/** @type {any} */ row) => [row.name, row]) : []);
  const ratio = (/** @type {any} */ row, /** @type {any} */ before) => (!before || before.unit !== row.unit ? "" : row.std === null || before.std === null ? (row.status === before.status ? "" : `${before.status} → ${row.status}`) : `× ${Number((row.std / before.std).toPrecision(2))}`);
  return html`
    <${Choice} label="Other plan" value=${their?.name ?? ""} none="choose a plan" groups=${[["", ofKind("plan").filter((one) => one !== file.value).map((one) => [one, one])]]} onValue=${choose} />
    ${mine && their && html`<div class="scroll" tabindex="0" role="region" aria-label="Two plans"><table>
      <thead><tr><th scope="col">offset</th><th scope="col" class="right">this plan</th><th scope="col" class="right">${their.name.replace(/^.*\//, "")}</th><th scope="col" class="right">to this</th></tr></thead>
      <tbody>
        ${offsets(mine).map((/** @type {any} */ row) => html`<tr><th scope="row">${named(row.name)}</th><td class=${`right u ${row.status}`}>${number(row)}</td>
          <td class="right">${theirs.has(row.name) ? number(theirs.get(row.name)) : "—"}</td><td class="right">${ratio(row, theirs.get(row.name))}</td></tr>`)}
        <tr><th scope="row">verdict</th><td class="right">${marked(mine.verdict).trim()}</td><td class="right">${marked(their.found.verdict).trim()}</td><td></td></tr>
        <tr><th scope="row">measurements</th><td class="right">${mine.postures.length}</td><td class="right">${their.found.postures.length}</td><td></td></tr>
      </tbody></table></div>`}`;
}
