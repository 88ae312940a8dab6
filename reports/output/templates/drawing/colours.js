// The colours of bodies, mixed from the palette of the page (its CSS variables), light or dark.

/** @typedef {import("./bodies.js").Tone} Tone */
/** @typedef {Record<Tone|"panel"|"ground", string> & {dark: boolean}} Colours */

const ROLES = /** @type {const} */ (["ink", "muted", "line", "panel", "ground", "identified", "weak", "unidentifiable", "held", "misfit"]);

/** @param {string} hex `#rrggbb`, or `#rgb` @returns {number[]} */
export const channels = (hex) => (hex.length < 7 ? [1, 2, 3].map((i) => 17 * parseInt(hex[i], 16)) : [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16)));

/** @param {string} from @param {string} to @param {number} share @returns {string} `#rrggbb` */
export function mixed(from, to, share) {
  const [a, b] = [channels(from), channels(to)];
  return `#${a.map((v, i) => Math.round(v + (b[i] - v) * share).toString(16).padStart(2, "0")).join("")}`;
}

/** The colours as the page has them now. @param {Element} element @returns {Colours} */
export function coloursOf(element) {
  const style = getComputedStyle(element);
  const role = Object.fromEntries(ROLES.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
  const dark = channels(role.ground)[0] < 128, grey = dark ? role.muted : role.held;
  return /** @type {Colours} */ ({
    ...role,
    link: dark ? mixed(role.muted, role.ink, 0.3) : mixed(role.muted, role.ground, 0.62),
    joint: dark ? mixed(grey, role.ground, 0.45) : mixed(role.ink, role.muted, 0.9),
    base: dark ? mixed(grey, role.ground, 0.35) : mixed(role.muted, role.ground, 0.32),
    flange: dark ? mixed(role.ink, role.muted, 0.2) : mixed(role.ink, role.muted, 0.7),
    tool: dark ? mixed(role.ink, role.muted, 0.4) : mixed(role.ink, role.muted, 0.5),
    instrument: dark ? mixed(grey, role.ground, 0.3) : mixed(role.muted, role.ground, 0.15),
    face: dark ? role.ink : role.ground,
    dark,
  });
}
