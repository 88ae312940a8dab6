// The place Measure: a plan carried out by a simulation, by hand or by a robot, and what is seen of it.
import { get, post, Refused, remove } from "/page/parts/api.js";
import { by, fill, make, options, say } from "/page/parts/dom.js";
import { follow } from "/page/places/measure/follow.js";
import { Live } from "/page/places/measure/live.js";

const OVER = ["done", "stopped", "failed"];
const live = new Live(answer);
let following = null, files = [], visible = false, bar = null, pending = null;

const rig = () => document.querySelector("#measure-form [name=rig]:checked").value;
const value = (id) => by(id).value.trim();
const fileOf = (words) => words.find((word) => word.startsWith("--out=")).slice(6);
const underWay = () => following !== null && !OVER.includes(following.seen.job.state);

function fault(error) {
  if (!(error instanceof Refused)) throw error;
  by("measure-fault").textContent = error.text;
  by("measure-fault").hidden = false;
}
function noFault() { by("measure-fault").hidden = true; }

// The words of the command; what is left as it is usual is not stated.
function command() {
  const words = ["run", `--out=${value("measure-file")}`, `--rig=${rig()}`];
  const add = (option, id, usual = "") => { if (value(id) !== usual) words.push(`${option}=${value(id)}`); };
  const flag = (option, id) => { if (by(id).checked) words.push(option); };
  if (rig() === "simulated") {
    add("--cell", "measure-cell");
    add("--seed", "measure-seed");
    if (!by("measure-camera").checked) words.push("--no-camera");
  } else if (rig() === "manual") {
    add("--units", "measure-units", "deg");
    add("--j3", "measure-j3");
  } else {
    add("--host", "measure-host");
    add("--speed", "measure-speed");
    add("--sensors", "measure-sensors");
    add("--user", "measure-user");
    add("--port", "measure-port");
    add("--egm-port", "measure-egm-port");
    add("--sensor-port", "measure-sensor-port");
    add("--laser", "measure-laser");
  }
  flag("--closing", "measure-closing");
  flag("--adaptive", "measure-adaptive");
  if (by("measure-adaptive").checked) add("--tolerance", "measure-tolerance");
  return [...words, value("measure-plan")];
}

async function start(words, password = by("measure-password").value) {
  noFault();
  for (const button of document.querySelectorAll("#measure-start, #measure-unfinished button")) button.disabled = true;
  try {
    const { id } = await post("/api/jobs", { command: words, ...(password && words.includes("--rig=abb") ? { password } : {}) });
    by("measure-password").value = "";
    attach(id, words);
  } catch (error) {
    fault(error);
    showForm();
  }
}

// `words`: the command, of which the last word is the plan.
function attach(id, words) {
  if (following) following.close();
  live.begin();
  prepare(words.at(-1));
  let resumed = false;
  following = follow(id, (seen) => {
    if (!resumed && seen.run.recorded.length && seen.run.course.length === 0) { resumed = true; earlier(words); }
    live.changed(seen);
    frame(seen);
  }, () => {
    following = null;
    by("measure-run").hidden = true;
    fault(new Refused({ what: "the server was started anew, and what was under way has ended with it", to_do: "go on with the run below" }));
    frame(null);
    showForm();
  });
  frame(following.seen);
  showForm();
}

// u after the measurements of earlier sessions, from the run file.
async function earlier(words) {
  const own = following;
  try {
    const { course } = await get(`/api/run?file=${encodeURIComponent(fileOf(words))}`);
    if (following !== own) return;
    live.earlier = course;
    live.changed(own.seen);
  } catch (error) {
    if (!(error instanceof Refused)) throw error; // then the picture begins with the next measurement
  }
}

// What the pictures need to know of the plan.
async function prepare(file) {
  if (!file || (live.plan && live.plan.of === file)) { if (live.plan) live.scene(following ? following.seen.run : { arm: null }); return; }
  live.plan = null;
  try {
    const found = await get(`/api/plan?file=${encodeURIComponent(file)}`);
    const checked = await post("/api/check", { plan: found.plan, file: found.file, scene: true });
    live.plan = { of: file, scene: checked.scene, reach: found.robot.reach_mm, units: Object.fromEntries(checked.parameters.map((row) => [row.name, row.unit])) };
    if (following) live.changed(following.seen);
    else live.scene({ arm: null });
  } catch (error) {
    if (!following) fault(error);
  }
}

// The bar with Stop is there wherever the reader is, as long as something is under way.
function frame(seen) {
  const on = seen !== null && !OVER.includes(seen.job.state);
  if (bar.hidden === on) {
    bar.hidden = !on;
    document.body.classList.toggle("measuring", on);
    if (on) { by("measure-stop").disabled = false; bar.firstElementChild.textContent = ""; }
    else over(seen);
  }
  if (on && pending === null) {
    const text = seen.run.file ? `Run ${seen.run.file}: ${seen.run.recorded.length} of ${seen.run.postures} recorded` : "A run begins";
    if (bar.firstElementChild.textContent !== text) bar.firstElementChild.textContent = text;
  }
}

async function over(seen) {
  pending = null;
  showForm();
  if (seen) await counted(seen);
  refresh();
}

// What a run that was broken off keeps is what its file has: the last measurement may not have been told any more.
async function counted(seen) {
  if (!seen.run.end && seen.run.file) {
    try {
      const found = await get(`/api/run?file=${encodeURIComponent(fileOf(seen.job.command))}`);
      Object.assign(seen.run, { recorded: found.recorded, std: found.std, course: found.course });
    } catch (error) {
      if (!(error instanceof Refused)) throw error; // then what was told has to do
    }
  }
  seen.run.counted = true;
  if (!following || following.seen !== seen) return; // another run has begun
  live.changed(seen);
  say(live.now(seen.job, seen.run, false));
}

async function stop() {
  if (!underWay() || pending !== null) return;
  pending = following.seen.job.id;
  by("measure-stop").disabled = true;
  bar.firstElementChild.textContent = "Stopping. What is recorded is kept.";
  try {
    await remove(`/api/jobs/${encodeURIComponent(pending)}`);
  } catch (error) {
    if (!(error instanceof Refused)) throw error;
    pending = null;
    by("measure-stop").disabled = false;
    bar.firstElementChild.textContent = "The server does not answer. At a real robot press the emergency stop.";
  }
}

async function answer(text) {
  if (!underWay()) return;
  try {
    noFault();
    await post(`/api/jobs/${encodeURIComponent(following.seen.job.id)}/line`, { text });
    const asked = following.seen.run.asked, doubt = following.seen.run.doubt, before = following.seen.run.recorded.length;
    setTimeout(() => {
      const now = following && following.seen.run;
      if (!now || now.asked !== asked || now.doubt !== doubt || now.recorded.length !== before || !underWay() || !by("measure-line").value) return;
      by("measure-doubt").textContent = "The values of some joints are still missing: paste the others, too.";
    }, 2000);
  } catch (error) {
    fault(error);
  }
}

function showForm() {
  const on = underWay();
  by("measure-form").hidden = by("measure-another").hidden = on;
  if (by("measure-run").hidden) by("measure-another").hidden = true;
  by("measure-start").disabled = on;
  if (on) by("measure-open").hidden = true;
  else listUnfinished();
}

let listing = 0;
async function listUnfinished() {
  const own = (listing += 1); // the last that was asked for is shown
  try {
    const [open, jobs] = await Promise.all([get("/api/unfinished"), get("/api/jobs")]);
    if (own !== listing || underWay()) return;
    const busy = jobs.filter((job) => !OVER.includes(job.state)).flatMap((job) => job.command);
    const free = open.filter((run) => !busy.includes(`--out=${run.file}`));
    by("measure-open").hidden = !free.length;
    fill(by("measure-unfinished"), free.map((run) => unfinished(run)));
  } catch (error) {
    if (own === listing && !underWay()) fault(error);
  }
}

function unfinished(run) {
  const of = run.postures ? ` of ${run.postures}` : "";
  const facts = run.recorded ? `${run.recorded.length}${of} recorded.${run.torn ? " The last line is torn and will be left out." : ""}` : "";
  const item = make("li", {}, make("p", {}, run.file, make("small", {}, [facts, run.why_not].filter(Boolean).join(" "))));
  if (!run.resume) return item;
  // A controller asks for a password, and it is kept nowhere.
  const password = run.resume.includes("--rig=abb") ? make("input", { type: "password", autocomplete: "off", "aria-label": `Password of the controller, for ${run.file}`, placeholder: "Password" }) : null;
  item.append(...(password ? [password] : []), make("button", { type: "button", "aria-label": `Resume ${run.file}`, onclick: () => start(run.resume, password ? password.value : "") }, "Resume"));
  return item;
}

async function refresh() {
  try {
    files = await get("/api/files");
    listFiles();
  } catch (error) {
    fault(error);
  }
}

function listFiles() {
  const of = (kind) => files.filter((f) => f.kind === kind).map((f) => [f.path, f.path]);
  const kept = Object.fromEntries(["plan", "cell", "sensors"].map((name) => [name, by(`measure-${name}`).value]));
  options(by("measure-plan"), [["plans of this folder", of("plan")]], "choose a plan");
  options(by("measure-cell"), [["cells of this folder", of("cell")]], "an ordinary one");
  options(by("measure-sensors"), [["sensors files of this folder", of("sensors")]], "those of the simulated controller");
  for (const [name, was] of Object.entries(kept)) by(`measure-${name}`).value = was;
  for (const name of Object.keys(kept)) if (by(`measure-${name}`).selectedIndex < 0) by(`measure-${name}`).value = "";
  propose();
}

// A name for the run file that is not taken.
let proposed = "";
function propose() {
  const plan = value("measure-plan");
  if (!plan || (value("measure-file") && value("measure-file") !== proposed)) return;
  const stem = plan.replace(/\.[^./]*$/, ""), taken = new Set(files.map((f) => f.path));
  proposed = `${stem}-run.jsonl`;
  for (let i = 2; taken.has(proposed); i++) proposed = `${stem}-run-${i}.jsonl`;
  by("measure-file").value = proposed;
}

function arrange() {
  for (const element of document.querySelectorAll("#measure-form [data-rig]")) element.hidden = element.dataset.rig !== rig();
  document.querySelector("#measure-form [data-adaptive]").hidden = !by("measure-adaptive").checked;
  by("measure-start").textContent = { simulated: "Start the simulation", manual: "Start", abb: "Start: asks before the robot moves" }[rig()];
}

function makeBar() {
  bar = make("div", { class: "stop-bar", role: "region", "aria-label": "Run under way", hidden: true },
    make("p", {}), make("button", { type: "button", id: "measure-stop", "aria-keyshortcuts": "Escape", onclick: stop }, "Stop"));
  document.querySelector("main").append(bar);
}

export const place = {
  async begin(robots, found) {
    makeBar();
    files = found;
    listFiles();
    by("measure-form").addEventListener("submit", (event) => { event.preventDefault(); if (!underWay()) start(command()); });
    by("measure-form").addEventListener("change", arrange);
    by("measure-plan").addEventListener("change", () => {
      noFault();
      by("measure-run").hidden = by("measure-another").hidden = true;
      if (following && !underWay()) following = null;
      propose();
      prepare(value("measure-plan"));
    });
    by("measure-hand").addEventListener("submit", (event) => {
      event.preventDefault();
      if (value("measure-line")) answer(by("measure-line").value);
    });
    by("measure-line").addEventListener("keydown", (event) => {
      if (event.key === "Enter" && !event.shiftKey) { event.preventDefault(); by("measure-hand").requestSubmit(); }
    });
    for (const button of document.querySelectorAll("#measure-hand [data-line]")) button.addEventListener("click", () => answer(button.dataset.line));
    by("measure-yes").addEventListener("click", () => answer("yes"));
    by("measure-no").addEventListener("click", () => answer("no"));
    addEventListener("keydown", (event) => { if (event.key === "Escape" && underWay()) { event.preventDefault(); stop(); } });
    arrange();
    const jobs = await get("/api/jobs");
    const last = jobs.find((job) => job.command[0] === "run");
    if (last && !OVER.includes(last.state)) attach(last.id, last.command);
    else await listUnfinished();
  },
  open() {
    visible = live.visible = true;
    live.shown.planned = live.shown.arm = null;
    if (live.plan) live.scene(following ? following.seen.run : { arm: null });
    if (following) live.changed(following.seen);
    showForm();
    if (!underWay()) refresh();
  },
  close() { visible = live.visible = false; },
  chosen() {},
  show(file) {
    if (underWay()) return;
    by("measure-plan").value = file;
    by("measure-plan").dispatchEvent(new Event("change", { bubbles: true }));
  },
};
