// The place Plan: postures, targets and tolerances of a plan file, and what the plan will determine as they change.
import { offBy, showAnswer, showRefusal } from "/page/places/plan/answer.js";
import { beginAdding, beginComparing, listPlans, showCompared } from "/page/places/plan/beside.js";
import { beginDrawing, bodyOf, dressed, wished } from "/page/places/plan/body.js";
import { beginExporting } from "/page/places/plan/exporting.js";
import { beginMaking, listHeaders } from "/page/places/plan/making.js";
import { constraintFields } from "/page/places/plan/constraints.js";
import { beginObstacles, boxes, listObstacles, moveBox, renderObstacles } from "/page/places/plan/obstacles.js";
import { get, latest, post, put, Refused } from "/page/parts/api.js";
import { by, fill, fixed, make, options, say, write } from "/page/parts/dom.js";
import { headerFields, targetFields } from "/page/places/plan/header.js";
import { History } from "/page/places/plan/history.js";
import { jointRows } from "/page/parts/joints.js";
import { animate } from "/page/places/plan/motion.js";
import { posed, show } from "/page/parts/picture.js";
import { robotGroups } from "/page/places/robot/place.js";

const SPREAD = [[0, 0, 0], [18, -6, 8], [-18, 8, -6], [9, 10, 4], [-9, -10, 10], [25, 4, -12], [-25, -3, 5]]; // degrees, of the first postures
let visible = false, history = null, arm = null, chosen = 0, answer = null, setRows = null, stop = null, moving = null;
let shown = 0; // number of the plan that was opened: a new one is fitted into the picture
let saved = ""; // the plan as the file has it

const row = (posture) => (Array.isArray(posture) ? posture : posture.joints_deg);
const folderOf = (file) => file.slice(0, file.lastIndexOf("/") + 1);

// A robot file is named from the plan's folder in the plan, and from the app's folder elsewhere.
function robotRef(plan) {
  const folder = folderOf(opened), ref = plan.robot;
  if (typeof ref === "object") return { ...ref, urdf: folder + ref.urdf };
  return /\.(yaml|yml|json|urdf)$/.test(ref) ? folder + ref : ref;
}
let opened = "";

const ofFile = (file) => (opened && folderOf(opened) === folderOf(file) ? { file: opened } : {});
const adds = beginAdding(() => ({ plan: history && history.plan, answer, chosen, ...ofFile(by("plan-file").value) }));

const ask = latest(
  async () => {
    if (history === null) return null;
    const asked = history.plan, number = shown;
    const file = by("plan-file").value;
    const found = await post("/api/check", { plan: asked, scene: true, ...ofFile(file) });
    if (wished() && found.scene[chosen]) found.body = { of: chosen, arm: await bodyOf(robotRef(asked), found.scene[chosen]) };
    return number === shown ? found : null;
  },
  (found, newest) => {
    const first = answer === null;
    answer = found;
    if (newest) pending(false);
    wrong(null);
    showAnswer(found, move, moving);
    showCompared(found);
    if (newest) adds();
    if (first) renderAll();
    else renderPlaces();
    if (!first && !by("plan-targets").contains(document.activeElement)) renderTargets();
    draw();
  },
  (error) => {
    answer = null;
    pending(false);
    halt();
    wrong(error);
    showRefusal(error.text);
    renderPlaces();
  },
);

// An error stands at what it belongs to: the innermost element whose key leads to the value.
function wrong(error) {
  for (const old of document.querySelectorAll("#plan .error")) old.remove();
  for (const old of document.querySelectorAll("#plan [data-wrong]")) old.removeAttribute("data-wrong");
  if (!error) return;
  const key = error.key.slice(error.key[0] === "plan" ? 1 : 0).join("/");
  const near = [...document.querySelectorAll("#plan [data-key]")].filter((e) => key === e.dataset.key || key.startsWith(`${e.dataset.key}/`));
  const element = near.sort((a, b) => b.dataset.key.length - a.dataset.key.length)[0];
  if (!element) return;
  element.setAttribute("data-wrong", "");
  element.append(make("p", { class: "error" }, error.text));
}

function change(key, edit) {
  history.change(key, edit);
  halt();
  pending(true);
  renderButtons();
  if (key === null) renderAll();
  else renderPlaces();
  ask();
}

// Numbers that the plan has outrun are pale until those of the plan as it is now are there.
function pending(on) {
  for (const id of ["plan-table", "plan-verdict", "glance"]) by(id).classList.toggle("pending", on);
  by("plan-table").setAttribute("aria-busy", String(on));
}

function renderButtons() {
  by("plan-undo").disabled = !history.before.length;
  by("plan-redo").disabled = !history.after.length;
  by("posture-remove").disabled = history.plan.postures_deg.length < 2;
  by("posture-up").disabled = chosen === 0;
  by("posture-down").disabled = chosen >= history.plan.postures_deg.length - 1;
  write(by("plan-saved"), JSON.stringify(history.plan) === saved ? "Saved." : "Changes are not saved.");
}

// The list of postures: made anew where their number changes, else its texts alone.
function renderPlaces() {
  const list = by("postures"), postures = history.plan.postures_deg;
  if (list.children.length !== postures.length) {
    fill(list, postures.map((_, i) => make("li", { "data-key": `postures_deg/${i}` }, make("button", { type: "button", onclick: () => choose(i) }, make("span"), make("small")))));
  }
  postures.forEach((posture, i) => {
    const item = list.children[i], button = item.firstElementChild;
    const own = answer && answer.postures[i], place = answer && answer.scene[i];
    write(button.firstElementChild, `${i}: ${row(posture).map((v) => fixed(v, 1)).join(", ")}`);
    write(button.lastElementChild, own ? `${place.target_name}, ${offBy(own)}${own.hit && !place.reaches ? ", target behind the laser" : ""}${place.violations.map((what) => `; ${what}`).join("")}` : "");
    item.classList.toggle("misses", Boolean(place) && (!place.reaches || place.violations.length > 0));
    if (i === chosen) button.setAttribute("aria-current", "true");
    else button.removeAttribute("aria-current");
  });
  write(by("posture-title"), `Joints of posture ${chosen}`);
  if (setRows) setRows(row(postures[chosen]));
}

function renderAll() {
  chosen = Math.min(chosen, history.plan.postures_deg.length - 1);
  setRows = jointRows(by("plan-joints"), arm.joints, (j, value) => change(`joint/${chosen}/${j}`, (plan) => { row(plan.postures_deg[chosen])[j] = value; }));
  renderPlaces();
  headerFields(by("plan-header"), history.plan, change);
  if (!typing("plan-constraints")) constraintFields(history.plan, change);
  if (!typing("obstacles-fields")) renderObstacles();
  renderTargets();
  renderButtons();
}

// Fields in which somebody types are not made anew.
const typing = (id) => by(id).contains(document.activeElement) && document.activeElement.tagName === "INPUT";

function renderTargets() {
  const nominal = {};
  for (const place of answer ? answer.scene : []) nominal[place.target_name] ??= place.target;
  for (const [name, target] of Object.entries(history.plan.targets || {})) if (Array.isArray(target.guess_mm)) nominal[name] ??= target.guess_mm;
  targetFields(by("plan-targets"), history.plan, nominal, change);
}

function draw(step = null) {
  if (!visible || answer === null || arm === null) return;
  const postures = answer.scene.map((place, i) => (step && i === chosen ? step.posture : posed(`posture ${i}`, place.skeleton, place.tool, place.beam, place.reaches)));
  const targets = new Map(answer.scene.map((place) => [place.target_name, { name: place.target_name, at: place.target, state: "nominal" }]));
  if (step) targets.set(step.target.name, step.target);
  const body = step ? step.arm : answer.body && answer.body.of === chosen ? answer.body.arm : null;
  if (body && postures[chosen]) postures[chosen] = dressed(postures[chosen], body, robotRef(history.plan), () => draw());
  show(`plan ${shown}`, postures, [...targets.values()], all ? null : chosen, arm.reach_mm,
    step ? "The arm moves along the null-space direction, with the target: the measurements hardly change." : "Postures as the servo will leave them, turned onto their targets.", boxes(answer.touched_boxes).flatMap((box) => [box.min, box.max]), { movable: !step, boxes: boxes(answer.touched_boxes) });
}
let all = false;

function halt() {
  if (stop) stop();
  stop = null;
  moving = null;
  for (const button of document.querySelectorAll("[data-direction]")) button.setAttribute("aria-pressed", "false");
}

function move(i) {
  const same = moving === i;
  halt();
  if (same) { draw(); return; }
  moving = i;
  all = false;
  by("plan-directions").querySelector(`[data-direction="${i}"]`).setAttribute("aria-pressed", "true");
  stop = animate(robotRef(history.plan), answer.scene[chosen], answer.null_motion[i], draw, fault);
}

function choose(i) {
  if (history === null) return;
  halt();
  all = false;
  chosen = i;
  renderPlaces();
  renderButtons();
  draw();
  if (wished()) ask();
  if (history.plan.postures_deg.length > 30) adds();
}

function fault(error) {
  if (!(error instanceof Refused)) throw error;
  by("fault").textContent = error.text;
  by("fault").hidden = false;
}

async function start(plan, robot, file) {
  halt();
  by("fault").hidden = true;
  history = new History(plan);
  arm = robot;
  opened = file;
  shown += 1;
  chosen = 0;
  listHeaders(listed, true);
  answer = null;
  all = false;
  saved = file ? JSON.stringify(plan) : "";
  by("plan-file").value = file || "plan.yaml";
  by("plan-none").hidden = true;
  by("plan-work").hidden = false;
  fill(by("postures"), []);
  by("plan-solid").hidden = typeof plan.robot !== "object";
  renderAll();
  ask();
}

async function open(file) {
  const found = await get(`/api/plan?file=${encodeURIComponent(file)}`);
  await start(found.plan, found.robot, found.file);
  by("plan-open").value = found.file;
}

// A first plan: postures about a bent arm, of which the servo turns the wrist onto the target.
async function begin(name) {
  const robot = await post("/api/robot", { robot: name });
  const inside = (joint, value) => Math.max(joint.lower + 5, Math.min(joint.upper - 5, value));
  const middle = (joint) => Math.round((joint.lower + joint.upper) / 2);
  const base = robot.joints.map((joint, i) => (joint.kind === "revolute" ? inside(joint, [0, -60, 60, 0, 60, 0][i] ?? 0) : middle(joint)));
  const postures = SPREAD.map((turns) => base.map((v, i) => inside(robot.joints[i], v + (turns[i] ?? 0))));
  const plan = {
    schema: "zerobeam/plan/1",
    robot: name,
    tool: { kind: "laser", calibrated: true, point_mm: [0, 0, 65], direction: [1, 0, 0] },
    noise: { joint_deg: 0.01, spot_mm: 0.05 },
    postures_deg: postures,
  };
  await start(plan, robot, "");
}

async function save() {
  const file = by("plan-file").value.trim(), text = JSON.stringify(history.plan);
  try {
    const done = await put("/api/plan", { file, plan: JSON.parse(text) });
    saved = text;
    opened = done.file;
    renderButtons();
    by("plan-saved").textContent = `Saved as ${done.file}.`;
    say(`Saved as ${done.file}`);
    await listFiles();
  } catch (error) {
    if (!(error instanceof Refused)) throw error;
    by("plan-saved").textContent = `Not saved. ${error.text}`;
    wrong(error);
  }
}

function step(which) {
  if (history === null || !history[which]()) return;
  halt();
  pending(true);
  renderAll();
  ask();
}

async function listFiles(files) {
  const found = files || await get("/api/files");
  listed = found;
  options(by("plan-open"), [["plans of this folder", found.filter((f) => f.kind === "plan").map((f) => [f.path, f.path])]], "choose a plan");
  listHeaders(found, history !== null);
  listObstacles(found);
  listPlans(found);
}
let listed = []; // the files of the folder

// What the reader moves in the picture: the nominal target, or an obstacle.
function moved({ kind, name, at }) {
  if (!visible || answer === null || moving !== null) return;
  if (kind === "box") { moveBox(name, at); return; }
  change(`target/${name}`, (plan) => {
    plan.targets ??= {};
    plan.targets[name] = { ...plan.targets[name], guess_mm: at.map((v) => Math.round(10 * v) / 10) };
  });
}

const swap = (to) => change(null, (plan) => {
  const [posture] = plan.postures_deg.splice(chosen, 1);
  plan.postures_deg.splice(to, 0, posture);
  chosen = to;
});

// A posture beside the chosen one; `turn` degrees at joint 1, so that it adds something.
const another = (turn) => change(null, (plan) => {
  const copy = JSON.parse(JSON.stringify(plan.postures_deg[chosen])), joint = arm.joints[0];
  const sign = row(copy)[0] + turn > joint.upper ? -1 : 1;
  row(copy)[0] += sign * turn;
  plan.postures_deg.splice(chosen + 1, 0, copy);
  chosen += 1;
});

export const place = {
  async begin(robots, files) {
    await listFiles(files);
    options(by("plan-begin"), robotGroups(robots, files.filter((f) => !f.path.endsWith(".urdf"))), "choose a robot");
    const picked = (id, then) => by(id).addEventListener("change", () => {
      const name = by(id).value;
      if (!name) return;
      by(id === "plan-open" ? "plan-begin" : "plan-open").value = "";
      then(name).catch(fault);
    });
    beginMaking(() => ({ plan: history && history.plan, folder: folderOf(opened), target: answer && answer.scene[chosen].target }), async (file) => {
      await listFiles();
      await open(file);
    });
    beginComparing(() => answer);
    beginObstacles(() => history && history.plan, (key, edit) => { if (history !== null) change(key, edit); }, () => (answer ? answer.scene[chosen].target : [500, 0, 500]), listFiles);
    beginExporting(() => (history !== null && JSON.stringify(history.plan) === saved ? opened : ""));
    beginDrawing(() => { if (history !== null) ask(); });
    by("scene").addEventListener("moved", (event) => moved(event.detail));
    picked("plan-open", open);
    picked("plan-begin", begin);
    by("plan-undo").addEventListener("click", () => step("undo"));
    by("plan-redo").addEventListener("click", () => step("redo"));
    by("plan-save").addEventListener("click", save);
    by("posture-add").addEventListener("click", () => another(15));
    by("posture-copy").addEventListener("click", () => another(0));
    by("posture-up").addEventListener("click", () => swap(chosen - 1));
    by("posture-down").addEventListener("click", () => swap(chosen + 1));
    by("posture-remove").addEventListener("click", () => change(null, (now) => {
      now.postures_deg.splice(chosen, 1);
      chosen = Math.min(chosen, now.postures_deg.length - 1);
    }));
    addEventListener("keydown", (event) => {
      if (!visible || history === null || !(event.ctrlKey || event.metaKey) || event.altKey) return;
      const key = event.key.toLowerCase();
      if (key === "s") save();
      else if (key === "z" || key === "y") step(key === "y" || event.shiftKey ? "redo" : "undo");
      else return;
      event.preventDefault();
    });
    addEventListener("beforeunload", (event) => {
      if (history !== null && history.before.length && JSON.stringify(history.plan) !== saved) event.preventDefault();
    });
  },
  open() { visible = true; by("glance").hidden = false; draw(); },
  close() { visible = false; by("glance").hidden = true; halt(); },
  show(file) { open(file).catch(fault); },
  chosen(which) {
    if (history === null || answer === null || moving !== null) return;
    if (which === null) { all = true; return; }
    if (which === chosen && !all) return;
    all = false;
    chosen = which;
    renderPlaces();
    renderButtons();
    if (wished()) ask();
  },
};
