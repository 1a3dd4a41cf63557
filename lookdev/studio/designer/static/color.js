// @ts-check
// Linear Rec.709 as the colours of an input, sRGB by the piecewise curve of IEC 61966-2-1.

const encoded = (v) => (v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055);
const decoded = (c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4);

export const toHex = (color) =>
  `#${color
    .map((v) =>
      Math.round(255 * encoded(Math.min(1, Math.max(0, v))))
        .toString(16)
        .padStart(2, "0"),
    )
    .join("")}`;
export const fromHex = (text) =>
  text.match(/\w\w/g).map((each) => Number(decoded(parseInt(each, 16) / 255).toPrecision(5)));
