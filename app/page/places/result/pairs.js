// The draws of the offsets, pair by pair, on a canvas: a region of a panel chooses draws, an arrow shows a shift.
import { by, fill, fixed, make, named } from "/page/parts/dom.js";

const EDGE = { left: 58, right: 8, top: 8, bottom: 44 }, GAP = 6;
const BINS = 32;
const STEP = 0.04; // of a panel: by how much an arrow key moves or changes a region

let data = null, ranges = {}, panel = 0, estimates = {}, shift = null, changed = () => {};
const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
const canvas = () => by("result-plot").querySelector("canvas");
const short = (name) => named(name).split(" ")[0];

function limits(values) {
  const sorted = [...values].sort((a, b) => a - b), at = (p) => sorted[Math.min(sorted.length - 1, Math.floor(p * sorted.length))];
  const low = at(0.001), high = at(0.999), margin = 0.06 * (high - low) || 1;
  return [low - margin, high + margin];
}

// `found` is what /api/posterior says, `rows` the parameters of the result; `moved` is called with the chosen ranges.
export function showPairs(found, rows, moved) {
  changed = moved;
  ranges = {};
  panel = 0;
  shift = null;
  const empty = !found || !found.names.length;
  by("result-plot").hidden = empty;
  data = empty ? null : { ...found, limits: found.draws.map(limits), pairs: [] };
  if (empty) return;
  for (let i = 0; i < data.names.length; i++) for (let j = 0; j <= i; j++) data.pairs.push([j, i]);
  panel = Math.min(1, data.pairs.length - 1);
  estimates = Object.fromEntries(rows.map((row) => [row.name, row]));
  const said = data.names.map((name) => named(name)).join(", ");
  canvas().setAttribute("aria-label", `Posterior draws of ${said}: each alone on the diagonal, each pair below it. The fields beneath choose the same regions.`);
  fill(by("result-ranges"), data.names.flatMap((name, i) => ["from", "to"].map((end, k) => {
    const field = make("input", { type: "number", step: "any", "data-range": `${name}/${k}` });
    field.addEventListener("change", () => {
      const own = ranges[name] ? [...ranges[name]] : [...data.limits[i]];
      const value = field.value === "" ? data.limits[i][k] : Number(field.value);
      if (!Number.isFinite(value)) return;
      own[k] = value;
      ranges[name] = [Math.min(...own), Math.max(...own)];
      told();
    });
    return make("label", {}, `${named(name)} ${end}, ${data.units[i] === "deg" ? "°" : data.units[i]}`, field);
  })));
  draw();
  fields();
}

// The estimates without some measurements, as rows of /api/refit, or null.
export function showShift(rows) {
  shift = rows && Object.fromEntries(rows.filter((row) => row.estimate !== null && row.before.estimate !== null).map((row) => [row.name, [row.before.estimate, row.estimate]]));
  draw();
}

export function clearRanges() { ranges = {}; told(); }

function told() {
  fields();
  draw();
  changed({ ...ranges });
}

function fields() {
  for (const field of by("result-ranges").querySelectorAll("input")) {
    const at = field.dataset.range.lastIndexOf("/"), name = field.dataset.range.slice(0, at), own = ranges[name];
    if (document.activeElement !== field) field.value = own ? Number(own[Number(field.dataset.range.slice(at + 1))].toPrecision(6)) : "";
  }
}

function place() {
  const width = canvas().clientWidth || 600, count = data.names.length;
  const side = (width - EDGE.left - EDGE.right - GAP * (count - 1)) / count, tall = Math.min(side, 220) * 0.9;
  return { width, side, tall, height: EDGE.top + EDGE.bottom + tall * count + GAP * (count - 1) };
}

function box([j, i], size) {
  const left = EDGE.left + j * (size.side + GAP), top = EDGE.top + i * (size.tall + GAP);
  const [x0, x1] = data.limits[j], [y0, y1] = data.limits[i];
  return {
    left, top, right: left + size.side, bottom: top + size.tall,
    x: (v) => left + ((v - x0) / (x1 - x0)) * size.side, y: (v) => top + size.tall - ((v - y0) / (y1 - y0)) * size.tall,
    inX: (px) => x0 + ((px - left) / size.side) * (x1 - x0), inY: (py) => y0 + ((top + size.tall - py) / size.tall) * (y1 - y0),
  };
}

const within = (k) => Object.entries(ranges).every(([name, [low, high]]) => { const v = data.draws[data.names.indexOf(name)][k]; return v >= low && v <= high; });

function draw() {
  if (!data) return;
  const element = canvas(), size = place(), ratio = Math.min(3, devicePixelRatio || 1);
  element.width = Math.round(size.width * ratio);
  element.height = Math.round(size.height * ratio);
  element.style.height = `${size.height}px`;
  const pen = element.getContext("2d");
  pen.scale(ratio, ratio);
  pen.font = '11px "IBM Plex Sans", sans-serif';
  const any = Object.keys(ranges).length > 0, chosen = data.draws[0].map((_, k) => any && within(k));
  data.pairs.forEach((pair, number) => drawPanel(pen, pair, box(pair, size), chosen, any, number === panel));
  pen.fillStyle = colour("ink");
  pen.font = '700 12px "IBM Plex Sans", sans-serif';
  data.names.forEach((name, i) => {
    const bottom = box([i, data.names.length - 1], size), left = box([0, i], size);
    pen.textAlign = "center";
    pen.fillText(`${short(name)}, ${data.units[i] === "deg" ? "°" : data.units[i]}`, (bottom.left + bottom.right) / 2, size.height - 6);
    if (i) { pen.save(); pen.translate(12, (left.top + left.bottom) / 2); pen.rotate(-Math.PI / 2); pen.fillText(short(name), 0, 0); pen.restore(); }
  });
}

function tone(j, i) {
  const statuses = [j, i].map((k) => estimates[data.names[k]]?.status);
  return colour(statuses.includes("unvalidated") ? "unvalidated" : statuses.includes("weak") ? "weak" : "identified");
}

function drawPanel(pen, [j, i], at, chosen, any, current) {
  pen.strokeStyle = current && document.activeElement === canvas() ? colour("ink") : colour("line");
  pen.lineWidth = 1;
  pen.strokeRect(at.left + 0.5, at.top + 0.5, at.right - at.left - 1, at.bottom - at.top - 1);
  pen.save();
  pen.beginPath();
  pen.rect(at.left, at.top, at.right - at.left, at.bottom - at.top);
  pen.clip();
  pen.fillStyle = tone(j, i);
  if (i === j) {
    histogram(pen, at, j, () => true, any ? 0.3 : 0.6);
    pen.fillStyle = colour("misfit");
    if (any) histogram(pen, at, j, (k) => chosen[k], 0.8);
  } else {
    const x = data.draws[j], y = data.draws[i];
    pen.globalAlpha = any ? 0.18 : 0.3;
    for (let k = 0; k < x.length; k++) if (!chosen[k]) pen.fillRect(at.x(x[k]) - 1, at.y(y[k]) - 1, 2, 2);
    pen.globalAlpha = 0.8;
    pen.fillStyle = colour("misfit");
    if (any) for (let k = 0; k < x.length; k++) if (chosen[k]) pen.fillRect(at.x(x[k]) - 1.2, at.y(y[k]) - 1.2, 2.4, 2.4);
    pen.globalAlpha = 1;
  }
  region(pen, at, j, i);
  marks(pen, at, j, i);
  pen.restore();
  ticks(pen, at, j, i);
}

function histogram(pen, at, j, counted, strength) {
  const [low, high] = data.limits[j], heights = new Array(BINS).fill(0), all = new Array(BINS).fill(0);
  data.draws[j].forEach((v, k) => { const b = Math.floor(((v - low) / (high - low)) * BINS); if (b >= 0 && b < BINS) { all[b]++; if (counted(k)) heights[b]++; } });
  const most = Math.max(...all) * 1.08, wide = (at.right - at.left) / BINS;
  pen.globalAlpha = strength;
  heights.forEach((h, b) => { const tall = (h / most) * (at.bottom - at.top); pen.fillRect(at.left + b * wide, at.bottom - tall, wide + 0.4, tall); });
  pen.globalAlpha = 1;
}

function region(pen, at, j, i) {
  const x = ranges[data.names[j]], y = i === j ? null : ranges[data.names[i]];
  if (!x && !y) return;
  const left = x ? at.x(x[0]) : at.left, right = x ? at.x(x[1]) : at.right, top = y ? at.y(y[1]) : at.top, bottom = y ? at.y(y[0]) : at.bottom;
  pen.strokeStyle = colour("ink");
  pen.setLineDash([4, 3]);
  pen.strokeRect(left, top, right - left, bottom - top);
  pen.setLineDash([]);
}

function marks(pen, at, j, i) {
  const here = (k) => estimates[data.names[k]]?.estimate ?? null;
  const moved = (k) => shift && shift[data.names[k]];
  pen.strokeStyle = colour("ink");
  pen.lineWidth = 1.5;
  pen.beginPath();
  if (i === j) {
    if (here(j) !== null) { pen.moveTo(at.x(here(j)), at.top); pen.lineTo(at.x(here(j)), at.bottom); }
    if (moved(j)) arrow(pen, at.x(moved(j)[0]), (at.top + at.bottom) / 2, at.x(moved(j)[1]), (at.top + at.bottom) / 2);
  } else if (here(j) !== null && here(i) !== null) {
    const x = at.x(here(j)), y = at.y(here(i));
    pen.moveTo(x - 5, y); pen.lineTo(x + 5, y); pen.moveTo(x, y - 5); pen.lineTo(x, y + 5);
    if (moved(j) && moved(i)) arrow(pen, at.x(moved(j)[0]), at.y(moved(i)[0]), at.x(moved(j)[1]), at.y(moved(i)[1]));
  }
  pen.stroke();
}

function arrow(pen, x0, y0, x1, y1) {
  const long = Math.hypot(x1 - x0, y1 - y0), turn = Math.atan2(y1 - y0, x1 - x0), head = Math.min(8, long);
  pen.moveTo(x0, y0);
  pen.lineTo(x1, y1);
  for (const aside of [2.6, -2.6]) { pen.moveTo(x1, y1); pen.lineTo(x1 + head * Math.cos(turn + aside), y1 + head * Math.sin(turn + aside)); }
}

function ticks(pen, at, j, i) {
  pen.fillStyle = colour("muted");
  pen.font = '10px "IBM Plex Sans", sans-serif';
  const said = (k, value) => fixed(value, Math.max(0, Math.min(6, 1 - Math.floor(Math.log10(data.limits[k][1] - data.limits[k][0])))));
  const between = (k) => [0.2, 0.8].map((share) => data.limits[k][0] + share * (data.limits[k][1] - data.limits[k][0]));
  const middle = (k) => (data.limits[k][0] + data.limits[k][1]) / 2;
  const narrow = at.right - at.left < 80;
  if (i === data.names.length - 1) for (const v of narrow ? [middle(j)] : between(j)) { pen.textAlign = "center"; pen.fillText(said(j, v), at.x(v), at.bottom + 14); }
  if (j === 0 && i !== 0) for (const v of at.bottom - at.top < 60 ? [middle(i)] : between(i)) { pen.textAlign = "right"; pen.fillText(said(i, v), at.left - 4, at.y(v) + 3); }
}

// ── choosing a region ──

function ranged(pair, at, [x0, y0], [x1, y1]) {
  const clip = (v, [low, high]) => Math.max(low, Math.min(high, v));
  const [j, i] = pair, xs = [at.inX(x0), at.inX(x1)].map((v) => clip(v, data.limits[j]));
  ranges = { [data.names[j]]: [Math.min(...xs), Math.max(...xs)] };
  if (i !== j) { const ys = [at.inY(y0), at.inY(y1)].map((v) => clip(v, data.limits[i])); ranges[data.names[i]] = [Math.min(...ys), Math.max(...ys)]; }
}

function keyed(event) {
  if (!data) return;
  const [j, i] = data.pairs[panel], sides = { ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowDown: [1, -1], ArrowUp: [1, 1] };
  const key = event.key;
  if (key === "Escape") { event.preventDefault(); clearRanges(); return; }
  if (/^[npNP]$/.test(key) && !event.ctrlKey && !event.metaKey) { panel = (panel + (key.toLowerCase() === "n" ? 1 : data.pairs.length - 1)) % data.pairs.length; ranges = {}; told(); return; }
  if (!sides[key]) return;
  event.preventDefault();
  const middle = (k) => { const [low, high] = data.limits[k]; return [low + 0.4 * (high - low), low + 0.6 * (high - low)]; };
  const axes = i === j ? [j] : [j, i];
  const own = axes.map((k) => [...(ranges[data.names[k]] || middle(k))]);
  const [side, sign] = sides[key], k = Math.min(side, axes.length - 1), step = sign * STEP * (data.limits[axes[k]][1] - data.limits[axes[k]][0]);
  if (Object.keys(ranges).length) {
    if (event.shiftKey) own[k][1] = Math.max(own[k][0], own[k][1] + step);
    else own[k] = own[k].map((v) => v + step);
  }
  ranges = Object.fromEntries(axes.map((axis, n) => [data.names[axis], own[n]]));
  told();
}

export function beginPairs() {
  const element = canvas();
  let drag = null;
  const at = (event) => { const edge = element.getBoundingClientRect(); return [event.clientX - edge.left, event.clientY - edge.top]; };
  element.addEventListener("pointerdown", (event) => {
    if (!data) return;
    const [x, y] = at(event), size = place();
    const found = data.pairs.findIndex((pair) => { const own = box(pair, size); return x >= own.left && x <= own.right && y >= own.top && y <= own.bottom; });
    if (found < 0) return;
    panel = found;
    drag = { pair: data.pairs[found], at: box(data.pairs[found], size), from: [x, y] };
    element.setPointerCapture(event.pointerId);
  });
  element.addEventListener("pointermove", (event) => {
    if (!drag) return;
    const to = at(event);
    if (Math.hypot(to[0] - drag.from[0], to[1] - drag.from[1]) < 4) return;
    ranged(drag.pair, drag.at, drag.from, to);
    told();
  });
  const end = () => { if (drag) draw(); drag = null; };
  element.addEventListener("pointerup", end);
  element.addEventListener("pointercancel", end);
  element.addEventListener("keydown", keyed);
  element.addEventListener("focus", draw);
  element.addEventListener("blur", draw);
  new ResizeObserver(() => draw()).observe(by("result-plot"));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  document.fonts.ready.then(draw);
}
