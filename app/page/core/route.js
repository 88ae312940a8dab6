// The address says what is open: #/, #/new, #/import, #/job/NAME/STEP, #/job/NAME/STEP/FILE.
import { signal } from "@preact/signals";

/** @typedef {"cell" | "plan" | "measure" | "result"} Step */
/** @typedef {{view: "home" | "new" | "import" | "job", name: string, step: Step, file: string}} Route */

/** @type {Step[]} */
export const STEPS = ["cell", "plan", "measure", "result"];

/** @param {string} hash @returns {Route} */
export function read(hash) {
  const parts = hash.replace(/^#\/?/, "").split("/").map(decodePart);
  const [view, name = "", step = "", ...file] = parts;
  if (view === "new") return { view, name: "", step: "cell", file: "" };
  if (view === "import") return { view, name: "", step: "cell", file: [name, step, ...file].filter(Boolean).join("/") };
  if (view === "job" && name) {
    return { view, name, step: STEPS.find((known) => known === step) ?? "plan", file: file.join("/") };
  }
  return { view: "home", name: "", step: "cell", file: "" };
}

/** @param {string} part */
function decodePart(part) {
  try {
    return decodeURIComponent(part);
  } catch {
    return part;
  }
}

/** @param {string} name @param {Step} step @param {string} [file] */
export const toJob = (name, step, file = "") =>
  `#/job/${encodeURIComponent(name)}/${step}${file ? `/${file.split("/").map(encodeURIComponent).join("/")}` : ""}`;
/** @param {string} [file] */
export const toImport = (file = "") => `#/import${file ? `/${file.split("/").map(encodeURIComponent).join("/")}` : ""}`;

export const route = signal(read(location.hash));

let last = location.hash;
/** @type {(to: string) => boolean} whether what is open may be left for another address */
let mayLeave = () => true;
/** @param {(to: string) => boolean} ask */
export function guardLeaving(ask) { mayLeave = ask; }

/** @param {string} hash @param {{replace?: boolean, sure?: boolean}} [how] */
export function go(hash, { replace = false, sure = false } = {}) {
  if (!replace && !sure) { location.hash = hash; return; }
  history[replace ? "replaceState" : "pushState"](null, "", hash);
  last = hash;
  route.value = read(hash);
}

/**
 * Goes on to what has been done, unless its reader has left meanwhile.
 * @param {Route} from @param {string} hash @param {Parameters<typeof go>[1]} [how]
 */
export function goOn(from, hash, how) {
  if (route.value.view === from.view && route.value.name === from.name) go(hash, how);
}

/**
 * The folder of a file: of a plan, a run or a header its calibration; what any file is of, a report's too, `ownerOf`
 *   says.
 * @param {string} file
 */
export const calibrationOf = (file) => (file.includes("/") ? file.slice(0, file.lastIndexOf("/")) : ".");

/** Begins to follow the address. */
export function follow() {
  addEventListener("hashchange", () => {
    if (location.hash === last) return;
    const next = read(location.hash), here = route.value;
    if ((next.view !== here.view || next.name !== here.name) && !mayLeave(location.hash)) {
      history.replaceState(null, "", last);
      return;
    }
    last = location.hash;
    route.value = next;
  });
  // The token of the address has become a cookie: it is not left where it is read over a shoulder or copied.
  if (location.search) history.replaceState(null, "", location.pathname + location.hash);
}
