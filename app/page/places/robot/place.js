// The place Robot: an arm of the library or of a file, its joints, and the flange's pose to hold against the pendant.
import { latest, post } from "/page/parts/api.js";
import { by, fill, fixed, make, named, options, say, withUnit } from "/page/parts/dom.js";
import { jointRows } from "/page/parts/joints.js";
import { posed, show, within } from "/page/parts/picture.js";
import { axesOf, framesOf, meshesOf, placed } from "/page/places/robot/shape.js";

let values = [], shape = "", setRows = null, visible = false, arm = null;

function stated() {
  const name = by("robot-name").value;
  if (!name.endsWith(".urdf")) return name;
  return { urdf: name, base: by("robot-base").value, tip: by("robot-tip").value };
}

const ask = latest(
  () => post("/api/robot", { robot: stated(), j3: by("robot-j3").value, ...(values.length ? { joints_deg: values } : {}) }),
  shown,
  (error) => {
    by("fault").textContent = error.text;
    by("fault").hidden = false;
    arm = null;
    by("robot-facts").textContent = "";
    fill(by("robot-pose").tBodies[0], []);
  },
);

const cells = (digits, unit, of) => of.map((v) => withUnit(fixed(v, digits), unit)).join(", ");

// The rows that `zerobeam robot` prints.
const forms = (pose) => [
  ["X, Y, Z", cells(2, "mm", pose.xyz_mm), "all"],
  ["q1, q2, q3, q4", cells(5, "", pose.quaternion_wxyz), "ABB"],
  ["A, B, C", cells(3, "deg", pose.abc_deg), "KUKA"],
  ["W, P, R", cells(3, "deg", pose.rpy_deg), "FANUC, roll pitch yaw"],
  ["rx, ry, rz", cells(4, "rad", pose.rotation_vector_rad), "UR"],
  ["Rx, Ry, Rz", cells(3, "deg", pose.rx_ry_rz_deg), "Stäubli"],
];

function shown(answer) {
  arm = answer;
  by("fault").hidden = true;
  const pose = answer.poses[0];
  const now = JSON.stringify([by("robot-name").value, answer.joints]);
  if (now !== shape) {
    shape = now;
    values = [...pose.counted_deg];
    setRows = jointRows(by("robot-joints"), answer.joints, (i, value) => { values[i] = value; ask(); });
    setRows(values);
    fill(by("robot-table").tBodies[0], answer.joints.map((joint, i) => make("tr", {},
      make("th", { scope: "row" }, answer.pendant.names[i]), make("td", {}, joint.name), make("td", {}, joint.kind),
      ...[joint.lower, joint.upper].map((v) => make("td", { class: "right" }, withUnit(String(Number(v.toFixed(2))), joint.unit))),
      make("td", { class: "right" }, joint.speed === null ? "not stated" : `${withUnit(String(Number(joint.speed.toFixed(2))), joint.unit)}/s`))));
    by("robot-facts").textContent = `${[answer.vendor, answer.model || answer.name].filter(Boolean).join(", ")}: ${answer.joints.length} joints. The flange gets up to ${fixed(answer.reach_mm, 0)} mm from the axis of joint 1. ${answer.pendant.joint3 === "ground" ? "Joint 3 is counted from the ground: the angle between links 2 and 3 is J2 + J3." : "Joint 3 is counted from link 2."} ${answer.mounting.below_base_mm === null ? "The mounting face is not stated." : `The mounting face is at z = ${withUnit(String(-answer.mounting.below_base_mm), "mm")} of the base frame.`}`;
  } else setRows(values);
  renderNotes();
  fill(by("robot-pose").tBodies[0], forms(pose).map(([name, text, used]) => make("tr", {},
    make("th", { scope: "row" }, name), make("td", { class: "copy" }, text), make("td", { class: "muted" }, used))));
  say(`Flange at ${cells(1, "mm", pose.xyz_mm)}`);
  draw();
}

const loaded = () => { renderNotes(); draw(); };

function renderNotes() {
  const beyond = arm.poses[0].outside.map((j) => `J${j}`), shown = meshesOf(stated(), loaded);
  const notes = [...arm.notes, ...(shown ? shown.notes : []), ...(beyond.length ? [`Beyond the limits: ${beyond.join(", ")}`] : [])];
  fill(by("robot-notes"), notes.map((note) => make("li", {}, named(note))));
  by("robot-solid").hidden = !(shown && shown.meshes.length);
}

function draw() {
  if (!visible || arm === null) return;
  const found = meshesOf(stated(), loaded), on = (id) => by(id).checked;
  const posture = {
    ...posed(arm.name, arm.skeleton),
    ...(on("robot-axes") ? { axes: axesOf(arm) } : {}),
    ...(on("robot-frames") ? { frames: framesOf(arm) } : {}),
    ...(found && found.meshes.length && on("robot-meshes") ? { meshes: placed(found.meshes, arm.links) } : {}),
  };
  show(`robot ${shape}`, [posture], [], 0, arm.reach_mm, "The line ends at the flange.", within(arm.reach_mm));
}

export function robotGroups(robots, files) {
  const vendors = [...new Set(robots.map((r) => r.vendor || "other"))].sort();
  const groups = vendors.map((vendor) => [vendor, robots.filter((r) => (r.vendor || "other") === vendor).map((r) => [r.name, r.model || r.name])]);
  return [...groups, ["files of this folder", files.filter((f) => f.kind === "robot").map((f) => [f.path, f.path])]];
}

export const place = {
  async begin(robots, files) {
    options(by("robot-name"), robotGroups(robots, files));
    if (robots.some((r) => r.name === "ur5e")) by("robot-name").value = "ur5e";
    const changed = () => {
      for (const label of document.querySelectorAll(".urdf")) label.hidden = !by("robot-name").value.endsWith(".urdf");
      values = [];
      shape = "";
      const urdf = stated();
      if (typeof urdf === "string" || (urdf.base && urdf.tip)) ask();
    };
    for (const id of ["robot-name", "robot-j3", "robot-base", "robot-tip"]) by(id).addEventListener("change", changed);
    for (const id of ["robot-axes", "robot-frames", "robot-meshes"]) by(id).addEventListener("change", draw);
    by("robot-zero").addEventListener("click", () => { values = values.map(() => 0); ask(); });
    changed();
  },
  open() { visible = true; draw(); },
  close() { visible = false; },
  chosen() {},
};
