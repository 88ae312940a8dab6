// The columns of a table as joints: layout, proposals, and per joint its column, sign and range against the limits.
import { html } from "htm/preact";
import { fixed, withUnit } from "../core/words.js";
import { checked, Choice, Joint3, heard } from "../parts/Controls.js";
import { answer, layout, layOut, map, mapColumn, mapped, reverse, wrong } from "./mapping.js";
import { recordings } from "./sources.js";

/** @typedef {import("answers").JointColumn} JointColumn */
/** @typedef {import("answers").TableColumn} TableColumn */

/** @type {Record<string, string>} */
const WAY = { deg: "degrees", rad: "radians", mm: "millimetres", m: "metres", link: "link 2", ground: "the ground" };
const range = (/** @type {[number, number]} */ [low, high], /** @type {string} */ unit) =>
  `${fixed(low, 2)} to ${withUnit(fixed(high, 2), unit)}`;

function LayoutFields() {
  const own = recordings.value[0]?.found?.layout;
  if (!own) return null;
  /** @type {[string, string][]} */
  const signs = [[",", "comma"], [";", "semicolon"], ["\t", "tab"], [" ", "blank"]];
  if (!signs.some(([sign]) => sign === own.delimiter)) signs.push([own.delimiter, own.delimiter]);
  return html`
    <div class="fields">
      <${Choice} label="Header row" value=${String(own.header_row)}
        items=${[["true", "the first row names the columns"], ["false", "none"]]}
        onValue=${(/** @type {string} */ value) => layOut({ header_row: value === "true" })} />
      <${Choice} label="Delimiter" value=${own.delimiter} items=${signs}
        onValue=${(/** @type {string} */ value) => layOut({ delimiter: value })} />
      <${Choice} label="Decimal sign" value=${own.decimal} items=${[[".", "point"], [",", "comma"]]}
        onValue=${(/** @type {string} */ value) => layOut({ decimal: value })} />
      <p class="muted help">
        ${Object.keys(layout.value).length ? "As you state it." : `Found: ${own.why.join("; ")}.`}</p>
    </div>`;
}

/**
 * A proposal, or why there is none, and what takes it.
 * @param {{text: string, take?: (() => void) | null, decided?: boolean}} props
 */
function Proposal({ text, take = null, decided = true }) {
  return html`
    <div class=${take ? "proposed" : ""}><span>${text}</span>
      ${take && html`
        <button type="button" onClick=${take}>${decided ? "Take it" : "Take it unproved"}</button>`}</div>`;
}

function Proposals() {
  if (answer.value === null) return null;
  const { columns, units, lengths, j3 } = answer.value, now = mapped.value;
  const differs = columns !== null && JSON.stringify(columns.choice) !== JSON.stringify(now.columns);
  const ordered = columns
    && `Proposed columns: ${columns.choice.join(", ")}, because ${columns.why}. The order is not tested by this.`;
  /** @typedef {import("answers").Reading | null} Found */
  const readings = /** @type {["units" | "lengths" | "j3", string, Found][]} */ ([
    ["units", "Unit of the angles", units], ["lengths", "Unit of prismatic joints", lengths], ["j3", "Joint 3", j3],
  ]);
  return html`
    <div class="proposals" aria-live="polite">
      ${columns && differs && html`
        <${Proposal} text=${ordered} decided=${false} take=${() => map({ columns: [...columns.choice] })} />`}
      ${readings.map(([key, of, found]) => {
        if (found === null) return null;
        const { choice } = found;
        const text = choice ? `${of}: ${WAY[choice]} ${found.decided ? "by the limits" : "perhaps"}: ${found.why}.`
          : `${of}: ${found.why}.`;
        return html`
          <${Proposal} key=${key} text=${text} decided=${found.decided}
            take=${choice && choice !== now[key] ? () => map({ [key]: choice }) : null} />`;
      })}
    </div>`;
}

/** The range of a joint over its limits. @param {{joint: JointColumn, seen: [number, number]}} props */
function Bar({ joint, seen }) {
  const low = Math.min(joint.lower, seen[0]), high = Math.max(joint.upper, seen[1]);
  const at = (/** @type {number} */ value) => (100 * (value - low)) / (high - low || 1);
  const wide = (/** @type {number} */ from, /** @type {number} */ to) => Math.max(1, at(to) - at(from));
  return html`
    <svg viewBox="0 0 100 12" preserveAspectRatio="none" aria-hidden="true">
      <rect class="limits" x=${at(joint.lower)} y="0" width=${wide(joint.lower, joint.upper)} height="12" />
      <rect class=${joint.outside ? "range out" : "range"} x=${at(seen[0])} y="3" width=${wide(...seen)} height="6" />
    </svg>`;
}

/** @param {{joint: JointColumn, i: number, columns: TableColumn[], rows: number}} props */
function JointRow({ joint, i, columns, rows }) {
  const column = mapped.value.columns?.[i] ?? "", reversed = mapped.value.reversed.includes(i + 1);
  const { sign, seen, recorded, outside } = joint;
  const wish = sign !== null && sign.choice !== null && (sign.choice === "reversed") !== reversed;
  const refused = wrong.value?.key[0] === "columns" && wrong.value.key[1] === i;
  return html`
    <tr data-joint=${i}>
      <th scope="row">J${i + 1}<small>${joint.name}</small></th>
      <td data-head="column">
        <select aria-label=${`Column of J${i + 1}`} aria-invalid=${refused} value=${column}
          onChange=${heard((column) => mapColumn(i, column || null))}>
        <option value="" selected=${!column}>not stated</option>
        ${columns.map((one) => html`
          <option value=${one.stated} selected=${one.stated === column}
            disabled=${one.lowest === null}>
            ${one.lowest === null ? `${one.name} (no number in line ${one.line})` : one.name}</option>`)}
      </select></td>
      <td data-head="sign">
        <label class="check">
          <input type="checkbox" aria-label=${`J${i + 1}: reverse the sign`} checked=${reversed}
            onChange=${checked((on) => reverse(i + 1, on))} /> reversed</label></td>
      <td class="right" data-head="seen">
        ${seen ? range(seen, joint.unit) : recorded ? `${range(recorded, "1")} recorded` : "—"}</td>
      <td class="right" data-head="limits">${range([joint.lower, joint.upper], joint.unit)}</td>
      <td class=${outside ? "beyond" : ""} data-head="against the limits">
        ${seen && html`<${Bar} joint=${joint} seen=${seen} />`}${outside === null ? ""
          : outside ? `${outside} of ${rows} rows outside` : "all within"}</td>
      <td class=${wish ? "proposed" : ""} data-head="what the limits say">
        ${sign && html`
          <small>${sign.choice || !sign.outside.recorded ? `Sign ${sign.why}` : "Neither sign fits"}</small>`}
        ${wish && html`
          <button type="button"
            onClick=${() => reverse(i + 1, sign.choice === "reversed")}>
            ${sign.choice === "reversed" ? "Reverse it" : "Do not reverse"}</button>`}
      </td>
    </tr>`;
}

export function Mapper() {
  const found = answer.value, columns = recordings.value[0]?.found?.columns ?? [], now = mapped.value;
  const pick = (/** @type {"units" | "lengths" | "j3"} */ key) =>
    (/** @type {string} */ value) => map({ [key]: value });
  return html`
    <${LayoutFields} /><${Proposals} />
    ${wrong.value && html`<p class="fault" role="alert">${wrong.value.text}</p>`}
    ${found && html`
      <div class="fields">
        ${found.joints.some((joint) => joint.unit === "deg") && html`
          <${Choice} label="Unit of the angles" value=${now.units} none="choose"
            items=${[["deg", "degrees"], ["rad", "radians"]]} onValue=${pick("units")} />`}
        ${found.joints.some((joint) => joint.unit === "mm") && html`
          <${Choice} label="Unit of prismatic joints" value=${now.lengths} none="choose"
            items=${[["mm", "millimetres"], ["m", "metres"]]} onValue=${pick("lengths")} />`}
        <${Joint3} value=${now.j3} onValue=${pick("j3")} />
      </div>
      <div class="scroll" tabindex="0" role="region" aria-label="Columns as joints">
        <table class="mapper">
          <caption>
            ${found.whole ? `All ${found.rows} rows`
              : `The first ${found.rows} rows; the rest is checked at the import`},
            robot ${found.robot}.</caption>
          <thead><tr>
            ${["joint", "column", "sign", "seen", "limits", "against the limits",
              "what the limits say"].map((head, i) => html`
              <th scope="col" class=${i === 3 || i === 4 ? "right" : ""}>${head}</th>`)}</tr></thead>
          <tbody>${found.joints.map((joint, i) => html`
            <${JointRow} key=${i} joint=${joint} i=${i} columns=${columns} rows=${found.rows} />`)}</tbody>
        </table>
      </div>`}`;
}
