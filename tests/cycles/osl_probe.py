"""Run OSL snippets inside Blender's Cycles, a row of numbers a pixel: ``python osl_probe.py request.npz answer.npz``.

The request has for every probe its shader text (``NAME.osl``), its table (``NAME.table``, (n, 12) float32) and the
samples a pixel (``NAME.samples``), and arrays that are parameters of all of them (``array.NAME``); the answer has the
emission of each shader, (n, 3), averaged over the samples.
"""

from __future__ import annotations

import sys

import numpy as np

from lookdev.codegen import ShaderSource

TEMPLATE = """
#define SAMPLES %(samples)d
#include "stdosl.h"
%(headers)s
shader probe(string points_file = "", int columns = 1, int rows = 1, %(arrays)s output closure color surface = 0)
{
    vector ndc = transform("NDC", P);
    int column = int(floor(ndc[0] * columns));
    int row = int(floor(ndc[1] * rows));
    int number = column + columns * row;
    float in[12];
    for (int i = 0; i < 4; ++i) {
        color cell = lookdev_texel(points_file, i + 4 * column, row, 4 * columns, rows);
        in[3 * i] = cell[0];
        in[3 * i + 1] = cell[1];
        in[3 * i + 2] = cell[2];
    }
    color value = 0;
    %(code)s
    surface = value * emission();
}
"""


def main(request: str, answer: str) -> None:
    """Answer all probes of a request."""
    from lookdev.cycles.points import render_table

    results = {}
    with np.load(request, allow_pickle=False) as stored:
        names = {tuple(key.split(".")) for key in stored.files}
        arrays = {name: stored[f"array.{name}"] for kind, name in names if kind == "array"}
        for name in sorted({name for name, _ in names} - {"array"}):
            source = ShaderSource("probe", str(stored[f"{name}.osl"]), (), (), "")
            samples = int(stored[f"{name}.samples"])
            results[name] = render_table(source, stored[f"{name}.table"], 4, samples, arrays)
    np.savez(answer, **results)


if __name__ == "__main__":
    from lookdev.cycles.leave import leaving

    with leaving():
        main(*sys.argv[1:])
