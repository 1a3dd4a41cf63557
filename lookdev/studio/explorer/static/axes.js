// @ts-check
// Axes of plots on a 2D canvas: scales, ticks and curves. Lengths are in CSS pixels.

export const DECADES = 4; // powers of ten that a logarithmic radius shows

/** Return the colours and the font of the page's style sheet. */
export const readTheme = () => {
  const style = getComputedStyle(document.body);
  const read = (name) => {
    // The browser resolves light-dark() only in the colour of an element, so an element gets it.
    probe.style.color = `var(${name})`;
    return getComputedStyle(probe).color;
  };
  const probe = document.createElement("i");
  document.body.append(probe);
  const colors = {
    ink: read("--ink"),
    quiet: read("--quiet"),
    line: read("--line"),
    edge: read("--edge"),
    panel: read("--panel"),
    font: style.fontFamily || "system-ui",
  };
  probe.remove();
  return colors;
};

/** Return about `count` round numbers from `low` to `high`, at equal distances. */
const niceTicks = (low, high, count) => {
  const step = (high - low) / count,
    power = 10 ** Math.floor(Math.log10(step)),
    fraction = step / power;
  const tickStep = (fraction < 1.5 ? 1 : fraction < 3 ? 2 : fraction < 7 ? 5 : 10) * power,
    ticks = [];
  for (let k = Math.ceil(low / tickStep - 1e-9); k * tickStep <= high + 1e-9 * tickStep; k++)
    ticks.push(k * tickStep);
  return ticks;
};

/** Return a number as short text, with an exponent if it is very large or very small. */
export const formatShort = (value) => {
  if (value === 0) return "0";
  const size = Math.abs(value);
  return size >= 1e5 || size < 1e-3
    ? value.toExponential(Number.isInteger(Math.log10(size)) ? 0 : 1).replace("e+", "e")
    : String(Number(value.toPrecision(4)));
};

const signedRoot = (value) => Math.sign(value) * Math.sqrt(Math.abs(value));

// Return a scale of a kind, "linear", "sqrt" or "log": about `count` ticks, `map`, the function
// from values to [0, 1], and `invert`, the inverse function.
export const makeScale = (kind, low, high, count) => {
  if (kind === "log") {
    const [a, b] = [Math.log10(low), Math.log10(high)],
      ticks = [],
      step = Math.max(1, Math.ceil((b - a) / count));
    for (let k = Math.ceil(a - 1e-9); k <= b + 1e-9; k += step) ticks.push(10 ** k);
    return {
      low,
      high,
      ticks: ticks.length > 1 ? ticks : niceTicks(low, high, count),
      map: (v) => (v > 0 ? (Math.log10(v) - a) / (b - a) : -1),
      invert: (t) => 10 ** (a + t * (b - a)),
    };
  }
  if (kind === "sqrt") {
    const [a, b] = [signedRoot(low), signedRoot(high)];
    return {
      low,
      high,
      ticks: niceTicks(a, b, count)
        .map((root) => Math.sign(root) * root * root)
        .map((tick) => Number(tick.toPrecision(3))),
      map: (v) => (signedRoot(v) - a) / (b - a),
      invert: (t) => {
        const r = a + t * (b - a);
        return Math.sign(r) * r * r;
      },
    };
  }
  return {
    low,
    high,
    ticks: niceTicks(low, high, count),
    map: (v) => (v - low) / (high - low),
    invert: (t) => low + t * (high - low),
  };
};

/** Axes in a box {left, top, width, height} of a canvas, with scales `x` and `y`. */
export class Axes {
  constructor(context, box, x, y, theme) {
    this.context = context;
    this.box = box;
    this.x = x;
    this.y = y;
    this.theme = theme;
  }

  /** Return the horizontal position of a value on the canvas. */
  toX(value) {
    return this.box.left + this.x.map(value) * this.box.width;
  }
  toY(value) {
    return this.box.top + (1 - this.y.map(value)) * this.box.height;
  }

  /** Draw lines at the ticks with their numbers, and the labels of both axes. */
  drawGrid(xLabel, yLabel) {
    const { context: c, box, theme } = this;
    c.font = `11px ${theme.font}`;
    c.lineWidth = 1;
    c.strokeStyle = theme.line;
    c.fillStyle = theme.quiet;
    c.textAlign = "center";
    c.textBaseline = "top";
    for (const tick of this.x.ticks) {
      const x = Math.round(this.toX(tick)) + 0.5;
      if (x < box.left - 1 || x > box.left + box.width + 1) continue;
      c.beginPath();
      c.moveTo(x, box.top);
      c.lineTo(x, box.top + box.height);
      c.stroke();
      c.fillText(formatShort(tick), x, box.top + box.height + 7);
    }
    c.textAlign = "right";
    c.textBaseline = "middle";
    let last = Infinity;
    for (const tick of this.y.ticks) {
      const y = Math.round(this.toY(tick)) + 0.5;
      if (y < box.top - 1 || y > box.top + box.height + 1 || last - y < 15) continue;
      c.beginPath();
      c.moveTo(box.left, y);
      c.lineTo(box.left + box.width, y);
      c.stroke();
      c.fillText(formatShort(tick), box.left - 8, y);
      last = y;
    }
    c.fillStyle = theme.ink;
    c.font = `12px ${theme.font}`;
    c.textAlign = "center";
    c.textBaseline = "alphabetic";
    c.fillText(xLabel, box.left + box.width / 2, box.top + box.height + 38);
    c.textAlign = "left";
    c.fillText(yLabel, box.left, box.top - 12);
  }

  // Draw a curve of `values` at `xs`; what is outside the box is clipped. `band` has the half
  // heights of a band around the curve.
  drawCurve(xs, values, color, { dash = [], width = 2, band = null } = {}) {
    const { context: c, box } = this;
    c.save();
    c.beginPath();
    c.rect(box.left, box.top - 2, box.width, box.height + 4);
    c.clip();
    const clampedY = (v) =>
      Math.min(Math.max(this.toY(v), box.top - 4000), box.top + box.height + 4000);
    if (band) {
      c.globalAlpha = 0.22;
      c.fillStyle = color;
      c.beginPath();
      for (let i = 0; i < xs.length; i++) c.lineTo(this.toX(xs[i]), clampedY(values[i] + band[i]));
      for (let i = xs.length; i--;) c.lineTo(this.toX(xs[i]), clampedY(values[i] - band[i]));
      c.fill();
      c.globalAlpha = 1;
    }
    c.strokeStyle = color;
    c.lineWidth = width;
    c.lineJoin = "round";
    c.setLineDash(dash);
    c.beginPath();
    for (let i = 0; i < xs.length; i++) c.lineTo(this.toX(xs[i]), clampedY(values[i]));
    c.stroke();
    c.restore();
  }
}
