// Names in a picture: each where there is room for it, none over another. Drawn on a 2D canvas with a halo.

/** A name at (x, y), px; lower `rank` comes first. @typedef {{x: number, y: number, text: string, tone: string, rank: number, bold?: boolean}} Label */

const LINE = 17, GAP = 9;

/** @param {boolean} [bold] */
export const labelFont = (bold) => `${bold ? "700 " : ""}13px "IBM Plex Sans", system-ui, sans-serif`;

/**
 * Where the names go: right of their point, else left, below, above; one that finds no room is left out.
 * @param {Label[]} labels @param {(label: Label) => number} wide px @param {{wide: number, high: number}} room
 * @returns {(Label & {left: number, top: number})[]}
 */
export function placedLabels(labels, wide, room) {
  /** @type {number[][]} */
  const taken = [];
  const placed = [];
  const free = (/** @type {number[]} */ [l, t, r, b]) => l >= 2 && t >= 2 && r <= room.wide - 2 && b <= room.high - 2
    && taken.every(([l2, t2, r2, b2]) => r < l2 || l > r2 || b < t2 || t > b2);
  for (const label of [...labels].sort((a, b) => a.rank - b.rank)) {
    const w = wide(label), { x, y } = label;
    const tries = [[x + GAP, y - LINE], [x + GAP, y + 2], [x - GAP - w, y - LINE], [x - GAP - w, y + 2], [x - w / 2, y + GAP], [x - w / 2, y - GAP - LINE]];
    const spot = tries.find(([left, top]) => free([left, top, left + w, top + LINE]));
    if (!spot) continue;
    taken.push([spot[0], spot[1], spot[0] + w, spot[1] + LINE]);
    placed.push({ ...label, left: spot[0], top: spot[1] });
  }
  return placed;
}

/** @param {CanvasRenderingContext2D} pen @param {Label[]} labels @param {{wide: number, high: number}} room @param {string} halo */
export function drawLabels(pen, labels, room, halo) {
  const wide = (/** @type {Label} */ label) => {
    pen.font = labelFont(label.bold);
    return pen.measureText(label.text).width;
  };
  pen.setLineDash([]);
  pen.globalAlpha = 1;
  pen.lineJoin = "round";
  for (const label of placedLabels(labels, wide, room)) {
    pen.font = labelFont(label.bold);
    pen.lineWidth = 4;
    pen.strokeStyle = halo;
    pen.strokeText(label.text, label.left, label.top + 13);
    pen.fillStyle = label.tone;
    pen.fillText(label.text, label.left, label.top + 13);
  }
}
