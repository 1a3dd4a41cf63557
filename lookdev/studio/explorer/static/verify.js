// @ts-check
// What the browser computes, at random pairs of directions, beside the models in float64.
import { numberOf } from "./gl.js";
import { nameOf, visibleSurfaces, wordsOf } from "./state.js";

export const TOLERANCE = 2e-4;
const SHARE = 0.99;

// Differences relative to each value, or to the thousandth part of the median where that is larger.
const compare = (values, expected, width) => {
  const sizes = Float32Array.from(expected, Math.abs).sort(),
    floor = 1e-3 * Math.max(1, sizes[sizes.length >> 1]),
    differences = new Float32Array(expected.length);
  for (let i = 0; i < expected.length; i++) {
    const value = values[4 * Math.floor(i / width) + (i % width)];
    differences[i] = Number.isFinite(value)
      ? Math.abs(value - expected[i]) / Math.max(Math.abs(expected[i]), floor)
      : Infinity;
  }
  return differences;
};

// For each surface: the share of channels within the tolerance, the quantile of 99 % and the
// largest difference.
export const verify = async (link, shaders) => {
  const rows = [];
  for (const surface of visibleSurfaces()) {
    try {
      const [shader, { arrays }] = [
        await shaders.of(surface),
        await link.ask({ do: "pairs", surface: wordsOf(surface) }),
      ];
      const numbers = numberOf(surface, shaders.models),
        all = [];
      if (arrays.value.some(Boolean)) {
        const values = shader.at(arrays.wo, arrays.wi, numbers);
        all.push(
          compare(values, arrays.value, 3),
          compare(
            values
              .filter((_, i) => i % 4 === 3)
              .reduce((out, v, i) => {
                out[4 * i] = v;
                return out;
              }, new Float32Array(values.length)),
            arrays.pdf,
            1,
          ),
        );
      }
      for (let k = 0; arrays[`direction${k}`]; k++) {
        all.push(
          compare(shader.at(arrays.wo, arrays.wi, numbers, 1 + 2 * k), arrays[`direction${k}`], 3),
        );
        all.push(
          compare(shader.at(arrays.wo, arrays.wi, numbers, 2 + 2 * k), arrays[`factor${k}`], 3),
        );
      }
      const sorted = Float32Array.from(all.flatMap((differences) => [...differences])).sort();
      const quantile = sorted[Math.floor(SHARE * (sorted.length - 1))];
      rows.push({
        name: nameOf(surface),
        count: sorted.length,
        within: sorted.filter((difference) => difference < TOLERANCE).length / sorted.length,
        quantile,
        most: sorted[sorted.length - 1],
        agrees: quantile < TOLERANCE,
      });
    } catch (error) {
      rows.push({ name: nameOf(surface), problem: error.message, agrees: false });
    }
  }
  return rows;
};

export const verdict = (rows) => {
  const table = document.createElement("table");
  table.innerHTML =
    "<thead><tr><th>Surface</th><th>Channels</th><th>99 % within</th>" +
    "<th>Largest</th><th></th></tr></thead>";
  const body = table.createTBody();
  for (const result of rows) {
    const row = body.insertRow(),
      cells = result.problem
        ? [result.name, result.problem, "", "", ""]
        : [
            result.name,
            result.count,
            result.quantile.toExponential(1),
            result.most.toExponential(1),
            result.agrees ? "agrees" : "differs",
          ];
    cells.forEach((text, i) => {
      const cell = row.insertCell();
      cell.textContent = text;
      if (i === 4) cell.className = result.agrees ? "good" : "bad";
      else if (i && !result.problem) cell.className = "number";
    });
    if (result.problem)
      ((row.cells[1].colSpan = 4), row.deleteCell(4), row.deleteCell(3), row.deleteCell(2));
  }
  const text = document.createElement("p");
  text.textContent =
    "f times the cosine, and the pdf, at 2048 random pairs of directions, in the browser's " +
    "float32 and in Python's float64. They agree if the relative difference is below " +
    `${TOLERANCE} in 99 % of the channels.`;
  return [text, table];
};
