// Numbers as people type them: a decimal point or comma. What could be read in two ways is refused.

export const ALLOWED = "a number such as 0.5 or 0,5, without separators of thousands";

/**
 * The number that a text states; null where it states none, or could be misread: 1,234 is 1.234 for some and 1234 for
 *   others.
 * @param {string} text
 */
export function parsed(text) {
  const plain = text.trim().replace(/^\u2212/, "-");
  if (!/^[-+]?(\d+([.,]\d*)?|[.,]\d+)(e[-+]?\d+)?$/i.test(plain)) return null;
  if (/^[-+]?[1-9]\d{0,2},\d{3}(e|$)/i.test(plain)) return null;
  const value = Number(plain.replace(",", "."));
  return Number.isFinite(value) ? value : null;
}

/**
 * The numbers of a list: separated by spaces or semicolons, or by commas where these are followed by a space or the
 *   numbers have points or none.
 * @param {string} text
 */
export function parsedList(text) {
  const parts = /[;\s]/.test(text.trim()) ? text.trim().split(/(?:\s*;\s*|,\s+|\s+)/) : text.trim().split(",");
  const values = parts.filter((part) => part !== "").map(parsed);
  return values.some((value) => value === null) ? null : /** @type {number[]} */ (values);
}

/** As a field shows it. @param {number} value @param {number} [digits] */
export const typed = (value, digits = 4) => String(Number(value.toFixed(digits)));
