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

export const LIST = "numbers separated by spaces or semicolons, such as 0.5 1 2 or 0,5; 1; 2";

/**
 * The numbers of a list; null where they could be read in two ways: 1,5 is one number for some and two for others.
 * @param {string} text @returns {number[] | null}
 */
export function numbersOf(text) {
  const plain = text.trim(), commas = plain.split(",").length - 1;
  const parts = /;/.test(plain) ? plain.split(/\s*;\s*/) : /\s/.test(plain) ? plain.split(/,?\s+/)
    : commas > 1 ? plain.split(",") : commas === 1 ? [] : [plain];
  const values = parts.filter(Boolean).map(parsed);
  return values.length === 0 || values.includes(null) ? null : /** @type {number[]} */ (values);
}

/** As a field shows it. @param {number} value @param {number} [digits] */
export const typed = (value, digits = 4) => String(Number(value.toFixed(digits)));
