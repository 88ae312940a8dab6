// What the whole page shares: the folder's files and calibrations, kept up to date, and what is said of faults.
import { computed, signal } from "@preact/signals";
import { get, Refused, STARTED_ANEW } from "./api.js";
import { route } from "./route.js";

/** @typedef {import("answers").FolderFile} FolderFile */
/** @typedef {import("answers").Calibration} Calibration */

const EVERY_MS = 2000; // the folder is looked at, while the page is visible

export const files = signal(/** @type {FolderFile[]} */ ([]));
export const robots = signal(/** @type {import("answers").BuiltInRobot[]} */ ([]));
export const home = signal(/** @type {import("answers").HomeAnswer | null} */ (null));
export const fault = signal(/** @type {string} */ (""));
/** Whether the folder has been read, or that was refused: what is shown before knows nothing of it. */
export const begun = signal(false);
/** Said by a screen reader, and shown for some seconds. */
export const notice = signal(/** @type {string} */ (""));

/** The calibration that is open; null where there is none of this name. */
export const calibration = computed(() =>
  home.value?.calibrations.find((one) => one.name === route.value.name) ?? null);

/**
 * The calibration that a file is of: the one that lists it, else the innermost folder of one that is known or open.
 * @param {string} file
 */
export function ownerOf(file) {
  const known = home.value?.calibrations ?? [];
  const listing = known.find((one) => Object.values(one.files).some((names) => names.includes(file)));
  if (listing) return listing.name;
  const around = [route.value.name, ...known.map((one) => one.name)].filter((one) =>
    one === "." || file.startsWith(`${one}/`));
  return around.sort((a, b) => b.length - a.length)[0] ?? ".";
}

/** The file that the address names; "" where that is of another calibration: nothing is shown under another's name. */
export const addressed = computed(() => (ownerOf(route.value.file) === route.value.name ? route.value.file : ""));

/** @param {unknown} error @param {string} [of] the calibration, which is named where it has been left meanwhile */
export function failed(error, of = route.value.name) {
  if (!(error instanceof Refused)) throw error;
  fault.value = (of && of !== route.value.name ? `${of}: ` : "") + error.text;
}

/**
 * Carries work out, and says at the top of the page where it is refused.
 * @template T @param {() => Promise<T>} work @returns {Promise<T | undefined>}
 */
export async function attempt(work) {
  const { name } = route.value;
  try {
    fault.value = "";
    return await work();
  } catch (error) {
    failed(error, name);
    return undefined;
  }
}

/**
 * State that each calibration has of its own: what is set in one is as it begins in another.
 * @template T @param {T} first
 */
export function ofCalibration(first) {
  const all = signal(/** @type {Map<string, T>} */ (new Map()));
  return {
    /** @returns {T} */
    get value() { return all.value.get(route.value.name) ?? first; },
    set value(next) { this.set(next); },
    /** What has come of it in a calibration, whichever is open by now. @param {T} next @param {string} [of] */
    set(next, of = route.value.name) { all.value = new Map(all.value).set(of, next); },
  };
}

/** What is typed into a form of each calibration, by option. @param {import("../parts/Fields.js").Values} [first] */
export function typedIn(first = {}) {
  const typed = ofCalibration(first);
  return { get value() { return typed.value; },
    set: (/** @type {string} */ flag, /** @type {string} */ text) => {
      typed.value = { ...typed.value, [flag]: text };
    },
    clear: () => { typed.value = first; } };
}

let silence = 0;
/** @param {string} text */
export function say(text) {
  clearTimeout(silence);
  notice.value = text;
  silence = setTimeout(() => { notice.value = ""; }, 8000);
}

/** The version of a file as the folder has it; null where it is gone. @param {string} path */
export const versionOf = (path) => files.value.find((file) => file.path === path)?.version ?? null;

/** @param {string} kind */
export const ofKind = (kind) => files.value.filter((file) => file.kind === kind).map((file) => file.path);

/**
 * A name that no file and no folder of files has.
 * @param {string} name @param {string} [before] what is before a number that is added
 */
export function freeName(name, before = "-") {
  const dot = name.lastIndexOf("."), cut = dot > name.lastIndexOf("/") + 1 ? dot : name.length;
  for (let k = 1; ; k++) {
    const other = k === 1 ? name : `${name.slice(0, cut)}${before}${k}${name.slice(cut)}`;
    if (!files.value.some(({ path }) => path === other || path.startsWith(`${other}/`))) return other;
  }
}

/** Looks at the folder now: after a file was written. */
export async function refresh() {
  const [found, calibrations] = await Promise.all([get("/api/files"), get("/api/home")]);
  files.value = found;
  home.value = calibrations;
}

/** Begins to look at the folder, as long as somebody looks at the page. */
export async function begin() {
  await attempt(async () => {
    [robots.value] = await Promise.all([get("/api/robots"), refresh()]);
  });
  begun.value = true;
  const look = async () => {
    if (document.visibilityState === "visible") {
      try {
        const found = await get("/api/files");
        const was = files.value.map((file) => file.path + file.version).join();
        if (found.map((file) => file.path + file.version).join() !== was) {
          files.value = found;
          home.value = await get("/api/home");
        }
      } catch (error) {
        if (!(error instanceof Refused)) throw error;
        if (error.status === STARTED_ANEW) { fault.value = error.text; return; } // nothing of it is answered any more
      }
    }
    setTimeout(look, EVERY_MS);
  };
  setTimeout(look, EVERY_MS);
}

/** The folder of a calibration as file names begin. @param {string} name */
export const inside = (name) => (name === "." ? "" : `${name}/`);
