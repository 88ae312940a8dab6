// What is asked before changes that are not saved would be lost: the file was changed meanwhile, or they are left.
import { html } from "htm/preact";
import { useEffect, useRef } from "preact/hooks";
import { signal, useSignal } from "@preact/signals";
import { counted } from "../core/counting.js";
import { arm, conflict, discard, file, keepMine, plan, save, takeTheirs, unsaved } from "../core/editing.js";
import { go, goOn, route, toJob } from "../core/route.js";
import { freeName } from "../core/store.js";
import { Table } from "./Table.js";

/**
 * A question, above the page until it is answered.
 * @param {{title: string, onClose: () => void, children?: unknown}} props `onClose`: Escape, or the button
 */
function Dialog({ title, onClose, children }) {
  const element = useRef(/** @type {HTMLDialogElement | null} */ (null));
  useEffect(() => { if (!element.current?.open) element.current?.showModal(); }, []);
  return html`
    <dialog ref=${element} aria-labelledby="dialog-title"
      onCancel=${(/** @type {Event} */ event) => { event.preventDefault(); onClose(); }}>
      <h2 id="dialog-title">${title}</h2>
      ${children}
    </dialog>`;
}

/**
 * The plan as it is edited, as a file of the person's own: also where the folder cannot take it.
 * @param {import("preact").TargetedMouseEvent<HTMLAnchorElement>} event
 */
function download(event) {
  const content = new Blob([`${JSON.stringify(plan.value, null, 1)}\n`],
    { type: "application/yaml" }); // JSON is YAML too
  const address = URL.createObjectURL(content);
  event.currentTarget.href = address;
  setTimeout(() => URL.revokeObjectURL(address), 10_000);
}

export const DownloadDraft = () => html`
  <a class="button" href="#" download=${file.value.replace(/^.*\//, "")} onClick=${download}>Download the plan</a>`;

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

/** The plan that is open was changed elsewhere: both are shown, and one is chosen. Nothing is written before. */
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

/** Where to go; "" where nobody leaves. */
export const leaving = signal("");

/** Before a calibration is left: changes are saved, kept as a draft, or given up. */
export function Leaving() {
  const to = leaving.value;
  if (!to) return null;
  const leave = () => { leaving.value = ""; go(to, { sure: true }); };
  const stay = () => { leaving.value = ""; };
  return html`
    <${Dialog} title="The plan has changes that are not saved" onClose=${stay}>
      <p>${file.value}. As a draft they stay in this browser, and are there when the plan is opened again.</p>
      <p class="bar">
        <button type="button" class="main"
          onClick=${async () => { if (await save()) leave(); else stay(); }}>Save</button>
        <button type="button" onClick=${leave}>Leave them as a draft</button>
        <button type="button" onClick=${() => { discard(); leave(); }}>Discard</button>
        <button type="button" onClick=${stay}>Stay</button>
      </p>
    <//>`;
}
