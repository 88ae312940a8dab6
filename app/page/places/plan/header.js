// Target, laser, noise and geometry of a plan, as fields.
import { fill, make } from "/page/parts/dom.js";

const SPAN = 1000; // mm: how far a target's slider goes to each side
const at = (plan, key) => key.reduce((value, part) => (value === undefined || value === null ? undefined : value[part]), plan);

export function put(plan, key, value) {
  let inside = plan;
  key.slice(0, -1).forEach((part) => { inside[part] ??= {}; inside = inside[part]; });
  inside[key.at(-1)] = value;
}

function number(label, value, unit, key, changed) {
  const field = make("input", { type: "number", step: "any", value });
  field.addEventListener("input", () => {
    const given = field.value === "" ? NaN : Number(field.value);
    field.toggleAttribute("aria-invalid", !Number.isFinite(given));
    if (Number.isFinite(given)) changed(given);
    else field.setAttribute("aria-invalid", "true");
  });
  return make("label", { class: "number", "data-key": key }, label, " ", make("span", { class: "together" }, field, make("span", { "aria-hidden": "true" }, unit)));
}

// A vector of three, or one number; a list of another length is left to the file.
function fieldsOf(plan, label, key, unit, change) {
  const value = at(plan, key);
  if (typeof value === "number") return [number(label, value, unit, key.join("/"), (given) => change(key.join("/"), (p) => put(p, key, given)))];
  if (!Array.isArray(value)) return [];
  if (value.length !== 3) return [make("p", { class: "muted" }, `${label}: stated for each joint in the file.`)];
  return ["x", "y", "z"].map((axis, i) => number(`${label} ${axis}`, value[i], unit, key.join("/"), (given) => change(`${key.join("/")}/${i}`, (p) => { at(p, key)[i] = given; })));
}

export function headerFields(parent, plan, change) {
  const rows = [
    ...fieldsOf(plan, plan.tool && plan.tool.direction ? "Laser" : "Tip", ["tool", "point_mm"], "mm", change),
    ...fieldsOf(plan, "Beam", ["tool", "direction"], "", change),
    ...fieldsOf(plan, "Noise of a joint", ["noise", "joint_deg"], "°", change),
    ...fieldsOf(plan, "Noise of the spot", ["noise", "spot_mm"], "mm", change),
  ];
  if (plan.tool && "calibrated" in plan.tool) {
    const box = make("input", { type: "checkbox" });
    box.checked = plan.tool.calibrated;
    box.addEventListener("change", () => change(null, (p) => { p.tool.calibrated = box.checked; }));
    rows.push(make("label", { class: "check", "data-key": "tool/calibrated" }, box, " The tool is calibrated"));
  }
  const geometry = make("input", { type: "checkbox", id: "plan-geometry" });
  geometry.checked = plan.geometry !== "exact";
  geometry.addEventListener("change", () => change(null, (p) => {
    if (geometry.checked) delete p.geometry;
    else p.geometry = "exact";
  }));
  rows.push(make("label", { class: "check", "data-key": "geometry" }, geometry, " The arm deviates from nominal geometry, within tolerances"));
  if (geometry.checked) rows.push(
    tolerance("Tolerance of lengths", plan, "length_mm", 0.3, "mm", change), tolerance("Tolerance of angles", plan, "angle_deg", 0.1, "°", change));
  fill(parent, rows);
}

// A logarithmic slider from a hundredth of the usual tolerance to ten times of it.
function tolerance(label, plan, name, usual, unit, change) {
  const key = ["geometry", "tolerance", name], value = at(plan, key) ?? usual;
  if (typeof value !== "number") return make("p", { class: "muted" }, `${label}: stated for each link in the file.`);
  const said = make("output", {}, `${value}\u00a0${unit}`);
  const slider = make("input", { type: "range", min: Math.log10(usual) - 2, max: Math.log10(usual) + 1, step: 0.05, value: Math.log10(value), "aria-label": label, "aria-valuetext": `${value} ${unit}`, "data-tolerance": name });
  slider.addEventListener("input", () => {
    const given = Number((10 ** slider.value).toPrecision(2));
    said.textContent = `${given}\u00a0${unit}`;
    slider.setAttribute("aria-valuetext", `${given} ${unit}`);
    change(key.join("/"), (p) => put(p, key, given));
  });
  return make("div", { class: "tolerance", "data-key": key.join("/") }, `${label} `, slider, " ", said);
}

// The targets' coordinates. `nominal` has the places of those that the plan states none for. Returns what shows others.
export function targetFields(parent, plan, nominal, change) {
  fill(parent, Object.keys(nominal).map((name) => {
    const stated = at(plan, ["targets", name, "guess_mm"]);
    const place = stated || nominal[name];
    const said = (own) => (own ? `${name}: nominal place, as stated in the plan` : `${name}: nominal place, taken from the postures; the plan states none`);
    const legend = make("legend", {}, said(stated));
    const move = (i, value) => change(`target/${name}/${i}`, (p) => {
      legend.textContent = said(true);
      const guess = [...(at(p, ["targets", name, "guess_mm"]) || place)];
      guess[i] = value;
      put(p, ["targets", name, "guess_mm"], guess);
    });
    const rows = ["x", "y", "z"].map((axis, i) => {
      const middle = Math.round(place[i] / 100) * 100, value = Number(place[i].toFixed(3));
      const slider = make("input", { type: "range", min: middle - SPAN, max: middle + SPAN, step: 1, value, "aria-label": `${name}, ${axis} in mm` });
      const field = make("input", { type: "number", step: "any", value, "aria-label": `${name}, ${axis} in mm, exactly` });
      slider.addEventListener("input", () => { field.value = slider.value; move(i, Number(slider.value)); });
      field.addEventListener("input", () => {
        const given = field.value === "" ? NaN : Number(field.value);
        if (!Number.isFinite(given)) { field.setAttribute("aria-invalid", "true"); return; }
        field.removeAttribute("aria-invalid");
        slider.value = given;
        move(i, given);
      });
      return make("div", { class: "joint" }, make("span", { class: "name" }, axis), slider, field, make("span", { "aria-hidden": "true" }, "mm"));
    });
    return make("fieldset", { "data-key": `targets/${name}` }, legend, ...rows);
  }));
}
