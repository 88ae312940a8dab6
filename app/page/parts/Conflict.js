// The plan that is open was changed elsewhere meanwhile: both are shown, and one is chosen. Nothing is written before.
import { html } from "htm/preact";
import { useSignal } from "@preact/signals";
import { counted } from "../core/counting.js";
import { arm, conflict, file, keepMine, plan, save, takeTheirs, unsaved } from "../core/editing.js";
import { goOn, route, toJob } from "../core/route.js";
import { freeName } from "../core/store.js";
import { Dialog } from "./Dialog.js";
import { DownloadDraft } from "./DownloadDraft.js";
import { Table } from "./Table.js";

const MOST = 30; // differences that are shown

/**
 * The values at which two contents differ, by their key.
 * @param {unknown} mine @param {unknown} theirs @param {string} [key] @returns {[string, string, string][]}
 */
function differences(mine, theirs, key = "") {
  if (JSON.stringify(mine) === JSON.stringify(theirs)) return [];
  if (!isPart(mine) || !isPart(theirs)) return [[key, short(mine), short(theirs)]];
  const keys = [...new Set([...Object.keys(mine), ...Object.keys(theirs)])];
  return keys.flatMap((one) => differences(mine[one], theirs[one], key ? `${key} / ${one}` : one));
}
/** @param {unknown} value @returns {value is Record<string, unknown>} */
const isPart = (value) => value !== null && typeof value === "object";
/**
 * A plan with its joints by the pendant's names, as the pendant counts them.
 * @param {import("../core/editing.js").PlanContent} content @param {import("../core/counting.js").CountedArm} body
 */
function named(content, body) {
  const joints = (/** @type {number[]} */ values) =>
    Object.fromEntries(counted(body, values)
      .map((value, i) => [body.pendant.names[i] ?? `J${i + 1}`, Number(value.toFixed(6))]));
  return { ...content,
    postures_deg: content.postures_deg.map((one) =>
      (Array.isArray(one) ? joints(one) : { ...one, joints_deg: joints(one.joints_deg) })) };
}
const short = (/** @type {unknown} */ value) => {
  const text = value === undefined ? "—" : JSON.stringify(value);
  return text.length > 60 ? `${text.slice(0, 57)}…` : text;
};

export function Conflict() {
  const theirs = conflict.value, busy = useSignal(false);
  if (theirs === null || !unsaved.value) return null;
  const broken = theirs !== "gone" && theirs.content === null;
  const content = theirs === "gone" ? null : theirs.content, mine = plan.value, body = arm.value;
  const other = content !== null && JSON.stringify(content.robot) !== JSON.stringify(mine?.robot);
  const asNamed = body !== null && !other && mine !== null;
  const rows = content === null ? [] : asNamed ? differences(named(mine, body), named(content, body))
    : differences(mine, content);
  const during = (/** @type {() => unknown} */ work) =>
    async () => { busy.value = true; await work(); busy.value = false; };
  const copy = freeName(file.value.replace(/(\.ya?ml)?$/, "-mine.yaml"));
  const saveCopy = async () => {
    const from = route.value;
    if (await save(copy)) goOn(from, toJob(route.value.name, route.value.step, copy), { replace: true, sure: true });
  };
  return html`
    <${Dialog} title=${theirs === "gone" ? "The plan's file is gone" : "The plan's file was changed meanwhile"}
      onClose=${() => { conflict.value = null; }}>
      <p>${file.value} ${theirs === "gone"
        ? "was deleted or moved outside of this page. The plan is still here, and kept as a draft in this browser."
        : "was changed in another window or program since it was opened here. Nothing is written until you choose."}</p>
      ${broken && html`<p class="error">The file is no plan any more, or cannot be read.</p>`}
      ${other && html`<p class="error">The file is now a plan of another robot than yours.</p>`}
      ${rows.length > 0 && html`
        <${Table} name="Differences" heads=${["value", "yours", "in the file"]}>
          <tbody>${rows.slice(0, MOST)
            .map(([key, mine, other]) => html`
              <tr><th scope="row">${key}</th><td>${mine}</td><td>${other}</td></tr>`)}</tbody><//>
        ${body !== null && rows.some(([key]) => key.startsWith("postures_deg")) && html`
          <p class="muted">
            ${other ? "Joints are as in the files: joint 3 from link 2."
              : "Joints are as the pendant counts them, in degrees (mm)."}</p>`}
        ${rows.length > MOST && html`<p class="muted">And ${rows.length - MOST} more.</p>`}`}
      <p class="bar">
        <button type="button" disabled=${busy.value}
          onClick=${during(keepMine)}>
          ${theirs === "gone" ? "Write the file again" : "Overwrite the file with mine"}</button>
        ${theirs !== "gone" && !broken && html`
          <button type="button" disabled=${busy.value} onClick=${takeTheirs}>Take the file's</button>`}
        <button type="button" disabled=${busy.value} onClick=${during(saveCopy)}>Save mine as ${copy}</button>
        <${DownloadDraft} />
      </p>
    <//>`;
}
