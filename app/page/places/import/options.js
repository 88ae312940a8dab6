// What an import may be told besides columns, by format, and the words of its command.
import { by, fill, make } from "/page/parts/dom.js";

const DWELL = ["--still-deg", "--still-s", "--still-mm"];
const POINTS = ["--points"];
// By format: its name, the words of the command, its options.
export const FORMATS = {
  csv: ["Table, one layout stated by you", ["csv"], ["measured", "--target-column", "--shot-column", "--spot-columns", "--time-column", "--time-units", ...DWELL, "--marker-column", "--small-angles"]],
  "log ur": ["RTDE recording of a UR (record.py)", ["log", "ur"], [...DWELL, "--marker-column"]],
  "log egm": ["EGM log of an ABB (abb_libegm)", ["log", "egm"], [...DWELL, "--marker-column"]],
  "log robodk": ["MonitorJoints log of RoboDK", ["log", "robodk"], [...DWELL, "--j3", "--marker-column"]],
  ros: ["ROS bag", ["ros"], ["--topic", "--columns", ...DWELL, "--marker-topic"]],
  "joint states": ["Joint states in text (ros2 topic echo)", ["ros"], ["--columns"]],
  rapid: ["ABB RAPID: targets, or log of a plan's program", ["rapid"], [...POINTS, "--tool", "--frame"]],
  kuka: ["KUKA KRL: data list", ["kuka"], POINTS],
  fanuc: ["FANUC: TP program or position registers", ["fanuc"], ["--j3", ...POINTS, "--register"]],
  "universal-robots": ["UR: log of a plan's program", ["universal-robots"], []],
  robodk: ["RoboDK: log of a plan's program", ["robodk"], ["--j3"]],
};
const TIMED = ["--time-column", "--time-units", ...DWELL, "--marker-column"];
const columns = (found) => found.columns.map((column) => [column.stated, column.name]);
const OPTIONS = {
  measured: { label: "A measurement is", words: () => [["rows", "each row"], ["dwells", "each dwell of the arm (a pause)"]] },
  "--target-column": { label: "Target of each row", help: "column that names it, instead of one target for each file", words: columns, none: "no column" },
  "--shot-column": { label: "Measurement number", help: "column of numbers from 0", words: columns, none: "no column" },
  "--spot-columns": { label: "Spot on the PSD", help: "two columns, dx,dy in mm, if it was read" },
  "--time-column": { label: "Time", words: columns, none: "no column" },
  "--time-units": { label: "Unit of the times", words: () => ["s", "ms", "us", "ns"].map((u) => [u, u]), none: "choose" },
  "--still-deg": { label: "Dwell: each joint within (°)", help: "largest range of a revolute joint while the arm is at rest" },
  "--still-s": { label: "Dwell: at least (s)", help: "how long the arm is at rest for a measurement" },
  "--still-mm": { label: "Dwell: prismatic joints within (mm)", help: "for arms with prismatic joints" },
  "--marker-column": { label: "Marker (trigger)", help: "column: only dwells in which it becomes other than 0 are measurements", words: columns, none: "every dwell is a measurement" },
  "--small-angles": { label: "The angles are degrees, although all are as small as radians would be", box: true },
  "--topic": { label: "Joint states on", words: (found) => found.topics.filter((t) => t.joints.length).map((t) => [t.name, `${t.name}: ${t.messages} messages, ${t.joints.join(", ")}`]), none: "the only topic of joint states" },
  "--marker-topic": { label: "Marker topic (trigger)", help: "only dwells at a message on it are measurements; a std_msgs/String names the target", words: (found) => found.topics.filter((t) => !t.joints.length).map((t) => [t.name, `${t.name}: ${t.messages} of ${t.type}`]), none: "every dwell is a measurement" },
  "--columns": { label: "Names of joint 1, 2, …", told: (found) => `in the messages, with commas; default: the robot's own. Found: ${[...new Set([...found.names, ...found.topics.flatMap((t) => t.joints)])].join(", ")}` },
  "--points": { label: "Points", points: true },
  "--tool": { label: "Tool of the robtargets", help: "as seen from the flange: X,Y,Z,Q1,Q2,Q3,Q4; without it robtargets are not read" },
  "--frame": { label: "Work object of the robtargets", help: "X,Y,Z,Q1,Q2,Q3,Q4; default: wobj0" },
  "--j3": { label: "Joint 3 is counted from", help: "on a FANUC pendant: the ground", words: () => [["ground", "the ground"], ["link", "link 2"]], none: "as the robot file states" },
  "--register": { label: "First position register", help: "of a plan's program; default: 1" },
};

export const values = {};

function field(key, found, changed) {
  const own = OPTIONS[key], help = `import-help${key}`;
  const set = (value) => { values[key] = value; changed(); };
  if (own.points) return pointBoxes(found, set);
  if (own.box) {
    const box = make("input", { type: "checkbox" });
    box.checked = Boolean(values[key]);
    box.addEventListener("change", () => set(box.checked));
    return make("label", { class: "check", "data-option": key }, box, ` ${own.label}`);
  }
  const input = own.words ? make("select", {}, ...(own.none ? [make("option", { value: "" }, own.none)] : []), ...own.words(found).map(([value, text]) => make("option", { value }, text))) : make("input", { autocomplete: "off", spellcheck: "false" });
  if (values[key] !== undefined) input.value = values[key];
  values[key] = input.value;
  input.addEventListener("input", () => set(input.value.trim()));
  const said = own.told ? own.told(found) : own.help;
  if (said) input.setAttribute("aria-describedby", help);
  return make("div", { "data-option": key }, make("label", {}, own.label, " ", input), said ? make("span", { class: "help", id: help }, said) : "");
}

// Which points are measurements; all that have joints where nothing is left out.
function pointBoxes(found, set) {
  const boxes = found.points.map(({ name, joints }) => {
    const box = make("input", { type: "checkbox", value: name });
    box.checked = values["--points"] ? values["--points"].split(",").includes(name) : joints;
    box.addEventListener("change", () => set(boxes.every((one) => one.checked) ? "" : boxes.filter((one) => one.checked).map((one) => one.value).join(",")));
    return box;
  });
  if (values["--points"] === undefined && boxes.some((box) => !box.checked)) values["--points"] = boxes.filter((box) => box.checked).map((box) => box.value).join(",");
  return make("fieldset", { class: "points", "data-option": "--points" }, make("legend", {}, "Points that are measurements"),
    ...found.points.map(({ name, joints }, i) => make("label", { class: "check" }, boxes[i], ` ${name}${joints ? "" : " (no joint values: Cartesian, or not taught)"}`)));
}

export function show(format, found, changed) {
  const again = () => { hide(format); changed(); };
  fill(by("import-options"), FORMATS[format][2].map((key) => field(key, found, again)));
  hide(format);
}

function hide(format) {
  if (format !== "csv") return;
  const rows = values.measured !== "dwells";
  for (const key of TIMED) {
    const only = key !== "--time-column" && key !== "--time-units";
    by("import-options").querySelector(`[data-option="${key}"]`).hidden = rows && only;
  }
  by("import-options").querySelector('[data-option="--shot-column"]').hidden = !rows;
}

// What must be stated before the import, in words; null where all is.
export function open(format) {
  const shown = (key) => by("import-options").querySelector(`[data-option="${key}"]:not([hidden])`);
  if (shown("--still-deg") && !(values["--still-deg"] && values["--still-s"])) return "state what a dwell is: within how many degrees, for how long";
  if (format === "csv" && values.measured === "dwells" && !values["--time-column"]) return "state the column of times";
  if (values["--time-column"] && !values["--time-units"]) return "state the unit of the times";
  return null;
}

// The words of the options that are shown.
export function words(format) {
  const stated = [];
  for (const key of FORMATS[format][2]) {
    const element = by("import-options").querySelector(`[data-option="${key}"]`), value = values[key];
    if (!key.startsWith("--") || !element || element.hidden || !value) continue;
    stated.push(value === true ? key : `${key}=${value}`);
  }
  return stated;
}
