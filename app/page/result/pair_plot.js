// The draws of the offsets, pair by pair, on a canvas: what is where, and how it is drawn.
import { fixed, named } from "../core/words.js";

/** @typedef {import("answers").PosteriorDraws} Posterior */
/** @typedef {import("./state.js").Ranges} Ranges */
/** @typedef {[number, number]} Pair column and row of a panel */
/**
 * @typedef {{left: number, top: number, right: number, bottom: number, x: (v: number) => number,
 *   y: (v: number) => number, inX: (px: number) => number, inY: (py: number) => number}} Panel
 */
/** @typedef {Posterior & {limits: [number, number][], pairs: Pair[]}} Plotted */
/**
 * @typedef {{ranges: Ranges, panel: number, focused: boolean, rows: Record<string, import("answers").ParameterResult>,
 *   shift: Record<string, [number, number]>}} Shown `shift`: estimates before and after, by name
 */

const EDGE = { left: 58, right: 8, top: 8, bottom: 44 }, GAP = 6, BINS = 32, MOST_TALL = 220;
const FONT = '"IBM Plex Sans", sans-serif';
const short = (/** @type {string} */ name) => named(name).split(" ")[0];
const colour = (/** @type {string} */ name) =>
  getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

/** @param {Posterior} found @returns {Plotted} */
export function plotted(found) {
  const limits = found.draws.map((values) => {
    const sorted = [...values].sort((a, b) => a - b);
    const at = (/** @type {number} */ p) => sorted[Math.min(sorted.length - 1, Math.floor(p * sorted.length))];
    const low = at(0.001), high = at(0.999), margin = 0.06 * (high - low) || 1;
    return /** @type {[number, number]} */ ([low - margin, high + margin]);
  });
  /** @type {Pair[]} */
  const pairs = found.names.flatMap((_, i) => Array.from({ length: i + 1 }, (__, j) => /** @type {Pair} */ ([j, i])));
  return { ...found, limits, pairs };
}

/** @param {Plotted} data @param {number} width */
export function sizeOf(data, width) {
  const count = data.names.length, side = (width - EDGE.left - EDGE.right - GAP * (count - 1)) / count;
  const tall = 0.9 * Math.min(side, MOST_TALL);
  return { width, side, tall, height: EDGE.top + EDGE.bottom + tall * count + GAP * (count - 1) };
}
/** @typedef {ReturnType<typeof sizeOf>} Size */

/** @param {Plotted} data @param {Pair} pair @param {Size} size @returns {Panel} */
export function panelOf(data, [j, i], { side, tall }) {
  const left = EDGE.left + j * (side + GAP), top = EDGE.top + i * (tall + GAP), [x0, x1] = data.limits[j];
  const [y0, y1] = data.limits[i];
  return {
    left, top, right: left + side, bottom: top + tall,
    x: (v) => left + ((v - x0) / (x1 - x0)) * side, y: (v) => top + tall - ((v - y0) / (y1 - y0)) * tall,
    inX: (px) => x0 + ((px - left) / side) * (x1 - x0), inY: (py) => y0 + ((top + tall - py) / tall) * (y1 - y0),
  };
}

/**
 * The ranges of a region between two points of a panel.
 * @param {Plotted} data @param {Pair} pair @param {Panel} at @param {Pair} from @param {Pair} to @returns {Ranges}
 */
export function regionOf(data, [j, i], at, [x0, y0], [x1, y1]) {
  const between = (/** @type {number[]} */ values, /** @type {number} */ k) => {
    const [low, high] = data.limits[k], clipped = values.map((v) => Math.max(low, Math.min(high, v)));
    return /** @type {[number, number]} */ ([Math.min(...clipped), Math.max(...clipped)]);
  };
  return { [data.names[j]]: between([at.inX(x0), at.inX(x1)], j),
    ...(i === j ? {} : { [data.names[i]]: between([at.inY(y0), at.inY(y1)], i) }) };
}

/** Draws all of it. @param {HTMLCanvasElement} canvas @param {Plotted} data @param {Shown} shown */
export function draw(canvas, data, shown) {
  const size = sizeOf(data, canvas.clientWidth || 600), ratio = Math.min(3, devicePixelRatio || 1);
  const pen = canvas.getContext("2d");
  if (pen === null) return;
  canvas.width = Math.round(size.width * ratio);
  canvas.height = Math.round(size.height * ratio);
  pen.scale(ratio, ratio);
  const limits = Object.entries(shown.ranges);
  const within = (/** @type {number} */ k) =>
    limits.every(([name, [low, high]]) => {
      const v = data.draws[data.names.indexOf(name)][k];
      return v >= low && v <= high;
    });
  const chosen = data.draws[0].map((_, k) => limits.length > 0 && within(k));
  const tones = Object.fromEntries(["ink", "line", "muted", "misfit", "unvalidated", "assumed", "weak",
    "identified"].map((name) =>
    [name, colour(name)]));
  data.pairs.forEach((pair, number) =>
    drawPanel(pen, data, pair,
      panelOf(data, pair, size), { ...shown, chosen, some: limits.length > 0, current: number === shown.panel,
        tones }));
  pen.fillStyle = tones.ink;
  pen.font = `700 12px ${FONT}`;
  data.names.forEach((name, i) => {
    const bottom = panelOf(data, [i, data.names.length - 1], size), left = panelOf(data, [0, i], size);
    pen.textAlign = "center";
    pen.fillText(`${short(name)}, ${data.units[i] === "deg" ? "°" : data.units[i]}`, (bottom.left + bottom.right) / 2,
      size.height - 6);
    if (i === 0) return;
    pen.save();
    pen.translate(12, (left.top + left.bottom) / 2);
    pen.rotate(-Math.PI / 2);
    pen.fillText(short(name), 0, 0);
    pen.restore();
  });
}

/** @typedef {Shown & {chosen: boolean[], some: boolean, current: boolean, tones: Record<string, string>}} Drawn */

/**
 * @param {CanvasRenderingContext2D} pen @param {Plotted} data @param {Pair} pair @param {Panel} at
 * @param {Drawn} of
 */
function drawPanel(pen, data, [j, i], at, of) {
  const { chosen, some, tones } = of, statuses = [j, i].map((k) => of.rows[data.names[k]]?.status);
  pen.strokeStyle = of.current && of.focused ? tones.ink : tones.line;
  pen.lineWidth = 1;
  pen.strokeRect(at.left + 0.5, at.top + 0.5, at.right - at.left - 1, at.bottom - at.top - 1);
  pen.save();
  pen.beginPath();
  pen.rect(at.left, at.top, at.right - at.left, at.bottom - at.top);
  pen.clip();
  pen.fillStyle = statuses.includes("unvalidated") ? tones.unvalidated : statuses.includes("assumed") ? tones.assumed
    : statuses.includes("weak") ? tones.weak : tones.identified;
  if (i === j) {
    histogram(pen, data, at, j, null, some ? 0.3 : 0.6);
    pen.fillStyle = tones.misfit;
    if (some) histogram(pen, data, at, j, chosen, 0.8);
  } else {
    const x = data.draws[j], y = data.draws[i];
    pen.globalAlpha = some ? 0.18 : 0.3;
    for (let k = 0; k < x.length; k++) if (!chosen[k]) pen.fillRect(at.x(x[k]) - 1, at.y(y[k]) - 1, 2, 2);
    pen.globalAlpha = 0.8;
    pen.fillStyle = tones.misfit;
    if (some) {
      for (let k = 0; k < x.length; k++) if (chosen[k]) pen.fillRect(at.x(x[k]) - 1.2, at.y(y[k]) - 1.2, 2.4, 2.4);
    }
    pen.globalAlpha = 1;
  }
  pen.strokeStyle = tones.ink;
  region(pen, at, of.ranges[data.names[j]], i === j ? undefined : of.ranges[data.names[i]]);
  marks(pen, data, [j, i], at, of);
  pen.restore();
  pen.fillStyle = tones.muted;
  ticks(pen, data, [j, i], at);
}

/**
 * @param {CanvasRenderingContext2D} pen @param {Plotted} data @param {Panel} at @param {number} j
 * @param {boolean[] | null} only @param {number} strength
 */
function histogram(pen, data, at, j, only, strength) {
  const [low, high] = data.limits[j], heights = new Array(BINS).fill(0), all = new Array(BINS).fill(0);
  data.draws[j].forEach((v, k) => {
    const bin = Math.floor(((v - low) / (high - low)) * BINS);
    if (bin < 0 || bin >= BINS) return;
    all[bin]++;
    if (only === null || only[k]) heights[bin]++;
  });
  const most = Math.max(...all) * 1.08, wide = (at.right - at.left) / BINS;
  pen.globalAlpha = strength;
  heights.forEach((count, bin) => {
    const tall = (count / most) * (at.bottom - at.top);
    pen.fillRect(at.left + bin * wide, at.bottom - tall, wide + 0.4, tall);
  });
  pen.globalAlpha = 1;
}

/**
 * @param {CanvasRenderingContext2D} pen @param {Panel} at @param {[number, number]} [x]
 * @param {[number, number]} [y]
 */
function region(pen, at, x, y) {
  if (!x && !y) return;
  const left = x ? at.x(x[0]) : at.left, right = x ? at.x(x[1]) : at.right, top = y ? at.y(y[1]) : at.top;
  const bottom = y ? at.y(y[0]) : at.bottom;
  pen.setLineDash([4, 3]);
  pen.strokeRect(left, top, right - left, bottom - top);
  pen.setLineDash([]);
}

/**
 * @param {CanvasRenderingContext2D} pen @param {Plotted} data @param {Pair} pair @param {Panel} at
 * @param {Drawn} of
 */
function marks(pen, data, [j, i], at, { rows, shift }) {
  const here = (/** @type {number} */ k) => rows[data.names[k]]?.estimate ?? null;
  const moved = (/** @type {number} */ k) => shift[data.names[k]];
  const x = here(j), y = here(i), middle = (at.top + at.bottom) / 2;
  pen.lineWidth = 1.5;
  pen.beginPath();
  if (i === j) {
    if (x !== null) { pen.moveTo(at.x(x), at.top); pen.lineTo(at.x(x), at.bottom); }
    if (moved(j)) arrow(pen, at.x(moved(j)[0]), middle, at.x(moved(j)[1]), middle);
  } else if (x !== null && y !== null) {
    pen.moveTo(at.x(x) - 5, at.y(y)); pen.lineTo(at.x(x) + 5, at.y(y)); pen.moveTo(at.x(x),
      at.y(y) - 5); pen.lineTo(at.x(x), at.y(y) + 5);
    if (moved(j) && moved(i)) arrow(pen, at.x(moved(j)[0]), at.y(moved(i)[0]), at.x(moved(j)[1]), at.y(moved(i)[1]));
  }
  pen.stroke();
}

/** @param {CanvasRenderingContext2D} pen @param {number} x0 @param {number} y0 @param {number} x1 @param {number} y1 */
function arrow(pen, x0, y0, x1, y1) {
  const turn = Math.atan2(y1 - y0, x1 - x0), head = Math.min(8, Math.hypot(x1 - x0, y1 - y0));
  pen.moveTo(x0, y0);
  pen.lineTo(x1, y1);
  for (const aside of [2.6, -2.6]) {
    pen.moveTo(x1, y1);
    pen.lineTo(x1 + head * Math.cos(turn + aside), y1 + head * Math.sin(turn + aside));
  }
}

/** @param {CanvasRenderingContext2D} pen @param {Plotted} data @param {Pair} pair @param {Panel} at */
function ticks(pen, data, [j, i], at) {
  pen.font = `10px ${FONT}`;
  const text = (/** @type {number} */ k, /** @type {number} */ value) =>
    fixed(value, Math.max(0, Math.min(6, 1 - Math.floor(Math.log10(data.limits[k][1] - data.limits[k][0])))));
  const ofLimits = (/** @type {number} */ k, /** @type {number[]} */ shares) =>
    shares.map((share) => data.limits[k][0] + share * (data.limits[k][1] - data.limits[k][0]));
  if (i === data.names.length - 1) {
    for (const v of ofLimits(j, at.right - at.left < 80 ? [0.5] : [0.2, 0.8])) {
      pen.textAlign = "center";
      pen.fillText(text(j, v), at.x(v), at.bottom + 14);
    }
  }
  if (j === 0 && i !== 0) {
    for (const v of ofLimits(i, at.bottom - at.top < 60 ? [0.5] : [0.2, 0.8])) {
      pen.textAlign = "right";
      pen.fillText(text(i, v), at.left - 4, at.y(v) + 3);
    }
  }
}
