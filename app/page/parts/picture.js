// What scene.js draws: arms as the server places them, in a frame that only changes when it has to.
import { by } from "/page/parts/dom.js";

const ONE_PLACE = 15; // mm: joints nearer to each other than this share one number
const far = (a, b) => Math.hypot(...a.map((v, i) => v - b[i]));

function numbers(arm) {
  const places = [];
  arm.slice(1, -1).forEach((at, i) => {
    const near = places.find((place) => far(place.at, at) < ONE_PLACE);
    if (near) near.text += `, ${i + 1}`;
    else places.push({ at, text: String(i + 1) });
  });
  return places;
}

// One posture: `arm` points, `tool` (the laser's origin, or null), `beam` (two points, or null).
export const posed = (name, arm, tool = null, beam = null, reaches = true) => ({
  name, arm, tool: [arm.at(-1), tool || arm.at(-1)], beam, reaches, numbers: numbers(arm),
});

function frame(postures, targets, reach, extent) {
  const points = [[0, 0, 0], ...extent, ...targets.map((t) => t.at)];
  for (const p of postures) points.push(...p.arm, ...p.tool, ...(p.beam || []));
  const low = [0, 1, 2].map((i) => Math.min(...points.map((p) => p[i])));
  const high = [0, 1, 2].map((i) => Math.max(...points.map((p) => p[i])));
  const centre = low.map((v, i) => (v + high[i]) / 2);
  const radius = Math.max(...points.map((p) => far(p, centre)), reach / 2);
  const rough = Math.max(high[0] - low[0], high[1] - low[1], reach) / 8, power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((k) => k * power).find((s) => s >= rough);
  const half = Math.max(high[0] - low[0], high[1] - low[1], reach) / 2;
  const bounds = [0, 1].flatMap((i) => [Math.floor((centre[i] - half) / step), Math.ceil((centre[i] + half) / step)].map((n) => n * step));
  return { centre, radius, grid: { step, bounds }, axis: 0.22 * radius, factor: null };
}

let kept = null, keptOf = null;

// Where an arm of some reach can get to, for a picture in which it is moved about.
export const within = (reach) => [-0.65, 0.65].flatMap((x) => [[x * reach, 0, 0], [0, x * reach, 0]]).concat([[0, 0, reach]]);

// `of` says what is shown: as long as it is the same, the view stays as the reader turned it. `extent`: points to fit in.
// `more`: `boxes` (name, min, max, touched), and whether targets and boxes are `movable`.
export function show(of, postures, targets, chosen, reach, caption, extent = [], more = {}) {
  const fit = of !== keptOf;
  if (fit) kept = { ...frame(postures, targets, reach, extent), extent };
  keptOf = of;
  by("scene-caption").textContent = `${caption} Grid of ${kept.grid.step} mm at z = 0; x, y and z are the base frame.`;
  by("scene").classList.toggle("single", postures.length < 2);
  by("scene").dispatchEvent(new CustomEvent("scene", { detail: { scene: { ...kept, postures, targets, ...more }, chosen, fit } }));
}
