// Joint positions as sliders within the limits, each with a numeric field.
import { fill, make } from "/page/parts/dom.js";

// `moved(index, value)` is called with degrees (mm of a prismatic joint). Returns a function that shows other values.
export function jointRows(parent, joints, moved) {
  const rows = joints.map((joint, i) => {
    const unit = joint.unit === "deg" ? "°" : joint.unit;
    const low = Math.max(joint.lower, -1e4), high = Math.min(joint.upper, 1e4);
    const name = `J${i + 1}`;
    const slider = make("input", { type: "range", min: low, max: high, step: 0.1, "aria-label": `${name}, ${joint.name}` });
    const field = make("input", { type: "number", step: "any", "aria-label": `${name} in ${joint.unit}` });
    slider.addEventListener("input", () => { field.value = slider.value; field.removeAttribute("aria-invalid"); moved(i, Number(slider.value)); });
    field.addEventListener("input", () => {
      const value = field.value === "" ? NaN : Number(field.value);
      if (!Number.isFinite(value)) { field.setAttribute("aria-invalid", "true"); return; }
      field.removeAttribute("aria-invalid");
      slider.value = value;
      moved(i, value);
    });
    const row = make("div", { class: "joint", "data-joint": i }, make("span", { class: "name" }, name), slider, field, make("span", { "aria-hidden": "true" }, unit));
    const set = (value) => {
      slider.value = value;
      slider.setAttribute("aria-valuetext", `${Number(value.toFixed(2))} ${joint.unit}`);
      if (document.activeElement !== field) { field.value = Number(value.toFixed(4)); field.removeAttribute("aria-invalid"); }
      field.toggleAttribute("data-beyond", value < joint.lower - 1e-9 || value > joint.upper + 1e-9);
    };
    return { row, set };
  });
  fill(parent, rows.map((r) => r.row));
  return (values) => rows.forEach((r, i) => r.set(values[i] ?? 0));
}
