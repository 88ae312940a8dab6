// A chart by uPlot in the page's tones and type: made anew where these or its room change.
import { html } from "htm/preact";
import { useEffect, useRef } from "preact/hooks";

/** @typedef {import("uplot")} UPlot */
/** @typedef {(name: string) => string} Tone the colour of this name, as it is now */

/** A power of ten as a tick of a logarithmic axis; "" for the ticks between. @param {number | null} v */
export const power = (v) => (v === null || !/^1/.test(v.toExponential()) ? "" : `${Number(v.toPrecision(1))}`);

const FONT = '12px "IBM Plex Sans", system-ui, sans-serif';

/**
 * @param {{data: import("uplot").AlignedData, shape: string, says: string, class?: string,
 *   options: (tone: Tone, axis: import("uplot").Axis, chart: typeof import("uplot")) =>
 *     Omit<import("uplot").Options, "width" | "height">,
 *   tall: (room: HTMLElement) => number}} props `shape`: what the options depend on; `says`: for what reads the page;
 *   `axis`: as all axes are
 */
export function Plot({ data, shape, says, class: name, options, tall }) {
  const box = useRef(/** @type {HTMLDivElement | null} */ (null)), plot = useRef(/** @type {UPlot | null} */ (null));
  const latest = useRef({ data, options });
  latest.current = { data, options };
  const size = (/** @type {HTMLElement} */ room) => ({ width: Math.max(room.clientWidth, 120), height: tall(room) });
  useEffect(() => {
    let gone = false;
    const sizes = new ResizeObserver(() => { if (box.current) plot.current?.setSize(size(box.current)); });
    const make = async () => {
      const { default: Chart } = await import("uplot"), room = box.current;
      if (gone || room === null) return;
      const style = getComputedStyle(room);
      const tone = (/** @type {string} */ of) => style.getPropertyValue(`--${of}`).trim();
      const line = { stroke: tone("line"), width: 1 }, now = latest.current;
      const axis = { stroke: tone("muted"), grid: line, ticks: line, font: FONT, labelFont: FONT };
      plot.current?.destroy();
      plot.current = new Chart({ ...size(room), ...now.options(tone, axis, Chart) }, now.data, room);
      sizes.observe(room);
    };
    const dark = matchMedia("(prefers-color-scheme: dark)");
    make();
    dark.addEventListener("change", make);
    return () => {
      gone = true;
      dark.removeEventListener("change", make);
      sizes.disconnect();
      plot.current?.destroy();
      plot.current = null;
    };
  }, [shape]);
  useEffect(() => { plot.current?.setData(data); }, [JSON.stringify(data)]);
  return html`<div class=${name} ref=${box} role="img" aria-label=${says}></div>`;
}
