// The posterior of the offsets, pair by pair: a region of a panel chooses draws, an arrow shows a shift.
import { html } from "htm/preact";
import { useEffect, useMemo, useRef } from "preact/hooks";
import { useSignal } from "@preact/signals";
import { named } from "../core/words.js";
import { Fold } from "../parts/Fold.js";
import { NumberField } from "../parts/Controls.js";
import { draw, panelOf, plotted, regionOf, sizeOf } from "./pair_plot.js";
import { brushed, brushFault, chooseDraws, posterior, posteriorSays, ranges, shift } from "./state.js";

/** @typedef {import("./state.js").Ranges} Ranges */
/** @typedef {import("./pair_plot.js").Pair} Pair */

const STEP = 0.04; // of a panel: by how much an arrow key moves or changes a region
const LEAST_PX = 4; // that a drag is
/** Of an arrow key: the axis of the panel, and the way. @type {Record<string, [number, number]>} */
const WAYS = { ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowDown: [1, -1], ArrowUp: [1, 1] };

/** @param {{found: import("./state.js").Found}} props */
export function Pairs({ found }) {
  const drawn = posterior.value, data = useMemo(() => (drawn ? plotted(drawn) : null), [drawn]);
  const canvas = useRef(/** @type {HTMLCanvasElement | null} */ (null)), panel = useSignal(1);
  const focused = useSignal(false), width = useSignal(0);
  const drag = useRef(/** @type {{pair: Pair, at: import("./pair_plot.js").Panel, from: Pair} | null} */ (null));
  const dark = useSignal(0);
  const moved = shift.value?.parameters.flatMap((row) =>
    (row.estimate !== null && row.before.estimate !== null ? [[row.name, [row.before.estimate, row.estimate]]] : []))
    ?? [];
  const shown = { ranges: ranges.value, panel: Math.min(panel.value, (data?.pairs.length ?? 1) - 1),
    focused: focused.value, rows: Object.fromEntries(found.parameters.map((row) => [row.name, row])),
    shift: Object.fromEntries(moved) };
  useEffect(() => {
    const element = canvas.current;
    if (element === null) return undefined;
    const size = new ResizeObserver(() => { width.value = element.clientWidth; });
    const scheme = matchMedia("(prefers-color-scheme: dark)"), again = () => { dark.value++; };
    size.observe(element);
    scheme.addEventListener("change", again);
    document.fonts.ready.then(again);
    return () => { size.disconnect(); scheme.removeEventListener("change", again); };
  }, [data]);
  useEffect(() => { if (canvas.current !== null && data !== null) draw(canvas.current, data, shown); },
    [data, width.value, dark.value, panel.value, focused.value, ranges.value, shift.value]);
  if (data === null) return html`<p role="status">${posteriorSays.value}</p>`;

  const at = (/** @type {PointerEvent} */ event) => {
    const edge = /** @type {Element} */ (event.currentTarget).getBoundingClientRect();
    return /** @type {Pair} */ ([event.clientX - edge.left, event.clientY - edge.top]);
  };
  const size = () => sizeOf(data, canvas.current?.clientWidth || 600);
  const down = (/** @type {import("preact").TargetedPointerEvent<HTMLCanvasElement>} */ event) => {
    const [x, y] = at(event);
    const which = data.pairs.findIndex((pair) => {
      const own = panelOf(data, pair, size());
      return x >= own.left && x <= own.right && y >= own.top && y <= own.bottom;
    });
    if (which < 0) return;
    panel.value = which;
    drag.current = { pair: data.pairs[which], at: panelOf(data, data.pairs[which], size()), from: [x, y] };
    event.currentTarget.setPointerCapture(event.pointerId);
  };
  const move = (/** @type {PointerEvent} */ event) => {
    const now = drag.current;
    if (now === null) return;
    const to = at(event);
    if (Math.hypot(to[0] - now.from[0], to[1] - now.from[1]) >= LEAST_PX) {
      chooseDraws(regionOf(data, now.pair, now.at, now.from, to));
    }
  };
  const end = () => { drag.current = null; };
  const key = (/** @type {KeyboardEvent} */ event) => {
    if (event.key === "Escape") { event.preventDefault(); chooseDraws({}); return; }
    if (/^[np]$/i.test(event.key) && !event.ctrlKey && !event.metaKey) {
      panel.value = (shown.panel + (event.key.toLowerCase() === "n" ? 1 : data.pairs.length - 1)) % data.pairs.length;
      chooseDraws({});
      return;
    }
    const way = WAYS[event.key];
    if (!way) return;
    event.preventDefault();
    const [j, i] = data.pairs[shown.panel], axes = i === j ? [j] : [j, i];
    const span = (/** @type {number} */ axis) => data.limits[axis][1] - data.limits[axis][0];
    const middle = (/** @type {number} */ axis) => [0.4, 0.6].map((share) => data.limits[axis][0] + share * span(axis));
    const own = axes.map((axis) => [...(ranges.value[data.names[axis]] ?? middle(axis))]);
    if (Object.keys(ranges.value).length) {
      const k = Math.min(way[0], axes.length - 1), step = way[1] * STEP * span(axes[k]);
      if (event.shiftKey) own[k][1] = Math.max(own[k][0], own[k][1] + step);
      else own[k] = own[k].map((v) => v + step);
    }
    chooseDraws(Object.fromEntries(axes.map((axis, n) =>
      [data.names[axis], /** @type {[number, number]} */ (own[n])])));
  };
  /** @param {string} name @param {number} i @param {number} side @param {number | null} value */
  const bound = (name, i, side, value) => {
    const own = [...(ranges.value[name] ?? data.limits[i])];
    own[side] = value ?? data.limits[i][side];
    chooseDraws({ ...ranges.value, [name]: [Math.min(...own), Math.max(...own)] });
  };
  const chosen = brushed.value;
  const residuals = chosen?.reason ? `No residuals: ${named(chosen.reason)}.`
    : "Normalised residuals, beside the measurements: mean length over all draws and over the chosen ones.";
  const names = data.names.map(named).join(", ");
  const says = `Posterior draws of ${names}: each alone on the diagonal, each pair below it. `
    + "The fields beneath choose the same regions.";
  return html`
    <p role="status">${posteriorSays.value}</p>
    <figure class="pairs">
      <canvas ref=${canvas} tabindex="0" role="img" style=${{ height: `${sizeOf(data, width.value || 600).height}px` }}
        aria-describedby="pairs-keys"
        aria-label=${says}
        onPointerDown=${down} onPointerMove=${move} onPointerUp=${end} onPointerCancel=${end} onKeyDown=${key}
          onFocus=${() => { focused.value = true; }} onBlur=${() => { focused.value = false; }}></canvas>
      <figcaption id="pairs-keys">Drag over a panel to choose draws. By the keyboard: N and P choose a panel, arrow keys
        move the region, with Shift they change its size, Escape takes it away. The cross is the estimate, the arrow
        what leaving out the chosen measurements does to it.</figcaption>
    </figure>
    <div class="bar">
      <button type="button" disabled=${!Object.keys(ranges.value).length}
        onClick=${() => chooseDraws({})}>Choose no draws</button>
      <output class="chosen">
        ${brushFault.value
          || (chosen && `${chosen.chosen} of ${chosen.draws} draws are chosen. ${residuals}`)}</output></div>
    <${Fold} title="Choose draws by numbers">
      <div class="fields ranges">${data.names.flatMap((name, i) => ["from", "to"].map((side, k) => html`
      <${NumberField} key=${`${name} ${side}`} label=${`${named(name)} ${side}`}
        unit=${data.units[i] === "deg" ? "°" : data.units[i]} digits=${6} optional
        value=${ranges.value[name]?.[k] ?? null}
        onValue=${(/** @type {number | null} */ value) => bound(name, i, k, value)} />`))}</div><//>`;
}
