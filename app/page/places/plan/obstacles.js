// Obstacles of the cell: a file of the folder, boxes and floor as fields; the check says what touches them.
import { get, put, Refused } from "/page/parts/api.js";
import { by, fill, make, options } from "/page/parts/dom.js";

export const TOUCHED = { itself: "the arm hits itself", cell: "the arm hits the floor or a box", beam: "a box is in the beam's way" };
const SIZE = 200; // mm, of a new box

let content = null, changed = () => {}; // null: none are looked at

export const obstacles = () => content;

// As the picture draws them; `touched` is what the check says of each.
export const boxes = (touched) => (content ? content.boxes : []).map((box, i) => ({ name: box.name, min: box.min_mm, max: box.max_mm, touched: Boolean(touched && touched[i]) }));

function field(label, value, use, empty = false) {
  const own = make("input", { type: "number", step: "any", value: value ?? "", "aria-label": label });
  own.addEventListener("input", () => {
    const given = own.value === "" ? (empty ? null : NaN) : Number(own.value);
    own.toggleAttribute("aria-invalid", false);
    if (given !== null && !Number.isFinite(given)) { own.setAttribute("aria-invalid", "true"); return; }
    use(given);
    changed();
  });
  return own;
}

function boxRow(box, i) {
  const name = make("input", { value: box.name, "aria-label": `Name of box ${i + 1}`, autocomplete: "off" });
  name.addEventListener("input", () => { box.name = name.value; changed(); });
  const corner = (key, word) => ["x", "y", "z"].map((axis, k) => field(`${word} ${axis} of box ${i + 1} in mm`, box[key][k], (v) => { box[key][k] = v; }));
  return make("fieldset", { class: "box", "data-key": `obstacles/boxes/${i}` }, make("legend", {}, `Box ${i + 1}: name; lowest and highest corner x, y, z in mm`), name,
    make("div", { class: "corners" }, ...corner("min_mm", "lowest")), make("div", { class: "corners" }, ...corner("max_mm", "highest")),
    make("button", { type: "button", onclick: () => { content.boxes.splice(i, 1); render(); changed(); } }, "Remove"));
}

function render() {
  by("obstacles-fields").hidden = content === null;
  if (content === null) return;
  const at = typeof content.floor_mm === "number" ? "height" : content.floor_mm === null ? "none" : "mounting";
  const where = make("select", { "aria-label": "Where the floor is", onchange: (event) => { content.floor_mm = { mounting: "mounting", none: null, height: 0 }[event.target.value]; render(); changed(); } },
    ...[["mounting", "the arm's mounting face"], ["height", "at a height"], ["none", "none"]].map(([value, words]) => make("option", { value, selected: value === at }, words)));
  const height = at === "height" ? [make("label", {}, "Its height in the base frame, mm", field("Height of the floor in mm", content.floor_mm, (v) => { content.floor_mm = v; }))] : [];
  const thick = field("Radius of the arm's links in mm", content.thickness_mm, (v) => { content.thickness_mm = v; }, true);
  fill(by("obstacles-boxes"), [make("div", { class: "fields" }, make("label", {}, "Floor", where), ...height, make("label", {}, "Radius of the links, mm (empty: 5 % of the arm)", thick)), ...content.boxes.map(boxRow)]);
}

export function listObstacles(files) {
  const chosen = by("obstacles-open").value;
  options(by("obstacles-open"), [["obstacles of this folder", files.filter((f) => f.kind === "obstacles").map((f) => [f.path, f.path])]], "none");
  by("obstacles-open").value = [...by("obstacles-open").options].some((o) => o.value === chosen) ? chosen : "";
}

// In the picture a box is moved by its middle.
export function moveBox(i, at) {
  const box = content.boxes[i], middle = box.min_mm.map((v, k) => (v + box.max_mm[k]) / 2);
  for (const key of ["min_mm", "max_mm"]) box[key] = box[key].map((v, k) => Math.round(v + at[k] - middle[k]));
  render();
  changed();
}

// `then` is called when they change; `near()` is where a new box is put; `listed` when a file was written.
export function beginObstacles(then, near, listed) {
  changed = then;
  const fault = (error) => {
    if (!(error instanceof Refused)) throw error;
    by("obstacles-saved").textContent = error.text;
  };
  by("obstacles-open").addEventListener("change", async () => {
    const file = by("obstacles-open").value;
    by("obstacles-saved").textContent = "";
    try {
      content = file ? (await get(`/api/obstacles?file=${encodeURIComponent(file)}`)).obstacles : null;
      if (file) by("obstacles-file").value = file;
    } catch (error) {
      content = null;
      fault(error);
    }
    render();
    changed();
  });
  by("obstacles-add").addEventListener("click", () => {
    content ??= { floor_mm: "mounting", boxes: [], thickness_mm: null };
    const at = near().map(Math.round);
    content.boxes.push({ name: `box ${content.boxes.length + 1}`, min_mm: at.map((v) => v - SIZE / 2), max_mm: at.map((v) => v + SIZE / 2) });
    render();
    changed();
  });
  by("obstacles-save").addEventListener("click", async () => {
    try {
      const done = await put("/api/obstacles", { file: by("obstacles-file").value.trim(), obstacles: content });
      by("obstacles-saved").textContent = `Saved as ${done.file}.`;
      await listed();
      by("obstacles-open").value = done.file;
    } catch (error) {
      fault(error);
    }
  });
}
