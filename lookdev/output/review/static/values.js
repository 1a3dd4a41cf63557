// @ts-check
// Numbers of pixels and of frames, as text and tables.
"use strict";

review.make = (tag, attributes = {}, ...children) => {
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

review.table = (head, rows, attributes = {}) => {
  const { make } = review;
  return make(
    "table",
    attributes,
    head &&
      make("thead", {}, make("tr", {}, ...head.map((text) => make("th", { scope: "col" }, text)))),
    make("tbody", {}, ...rows),
  );
};

review.number = (value, digits = 4) => {
  if (value === 0) return "0";
  const size = Math.abs(value);
  return size >= 1e-3 && size < 1e5 ? value.toPrecision(digits) : value.toExponential(digits - 2);
};

// Return the colour, alpha and error of a frame's pixel.
review.pixel = (frame, x, y) => {
  const at = y * frame.width + x;
  const rgba = Array.from({ length: 4 }, (_, channel) => review.HALF[frame.rgba[4 * at + channel]]);
  return {
    rgb: rgba.slice(0, 3),
    alpha: rgba[3],
    error: frame.error ? review.HALF[frame.error[at]] : null,
  };
};

// As lookdev.metrics.noise_ratio, of all pixels; null where an error is not known or sizes differ.
review.noiseRatios = (a, b, size) => {
  if (!a.error || !b.error || a.width !== b.width || a.height !== b.height) return null;
  const { HALF } = review,
    { width, height } = a,
    count = width * height,
    reach = (size - 1) / 2;
  const planes = Array.from({ length: 4 }, () => new Float64Array(count));
  for (let i = 0, j = 0; i < count; i++, j += 4) {
    let square = 0;
    for (let k = 0; k < 3; k++) {
      const p = HALF[a.rgba[j + k]],
        q = HALF[b.rgba[j + k]];
      planes[k][i] = p - q;
      square += p * p + q * q;
    }
    planes[3][i] = HALF[a.error[i]] ** 2 + HALF[b.error[i]] ** 2 + square * 2 ** -22;
  }
  const line = new Float64Array(Math.max(width, height) + 1);
  const summed = (plane, start, stride, length) => {
    for (let i = 0; i < length; i++) line[i + 1] = line[i] + plane[start + i * stride];
    for (let i = 0; i < length; i++) {
      plane[start + i * stride] =
        line[Math.min(i + reach + 1, length)] - line[Math.max(i - reach, 0)];
    }
  };
  if (reach) {
    for (const plane of planes) {
      for (let y = 0; y < height; y++) summed(plane, y * width, 1, width);
      for (let x = 0; x < width; x++) summed(plane, x, width, height);
    }
  }
  const [red, green, blue, noise] = planes;
  return noise.map((value, i) =>
    value > 0 ? Math.sqrt((red[i] ** 2 + green[i] ** 2 + blue[i] ** 2) / value) : 0,
  );
};

// Return the share of the asset's pixels with a ratio above a limit.
review.shareBeyond = (a, b, ratios, limit) => {
  const { HALF } = review;
  let covered = 0,
    beyond = 0;
  ratios.forEach((ratio, i) => {
    if (!(HALF[a.rgba[4 * i + 3]] > 0 || HALF[b.rgba[4 * i + 3]] > 0)) return;
    covered++;
    if (ratio > limit) beyond++;
  });
  return covered ? beyond / covered : 0;
};

review.showValues = (target, x, y, a, b, display, ratios) => {
  const { make, number, table } = review;
  const row = (side, pixel) =>
    make(
      "tr",
      {},
      make("th", { scope: "row" }, make("b", { class: `side ${side}` }, side.toUpperCase())),
      ...pixel.rgb.map((value) => make("td", {}, number(value))),
      make("td", {}, number(pixel.alpha, 3)),
      make("td", {}, pixel.error === null ? "?" : number(pixel.error, 2)),
    );
  const first = review.pixel(a, x, y);
  const rows = [row("a", first)];
  const lines = [`column ${x}, row ${y}; on screen ${display.join(", ")}`];
  if (b && b.width === a.width && b.height === a.height) {
    const second = review.pixel(b, x, y);
    rows.push(
      row("b", second),
      make(
        "tr",
        {},
        make("th", { scope: "row" }, "A − B"),
        ...first.rgb.map((value, channel) =>
          make("td", {}, number(value - second.rgb[channel], 3)),
        ),
        make("td", {}, number(first.alpha - second.alpha, 3)),
        make("td", {}, ratios ? `z ${ratios[y * a.width + x].toFixed(2)}` : ""),
      ),
    );
  }
  target.replaceChildren(
    table(["", "R", "G", "B", "alpha", "error"], rows, { class: "numbers" }),
    ...lines.map((line) => make("p", { class: "quiet" }, line)),
  );
};

const LABELS = {
  relmse: "error (relMSE)",
  seconds: "render time, s",
  samples: "samples a pixel",
  "pose.element": "asset turned, °",
  "pose.lighting": "light turned, °",
  exposure: "exposure, stops",
  time: "finished (UTC)",
  ibl: "rig",
};
const HIDDEN = new Set(["look", "ibl", "turntable"]);

review.showProvenance = (target, a, b) => {
  const { make, table } = review;
  const columns = [a, b].filter(Boolean).map((frame) => ({ ...frame.header, file: frame.file }));
  const names = [...new Set(columns.flatMap((column) => Object.keys(column)))].filter(
    (name) => !HIDDEN.has(name),
  );
  const rank = (name) => (name.startsWith("digest") ? 2 : name.startsWith("version") ? 1 : 0);
  names.sort((p, q) => rank(p) - rank(q));
  const shown = (name, value) => {
    if (value === undefined) return "–";
    if (name === "relmse" || name === "raw.relmse" || name === "seconds")
      return review.number(Number(value), 3);
    if (name === "time") return value.replace("T", " ").replace("+00:00", "");
    return name.startsWith("digest") ? value.slice(0, 12) : value;
  };
  const rows = names.map((name) => {
    const values = columns.map((column) => column[name]);
    const differs = values.length > 1 && values[0] !== values[1];
    return make(
      "tr",
      { class: differs ? "differs" : null },
      make(
        "th",
        { scope: "row" },
        LABELS[name] || name.replace("version.", "").replace("digest.", "digest of "),
      ),
      ...values.map((value) => make("td", { title: value }, shown(name, value))),
    );
  });
  target.replaceChildren(
    table(columns.length > 1 ? ["", "A", "B"] : null, rows, { class: "provenance" }),
    ...(a.command
      ? [make("p", { class: "quiet" }, "To render A again:"), make("code", {}, a.command)]
      : []),
  );
};
