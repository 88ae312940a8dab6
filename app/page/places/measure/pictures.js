// The servo's trace, the spot on the PSD, u by measurement, and the camera's picture. Numbers are in the texts beside them, too.
import { fixed } from "/page/parts/dom.js";

const SVG = "http://www.w3.org/2000/svg";

function drawn(tag, attributes = {}, ...children) {
  const element = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.append(...children);
  return element;
}

const image = (width, height, label, ...children) => drawn("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": label }, ...children);
const path = (points) => points.map(([x, y]) => `${x.toFixed(1)},${y.toFixed(1)}`).join(" ");
const text = (x, y, said, anchor = "start") => drawn("text", { x, y, "text-anchor": anchor }, said);

// Decades from `low` to `high` that hold all values.
function decades(values) {
  const logs = values.map((v) => Math.log10(Math.max(v, 1e-6)));
  const low = Math.floor(Math.min(...logs)), high = Math.max(low + 1, Math.ceil(Math.max(...logs)));
  return [low, high];
}

export function trace(steps) {
  const W = 220, H = 220, left = 44, top = 12, right = W - 10, bottom = H - 26;
  if (!steps.length) return image(W, H, "No step of the servo yet.", text(W / 2, H / 2, "no step yet", "middle"));
  const [low, high] = decades(steps.map((s) => s.off_mm));
  const y = (v) => bottom - ((Math.log10(Math.max(v, 1e-6)) - low) / (high - low)) * (bottom - top);
  const x = (i) => left + (steps.length < 2 ? 0 : (i / (steps.length - 1)) * (right - left));
  const lines = [];
  for (let k = low; k <= high; k++) {
    const at = y(10 ** k);
    lines.push(drawn("line", { x1: left, x2: right, y1: at, y2: at, class: "grid" }), text(left - 5, at + 3, fixed(10 ** k, Math.max(0, -k)), "end"));
  }
  const points = steps.map((s, i) => [x(i), y(s.off_mm)]);
  return image(W, H, `Distance of the spot from the centre by step: ${steps.map((s) => fixed(s.off_mm, 4)).join(", ")} mm.`,
    ...lines, drawn("polyline", { points: path(points), class: "course" }), ...points.map(([cx, cy]) => drawn("circle", { cx, cy, r: 3, class: "spot" })),
    text(4, 10, "mm"), text((left + right) / 2, H - 8, `step 0 to ${steps.length - 1}`, "middle"));
}

export function psd(steps, size) {
  const W = 220, middle = W / 2, half = W / 2 - 16;
  const cross = [drawn("rect", { x: middle - half, y: middle - half, width: 2 * half, height: 2 * half, class: "grid" }),
    drawn("line", { x1: middle - half, x2: middle + half, y1: middle, y2: middle, class: "grid" }),
    drawn("line", { y1: middle - half, y2: middle + half, x1: middle, x2: middle, class: "grid" })];
  const seen = steps.filter((s) => s.at_mm);
  if (!seen.length || !size) return image(W, W, "No spot on the PSD yet.", ...cross);
  const at = (s) => s.at_mm.map((v, i) => middle + (i ? -1 : 1) * (v / (size / 2)) * half);
  const points = seen.map(at), [x, y] = seen.at(-1).at_mm;
  return image(W, W, `The spot is at x ${fixed(x, 4)} mm, y ${fixed(y, 4)} mm on a face of ${size} mm.`, ...cross,
    drawn("polyline", { points: path(points), class: "way" }), ...points.slice(0, -1).map(([cx, cy]) => drawn("circle", { cx, cy, r: 2, class: "before" })),
    drawn("circle", { cx: points.at(-1)[0], cy: points.at(-1)[1], r: 5, class: "spot" }),
    text(middle + half, W - 4, `x ${fixed(x, 3)}, y ${fixed(y, 3)} mm; face ${size} mm`, "end"));
}

// u of one offset by measurement, on the logarithmic scale that all rows share; where it is not determined there is no line.
export function course(rows, name, all) {
  const W = 144, H = 28, found = rows.map((row) => row.std[name]);
  if (!found.some((v) => v !== null && v !== undefined)) return "";
  const [low, high] = all, first = rows[0].recorded, last = rows.at(-1).recorded;
  const points = rows.flatMap((row, i) => (found[i] === null || found[i] === undefined ? [] : [[
    4 + (last === first ? 0 : (row.recorded - first) / (last - first)) * (W - 8), H - 4 - ((Math.log10(found[i]) - low) / (high - low)) * (H - 8)]]));
  return drawn("svg", { viewBox: `0 0 ${W} ${H}`, "aria-hidden": "true" }, drawn("polyline", { points: path(points), class: "course" }),
    drawn("circle", { cx: points.at(-1)[0], cy: points.at(-1)[1], r: 3, class: "spot" }));
}

export const span = (rows) => {
  const values = rows.flatMap((row) => Object.values(row.std).filter((v) => v !== null && v > 0));
  return values.length ? decades(values) : [0, 1];
};

export function picture(canvas, seen) {
  const bytes = atob(seen.grey), pen = canvas.getContext("2d");
  if (canvas.width !== seen.width || canvas.height !== seen.height) Object.assign(canvas, { width: seen.width, height: seen.height });
  const pixels = pen.createImageData(seen.width, seen.height);
  for (let i = 0; i < bytes.length; i++) {
    const grey = bytes.charCodeAt(i);
    pixels.data.set([grey, grey, grey, 255], 4 * i);
  }
  pen.putImageData(pixels, 0, 0);
}
