// The place Import: recordings of others become a run, by the command that is shown.
import { get, Refused } from "/page/parts/api.js";
import { by, fill, make, named, options, say } from "/page/parts/dom.js";
import { carryOut } from "/page/parts/jobs.js";
import { begin as beginHeader, header, list as listHeaders } from "/page/places/import/header.js";
import * as mapper from "/page/places/import/mapper.js";
import { FORMATS, open as openOptions, show as showOptions, values, words } from "/page/places/import/options.js";
import { begin as beginRecordings, choose, freeName, known, looked, recordings } from "/page/places/import/recordings.js";

// The formats that a file may have, by what it is found to be: the first is taken where it is the only one.
const FORMS = { csv: ["csv", "log robodk"], "program log": ["", "rapid", "universal-robots", "robodk"] };
let format = "", shape = "", targets = [], written = "", carried = "";

async function listFiles(files) {
  const found = files || await get("/api/files");
  known(found);
  options(by("import-folder"), [["files of this folder", found.filter((f) => !["run", "plan", "result", "robot", "header"].includes(f.kind)).map((f) => [f.path, f.path])]], "choose a file");
  listHeaders(found);
}

function fault(text) {
  by("import-fault").textContent = text;
  by("import-fault").hidden = !text;
}

// What files, header and format make possible is shown again.
function update() {
  const rows = recordings(), now = rows.map((row) => row.path).join("\n");
  fault("");
  by("import-form").hidden = by("import-rest").hidden = !rows.length;
  if (!rows.length) { shape = ""; return; }
  if (now !== shape) {
    shape = now;
    carried = "";
    by("import-answer").hidden = true;
    chooseFormat(rows);
    if (!by("import-out").value || by("import-out").value === written) by("import-out").value = freeName("run.jsonl");
  }
  const top = header();
  by("import-read").hidden = !top || !format;
  if (top && format) read(rows, top);
}

function chooseFormat(rows) {
  const forms = [...new Set(rows.map((row) => row.found.form))];
  const own = forms.length === 1 ? FORMS[forms[0]] || [forms[0], ...(forms[0].startsWith("log") ? ["csv"] : [])] : ["", ...forms.filter((form) => FORMATS[form])];
  options(by("import-format"), [["formats", own.filter(Boolean).map((form) => [form, FORMATS[form][0]])]], own[0] ? undefined : "choose");
  by("import-format").value = own.includes(format) ? format : own[0];
  by("import-format-why").textContent = forms.length > 1 ? "The files are of different kinds: all files of one import have one format." : own[0] ? `Recognised by ${rows[0].found.why}.` : "State which controller wrote it.";
  setFormat();
}

function setFormat() {
  if (by("import-format").value !== format) for (const key of Object.keys(values)) delete values[key];
  format = by("import-format").value;
}

function read(rows, top) {
  const found = rows[0].found;
  if (format === "csv") {
    const again = () => Promise.all(rows.map((row) => looked(row, mapper.layout))).then(update, (error) => fault(error.text));
    mapper.show({ files: rows.map((row) => row.path), found, robot: top.header.robot, beside: top.file }, again, () => command());
  } else mapper.hide();
  showOptions(format, found, () => { targetFields(rows, top); command(); });
  targetFields(rows, top);
  command();
}

// One target for each file; a plan says them itself, and a column or a marker may.
function targetFields(rows, top) {
  // Only what was typed is kept: the usual name is none where markers may name the target.
  const kept = Object.fromEntries(targets.filter((field) => field.dataset.typed).map((field) => [field.dataset.file, field.value]));
  targets = [];
  if (top.plan) { fill(by("import-targets"), [make("p", { class: "muted" }, "Targets are those of the plan.")]); return; }
  if (format === "csv" && values["--target-column"]) { fill(by("import-targets"), [make("p", { class: "muted" }, "The column names the target of each row.")]); return; }
  targets = rows.map((row) => {
    const usual = rows.length === 1 && !values["--marker-topic"] ? top.target : "";
    const field = make("input", { "data-file": row.path, "data-typed": row.path in kept, value: kept[row.path] ?? usual, autocomplete: "off", spellcheck: "false", list: "import-target-names" });
    field.addEventListener("input", () => { field.dataset.typed = "true"; command(); });
    return field;
  });
  fill(by("import-targets"), [
    ...targets.map((field) => make("label", {}, `Target of ${field.dataset.file} `, field)),
    make("datalist", { id: "import-target-names" }, ...Object.keys(top.header.targets || {}).map((name) => make("option", { value: name }))),
    values["--marker-topic"] ? make("p", { class: "muted" }, "Without targets the markers name them.") : "",
  ]);
}

// The words of the command, or null with what is still to be stated.
function command() {
  const top = header(), rows = recordings();
  if (!top || !format || !rows.length) return null;
  const named = targets.map((field) => field.value.trim()), by_marker = values["--marker-topic"] && named.every((name) => !name);
  const file = (name) => (name.startsWith("-") ? `./${name}` : name);
  const open = (format === "csv" && mapper.open()) || openOptions(format);
  const missing = open || (named.some((name) => !name) && !by_marker ? "state the target of each file: the same name where it stood at the same place" : null);
  const told = ["import", ...FORMATS[format][1], ...(format === "csv" ? mapper.words() : []), ...words(format),
    `--${top.plan ? "plan" : "header"}=${file(top.file)}`, ...(by_marker ? [] : named.map((name) => `--target=${name}`)), `--out=${by("import-out").value.trim()}`, ...rows.map((row) => file(row.path))];
  const quoted = told.map((word) => (/^[\w./=,:-]+$/.test(word) ? word : `'${word.replaceAll("'", "'\\''")}'`));
  const now = told.filter((word) => !word.startsWith("--out=")).join("\n");
  if (carried && now !== carried) by("import-state").textContent = "Changed since then: try or import again.";
  by("import-command").textContent = missing ? `Not complete: ${missing}.` : `zerobeam ${quoted.join(" ")}`;
  return missing ? { missing } : { told, now };
}

function busy(on) {
  for (const id of ["import-try", "import-go", "import-test"]) by(id).disabled = on;
}

// Carries a command out; the job once it has ended, null where it failed: that is said at the place.
async function done(told, title) {
  fault("");
  busy(true);
  by("import-state").textContent = "";
  try {
    const job = await carryOut(told, by("import-job"), title);
    if (job.state === "done") return job;
    if (job.state === "failed") fault(job.log.map((line) => line.trim()).join("; ").replace(/^error: /, "") || "the command failed");
    else by("import-state").textContent = "Cancelled: nothing was written.";
    return null;
  } catch (error) {
    if (!(error instanceof Refused)) throw error;
    fault(error.text);
    return null;
  } finally {
    by("import-job").hidden = true;
    busy(false);
  }
}

async function importNow(dry) {
  const asked = command();
  if (asked === null) return;
  if (asked.missing) { fault(`Not complete: ${asked.missing}.`); return; }
  by("import-answer").hidden = true;
  const out = by("import-out").value.trim();
  const job = await done(dry ? [...asked.told, "--dry-run"] : asked.told, dry ? "Trying" : "Importing");
  if (!job) return;
  carried = asked.now;
  by("import-answer").hidden = false;
  by("import-next").hidden = dry;
  by("import-verdict").hidden = true;
  fill(by("import-diagnosis"), []);
  fill(by("import-understood"), job.log.map((line) => make("li", {}, line.trim())));
  if (dry) by("import-done").textContent = "Tried: nothing was written.";
  else {
    written = out;
    await listFiles();
    by("import-out").value = freeName("run.jsonl");
    command();
    fill(by("import-done"), [`Written to ${out}. `, make("a", { href: `#result/${encodeURIComponent(out)}` }, "Show its result")]);
  }
  say(by("import-done").textContent);
}

async function test() {
  const job = await done(["analyse", written], "Testing by a fit");
  if (!job || !job.answer) return;
  const { verdict, headline, diagnosis } = job.answer;
  by("import-verdict").className = `verdict ${verdict}`;
  by("import-verdict").textContent = named(headline);
  by("import-verdict").hidden = false;
  fill(by("import-diagnosis"), diagnosis.length ? diagnosis.map(explained) : [make("li", {}, verdict === "misfit" ? "None of the causes that were tried explains the misfit." : "Nothing contradicts unit, signs and order as they were read.")]);
  say(headline);
}

// What explains a misfit, and what takes it where this import can say so.
function explained(found) {
  const take = format !== "csv" ? null : {
    swapped_joints: () => mapper.swap(...found.joints),
    sign: () => mapper.reverse(found.joints[0], !mapper.mapped().reversed.includes(found.joints[0])),
  }[found.cause];
  const button = take && make("button", { type: "button", onclick: () => {
    take();
    button.disabled = true;
    mapper.refresh();
    by("import-state").textContent = "Taken. Import again: under a new name, for nothing is replaced.";
    by("import-out").focus();
  } }, "Take it");
  return make("li", { class: take ? "proposed" : "" }, make("span", {}, `${found.sentence.replace(/^./, (c) => c.toUpperCase())}.`), button || "");
}

export const place = {
  async begin(robots, files) {
    await listFiles(files);
    beginRecordings(update);
    beginHeader(robots, update, listFiles);
    by("import-format").addEventListener("change", () => { setFormat(); update(); });
    by("import-out").addEventListener("input", () => command());
    by("import-try").addEventListener("click", () => importNow(true));
    by("import-go").addEventListener("click", () => importNow(false));
    by("import-test").addEventListener("click", test);
  },
  open() {},
  close() {},
  chosen() {},
  show(file) { choose(file); },
};
