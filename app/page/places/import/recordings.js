// The recordings of an import: sent to the folder or chosen there, and what each is.
import { post, Refused, upload } from "/page/parts/api.js";
import { by, fill, make, say } from "/page/parts/dom.js";

let rows = []; // {path, found, fault, busy, taken: {file, name}}
let names = new Set(); // of all files of the folder
let changed = () => {};

const bytes = (n) => (n < 1e3 ? `${n} bytes` : n < 1e6 ? `${(n / 1e3).toFixed(1)} kB` : `${(n / 1e6).toFixed(1)} MB`);

export const recordings = () => rows.filter((row) => row.found && row.found.form !== "ours");
export const pending = () => rows.some((row) => row.busy);

export function freeName(name) {
  if (!names.has(name)) return name;
  const dot = name.lastIndexOf("."), cut = dot > 0 ? dot : name.length;
  for (let k = 2; ; k++) {
    const other = `${name.slice(0, cut)}-${k}${name.slice(cut)}`;
    if (!names.has(other)) return other;
  }
}

// The files that the folder has by now.
export function known(files) {
  names = new Set(files.map((file) => file.path));
}

// Looks at a table again, as it is stated to be laid out.
export async function looked(row, layout) {
  const found = await post("/api/recording", { file: row.path, ...layout });
  row.found = found;
  render();
  return found;
}

async function look(row) {
  row.busy = true;
  render();
  try {
    row.found = await post("/api/recording", { file: row.path });
    row.fault = null;
    say(`${row.path}: ${row.found.count}`);
  } catch (error) {
    if (!(error instanceof Refused)) throw error;
    row.fault = error.text;
  }
  row.busy = false;
  render();
  changed();
}

export function choose(path) {
  if (rows.some((row) => row.path === path)) return;
  const row = { path };
  rows.push(row);
  return look(row);
}

async function send(file, name, row) {
  row.busy = true;
  row.fault = null;
  render();
  try {
    const done = await upload(name, file);
    names.add(done.file);
    row.path = done.file;
    row.taken = null;
    await look(row);
  } catch (error) {
    if (!(error instanceof Refused)) throw error;
    row.busy = false;
    row.fault = error.text;
    row.taken = { file, name };
    render();
  }
}

// Sends files: one whose name is taken waits for another name.
export async function take(files) {
  for (const file of files) {
    const row = { path: file.name };
    rows.push(row);
    if (names.has(file.name)) {
      row.taken = { file, name: freeName(file.name) };
      render();
      say(`There is a file ${file.name} already`);
    } else await send(file, file.name, row);
  }
}

function remove(row) {
  rows = rows.filter((other) => other !== row);
  render();
  changed();
}

// Where the name of a file is taken: another name, or the file that is there.
function another(row) {
  const field = make("input", { value: row.taken.name, autocomplete: "off", spellcheck: "false" });
  return make("div", { class: "actions" },
    make("p", { class: "muted" }, names.has(row.path) ? "The folder has a file of this name, and nothing is replaced." : "The file was not written."),
    make("label", {}, "Name in the folder ", field),
    make("button", { type: "button", onclick: () => send(row.taken.file, field.value.trim(), row) }, "Send under this name"),
    names.has(row.path) ? make("button", { type: "button", onclick: () => { row.taken = null; look(row); } }, "Use the file of the folder") : "");
}

function said(row) {
  if (row.busy) return make("small", {}, "being read…");
  if (!row.found) return "";
  const ours = { run: "result", plan: "plan" }[row.found.kind];
  return make("small", {}, `${row.found.count}; ${bytes(row.found.bytes)}`,
    ...(ours ? [" ", make("a", { href: `#${ours}/${encodeURIComponent(row.path)}` }, "Open it")] : row.found.form === "ours" ? [": nothing to import"] : []));
}

function render() {
  fill(by("import-files"), rows.map((row) => make("li", { "data-file": row.path, "aria-busy": row.busy ? "true" : null },
    make("p", {}, make("span", { class: "name" }, row.path), " ", said(row)),
    make("button", { type: "button", "aria-label": `Leave out ${row.path}`, onclick: () => remove(row) }, "Leave out"),
    row.fault ? make("p", { class: "error", role: "alert" }, row.fault) : "",
    row.taken ? another(row) : "")));
}

export function begin(then) {
  changed = then;
  const drop = by("import-drop");
  const over = (on) => (event) => { event.preventDefault(); drop.classList.toggle("over", on); };
  drop.addEventListener("dragenter", over(true));
  drop.addEventListener("dragover", over(true));
  drop.addEventListener("dragleave", over(false));
  drop.addEventListener("drop", (event) => {
    over(false)(event);
    take([...event.dataTransfer.files]);
  });
  by("import-choose").addEventListener("change", () => {
    take([...by("import-choose").files]).then(() => { by("import-choose").value = ""; });
  });
  by("import-folder").addEventListener("change", () => {
    const name = by("import-folder").value;
    by("import-folder").value = "";
    if (name) choose(name);
  });
}
