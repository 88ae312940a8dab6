// What the format may be told besides columns: its values are among what the recordings hold.
import { html } from "htm/preact";
import { Fields } from "../parts/Fields.js";
import { sources } from "./command.js";
import { fields, format, set, values } from "./formats.js";
import { recordings } from "./sources.js";

/** @typedef {import("./sources.js").Found} Found */
/** @typedef {import("../parts/Fields.js").Item} Item */

/** @param {Found} found @returns {Item[]} */
const columns = (found) => found.columns.map((column) => [column.stated, column.name]);
/** @param {Found} found */
const listed = (found) =>
  `columns of the table: ${found.columns.map((column) => column.stated).join(", ") || "none"}`;

export function Options() {
  const found = sources.value[0]?.found;
  const joints = recordings.value.find((row) => row.path === values.value["--joints"])?.found ?? found;
  if (!found || !joints || !fields.value.length) return null;
  const topics = found.topics.map((topic) => ({ ...topic, named: topic.joints.length > 0 }));
  const tables = recordings.value.filter((row) =>
    row.found?.columns.length && (row.path === values.value["--joints"] || sources.value.length > 1));
  /** @type {Record<string, Item[]>} */
  const offers = {
    columns: columns(found), "columns of the joints": columns(joints), tables: tables.map(({ path }) => [path, path]),
    topics: topics.filter((topic) => topic.named)
      .map((topic) => [topic.name, `${topic.name}: ${topic.messages} messages, ${topic.joints.join(", ")}`]),
    "other topics": topics.filter((topic) => !topic.named)
      .map((topic) => [topic.name, `${topic.name}: ${topic.messages} of ${topic.type}`]),
    points: found.points.map(({ name, joints: taught }) =>
      [name, `${name}${taught ? "" : " (no joint values: Cartesian, or not taught)"}`, taught]),
  };
  if (format.value === "points") delete offers.columns; // a remark may name the columns of such a table
  const names = [...new Set([...found.names, ...topics.flatMap((topic) => topic.joints)])];
  const hints = {
    "--joint-columns": listed(joints),
    "--decimal": found.layout?.decimal === "," ? "the numbers of the table seem to have commas" : "",
    "--columns": format.value === "ros" ? `found: ${names.join(", ")}` : listed(found),
    ...(format.value === "points" ? Object.fromEntries(["--number-column", "--time-column", "--reflector-column",
      "--quaternion-columns", "--rotation-columns"].map((flag) => [flag, listed(found)])) : {}),
  };
  return html`
    <${Fields} key=${format.value} fields=${fields.value} values=${values.value} onValue=${set} offers=${offers}
      hints=${hints} />`;
}
