// Values in human-readable form.

/** The stroke of the spool: ±16384 is ±100 %. */
export const FULL = 16384;

export const percent = (raw) => `${minus(((raw * 100) / FULL).toFixed(1))} %`;

export const seconds = (t_us) => (t_us / 1e6).toFixed(3);

export const hex = (number, digits) => number.toString(16).toUpperCase().padStart(digits, "0");

/** Returns a number's text with a true minus sign. */
export const minus = (text) => text.replace("-", "−");

/** Parses an identifier in hex, with or without 0x; eight digits mean 29 bits, as in candump. */
export function identifier(text) {
  const digits = text.replace(/^0x/i, "");
  return { id: parseInt(digits, 16), extended: digits.length === 8 };
}
