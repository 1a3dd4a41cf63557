// @ts-check
// Functions of the review page that show numbers: the values of a pixel, the ratios z of
// differences to noise, and the headers of frames; and that make elements and tables.
"use strict";

// Return an element. The attribute `on` has functions by the names of events; true sets an
// attribute without a value, and false, null and undefined leave it out.
review.makeElement = (tag, attributes = {}, ...children) => {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name === "on")
      for (const [event, handler] of Object.entries(value))
        element.addEventListener(event, handler);
    else if (value === true) element.setAttribute(name, "");
    else if (value !== false && value !== null && value !== undefined)
      element.setAttribute(name, value);
  }
  element.append(
    ...children.filter((child) => child !== null && child !== undefined && child !== false),
  );
  return element;
};

// Return a table of rows, with a row of column titles `head` unless that is null.
review.makeTable = (head, rows, attributes = {}) => {
  const { makeElement } = review;
  return makeElement(
    "table",
    attributes,
    head &&
      makeElement(
        "thead",
        {},
        makeElement("tr", {}, ...head.map((text) => makeElement("th", { scope: "col" }, text))),
      ),
    makeElement("tbody", {}, ...rows),
  );
};

// Return a number as text, with an exponent if it is very large or very small.
review.formatNumber = (value, digits = 4) => {
  if (value === 0) return "0";
  const size = Math.abs(value);
  return size >= 1e-3 && size < 1e5 ? value.toPrecision(digits) : value.toExponential(digits - 2);
};

// Return `rgb`, `alpha` and `error` of a pixel of a frame; the error is null if the frame has none.
review.pixelValues = (frame, x, y) => {
  const index = y * frame.width + x;
  const rgba = Array.from(
    { length: 4 },
    (_, channel) => review.HALF_TO_FLOAT[frame.rgba[4 * index + channel]],
  );
  return {
    rgb: rgba.slice(0, 3),
    alpha: rgba[3],
    error: frame.error ? review.HALF_TO_FLOAT[frame.error[index]] : null,
  };
};

// Return z of all pixels of two frames, as lookdev.metrics.noise_ratio defines it: their difference
// in units of its noise. `size` is the side of the squares. The result is null if a frame has no
// error, or if the frames differ in size.
review.noiseRatios = (a, b, size) => {
  if (!a.error || !b.error || a.width !== b.width || a.height !== b.height) return null;
  const { HALF_TO_FLOAT } = review,
    { width, height } = a,
    count = width * height,
    radius = (size - 1) / 2;
  const planes = Array.from({ length: 4 }, () => new Float64Array(count));
  for (let i = 0, j = 0; i < count; i++, j += 4) {
    let square = 0;
    for (let k = 0; k < 3; k++) {
      const p = HALF_TO_FLOAT[a.rgba[j + k]],
        q = HALF_TO_FLOAT[b.rgba[j + k]];
      planes[k][i] = p - q;
      square += p * p + q * q;
    }
    planes[3][i] =
      HALF_TO_FLOAT[a.error[i]] ** 2 + HALF_TO_FLOAT[b.error[i]] ** 2 + square * 2 ** -22;
  }
  const sums = new Float64Array(Math.max(width, height) + 1);
  // Replace each value of a row or a column by the sum of the values at most `radius` away from it.
  const sumWindows = (plane, start, stride, length) => {
    for (let i = 0; i < length; i++) sums[i + 1] = sums[i] + plane[start + i * stride];
    for (let i = 0; i < length; i++) {
      plane[start + i * stride] =
        sums[Math.min(i + radius + 1, length)] - sums[Math.max(i - radius, 0)];
    }
  };
  if (radius) {
    for (const plane of planes) {
      for (let y = 0; y < height; y++) sumWindows(plane, y * width, 1, width);
      for (let x = 0; x < width; x++) sumWindows(plane, x, width, height);
    }
  }
  const [red, green, blue, noise] = planes;
  return noise.map((value, i) =>
    value > 0 ? Math.sqrt((red[i] ** 2 + green[i] ** 2 + blue[i] ** 2) / value) : 0,
  );
};

// Return the fraction of the pixels of the asset, in either frame, whose ratio exceeds a limit.
review.shareBeyond = (a, b, ratios, limit) => {
  const { HALF_TO_FLOAT } = review;
  let covered = 0,
    beyond = 0;
  ratios.forEach((ratio, i) => {
    if (!(HALF_TO_FLOAT[a.rgba[4 * i + 3]] > 0 || HALF_TO_FLOAT[b.rgba[4 * i + 3]] > 0)) return;
    covered++;
    if (ratio > limit) beyond++;
  });
  return covered ? beyond / covered : 0;
};

// Show the values of a pixel of the frames `a` and `b` (or null) in an element. `display` are its
// code values on screen, and `ratios` the result of review.noiseRatios, or null.
review.showValues = (target, x, y, a, b, display, ratios) => {
  const { makeElement, formatNumber, makeTable } = review;
  const row = (side, pixel) =>
    makeElement(
      "tr",
      {},
      makeElement(
        "th",
        { scope: "row" },
        makeElement("b", { class: `side ${side}` }, side.toUpperCase()),
      ),
      ...pixel.rgb.map((value) => makeElement("td", {}, formatNumber(value))),
      makeElement("td", {}, formatNumber(pixel.alpha, 3)),
      makeElement("td", {}, pixel.error === null ? "?" : formatNumber(pixel.error, 2)),
    );
  const first = review.pixelValues(a, x, y);
  const rows = [row("a", first)];
  const lines = [`column ${x}, row ${y}; on screen ${display.join(", ")}`];
  if (b && b.width === a.width && b.height === a.height) {
    const second = review.pixelValues(b, x, y);
    rows.push(
      row("b", second),
      makeElement(
        "tr",
        {},
        makeElement("th", { scope: "row" }, "A − B"),
        ...first.rgb.map((value, channel) =>
          makeElement("td", {}, formatNumber(value - second.rgb[channel], 3)),
        ),
        makeElement("td", {}, formatNumber(first.alpha - second.alpha, 3)),
        makeElement("td", {}, ratios ? `z ${ratios[y * a.width + x].toFixed(2)}` : ""),
      ),
    );
  }
  target.replaceChildren(
    makeTable(["", "R", "G", "B", "alpha", "error"], rows, { class: "numbers" }),
    ...lines.map((line) => makeElement("p", { class: "quiet" }, line)),
  );
};

const HEADER_LABELS = {
  relmse: "error (relMSE)",
  seconds: "render time, s",
  samples: "samples a pixel",
  "pose.element": "asset turned, °",
  "pose.lighting": "light turned, °",
  exposure: "exposure, stops",
  time: "finished (UTC)",
  ibl: "rig",
};
const HIDDEN_HEADERS = new Set(["look", "ibl", "turntable"]);

// Show the headers of the frames `a` and `b` (or null) in an element, and the command that renders
// `a` again. Digests come last, and versions before them.
review.showProvenance = (target, a, b) => {
  const { makeElement, makeTable } = review;
  const columns = [a, b].filter(Boolean).map((frame) => ({ ...frame.header, file: frame.file }));
  const names = [...new Set(columns.flatMap((column) => Object.keys(column)))].filter(
    (name) => !HIDDEN_HEADERS.has(name),
  );
  const rank = (name) => (name.startsWith("digest") ? 2 : name.startsWith("version") ? 1 : 0);
  names.sort((p, q) => rank(p) - rank(q));
  const formatHeader = (name, value) => {
    if (value === undefined) return "–";
    if (name === "relmse" || name === "raw.relmse" || name === "seconds")
      return review.formatNumber(Number(value), 3);
    if (name === "time") return value.replace("T", " ").replace("+00:00", "");
    return name.startsWith("digest") ? value.slice(0, 12) : value;
  };
  const rows = names.map((name) => {
    const values = columns.map((column) => column[name]);
    const differs = values.length > 1 && values[0] !== values[1];
    return makeElement(
      "tr",
      { class: differs ? "differs" : null },
      makeElement(
        "th",
        { scope: "row" },
        HEADER_LABELS[name] || name.replace("version.", "").replace("digest.", "digest of "),
      ),
      ...values.map((value) => makeElement("td", { title: value }, formatHeader(name, value))),
    );
  });
  target.replaceChildren(
    makeTable(columns.length > 1 ? ["", "A", "B"] : null, rows, { class: "provenance" }),
    ...(a.command
      ? [
          makeElement("p", { class: "quiet" }, "To render A again:"),
          makeElement("code", {}, a.command),
        ]
      : []),
  );
};
