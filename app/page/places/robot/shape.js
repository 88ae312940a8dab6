// What is drawn of an arm besides its line: the meshes of a URDF, joint axes and frames.
import { post, Refused } from "/page/parts/api.js";

const turned = (pose, v) => pose.map((row) => row[0] * v[0] + row[1] * v[1] + row[2] * v[2] + row[3]);

let of = "", found = null;

// The meshes of a URDF, read once: {meshes, notes}; nothing of another robot. `then` is called when they are there.
export function meshesOf(ref, then) {
  const key = typeof ref === "string" ? "" : JSON.stringify(ref);
  if (key === of) return found;
  of = key;
  found = null;
  if (key) {
    post("/api/meshes", { robot: ref }).catch((error) => {
      if (!(error instanceof Refused)) throw error;
      return { meshes: [], notes: [error.text] };
    }).then((answer) => {
      if (of !== key) return;
      found = answer;
      then();
    });
  }
  return found;
}

// In the base frame, by the poses of the links.
export const placed = (meshes, links) => meshes.map((mesh) => ({ faces: mesh.faces, vertices: mesh.vertices.map((v) => turned(links[mesh.link], v)) }));

// A line along each joint's axis, as long to both sides.
export const axesOf = (arm) => arm.axes.map((axis, i) => [-1, 1].map((sign) => arm.skeleton[i + 1].map((v, k) => v + sign * 0.09 * arm.reach_mm * axis[k])));

// Columns of the rotation of a unit quaternion.
function columns([w, x, y, z]) {
  return [
    [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)],
    [2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)],
    [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)],
  ];
}

export const framesOf = (arm) => [{ name: "base", at: [0, 0, 0], axes: [[1, 0, 0], [0, 1, 0], [0, 0, 1]] },
  { name: "flange", at: arm.poses[0].xyz_mm, axes: columns(arm.poses[0].quaternion_wxyz) }];
