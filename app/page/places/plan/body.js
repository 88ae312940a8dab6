// The arm of the chosen posture as the place Robot draws it: joint axes, frames and meshes, where they are wished for.
import { post } from "/page/parts/api.js";
import { by, named, write } from "/page/parts/dom.js";
import { axesOf, framesOf, meshesOf, placed } from "/page/places/robot/shape.js";

const TOGGLES = ["plan-axes", "plan-frames", "plan-meshes"];
const on = (id) => by(id).checked && !by(id).parentElement.hidden;

export const wished = () => TOGGLES.some(on);

// Asked with the check, so that line and meshes are of one state; a robot without a URDF has no meshes.
export const bodyOf = (ref, place) => post("/api/robot", { robot: ref, joints_deg: place.joints_deg });

export function beginDrawing(changed) {
  for (const id of TOGGLES) by(id).addEventListener("change", changed);
}

// A laser is a point and a direction in the flange's frame: the tool's frame is parallel to that.
export function dressed(posture, arm, ref, then) {
  const found = on("plan-meshes") ? meshesOf(ref, then) : null, frames = framesOf(arm);
  write(by("plan-undrawn"), found ? found.notes.map(named).join("; ") : "");
  return {
    ...posture,
    ...(on("plan-axes") ? { axes: axesOf(arm) } : {}),
    ...(on("plan-frames") ? { frames: [...frames, { name: "tool", at: posture.tool[1], axes: frames[1].axes }] } : {}),
    ...(found ? { meshes: placed(found.meshes, arm.links) } : {}),
  };
}
