// @ts-check
// Conversion between linear Rec.709, the space of looks, and "#rrggbb", the value of an HTML input
// of colours, which is sRGB by the piecewise curve of IEC 61966-2-1.

const encodeSrgb = (v) => (v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055);
const decodeSrgb = (c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4);

/** Return a linear colour [r, g, b] as "#rrggbb", clipped to [0, 1]. */
export function toHex(color) {
  const codes = color.map((v) => Math.round(255 * encodeSrgb(Math.min(1, Math.max(0, v)))));
  return `#${codes.map((code) => code.toString(16).padStart(2, "0")).join("")}`;
}

/** Return the linear colour [r, g, b] of "#rrggbb". */
export function fromHex(text) {
  const codes = text.match(/\w\w/g).map((digits) => parseInt(digits, 16) / 255);
  return codes.map((code) => Number(decodeSrgb(code).toPrecision(5)));
}
