// The constraints of a plan as fields: what every measurement must keep. An empty field: it is not judged.
import { by, fill, make } from "/page/parts/dom.js";
import { put } from "/page/places/plan/header.js";

const FIELDS = [
  ["facing", "Normal of the target's face: x, y, z (empty: any side)", 3],
  ["acceptance_deg", "Largest angle between beam and normal, ° (empty: 60)", 1],
  ["beam_mm", "Shortest and longest beam, mm (empty: any)", 2],
  ["margin_deg", "Margin to every joint limit, ° (empty: none)", 1],
];

function remove(plan, key) {
  delete plan.constraints?.[key];
  if (key === "facing") delete plan.constraints?.acceptance_deg; // an angle to what is no longer there
}

export function constraintFields(plan, change) {
  fill(by("plan-constraints"), FIELDS.map(([key, label, count]) => {
    const value = plan.constraints?.[key] ?? [];
    const field = make("input", { id: `constraint-${key}`, autocomplete: "off", value: [value].flat().join(", ") });
    field.addEventListener("input", () => {
      const numbers = field.value.split(",").map((part) => (part.trim() === "" ? NaN : Number(part)));
      const none = field.value.trim() === "", sound = numbers.length === count && numbers.every(Number.isFinite);
      field.toggleAttribute("aria-invalid", false);
      if (none) change(`constraints/${key}`, (p) => remove(p, key));
      else if (sound) change(`constraints/${key}`, (p) => put(p, ["constraints", key], count === 1 ? numbers[0] : numbers));
      else field.setAttribute("aria-invalid", "true");
    });
    return make("label", { "data-key": `constraints/${key}` }, label, " ", field);
  }));
}
