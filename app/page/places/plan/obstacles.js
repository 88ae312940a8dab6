// Obstacles of the cell, a constraint of the plan: boxes and floor as fields, taken from a file or written to one.
import { get, put, Refused } from "/page/parts/api.js";
import { by, fill, make, options } from "/page/parts/dom.js";

const SIZE = 200; // mm, of a new box

let current = () => null, change = () => {}; // the plan that is open, and how it is changed

const obstacles = () => current()?.constraints?.obstacles ?? null;
const edit = (key, use) => change(key && `constraints/obstacles/${key}`, (plan) => {
  plan.constraints ??= {};
  plan.constraints.obstacles ??= {};
  plan.constraints.obstacles.boxes ??= [];
  use(plan.constraints.obstacles);
});

// As the picture draws them; `touched` is what the check says of each.
export const boxes = (touched) => (obstacles()?.boxes ?? []).map((box, i) => ({ name: box.name, min: box.min_mm, max: box.max_mm, touched: Boolean(touched && touched[i]) }));

function field(label, value, use, empty = null) {
  const own = make("input", { type: "number", step: "any", value: value ?? "", "aria-label": label, placeholder: empty });
  own.addEventListener("input", () => {
    const given = own.value === "" ? (empty === null ? NaN : null) : Number(own.value);
    own.toggleAttribute("aria-invalid", false);
    if (given !== null && !Number.isFinite(given)) { own.setAttribute("aria-invalid", "true"); return; }
    use(given);
  });
  return own;
}

function boxRow(box, i) {
  const name = make("input", { value: box.name, "aria-label": `Name of box ${i + 1}`, autocomplete: "off" });
  name.addEventListener("input", () => edit(`boxes/${i}/name`, (own) => { own.boxes[i].name = name.value; }));
  const corner = (key, word) => ["x", "y", "z"].map((axis, k) => field(`${word} ${axis} of box ${i + 1} in mm`, box[key][k], (v) => edit(`boxes/${i}/${key}/${k}`, (own) => { own.boxes[i][key][k] = v; })));
  return make("fieldset", { class: "box", "data-key": `constraints/obstacles/boxes/${i}` }, make("legend", {}, `Box ${i + 1}: name; lowest and highest corner x, y, z in mm`), name,
    make("div", { class: "corners" }, ...corner("min_mm", "lowest")), make("div", { class: "corners" }, ...corner("max_mm", "highest")),
    make("button", { type: "button", onclick: () => edit(null, (own) => { own.boxes.splice(i, 1); }) }, "Remove"));
}

export function renderObstacles() {
  const content = obstacles();
  by("obstacles-fields").hidden = content === null;
  if (content === null) return;
  const at = typeof content.floor_mm === "number" ? "height" : content.floor_mm === null ? "none" : "mounting";
  const where = make("select", { "aria-label": "Where the floor is", onchange: (event) => edit(null, (own) => { own.floor_mm = { mounting: "mounting", none: null, height: 0 }[event.target.value]; }) },
    ...[["mounting", "the arm's mounting face"], ["height", "at a height"], ["none", "none"]].map(([value, words]) => make("option", { value, selected: value === at }, words)));
  const height = at === "height" ? [make("label", {}, "Its height in the base frame, mm", field("Height of the floor in mm", content.floor_mm, (v) => edit("floor_mm", (own) => { own.floor_mm = v; })))] : [];
  const thick = field("Radius of the arm's links in mm", content.thickness_mm, (v) => edit("thickness_mm", (own) => { own.thickness_mm = v; }), "5 % of the arm");
  fill(by("obstacles-boxes"), [make("div", { class: "fields", "data-key": "constraints/obstacles" }, make("label", {}, "Floor", where), ...height, make("label", {}, "Radius of the links, mm", thick)), ...(content.boxes ?? []).map(boxRow)]);
}

export function listObstacles(files) {
  const chosen = by("obstacles-open").value;
  options(by("obstacles-open"), [["obstacles of this folder", files.filter((f) => f.kind === "obstacles").map((f) => [f.path, f.path])]], "choose a file");
  by("obstacles-open").value = [...by("obstacles-open").options].some((o) => o.value === chosen) ? chosen : "";
}

// In the picture a box is moved by its middle.
export function moveBox(i, at) {
  edit(`boxes/${i}`, (own) => {
    const box = own.boxes[i], middle = box.min_mm.map((v, k) => (v + box.max_mm[k]) / 2);
    for (const key of ["min_mm", "max_mm"]) box[key] = box[key].map((v, k) => Math.round(v + at[k] - middle[k]));
  });
  renderObstacles();
}

// `plan()` is the one that is open, `changed(key, edit)` changes it; `near()` is where a new box is put;
// `listed` is called when a file was written.
export function beginObstacles(plan, changed, near, listed) {
  current = plan;
  change = changed;
  const carefully = async (work) => {
    by("obstacles-saved").textContent = "";
    try {
      await work();
    } catch (error) {
      if (!(error instanceof Refused)) throw error;
      by("obstacles-saved").textContent = error.text;
    }
  };
  by("obstacles-open").addEventListener("change", () => carefully(async () => {
    const file = by("obstacles-open").value;
    if (!file || current() === null) return;
    const found = (await get(`/api/obstacles?file=${encodeURIComponent(file)}`)).obstacles;
    by("obstacles-file").value = file;
    change(null, (plan) => { plan.constraints = { ...plan.constraints, obstacles: found }; });
  }));
  by("obstacles-none").addEventListener("click", () => change(null, (plan) => { delete plan.constraints?.obstacles; }));
  by("obstacles-add").addEventListener("click", () => {
    const at = near().map(Math.round);
    edit(null, (own) => { own.boxes.push({ name: `box ${own.boxes.length + 1}`, min_mm: at.map((v) => v - SIZE / 2), max_mm: at.map((v) => v + SIZE / 2) }); });
  });
  by("obstacles-save").addEventListener("click", () => carefully(async () => {
    const done = await put("/api/obstacles", { file: by("obstacles-file").value.trim(), obstacles: obstacles() });
    by("obstacles-saved").textContent = `Saved as ${done.file}.`;
    await listed();
    by("obstacles-open").value = done.file;
  }));
}
