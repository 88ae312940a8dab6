// The arm moves along a null-space direction: how it can be off without any measurement showing it.
import { post } from "/page/parts/api.js";
import { posed } from "/page/parts/picture.js";

const STEPS = 6; // poses to each side
const PERIOD = 2400; // ms, there and back
const minus = (a, b) => a.map((v, i) => v - b[i]);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];

// v turned by a unit quaternion, or turned back.
function turned([w, x, y, z], v, back = false) {
  const q = back ? [-x, -y, -z] : [x, y, z];
  const t = cross(q, v).map((c) => 2 * c);
  const u = cross(q, t);
  return v.map((c, i) => c + w * t[i] + u[i]);
}

// One posture at each step: laser and flange are one rigid body, the beam ends nearest to the moved target.
async function steps(robot, place, motion) {
  const shares = Array.from({ length: 2 * STEPS + 1 }, (_, i) => (i - STEPS) / STEPS);
  const arms = [];
  for (const share of shares) arms.push(await post("/api/robot", { robot, joints_deg: place.joints_deg.map((v, i) => v + share * motion.joints_deg[i]) }));
  const rest = arms[STEPS].poses[0];
  const own = (v) => turned(rest.quaternion_wxyz, v, true);
  const tool = own(minus(place.tool, rest.xyz_mm));
  const beam = place.beam && own(minus(place.beam[1], place.beam[0]));
  return arms.map((arm, i) => {
    const pose = arm.poses[0], to = (v) => turned(pose.quaternion_wxyz, v);
    const from = to(tool).map((v, k) => v + pose.xyz_mm[k]);
    const target = place.target.map((v, k) => v + shares[i] * (motion.others[`${place.target_name}.${"xyz"[k]}`] || 0));
    let ray = null;
    if (beam) {
      const direction = to(beam), length = dot(minus(target, from), direction) / dot(direction, direction);
      ray = [from, from.map((v, k) => v + Math.max(0, length) * direction[k])];
    }
    return { posture: posed("along the direction", arm.skeleton, from, ray, place.reaches), arm, target: { name: place.target_name, at: target, state: "nominal" } };
  });
}

// Shows it until the returned function is called; where less motion is wished for, its end alone.
export function animate(robot, place, motion, draw, failed) {
  let going = true;
  steps(robot, place, motion).then((found) => {
    if (matchMedia("(prefers-reduced-motion: reduce)").matches) { if (going) draw(found.at(-1)); return; }
    const begun = performance.now();
    const frame = (now) => {
      if (!going) return;
      const share = Math.sin((2 * Math.PI * (now - begun)) / PERIOD);
      draw(found[Math.round((share + 1) * STEPS)]);
      requestAnimationFrame(frame);
    };
    requestAnimationFrame(frame);
  }, failed);
  return () => { going = false; };
}
