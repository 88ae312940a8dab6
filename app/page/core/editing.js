// The plan that is open: its content, undone and redone, kept as a draft until it is saved, and what the server says of
// it.
import { batch, computed, effect, signal } from "@preact/signals";
import { get, getFile, latest, post, put, Refused } from "./api.js";
import { calibrationOf } from "./route.js";
import { begun, failed, ownerOf, refresh, say, versionOf } from "./store.js";

/**
 * @typedef {import("answers").StatedPosture} StatedPosture
 * @typedef {import("answers").PlanFile} PlanContent
 * @typedef {import("answers").CheckAnswer} CheckAnswer
 * @typedef {CheckAnswer & {[K in "scene" | "marks" | "touched_boxes" | "null_motion" |
 *   "said"]: NonNullable<CheckAnswer[K]>}} Checked
 * @typedef {{version: string | null, content: PlanContent | null}} OnDisk `content`: null where the file is no plan
 *   any more
 * @typedef {{plan: string, base: string | null, content: PlanContent, when: string}} Draft
 */

const MOST_STEPS = 200; // that can be undone

/** @type {import("@preact/signals").Signal<string>} the plan file, "" where none is open */
export const file = signal("");
/** The plan that is being opened, "" for none: the answer to what was to be opened before it is dropped. */
export const opening = signal("");
export const plan = signal(/** @type {PlanContent | null} */ (null));
/** Arms (zerobeam/arm/1, drawn) by what plans state as their robot. */
const arms = signal(/** @type {Record<string, import("answers").DrawnArm>} */ ({}));
/** The arm of the plan, whichever content it has; null where it cannot be had. */
export const arm = computed(() => (plan.value === null ? null : arms.value[robotKey(plan.value)] ?? null));
/** @type {import("@preact/signals").Signal<Checked | null>} the last answer of a check */
export const answer = signal(null);
/** Whether the plan has been changed since the answer. */
export const pending = signal(false);
/** @type {import("@preact/signals").Signal<Refused | null>} why the plan cannot be checked, or not be saved */
export const wrong = signal(null);
/** The posture that is chosen. */
export const chosen = signal(0);
/**
 * @type {import("@preact/signals").Signal<OnDisk | "gone" | null>} what the file holds now, where that is not what
 *   was opened
 */
export const conflict = signal(null);
/** @type {import("@preact/signals").Signal<string>} since when a draft that was found is of */
export const restored = signal("");

const past = signal(/** @type {{before: PlanContent[], after: PlanContent[]}} */ ({ before: [], after: [] }));
/**
 * @type {import("@preact/signals").Signal<{version: string | null, text: string}>} the file as it was read or written
 *   last
 */
const disk = signal({ version: null, text: "" });
/** The version that the edits were made from; another one on the disk is replaced only by choice. */
const base = signal(/** @type {string | null} */ (null));
let merging = ""; // the key of the last change: typing on is one step

export const canUndo = computed(() => past.value.before.length > 0);
export const canRedo = computed(() => past.value.after.length > 0);
export const unsaved = computed(() => plan.value !== null && JSON.stringify(plan.value) !== disk.value.text);

/**
 * State of the plan that is open: as it begins where another one is opened.
 * @template T @param {T} first
 */
export function ofPlan(first) {
  const now = signal({ of: "", value: first });
  return { get value() { return now.value.of === file.value ? now.value.value : first; },
    set value(value) { now.value = { of: file.value, value }; } };
}

/** @param {PlanContent} content @param {number} i */
export const jointsOf = (content, i) => {
  const posture = content.postures_deg[i];
  return Array.isArray(posture) ? posture : posture.joints_deg;
};

/**
 * Edits a plan. A posture that repeats another keeps its joints and its number; where it is changed itself, or the
 *   other is gone, it is one of its own.
 * @param {PlanContent} content @param {(plan: PlanContent) => void} edit
 */
function editRepeated(content, edit) {
  /** @type {Map<unknown, {of: number[] | StatedPosture, was: string}>} */
  const repeats = new Map();
  for (const row of content.postures_deg) if (!Array.isArray(row) && row.again != null)
    repeats.set(row, { of: content.postures_deg[row.again], was: JSON.stringify(row.joints_deg) });
  edit(content);
  content.postures_deg.forEach((row, i) => {
    const repeat = repeats.get(row);
    if (Array.isArray(row) || repeat === undefined) return;
    const at = content.postures_deg.indexOf(repeat.of);
    if (at < 0 || at > i || repeat.was !== JSON.stringify(row.joints_deg)) delete row.again;
    else Object.assign(row, { again: at, joints_deg: [...jointsOf(content, at)] });
  });
}

const robotKey = (/** @type {PlanContent} */ content) => JSON.stringify(content.robot);

/**
 * A robot file is named from the plan's folder in the plan, and from the app's folder elsewhere.
 * @param {PlanContent["robot"]} ref @param {string} planFile
 */
export function robotFrom(ref, planFile) {
  const folder = planFile.slice(0, planFile.lastIndexOf("/") + 1);
  if (typeof ref === "object") return { ...ref, urdf: folder + ref.urdf };
  return /\.(yaml|yml|json|urdf)$/.test(ref) ? folder + ref : ref;
}

/**
 * Fetches the arm of a content before that is shown: a draft and its file may be of different arms.
 * @param {PlanContent} content @param {string} name
 */
async function fetchArm(content, name) {
  const key = robotKey(content);
  if (key in arms.peek()) return;
  try {
    const found = await post("/api/robot", { robot: robotFrom(content.robot, name), j3: "pendant" });
    arms.value = { ...arms.peek(), [key]: found };
  } catch (error) {
    if (!(error instanceof Refused)) throw error; // then the check says what is wrong with the robot
  }
}

const DRAFT = "zerobeam:draft:";
const draftKey = (/** @type {string} */ name) => DRAFT + name;

/** @param {string} name @returns {Draft | null} */
function draftOf(name) {
  try {
    const found = JSON.parse(localStorage.getItem(draftKey(name)) ?? "null");
    return found && typeof found === "object" && Array.isArray(found.content?.postures_deg) ? found : null;
  } catch {
    return null;
  }
}

/** The drafts of plans whose files are gone, the newest first. @returns {Draft[]} */
export function lostDrafts() {
  let names = /** @type {string[]} */ ([]);
  try {
    names = Object.keys(localStorage).filter((key) => key.startsWith(DRAFT)).map((key) => key.slice(DRAFT.length));
  } catch { /* a browser that keeps nothing has no drafts */ }
  return names.flatMap((name) => (versionOf(name) === null ? draftOf(name) ?? [] : []))
    .sort((a, b) => b.when.localeCompare(a.when));
}

/** The drafts of a calibration whose plans' files are gone. @param {string} name */
export const lostDraftsOf = (name) => lostDrafts().filter((draft) => calibrationOf(draft.plan) === name);

const ask = latest(
  () => file.value,
  async () => (plan.value === null ? null : /** @type {Checked} */ (await post("/api/check",
    { plan: plan.value, scene: true, links: true, file: file.value }))),
  (found, newest) => batch(() => {
    answer.value = found;
    wrong.value = null;
    if (newest) pending.value = false;
  }),
  (error) => batch(() => {
    answer.value = null;
    wrong.value = error;
    pending.value = false;
  }),
);

/**
 * Opens a plan file: what it holds, or the draft that was left of it. Of a file that is gone the draft is opened.
 * What is open stays as it is edited; of several that are to be opened the last is.
 * @param {string} name
 */
export async function open(name) {
  const isOpen = name === file.value && plan.value !== null;
  opening.value = isOpen ? "" : name;
  if (isOpen) return;
  const found = await getFile("plan", name).catch((/** @type {unknown} */ error) => {
    if (opening.value !== name || (draftOf(name) !== null && versionOf(name) === null)) return null;
    opening.value = "";
    throw error;
  });
  const kept = draftOf(name);
  if (kept !== null) await fetchArm(kept.content, name);
  if (opening.value !== name) return;
  const draft = draftOf(name); // as it is by now
  const text = found === null ? "" : JSON.stringify(found.plan), version = found?.version ?? null;
  const differs = draft !== null && JSON.stringify(draft.content) !== text;
  const outdated = differs && draft.base !== version;
  batch(() => {
    if (found !== null) arms.value = { ...arms.peek(), [robotKey(found.plan)]: found.robot };
    opening.value = "";
    file.value = name;
    disk.value = { version, text };
    base.value = differs ? draft.base : version;
    plan.value = differs ? draft.content : found?.plan ?? null;
    past.value = { before: differs && found !== null ? [found.plan] : [], after: [] };
    answer.value = null;
    wrong.value = null;
    chosen.value = 0;
    pending.value = true;
    restored.value = differs ? draft.when : "";
    conflict.value = found === null ? "gone" : outdated ? { version, content: found.plan } : null;
    merging = "";
  });
  ask();
}

/** No plan is open any more. */
export function close() {
  batch(() => {
    file.value = opening.value = "";
    plan.value = answer.value = wrong.value = conflict.value = null;
    restored.value = "";
  });
}

/**
 * Changes the plan. Changes of the same `key` that follow each other are one step (a slider that is dragged); null is
 *   a step of its own.
 * @param {string | null} key @param {(plan: PlanContent) => void} edit
 */
export function change(key, edit) {
  const now = plan.value;
  if (now === null) return;
  const next = structuredClone(now);
  editRepeated(next, edit);
  if (JSON.stringify(next) === JSON.stringify(now)) return;
  const goesOn = key !== null && key === merging;
  merging = key ?? "";
  set(next, { before: goesOn ? past.value.before : [...past.value.before, now].slice(-MOST_STEPS), after: [] });
}

/** @param {PlanContent} next @param {{before: PlanContent[], after: PlanContent[]}} steps */
function set(next, steps) {
  batch(() => {
    if (plan.value !== null && robotKey(next) !== robotKey(plan.value)) answer.value = null;
    plan.value = next;
    past.value = steps;
    pending.value = true;
    chosen.value = Math.min(chosen.value, next.postures_deg.length - 1);
  });
  ask();
}

export function undo() {
  const { before, after } = past.value, now = plan.value, back = before.at(-1);
  if (now === null || back === undefined) return;
  merging = "";
  set(back, { before: before.slice(0, -1), after: [now, ...after] });
}

export function redo() {
  const { before, after } = past.value, now = plan.value;
  if (now === null || !after.length) return;
  merging = "";
  set(after[0], { before: [...before, now], after: after.slice(1) });
}

let saving = Promise.resolve(true);
/**
 * Writes the plan, after what is being written; where the file has changed meanwhile, `conflict` says so and nothing
 *   is written.
 * @param {string} [as] another file, a new one @returns {Promise<boolean>} whether it was written
 */
export function save(as = file.value) {
  const name = file.value;
  return saving = saving.catch(() => false).then(() => file.value === name && write(as));
}

/** @param {string} as */
async function write(as) {
  const content = plan.value, name = file.value, same = as === name, version = same ? base.value : null;
  if (content === null) return false;
  if (same && version !== null && !unsaved.value) return true;
  const text = JSON.stringify(content), left = () => file.value !== name; // another plan is open by now
  try {
    const done = await put("/api/plan", { file: as, plan: content }, version);
    if (!left() || JSON.stringify(draftOf(name)?.content) === text) forget(name);
    batch(() => {
      if (left()) return;
      file.value = done.file;
      disk.value = { version: done.version, text };
      base.value = done.version;
      conflict.value = null;
      restored.value = "";
      wrong.value = null;
    });
    say(`Saved as ${done.file}.`);
    await refresh();
    return true;
  } catch (error) {
    if (!(error instanceof Refused)) throw error;
    if (left()) failed(error, ownerOf(name));
    else if (error.status === 412
      && same) await showConflict(/** @type {Parameters<typeof showConflict>[0]} */ (error.current));
    else wrong.value = error;
    return false;
  }
}

/** Whether a plan, open or not, has changes that its file does not have. @param {string} name */
export const hasEdits = (name) => (name !== "" && name === file.value ? unsaved.value : draftOf(name) !== null);

/**
 * Saves such changes; false where the file has none of them, and `conflict` or `wrong` says why.
 * @param {string} name
 */
export async function saveEdits(name) {
  await open(name);
  return name === file.value && (!unsaved.value || save());
}

/**
 * What a refused save says of the file: what GET answers of it; null where it is gone.
 * @param {{version: string, content: {plan: PlanContent} | null} | null} current
 */
async function showConflict(current) {
  const content = current?.content?.plan ?? null, name = file.value;
  if (content !== null) await fetchArm(content, name);
  if (name === file.value) conflict.value = current ? { version: current.version, content } : "gone";
}

/** What the file holds takes the place of what is edited: it can be undone. */
export function takeTheirs() {
  const theirs = conflict.value, now = plan.value;
  if (theirs === null || theirs === "gone" || theirs.content === null || now === null) return;
  forget(file.value);
  batch(() => {
    disk.value = { version: theirs.version, text: JSON.stringify(theirs.content) };
    base.value = theirs.version;
    conflict.value = null;
    restored.value = "";
  });
  set(theirs.content, { before: [...past.value.before, now], after: [] });
}

/** What is edited takes the place of what the file holds now. */
export async function keepMine() {
  const theirs = conflict.value;
  if (theirs === null) return false;
  base.value = theirs === "gone" ? null : theirs.version;
  conflict.value = null;
  return save();
}

/** The edits are given up: the plan is as the file has it; of a file that is gone nothing is left. */
export function discard() {
  const text = disk.value.text, now = plan.value;
  if (now === null) return;
  forget(file.value);
  if (!text) { close(); return; }
  restored.value = "";
  base.value = disk.value.version;
  set(JSON.parse(text), { before: [...past.value.before, now], after: [] });
}

/** @param {string} name */
function forget(name) {
  try { localStorage.removeItem(draftKey(name)); } catch { /* a browser that keeps nothing has nothing to forget */ }
}

// What is not saved is kept by the browser: it survives a reload and the end of either program.
effect(() => {
  if (!file.value || plan.value === null) return;
  if (!unsaved.value) { forget(file.value); return; }
  const draft = { plan: file.value, base: base.value, content: plan.value, when: new Date().toISOString() };
  try { localStorage.setItem(draftKey(file.value),
    JSON.stringify(draft)); } catch { /* a full or closed store: leaving the page still asks */ }
});

// A change of the file that is open is noticed: taken where nothing is lost by it, else shown beside the edits.
effect(() => {
  const name = file.value, version = versionOf(name), open = conflict.peek();
  if (!name || !begun.value || version === disk.peek().version || (open !== null && open !== "gone")) return;
  if (version === null) {
    get("/api/files").then((listed) => { // what was saved just now is not listed yet
      if (file.peek() !== name || listed.some((one) => one.path === name)) return;
      // Nothing holds this content any more but the page: it is unsaved, and so a draft.
      batch(() => { disk.value = { version, text: "" }; conflict.value = "gone"; });
    }, failed);
    return;
  }
  getFile("plan", name).then((found) => {
    if (file.peek() !== name || found.version === disk.peek().version) return;
    const text = JSON.stringify(found.plan);
    if (text === JSON.stringify(plan.peek())) {
      batch(() => {
        disk.value = { version: found.version, text };
        base.value = found.version;
        conflict.value = null;
        restored.value = "";
      });
      return;
    }
    arms.value = { ...arms.peek(), [robotKey(found.plan)]: found.robot };
    conflict.value = { version: found.version, content: found.plan };
    if (!unsaved.peek()) {
      takeTheirs();
      say(`${name} was changed outside of this page: it is shown as it is now.`);
    }
  }, failed);
});

addEventListener("beforeunload", (event) => { if (unsaved.peek()) event.preventDefault(); });
