// @ts-check
// Conversions of colours in linear Rec.709: to luminance, and to and from sRGB, by the piecewise
// curve of IEC 61966-2-1, and its text "#rrggbb".

const WEIGHTS = [0.2126, 0.7152, 0.0722]; // of red, green and blue in the luminance

/** Return the luminance of a colour, which is three numbers from an index of an array on. */
export const luminance = (array, index) =>
  WEIGHTS[0] * array[index] + WEIGHTS[1] * array[index + 1] + WEIGHTS[2] * array[index + 2];

export const encodeSrgb = (v) => (v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055);
export const decodeSrgb = (c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4);

/** Return a linear colour [r, g, b] as "#rrggbb", clipped to [0, 1]. */
export const toHex = (color) => {
  const codes = color.map((v) => Math.round(255 * encodeSrgb(Math.min(1, Math.max(0, v)))));
  return `#${codes.map((code) => code.toString(16).padStart(2, "0")).join("")}`;
};

/** Return the three sRGB codes of "#rrggbb", in [0, 1]. */
export const hexCodes = (text) => text.match(/\w\w/g).map((digits) => parseInt(digits, 16) / 255);

/** Return the linear colour [r, g, b] of "#rrggbb". */
export const fromHex = (text) =>
  hexCodes(text).map((code) => Number(decodeSrgb(code).toPrecision(5)));
