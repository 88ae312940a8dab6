// What an import may be told besides columns, by format, and the words of its command. Formats and their options are
// those of the makers' readers, as the server has them.
import { computed, signal } from "@preact/signals";
import { get } from "../core/api.js";
import { flagWords } from "../core/words.js";
import { recordings } from "./sources.js";

/** @typedef {import("./types.js").Found} Found */
/** @typedef {import("answers").FormField} FormatOption */
/** @typedef {import("answers").ImportForm} ImportForm */
/**
 * @typedef {{label: string, help?: string, none?: string, points?: boolean, words?: (found: Found) => [string,
 *   string][], about?: (found: Found) => string,
 *   of?: "joints"}} OptionFacts
 *   `of`: joints: its words are those of the table of the joints
 */

export const forms = signal(/** @type {ImportForm[] | null} */ (null));
export async function loadForms() { if (forms.value === null) forms.value = await get("/api/imports"); }

/** @param {string} name */
const formOf = (name) => forms.value?.find((one) => one.name === name);
/** The first sentence of what a format is. @param {string} name */
export const aboutOf = (name) => (formOf(name)?.about ?? name).replace(/\.(\s.*)?$/, "");

/**
 * The formats that files may have: the first is taken, unless the person has to say which ("" first).
 * @param {Found[]} founds
 */
export function formatsOf(founds) {
  const kinds = [...new Set(founds.map((found) => found.form))];
  const all = [...new Set(founds.flatMap((found) => found.formats))];
  // A table beside points is that of their joints.
  if (kinds.includes("points") && kinds.every((form) => form === "points" || form === "csv")) return ["points"];
  return kinds.length === 1 && (all.length === 1 || all.includes(kinds[0])) ? all : ["", ...all];
}

const DWELL = ["--still-deg", "--still-s", "--still-mm"];
/** Of a table the columns are mapped beside the options: what states them there is none of these. */
const MAPPED = ["--units", "--lengths", "--header-row", "--columns", "--delimiter", "--decimal", "--j3", "--reversed"];
/** What becomes necessary by another option. @type {Record<string, string>} */
const BY_TIME = { "--time-column": "time", "--time-units": "time", "--joints-time-column": "time",
  "--joints-time-units": "time", "--within-s": "time", "--number-column": "number",
  "--joints-number-column": "number" };

/** The columns of a table, to choose from. */
export const columns = (/** @type {Found} */ found) =>
  /** @type {[string, string][]} */ (found.columns.map((column) => [column.stated, column.name]));
const UNITS = /** @type {[string, string][]} */ (["s", "ms", "us", "ns"].map((unit) => [unit, unit]));
const ANGLES = /** @type {[string, string][]} */ ([["deg", "degrees"], ["rad", "radians"]]);
const COUNTED = /** @type {[string, string][]} */ ([["ground", "the ground"], ["link", "link 2"]]);
/** @param {Found} found */
export const listed = (found) =>
  `columns of the table: ${found.columns.map((column) => column.stated).join(", ") || "none"}`;

/**
 * What the page has to say of an option besides its help: by its name, or by format and name.
 * @type {Record<string, OptionFacts>}
 */
const OPTIONS = {
  measured: { label: "A measurement is",
    words: () => [["rows", "each row"], ["dwells", "each dwell of the arm (a pause)"]] },
  "--target-column": { label: "Target of each row", help: "column that names it, instead of one target for each file",
    words: columns, none: "no column" },
  "--shot-column": { label: "Measurement number", help: "column of numbers from 0", words: columns, none: "no column" },
  "--spot-columns": { label: "Spot on the PSD", help: "two columns, dx,dy in mm, if it was read" },
  "--time-column": { label: "Time", words: columns, none: "no column" },
  "--time-units": { label: "Unit of the times", words: () => UNITS, none: "choose" },
  "--still-deg": { label: "Dwell: each joint within (°)",
    help: "largest range of a revolute joint while the arm is at rest" },
  "--still-s": { label: "Dwell: at least (s)", help: "how long the arm is at rest for a measurement" },
  "--still-mm": { label: "Dwell: prismatic joints within (mm)", help: "for arms with prismatic joints" },
  "--marker-column": { label: "Marker (trigger)",
    help: "column: only dwells in which it becomes other than 0 are measurements", words: columns,
    none: "every dwell is a measurement" },
  "--small-angles": { label: "The angles are degrees, although all are as small as radians would be" },
  "--topic": { label: "Joint states on",
    words: (found) =>
      found.topics.filter((topic) => topic.joints.length)
        .map((topic) => [topic.name, `${topic.name}: ${topic.messages} messages, ${topic.joints.join(", ")}`]),
    none: "the only topic of joint states" },
  "--marker-topic": { label: "Marker topic (trigger)",
    help: "only dwells at a message on it are measurements; a std_msgs/String names the target",
    words: (found) =>
      found.topics.filter((topic) => !topic.joints.length)
        .map((topic) => [topic.name, `${topic.name}: ${topic.messages} of ${topic.type}`]),
    none: "every dwell is a measurement" },
  "ros --columns": { label: "Names of joint 1, 2, …",
    about: (found) => {
      const names = new Set([...found.names, ...found.topics.flatMap((topic) => topic.joints)]);
      return `in the messages, with commas; default: the robot's own. Found: ${[...names].join(", ")}`;
    } },
  "--points": { label: "Points that are measurements", points: true },
  "--tool": { label: "Tool of the robtargets",
    help: "as seen from the flange: X,Y,Z,Q1,Q2,Q3,Q4; without it robtargets are not read" },
  "--frame": { label: "Work object of the robtargets", help: "X,Y,Z,Q1,Q2,Q3,Q4; default: wobj0" },
  "--j3": { label: "Joint 3 is counted from", help: "on a FANUC pendant: the ground", words: () => COUNTED,
    none: "as the robot file states" },
  "--register": { label: "First position register", help: "of a plan's program; default: 1" },
  "--joints": { label: "Table of the joints",
    help: "drop it beside the points, or leave it if the joints are in the same table", none: "the same table" },
  "--joint-columns": { label: "Columns of joint 1, 2, …", about: listed, of: "joints" },
  "--joint-units": { label: "Unit of the joints", words: () => ANGLES, none: "choose" },
  "--units": { label: "Unit of the coordinates",
    words: () => [["mm", "millimetres"], ["m", "metres"], ["inch", "inches"]], none: "as the file states it" },
  "points --columns": { label: "Columns of x, y, z", about: (found) => `default: by these names; ${listed(found)}` },
  "--match": { label: "Points and joints belong together by",
    words: () => [["number", "number or order"], ["time", "time"]], none: "choose" },
  "--number-column": { label: "Numbers of the points", help: "or names that end with them", words: columns,
    none: "row by row" },
  "--joints-number-column": { label: "Numbers in the table of the joints", words: columns, none: "row by row",
    of: "joints" },
  "--joints-time-column": { label: "Times in the table of the joints", words: columns, none: "choose", of: "joints" },
  "points --time-units": { label: "Unit of the times",
    help: "s, ms, us, ns, iso, or a pattern such as %d.%m.%Y %H:%M:%S" },
  "--joints-time-units": { label: "Unit of the times of the joints", help: "if it is another one" },
  "--within-s": { label: "Largest time between a point and its joints (s)" },
  "--quaternion-columns": { label: "Of poses: columns of the quaternion w, x, y, z",
    help: "with commas; or angles, below" },
  "--rotation-columns": { label: "Of poses: columns of three angles", help: "with commas, in the order of the axes" },
  "--rotation-units": { label: "Unit of these angles", words: () => ANGLES, none: "choose" },
  "--euler": { label: "Axes of the angles",
    help: "in the order of the columns, fixed or moving with the body: XYZ-fixed, ZYX-moving, …; "
    + "vector: a rotation vector; find: the order that fits the nominal arm" },
  "--inverse": { label: "The poses of the table are",
    help: "the inverse rotation, or the inverse pose, where the table says how the instrument lies as the body sees it",
    words: () => [["none", "as they are"], ["rotation", "inverse rotations"], ["pose", "inverse poses"]],
    none: "looked at" },
  "--uncertainty": { label: "Level of the uncertainty columns",
    words: () => [["1sigma", "one standard uncertainty"], ["95", "95 %"], ["none", "they are not used"]],
    none: "there are none" },
  "--instrument": { label: "Instrument of the header", help: "if it states several" },
  "--reflector": { label: "Reflector of all points", help: "if there are several" },
  "--reflector-column": { label: "Column with each point's reflector", words: columns, none: "no column" },
  "--decimal": { label: "Decimal sign", words: () => [[",", "comma"]], none: "point",
    about: (found) => (found.layout?.decimal === "," ? "the numbers of the table seem to have commas" : "") },
  "--lengths": { label: "Unit of prismatic joints", words: () => [["mm", "millimetres"], ["m", "metres"]],
    none: "there are none" },
};
export const format = signal("");
export const values = signal(/** @type {Record<string, string>} */ ({}));

/** @param {string} key @param {string} value */
export function set(key, value) { values.value = { ...values.value, [key]: value }; }

/** @param {string} next */
export function setFormat(next) {
  if (next !== format.value) values.value = {};
  format.value = next;
}

/**
 * The options of the format, by name.
 * @type {import("@preact/signals").ReadonlySignal<Record<string, FormatOption>>}
 */
const options = computed(() =>
  Object.fromEntries((formOf(format.value)?.options ?? []).map((option) => [option.flag, option])));
/** @param {string} key @returns {FormatOption | undefined} */
export const optionOf = (key) => options.value[key];

/**
 * What a field says of an option: of one that has no words here, those of its command.
 * @param {string} key @returns {OptionFacts}
 */
export function factsOf(key) {
  const facts = OPTIONS[`${format.value} ${key}`] ?? OPTIONS[key], option = options.value[key];
  if (facts || !option) return facts ?? { label: key };
  return { label: flagWords(key), help: option.help, none: option.required ? "choose" : "not stated",
    words: option.choices.length ? () => option.choices.map((word) => [word, word]) : undefined };
}

/** The options that the format has, as far as others make them necessary. */
export const shown = computed(() => {
  const all = Object.keys(options.value), has = (/** @type {string} */ key) => Boolean(values.value[key]);
  if (format.value === "csv") {
    const rows = values.value.measured !== "dwells";
    return ["measured",
      ...all.filter((key) =>
        !MAPPED.includes(key)
          && (key === "--shot-column" ? rows : key === "--time-units" ? has("--time-column")
            : DWELL.includes(key) || key === "--marker-column" ? !rows : true))];
  }
  // Joint states in text have no times.
  if (recordings.value[0]?.found?.form === "joint states") return all.filter((key) => key === "--columns");
  if (format.value !== "points") return all;
  return all.filter((key) => {
    if (key === "--match") return has("--joints");
    if (key in BY_TIME) return has("--joints") && values.value["--match"] === BY_TIME[key];
    if (key === "--rotation-units" || key === "--euler") return has("--rotation-columns");
    if (key === "--inverse") return has("--rotation-columns") || has("--quaternion-columns");
    return true;
  });
});

/** What must be stated before the import, in words; null where all is. */
export const open = computed(() => {
  const has = (/** @type {string} */ key) => Boolean(values.value[key]);
  const needs = (/** @type {string} */ key) => shown.value.includes(key) && !has(key);
  const dwells = format.value === "csv" || format.value === "ros" || format.value.startsWith("log ");
  if (dwells && (needs("--still-deg") || needs("--still-s"))) {
    return "state what a dwell is: within how many degrees, for how long";
  }
  if (format.value === "csv" && values.value.measured === "dwells" && !has("--time-column")) {
    return "state the column of times";
  }
  if (format.value === "csv" && needs("--time-units")) return "state the unit of the times";
  if (needs("--joint-columns")) return "state the columns of the joints";
  if (needs("--joint-units")) return "state the unit of the joints";
  if (needs("--match")) return "state how points and joints belong together";
  if (["--time-column", "--time-units", "--joints-time-column", "--within-s"].some((key) =>
    format.value === "points" && needs(key))) {
    return "state both columns of times, their unit and the largest time between";
  }
  if (needs("--rotation-units") || needs("--euler")) return "state unit and order of the angles";
  const required = shown.value.find((key) => options.value[key]?.required && !has(key));
  return required ? `state: ${factsOf(required).label}` : null;
});

/** The words of the options that are shown. */
export const optionWords = computed(() =>
  shown.value.filter((key) => key.startsWith("--") && values.value[key]).map((key) => {
  const value = values.value[key], option = options.value[key];
  return option.box ? key : `${key}=${option.number ? value.replace(",", ".") : value}`;
}));
