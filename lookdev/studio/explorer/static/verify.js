// @ts-check
// The comparison of the page's shaders with the float64 models in Python, at random pairs of
// directions.
import { makeElement } from "./viewport/elements.js";
import { parameterLookup } from "./gl.js";
import { nameOf, visibleSurfaces, wordsOf } from "./state.js";

export const TOLERANCE = 2e-4; // largest relative difference of values that agree
const SHARE = 0.99; // fraction of the channels that must agree

// Return the differences of `values` and `expected`, relative to each expected value, or to a
// thousandth of the median if that is larger. For each pair of directions, `values` has 4 numbers,
// and `expected` has `width`.
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

// Return a row for each visible surface: the number of channels, the 99 % quantile and the largest
// of their relative differences, and whether the surface agrees.
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
  const makeCell = (textContent, properties = {}) =>
    makeElement("td", { textContent, ...properties });
  for (const { name, problem, count, quantile, largest, agrees } of rows) {
    const row = body.insertRow();
    row.append(makeCell(name));
    if (problem) {
      row.append(makeCell(problem, { colSpan: 4 }));
      continue;
    }
    const numbers = [count, quantile.toExponential(1), largest.toExponential(1)];
    row.append(
      ...numbers.map((number) => makeCell(number, { className: "number" })),
      makeCell(agrees ? "agrees" : "differs", { className: agrees ? "good" : "bad" }),
    );
  }
  const textContent =
    "f times the cosine, and the pdf, at 2048 random pairs of directions, in the browser's " +
    "float32 and in Python's float64. They agree if the relative difference is below " +
    `${TOLERANCE} in 99 % of the channels.`;
  return [makeElement("p", { textContent }), table];
};
