// Robot, tool and noise of the run: a header or plan of the folder, or a new header as a form.
import { get, latest, post, put, Refused } from "/page/parts/api.js";
import { by, fill, make, options, say } from "/page/parts/dom.js";
import { Form } from "/page/places/import/form.js";
import { freeName } from "/page/places/import/recordings.js";

const NEW = "\0new"; // no file can have this name
let form = null, chosen = null, changed = () => {}, saved = async () => {}, robots = [];

// {file, plan, header, target}, or null where none is chosen yet.
export const header = () => chosen;

function fault(error) {
  if (!(error instanceof Refused)) throw error;
  const placed = form && !by("import-header-form").hidden && form.wrong(error.key.slice(1), error.text);
  by("import-header-fault").textContent = placed ? "" : error.text;
  by("import-header-fault").hidden = Boolean(placed);
}

const check = latest(
  () => {
    const content = form.content;
    // Before robot, tool and noise are stated there is nothing to check.
    return ["robot", "tool", "noise"].every((key) => content[key] !== undefined) ? post("/api/header/check", { file: by("import-header-file").value.trim() || "header.yaml", header: content }) : null;
  },
  (found) => {
    form.right();
    by("import-header-fault").hidden = true;
    by("import-header-saved").textContent = `${found.robot}, ${found.joints} joints. Not saved yet. ${found.notes.join(" ")}`;
  },
  (error) => { by("import-header-saved").textContent = ""; fault(error); },
);

async function edit(content) {
  if (form === null) {
    const schema = await get("/api/header/schema");
    form = new Form(by("import-header-fields"), schema, { robot: robots }, () => { by("import-header-saved").textContent = "Not saved yet."; check(); });
  }
  form.show(content);
  by("import-header-fault").hidden = true;
  by("import-header-form").hidden = false;
  by("import-header-file").value = freeName("header.yaml");
  by("import-header-saved").textContent = "";
}

async function save() {
  const empty = form.missing();
  if (empty) {
    empty.querySelector("input, select").focus();
    return;
  }
  try {
    const done = await put("/api/header", { file: by("import-header-file").value.trim(), header: form.content });
    say(`Saved as ${done.file}`);
    await saved();
    by("import-header").value = done.file;
    await pick(done.file);
  } catch (error) {
    if (!(error instanceof Refused)) throw error;
    if (error.key[0] === "file") {
      by("import-header-file").setAttribute("aria-invalid", "true");
      by("import-header-fault").textContent = error.text;
      by("import-header-fault").hidden = false;
    } else fault(error);
    by("import-header-saved").textContent = "Not saved.";
  }
}

// A sentence about what is chosen.
function said({ header: own, plan, notes }) {
  const robot = typeof own.robot === "string" ? own.robot : `${own.robot.urdf}, ${own.robot.base} to ${own.robot.tip}`;
  const tool = `${own.tool.kind}${own.tool.calibrated === false ? ", not calibrated" : ""}`;
  const joint = Array.isArray(own.noise.joint_deg) ? own.noise.joint_deg.join(", ") : own.noise.joint_deg;
  return [`Robot ${robot}; ${tool}; noise ${joint}° of a joint, ${own.noise.spot_mm} mm of a spot.`, plan ? "The plan says which posture has which target." : "", ...notes].filter(Boolean).join(" ");
}

async function pick(name) {
  by("import-header-form").hidden = name !== NEW;
  by("import-header-edit").hidden = true;
  by("import-header-fault").hidden = true;
  by("import-header-said").textContent = "";
  chosen = null;
  if (name === NEW) await edit({});
  else if (name) {
    const found = await get(`/api/header?file=${encodeURIComponent(name)}`);
    if (by("import-header").value !== name) return;
    chosen = { ...found, plan: by("import-header").selectedOptions[0].parentElement.label === PLANS };
    by("import-header-said").textContent = said(chosen);
    by("import-header-edit").hidden = false;
  }
  changed();
}

const PLANS = "measured plans of the folder";
const picked = (name) => pick(name).catch((error) => {
  if (!(error instanceof Refused)) throw error;
  by("import-header-said").textContent = "";
  by("import-header-fault").textContent = "";
  fill(by("import-header-said"), [make("span", { class: "error", role: "alert" }, error.text)]);
  changed();
});

export function list(files) {
  const of = (kind) => files.filter((f) => f.kind === kind).map((f) => [f.path, f.path]);
  const before = by("import-header").value;
  options(by("import-header"), [["new", [[NEW, "fill in a new header"]]], ["headers of the folder", of("header")], [PLANS, of("plan")]], "choose");
  by("import-header").value = [...by("import-header").options].some((o) => o.value === before) ? before : "";
}

export function begin(known, told, listed) {
  robots = known.map((robot) => robot.name);
  changed = told;
  saved = listed;
  by("import-header").addEventListener("change", () => picked(by("import-header").value));
  by("import-header-save").addEventListener("click", save);
  by("import-header-file").addEventListener("input", () => by("import-header-file").removeAttribute("aria-invalid"));
  by("import-header-edit").addEventListener("click", () => {
    const content = chosen.header;
    by("import-header").value = NEW;
    chosen = null;
    by("import-header-said").textContent = "";
    by("import-header-edit").hidden = true;
    edit(content).then(() => { by("import-header-form").querySelector("input").focus(); changed(); });
  });
}
