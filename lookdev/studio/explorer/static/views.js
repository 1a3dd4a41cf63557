// @ts-check
// The views, one for each kind of plot. A view is a function that draws `items`, which are surfaces
// with their numbers from the server, on a canvas. It returns the function from a point of the
// canvas to the text of the readout. f is the BSDF.
import { Axes, DECADES, formatShort, makeScale } from "./axes.js";
import { encodeSrgb, luminance } from "./viewport/color.js";
import { colorOf, nameOf, option, state } from "./state.js";

// The colours of the curves of channels, on a light and on a dark page.
const RGB = { r: ["#c8322d", "#ff7a70"], g: ["#2b8a3e", "#6fcf87"], b: ["#2454c5", "#86a8ff"] };
const DASHES = [[], [7, 4], [2, 3], [7, 3, 2, 3]];
const AXIS = { theta_h: "θh", theta_d: "θd", theta_i: "θi" };

const isDark = () => matchMedia("(prefers-color-scheme: dark)").matches;

// Return the curves of each item's colours, the array `name` (n, 3): one of the luminance, or one
// for each channel.
const curvesOf = (items, name = "f") =>
  items.flatMap(({ surface, data }, index) => {
    const f = data.arrays[name],
      count = f.length / 3;
    if (option("channels") === "rgb")
      return Object.entries(RGB).map(([channel, colors], c) => ({
        surface,
        data,
        color: colors[isDark() ? 1 : 0],
        dash: DASHES[index % 4],
        label: `${nameOf(surface)} ${channel}`,
        values: Float32Array.from({ length: count }, (_, i) => f[3 * i + c]),
      }));
    const values = Float32Array.from({ length: count }, (_, i) => luminance(f, 3 * i));
    return [{ surface, data, color: colorOf(surface), dash: [], label: nameOf(surface), values }];
  });

// Return the index of the number nearest to x among increasing numbers.
const nearestIndex = (xs, x) => {
  let [low, high] = [0, xs.length - 1];
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (xs[middle] > x) high = middle;
    else low = middle;
  }
  return x - xs[low] < xs[high] - x ? low : high;
};

// Return the box of the axes on a canvas, within margins for labels.
const plotBox = (width, height) => ({
  left: width < 500 ? 48 : 64,
  top: 40,
  width: width - (width < 500 ? 64 : 92),
  height: height - 96,
});

const valueLabel = () => (option("cosine") ? "f cos θi (1/sr)" : "f (1/sr)");

const SCALE_WORDS = { log: ["log", `${DECADES} decades`], sqrt: ["square root"] };

/** Return the function that formats the value of a curve at an angle in degrees. */
const curveReadout =
  (angle) =>
  ({ data, values, label }) =>
    `${label} ${formatShort(values[nearestIndex(data.arrays.x, angle)])}`;

/** Return theta_h and theta_d of a cell of a slice as text; `cell` is that of `sliceCell`. */
const formatAngles = (cell) => `θh ${cell[2].toFixed(1)}°  θd ${cell[3].toFixed(1)}°`;

/** Return a view of curves over an angle, which draws as `lookdev.plotting.curves` does. */
const makeCurvesView =
  ({ xLabel, yLabel, name = "f", range = null, drawExtra = null, title, hasUnitLine = false }) =>
  (c, items, width, height, theme) => {
    const box = plotBox(width, height),
      curves = curvesOf(items, name);
    let [high, low] = [0, Infinity];
    for (const { data, values } of curves)
      values.forEach((v, i) => {
        if (data.arrays.inner && !data.arrays.inner[i]) return;
        high = Math.max(high, v);
        if (v > 0) low = Math.min(low, v);
      });
    high ||= 1;
    const kind = state.catalogue.kinds[state.kind].uses.includes("scale")
      ? option("scale")
      : "linear";
    const [from, to] =
      range?.(items) ??
      (kind === "log"
        ? [Math.max(Math.min(low, high), high * 1e-8) * 0.7, high * 1.6]
        : [0, high * (kind === "sqrt" ? 1.1 : 1.06)]);
    const xs = items[0]?.data.arrays.x ?? [0, 90];
    const angles = state.catalogue.kinds[state.kind].uses.includes("angles")
      ? option("angles")
      : "linear";
    const axes = new Axes(
      c,
      box,
      makeScale(angles, xs[0], xs[xs.length - 1], Math.max(3, Math.min(9, width / 90))),
      makeScale(range?.(items) ? "linear" : kind, from, to, Math.max(3, Math.min(8, height / 60))),
      theme,
    );
    axes.drawGrid(xLabel(), yLabel(items));
    if (hasUnitLine) axes.drawCurve([xs[0], xs[xs.length - 1]], [1, 1], theme.edge, { width: 1 });
    for (const { data, values, color, dash } of curves) {
      const errors = data.arrays.error;
      const band =
        errors && option("channels") !== "rgb"
          ? Float32Array.from({ length: values.length }, (_, i) => luminance(errors, 3 * i))
          : null;
      axes.drawCurve(data.arrays.x, values, color, { dash, band });
    }
    drawExtra?.(axes, items, theme);
    c.fillStyle = theme.quiet;
    c.font = `12px ${theme.font}`;
    c.textAlign = "right";
    c.fillText(title(items), box.left + box.width, box.top - 12);
    return (x) => {
      if (x < box.left || x > box.left + box.width || !curves.length) return "";
      const angle = axes.x.invert((x - box.left) / box.width);
      const readouts = curves.map(curveReadout(angle)).join("   ");
      return `${formatShort(Number(angle.toPrecision(4)))}°   ${readouts}`;
    };
  };

/**
 * Return the radius and the centre (x0, y0) of a polar plot, and `at`, the function from an angle
 * in degrees and a fraction of the radius to a point of the canvas.
 */
const polarFrame = (width, height) => {
  const radius = Math.min(width / 2 - 46, height - 110),
    [x0, y0] = [width / 2, (height + radius) / 2 + 14];
  const at = (degrees, share, beyond = 0) => {
    const a = (degrees * Math.PI) / 180,
      r = share * radius + beyond;
    return [x0 + r * Math.sin(a), y0 - r * Math.cos(a)];
  };
  return { radius, x0, y0, at };
};

/**
 * Return `size`, the function from values to fractions of the radius, and `rings`, the values that
 * have a ring.
 */
const polarScale = (scale, peak) => {
  const floor = peak * 10 ** -DECADES;
  const share = {
    log: (v) => Math.log10(Math.max(v, floor) / floor) / DECADES,
    sqrt: (v) => Math.sqrt(Math.max(v, 0) / peak),
    linear: (v) => Math.max(v, 0) / peak,
  }[scale];
  const rings =
    scale === "log"
      ? Array.from({ length: DECADES + 1 }, (_, k) => floor * 10 ** k)
      : makeScale(scale, 0, peak, 4).ticks.filter((v) => v > 0 && v <= peak * 1.001);
  return { size: (v) => share(v) * 0.94, rings };
};

const strokeLine = (c, from, to) => {
  c.beginPath();
  c.moveTo(...from);
  c.lineTo(...to);
  c.stroke();
};

/** Draw rings with their values, and spokes with their angles. */
const drawPolarGrid = (c, { radius, x0, y0, at }, { size, rings }, theme) => {
  c.lineWidth = 1;
  c.font = `11px ${theme.font}`;
  c.textAlign = "center";
  for (const v of rings) {
    const r = size(v) * radius;
    if (r < 1) continue;
    c.strokeStyle = theme.line;
    c.beginPath();
    c.arc(x0, y0, r, Math.PI, 0);
    c.stroke();
    c.fillStyle = theme.quiet;
    c.fillText(formatShort(Number(v.toPrecision(2))), x0 + r, y0 + 16);
  }
  for (let degrees = -90; degrees <= 90; degrees += 30) {
    c.strokeStyle = theme.line;
    strokeLine(c, [x0, y0], at(degrees, 1));
    c.fillStyle = theme.quiet;
    if (Math.abs(degrees) < 90) {
      const [x, y] = [at(degrees, 1, 16)[0], at(degrees, 1, 14)[1]];
      c.fillText(`${degrees}°`, x, y + 4);
    }
  }
};

/** Draw the direction of the view, and its mirror direction. */
const drawPolarView = (c, { x0, y0, at }, theme) => {
  for (const { sign, text } of [
    { sign: -1, text: "view" },
    { sign: 1, text: "mirrored" },
  ]) {
    const [x, y] = at(sign * option("theta"), 1);
    c.strokeStyle = theme.quiet;
    c.setLineDash([5, 4]);
    strokeLine(c, [x0, y0], [x, y]);
    c.setLineDash([]);
    c.fillStyle = theme.ink;
    c.fillText(text, x + sign * 4, y - 6);
  }
};

const drawPolar = (c, items, width, height, theme) => {
  const curves = curvesOf(items),
    frame = polarFrame(width, height),
    peaks = curves.map(({ values }) => values.reduce((a, b) => Math.max(a, b), 0)),
    name = option("scale"),
    scale = polarScale(name, Math.max(...peaks, 0) || 1);
  drawPolarGrid(c, frame, scale, theme);
  drawPolarView(c, frame, theme);
  for (const { data, values, color, dash } of curves) {
    c.strokeStyle = color;
    c.lineWidth = 2;
    c.setLineDash(dash);
    c.beginPath();
    data.arrays.x.forEach((degrees, i) => c.lineTo(...frame.at(degrees, scale.size(values[i]))));
    c.stroke();
    c.setLineDash([]);
  }
  c.fillStyle = theme.ink;
  c.textAlign = "left";
  c.font = `12px ${theme.font}`;
  c.fillText([valueLabel(), ...(SCALE_WORDS[name] ?? [])].join(", "), 18, 28);
  return (x, y) => {
    const degrees = (Math.atan2(x - frame.x0, frame.y0 - y) * 180) / Math.PI;
    if (Math.abs(degrees) > 90) return "";
    return [`θi ${degrees.toFixed(1)}°`, ...curves.map(curveReadout(degrees))].join("   ");
  };
};

// The sRGB codes of linear values k / 16384, by k.
const SRGB_CODES = Uint8ClampedArray.from({ length: 16385 }, (_, i) =>
  Math.round(255 * encodeSrgb(i / 16384)),
);
const colorImages = new WeakMap();

// Return a canvas with a picture of linear colours, 3 numbers each, whose row 0 is at the bottom.
// It is cached for the array.
export const drawColors = (array, width, height, exposure, chroma) => {
  const key = `${exposure} ${chroma}`,
    cached = colorImages.get(array);
  if (cached?.key === key) return cached.canvas;
  const canvas = cached?.canvas ?? new OffscreenCanvas(width, height),
    context = canvas.getContext("2d");
  const pixels = context.createImageData(width, height),
    data = pixels.data,
    gain = 2 ** exposure;
  for (let y = 0; y < height; y++) {
    let from = 3 * width * (height - 1 - y),
      to = 4 * width * y;
    for (let x = 0; x < width; x++, from += 3, to += 4) {
      let [r, g, b] = [array[from], array[from + 1], array[from + 2]];
      if (chroma) {
        const largest = Math.max(r, g, b, 1e-30);
        r /= largest;
        g /= largest;
        b /= largest;
      }
      r *= gain;
      g *= gain;
      b *= gain;
      data[to] = SRGB_CODES[r >= 1 ? 16384 : (r * 16384) | 0];
      data[to + 1] = SRGB_CODES[g >= 1 ? 16384 : (g * 16384) | 0];
      data[to + 2] = SRGB_CODES[b >= 1 ? 16384 : (b * 16384) | 0];
      data[to + 3] = 255;
    }
  }
  context.putImageData(pixels, 0, 0);
  colorImages.set(array, { key, canvas });
  return canvas;
};

// Return the positions {x, y, size} of `count` equal squares in rows on a canvas, as large as
// possible. Each has margins for its title and its axes.
export const layOutSquares = (
  count,
  width,
  height,
  { left = 46, right = 16, top = 34, bottom = 44, gap = 20 } = {},
) => {
  let best = { size: 0 };
  for (let columns = 1; columns <= count; columns++) {
    const rows = Math.ceil(count / columns);
    const size = Math.min(
      (width - (columns * (left + right) + (columns - 1) * gap)) / columns,
      (height - rows * (top + bottom)) / rows,
    );
    if (size > best.size) best = { size, columns, rows };
  }
  const { size, columns, rows } = best,
    w = columns * (left + size + right) + (columns - 1) * gap,
    h = rows * (top + size + bottom);
  return Array.from({ length: count }, (_, i) => ({
    size,
    x: (width - w) / 2 + left + (i % columns) * (left + size + right + gap),
    y: (height - h) / 2 + top + Math.floor(i / columns) * (top + size + bottom),
  }));
};

// Texts on a slice: horizontal and vertical position in [0, 1], text, rotation in degrees,
// alignment.
/** @type {[number, number, string, number, CanvasTextAlign][]} */
const SLICE_LABELS = [
  [0.035, 0.5, "specular peak", -90, "center"],
  [0.5, 0.96, "Fresnel peak", 0, "center"],
  [0.5, 0.03, "retroreflection", 0, "center"],
  [0.97, 0.03, "grazing retroreflection", 0, "right"],
  [0.5, 0.5, "diffuse", 0, "center"],
];

// Draw the frame of a slice with its title and ticks.
const frameSlice = (c, { x, y, size }, theme, title, color) => {
  c.strokeStyle = theme.edge;
  c.lineWidth = 1;
  c.strokeRect(x - 0.5, y - 0.5, size + 1, size + 1);
  c.fillStyle = theme.quiet;
  c.font = `11px ${theme.font}`;
  for (const tick of [0, 30, 60, 90]) {
    c.textAlign = "center";
    c.fillText(tick, x + (tick / 90) * size, y + size + 16);
    c.textAlign = "right";
    c.fillText(tick, x - 7, y + size - (tick / 90) * size + 4);
  }
  c.textAlign = "center";
  c.fillText("θh (degrees)", x + size / 2, y + size + 34);
  c.save();
  c.translate(x - 30, y + size / 2);
  c.rotate(-Math.PI / 2);
  c.fillText("θd (degrees)", 0, 0);
  c.restore();
  c.font = `550 12px ${theme.font}`;
  c.textAlign = "left";
  c.fillStyle = color ?? theme.ink;
  c.fillText(title, x, y - 10, size);
};

// Draw the slice of a surface in a square; a labelled one has the texts of its regions.
const drawSlice = (c, square, data, theme, title, color, isLabelled) => {
  const [rows, columns] = data.shapes.f;
  c.imageSmoothingEnabled = square.size * devicePixelRatio < columns;
  c.drawImage(
    drawColors(data.arrays.f, columns, rows, option("exposure"), option("chroma")),
    square.x,
    square.y,
    square.size,
    square.size,
  );
  frameSlice(c, square, theme, title, color);
  if (!isLabelled || square.size < 230) return;
  c.font = `11px ${theme.font}`;
  for (const [u, v, text, turn, align] of SLICE_LABELS) {
    c.save();
    c.translate(square.x + u * square.size, square.y + (1 - v) * square.size);
    c.rotate((turn * Math.PI) / 180);
    c.textAlign = align;
    c.textBaseline = turn ? "top" : "middle";
    const width = c.measureText(text).width + 8,
      left = align === "right" ? -width : -width / 2;
    c.fillStyle = "rgb(0 0 0 / 0.45)";
    c.fillRect(left + (align === "right" ? 4 : 0), turn ? -2 : -8, width, 16);
    c.fillStyle = "#fff";
    c.fillText(text, 0, 0);
    c.restore();
  }
  c.textBaseline = "alphabetic";
};

// Return column, row, θh and θd of a point in the square of a slice, or null outside; a slice has
// `count` cells along a side.
const sliceCell = (square, x, y, count) => {
  const [u, v] = [(x - square.x) / square.size, 1 - (y - square.y) / square.size];
  return u < 0 || u >= 1 || v < 0 || v >= 1
    ? null
    : [Math.floor(u * count), Math.floor(v * count), u * 90, v * 90];
};

const drawSlices = (c, items, width, height, theme) => {
  const squares = layOutSquares(items.length, width, height);
  items.forEach(({ surface, data }, i) =>
    drawSlice(c, squares[i], data, theme, nameOf(surface), colorOf(surface), i === 0),
  );
  return (x, y) => {
    for (const [i, square] of squares.entries()) {
      const { data } = items[i],
        cell = sliceCell(square, x, y, data.shapes.f[1]);
      if (!cell) continue;
      const k = 3 * (cell[1] * data.shapes.f[1] + cell[0]);
      const channels = [0, 1, 2].map((n) => formatShort(data.arrays.f[k + n]));
      return `${formatAngles(cell)}   f ${channels.join(" / ")}`;
    }
    return "";
  };
};

// Return the colour of t in [0, 1]: blue at 0, white in the middle, red at 1.
const blueRed = (t) => {
  // The ends and the middle of ColorBrewer's RdBu, reversed; colours between them are interpolated.
  const [a, b] =
      t < 0.5
        ? [
            [5, 48, 97],
            [247, 247, 247],
          ]
        : [
            [247, 247, 247],
            [103, 0, 31],
          ],
    s = t < 0.5 ? 2 * t : 2 * t - 1;
  const eased = t < 0.5 ? s ** 0.8 : s ** 1.2;
  return a.map((x, i) => x + (b[i] - x) * eased);
};

/**
 * Return a canvas with a picture of values (rows x columns), whose first row is the lowest. `scale`
 * maps a value to a number, which is clipped to [0, 1], and `colormap` maps this number to a
 * colour.
 */
const makePicture = (values, columns, rows, scale, colormap) => {
  const picture = new OffscreenCanvas(columns, rows),
    context = picture.getContext("2d"),
    pixels = context.createImageData(columns, rows);
  for (let y = 0; y < rows; y++)
    for (let x = 0; x < columns; x++) {
      const color = colormap(Math.min(1, Math.max(0, scale(values[(rows - 1 - y) * columns + x]))));
      pixels.data.set([...color, 255], 4 * (y * columns + x));
    }
  context.putImageData(pixels, 0, 0);
  return picture;
};

const drawDifference = (c, items, width, height, theme) => {
  if (items.length < 2) return "A difference needs two surfaces: add another.";
  const [first, second] = items.map(({ data }) => data.arrays.f),
    [rows, columns] = items[0].data.shapes.f;

  const root = new Float32Array(rows * columns);
  let sum = 0;
  for (let i = 0; i < root.length; i++) {
    root[i] = Math.cbrt(luminance(second, 3 * i)) - Math.cbrt(luminance(first, 3 * i));
    sum += root[i] ** 2;
  }
  const limit = root.map(Math.abs).sort()[Math.floor(0.98 * (root.length - 1))] || 1;
  // Blue below 0, red above, up to the limit.
  const picture = makePicture(root, columns, rows, (value) => 0.5 + (0.5 * value) / limit, blueRed);
  const squares = layOutSquares(3, width, height);
  items
    .slice(0, 2)
    .forEach(({ surface, data }, i) =>
      drawSlice(c, squares[i], data, theme, nameOf(surface), colorOf(surface), false),
    );
  c.imageSmoothingEnabled = false;
  c.drawImage(picture, squares[2].x, squares[2].y, squares[2].size, squares[2].size);
  const rms = formatShort(Number(Math.sqrt(sum / root.length).toPrecision(3))),
    limitText = formatShort(Number(limit.toPrecision(2)));
  frameSlice(c, squares[2], theme, `∛f: second less first, rms ${rms}`, theme.ink);
  c.font = `11px ${theme.font}`;
  c.textAlign = "right";
  c.fillStyle = theme.quiet;
  c.fillText(
    `blue −${limitText}, red +${limitText}`,
    squares[2].x + squares[2].size,
    squares[2].y + squares[2].size + 34,
  );
  return (x, y) => {
    for (const [i, square] of squares.entries()) {
      const cell = sliceCell(square, x, y, columns);
      if (!cell) continue;
      const k = cell[1] * columns + cell[0];
      const value =
        i === 2
          ? `difference of ∛f ${formatShort(root[k])}`
          : `f ${formatShort(luminance([first, second][i], 3 * k))}`;
      return `${formatAngles(cell)}   ${value}`;
    }
    return "";
  };
};

// Five colours of matplotlib's colormap viridis, at equal distances.
const VIRIDIS = [
  [68, 1, 84],
  [59, 82, 139],
  [33, 145, 140],
  [94, 201, 98],
  [253, 231, 37],
];
// Return the colour of t in [0, 1].
const viridis = (t) => {
  const k = Math.min(3, Math.floor(t * 4)),
    s = t * 4 - k;
  return VIRIDIS[k].map((x, i) => x + (VIRIDIS[k + 1][i] - x) * s);
};

/**
 * Return a picture of an array in the colours of viridis, over the six powers of ten below `top`.
 */
const makeHeatMap = (array, top, width, height) =>
  makePicture(
    array,
    width,
    height,
    (value) => Math.log10(Math.max(value / top, 1e-6)) / 6 + 1,
    viridis,
  );

/**
 * Draw numbers over the sphere of directions, by azimuth and cosine. Returns the numbers with the
 * rectangle that they fill.
 */
const drawDirections = (c, { left, top, width, height }, numbers, peak, theme) => {
  const { array, rows, columns, title } = numbers;
  c.imageSmoothingEnabled = false;
  c.drawImage(makeHeatMap(array, peak, columns, rows), left, top, width, height);
  c.strokeStyle = theme.edge;
  c.strokeRect(left - 0.5, top - 0.5, width + 1, height + 1);
  c.fillStyle = theme.ink;
  c.textAlign = "left";
  c.fillText(title, left, top - 8);
  c.fillStyle = theme.quiet;
  c.font = `11px ${theme.font}`;
  c.textAlign = "right";
  for (const tick of [-1, 0, 1])
    c.fillText(tick, left - 6, top + height * (1 - (tick + 1) / 2) + 4);
  c.textAlign = "center";
  for (const tick of [0, 180, 360])
    c.fillText(tick, left + (width * tick) / 360, top + height + 16);
  c.fillText("φ (degrees), upwards cos θi", left + width / 2, top + height + 32);
  c.font = `12px ${theme.font}`;
  return { ...numbers, left, top, width, height };
};

/** Draw the histogram of the samples' weights, f cos / pdf. */
const drawWeights = (c, box, { counts, edges }, color, theme) => {
  const largestCount = counts.reduce((a, b) => Math.max(a, b), 1);
  const axes = new Axes(
    c,
    box,
    makeScale("log", edges[0], edges[edges.length - 1], 3),
    makeScale("log", 0.7, largestCount * 1.5, 5),
    theme,
  );
  axes.drawGrid("", "samples, by f cos / pdf");
  c.fillStyle = color;
  for (let i = 0; i < counts.length; i++) {
    if (!counts[i]) continue;
    const [x, y] = [axes.toX(edges[i]), axes.toY(counts[i])];
    c.fillRect(x, y, Math.max(1, axes.toX(edges[i + 1]) - x), axes.box.top + axes.box.height - y);
  }
};

const drawSampling = (c, items, width, height, theme) => {
  const rowHeight = height / items.length,
    column = (width - 40) / 3;
  const areas = [];
  items.forEach(({ surface, data }, row) => {
    const { pdf, value } = data.arrays,
      [rows, columns] = data.shapes.pdf,
      top = row * rowHeight,
      box = { top: top + 56, height: rowHeight - 108 };
    c.font = `550 12px ${theme.font}`;
    c.textAlign = "left";
    c.fillStyle = colorOf(surface);
    c.fillText(nameOf(surface), 60, top + 22);
    c.font = `12px ${theme.font}`;
    c.fillStyle = theme.quiet;
    c.fillText(data.note, 60 + c.measureText(nameOf(surface)).width + 24, top + 22);
    const peak = pdf.reduce((a, b) => Math.max(a, b), 1e-12);
    [
      { array: pdf, title: "pdf (1/sr), log" },
      { array: value, title: "f cos θi (1/sr), log" },
    ].forEach((numbers, k) => {
      const area = { ...box, left: 60 + k * column, width: column - 66 };
      areas.push(drawDirections(c, area, { ...numbers, rows, columns }, peak, theme));
    });
    const weights = { ...box, left: 60 + 2 * column + 10, width: column - 56 };
    drawWeights(c, weights, data.arrays, colorOf(surface), theme);
  });
  return (x, y) => {
    for (const picture of areas) {
      const [u, v] = [(x - picture.left) / picture.width, 1 - (y - picture.top) / picture.height];
      if (u < 0 || u >= 1 || v < 0 || v >= 1) continue;
      const { array, rows, columns, title } = picture,
        cell = Math.floor(v * rows) * columns + Math.floor(u * columns);
      const value = `${title.split(" (")[0]} ${formatShort(array[cell])}`;
      return `φ ${(u * 360).toFixed(0)}°  cos θi ${(2 * v - 1).toFixed(3)}   ${value}`;
    }
    return "";
  };
};

const drawSchlick = (axes, items, theme) => {
  const item = items.find(({ data }) => data.arrays.schlick);
  if (item)
    axes.drawCurve(item.data.arrays.x, item.data.arrays.schlick, theme.ink, {
      dash: [6, 4],
      width: 1.2,
    });
};
const fixedAngles = () => {
  const [axis, theta, phi] = [option("axis"), option("theta"), option("phi")];
  return axis === "theta_i"
    ? `view θo = ${theta}°`
    : `${axis === "theta_h" ? "θd" : "θh"} = ${theta}°, φd = ${phi}°`;
};
const hasSchlick = (items) => items.some(({ data }) => data.arrays.schlick);
const largestError = (items) => {
  const errors = items.map(({ data }) => data.arrays.error.reduce((a, b) => Math.max(a, b), 0));
  return errors.length
    ? `integration error at most ${formatShort(Number(Math.max(...errors).toPrecision(1)))}`
    : "";
};

export const VIEWS = {
  cartesian: makeCurvesView({
    xLabel: () => `${AXIS[option("axis")]} (degrees)`,
    yLabel: valueLabel,
    title: fixedAngles,
  }),
  retro: makeCurvesView({
    xLabel: () => "θh = θi = θo (degrees)",
    yLabel: valueLabel,
    title: () => "retroreflection",
  }),
  fresnel: makeCurvesView({
    xLabel: () => "θd (degrees)",
    yLabel: (items) => (hasSchlick(items) ? "offset and scaled f" : "reflectance"),
    range: (items) => (hasSchlick(items) ? state.catalogue.fresnelRange : null),
    drawExtra: drawSchlick,
    title: (items) =>
      hasSchlick(items)
        ? "mean over θh from 1° to 4°; dashed: Schlick's curve"
        : "Fresnel reflectance",
  }),
  albedo: makeCurvesView({
    xLabel: () => "θo (degrees)",
    yLabel: () => "directional albedo",
    title: largestError,
    hasUnitLine: true,
  }),
  polar: drawPolar,
  slice: drawSlices,
  difference: drawDifference,
  sampling: drawSampling,
};
