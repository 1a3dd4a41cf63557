// @ts-check
// Compares the browser's values at random pairs of directions with those of the models in float64.
import { parameterLookup } from "./gl.js";
import { nameOf, visibleSurfaces, wordsOf } from "./state.js";

export const TOLERANCE = 2e-4;
const SHARE = 0.99; // of the channels that must agree

// Return the differences relative to each expected value, or to a thousandth of the median if that
// is larger. `values` has texels of 4, `expected` of `width` numbers.
const relativeDifferences = (values, expected, width) => {
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

// Return for each surface the number of channels, and the 99 % quantile and the maximum of their
// differences.
export const verifySurfaces = async (link, shaders) => {
  const rows = [];
  for (const surface of visibleSurfaces()) {
    try {
      const [shader, { arrays }] = [
        await shaders.load(surface),
        await link.ask({ do: "pairs", surface: wordsOf(surface) }),
      ];
      const lookUp = parameterLookup(surface, shaders.models),
        differences = [];
      const evaluate = (quantity) => shader.evaluate(arrays.wo, arrays.wi, lookUp, quantity);
      if (arrays.value.some(Boolean)) {
        const values = evaluate(0);
        differences.push(
          relativeDifferences(values, arrays.value, 3),
          relativeDifferences(values.subarray(3), arrays.pdf, 1), // the fourth number of a texel
        );
      }
      for (let k = 0; arrays[`direction${k}`]; k++) {
        differences.push(
          relativeDifferences(evaluate(1 + 2 * k), arrays[`direction${k}`], 3),
          relativeDifferences(evaluate(2 + 2 * k), arrays[`factor${k}`], 3),
        );
      }
      const sorted = Float32Array.from(differences.flatMap((values) => [...values])).sort();
      const quantile = sorted[Math.floor(SHARE * (sorted.length - 1))];
      rows.push({
        name: nameOf(surface),
        count: sorted.length,
        quantile,
        largest: sorted[sorted.length - 1],
        agrees: quantile < TOLERANCE,
      });
    } catch (error) {
      rows.push({ name: nameOf(surface), problem: error.message, agrees: false });
    }
  }
  return rows;
};

/** Return the elements that show the results of `verifySurfaces`. */
export const makeReport = (rows) => {
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
            result.largest.toExponential(1),
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
