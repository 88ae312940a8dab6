// Names and numbers as people read them, rounded as in the reports.

/** @type {Record<string, string>} */
const GREEK = { alpha: "α", beta: "β", theta: "θ", cos: "cos q", sin: "sin q" };

/** delta2 is J2 (δ2), link2.alpha is link 2, α. @param {string} text */
export const named = (text) => text.replace(/\b[Dd]elta(\d+)\b/g, "J$1 (δ$1)")
  .replace(/\b(link|joint)(\d+)\.(alpha|beta|theta|gravity|cos|sin|[abd])\b/g,
    (_, body, number, axis) => `${body === "link" ? "link " : "J"}${number}, ${GREEK[axis] ?? axis}`);

/** @param {string} text */
export const capital = (text) => text.charAt(0).toUpperCase() + text.slice(1);

/** @param {string} text */
export function sentence(text) {
  const words = capital(named(text));
  return words + (/[.?!]$/.test(words) ? "" : ".");
}

/** The words of verdicts and the shapes of statuses, as in the reports. @type {Record<string, string>} */
export const WORDS = { pass: "Pass", weak: "Weakly observable", degenerate: "Degenerate", misfit: "Misfit",
  violated: "Constraints violated" };
/** @type {Record<string, string>} */
export const SHAPES = { identified: "●", weak: "◆", assumed: "○", unidentifiable: "✕", held: "■", unvalidated: "▲" };
/** @param {string} status */
export const marked = (status) => `${SHAPES[status] ?? ""} ${status === "weak" ? "weakly observable" : status}`;

const tidy = (/** @type {string} */ text) => text.replace("-", "−");
const digitsOf = (/** @type {number} */ std) =>
  Math.max(0, Math.min(12, 1 - Math.floor(Math.log10(Math.abs(std) || 1))));

/** @param {string} text @param {string | null | undefined} unit */
export function withUnit(text, unit) {
  const shown = unit === "deg" ? "°" : unit === "1" || !unit ? "" : `\u00a0${unit}`;
  return tidy(text) + shown;
}

/** @param {number} value @param {number} digits */
export const fixed = (value, digits) =>
  tidy((Object.is(value, -0) ? 0 : value).toFixed(digits).replace(/^-(0(\.0+)?)$/, "$1"));

/** A standard uncertainty to two significant digits. @param {number} value @param {string | null | undefined} unit */
export const spread = (value, unit) => withUnit(value.toFixed(digitsOf(value)), unit);

/**
 * A value to the second digit of its uncertainty.
 * @param {number} value @param {number} std @param {string | null | undefined} unit
 */
export const rounded = (value, std, unit) => withUnit(fixed(value, digitsOf(std)), unit);

/** @param {number} count @param {string} what */
export const counted = (count, what) => `${count} ${what}${count === 1 ? "" : "s"}`;

/** @param {number} n bytes */
export const bytes = (n) => (n < 1e3 ? `${n} bytes` : n < 1e6 ? `${fixed(n / 1e3, 0)} kB` : `${fixed(n / 1e6, 1)} MB`);

/** @param {number} s */
export const duration = (s) => (s < 90 ? `${Math.max(1, Math.round(s))} s` : `${Math.round(s / 60)} min`);

/** Expanded uncertainties, of which factor. @param {number} k */
export const expandedWord = (k) => `U (k = ${Number(k.toPrecision(3))})`;

/** A joint's name beside a number. @param {string} unit */
export const unitSign = (unit) => (unit === "deg" ? "°" : unit);

/** @typedef {{estimate: number | null, std: number | null, unit: string, status: string, held?: boolean}} Estimated */

/** To the second digit of its expanded uncertainty. @param {Estimated} row @param {number} k */
export function estimateOf(row, k) {
  if (row.estimate === null) return "not determined";
  if (row.held) return `held at ${withUnit(String(row.estimate), row.unit)}`;
  return row.std === null ? withUnit(String(row.estimate), row.unit) : rounded(row.estimate, k * row.std, row.unit);
}

/** @param {Estimated} row @param {number} k */
export const expandedOf = (row, k) =>
  (row.std === null || row.status === "unvalidated" ? "—" : spread(k * row.std, row.unit));
