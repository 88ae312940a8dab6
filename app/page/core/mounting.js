// How an instrument is mounted on the flange, in words: by the keys of its part of a header, flange frame.
import { fixed } from "./words.js";

/** What each key states, and its unit. @type {Record<string, [string, string]>} */
export const MOUNTED = { point_mm: ["Point", "mm"], tip_mm: ["Tip", "mm"], direction: ["Direction", ""] };

/** @param {string} key @param {number[]} values */
function vector(key, values) {
  const [title, unit] = MOUNTED[key];
  const shown = values.map((v) => fixed(Number(v.toFixed(4)), 4).replace(/\.?0+$/, "")).join(", ");
  return `${title.toLowerCase()} (${shown})${unit && `\u00a0${unit}`}`;
}

/** @param {Record<string, unknown>} part what a header, or a proposal, states */
export const mountedWords = (part) => Object.keys(MOUNTED)
  .flatMap((key) => (Array.isArray(part[key]) ? [vector(key, part[key])] : [])).join(", ");

/**
 * The same of each instrument of a plan that states any.
 * @param {import("./editing.js").PlanContent} content @returns {string[]}
 */
export const mountedIn = ({ tool, instruments }) => Object.values(instruments ?? { tool }).flatMap((part) => {
  const words = part ? mountedWords(part) : "";
  return part && words ? [`${part.kind}: ${words}`] : [];
});
