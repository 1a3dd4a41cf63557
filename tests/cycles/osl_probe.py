"""Run OSL snippets inside Blender's Cycles, a row of numbers a pixel: ``python osl_probe.py request.npz answer.npz``.

The request has for every probe its shader text (``NAME.osl``), its table (``NAME.table``, (n, 12) float32) and the
samples a pixel (``NAME.samples``), and arrays that are parameters of all of them (``array.NAME``); the answer has the
emission of each shader, (n, 3), averaged over the samples.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scripts import run_script

from lookdev.codegen import ShaderSource

Floats = NDArray[np.float64]
Probes = Mapping[str, tuple[Floats, str]]
"""Tables (n, up to 12) and code that sets `value` from a row `in`, by name."""

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


def evaluate(
    folder: Path,
    probes: Probes,
    headers: str,
    parameters: str = "",
    arrays: Mapping[str, Any] | None = None,
    samples: Mapping[str, int] | None = None,
) -> tuple[dict[str, Floats], dict[str, Floats]]:
    """Return the tables as Cycles gets them, in float32, and the values; one sample a pixel where none are given."""
    request: dict[str, Any] = {f"array.{name}": array for name, array in (arrays or {}).items()}
    tables = {name: table.astype(np.float32) for name, (table, _) in probes.items()}
    for name, (_, code) in probes.items():
        count = (samples or {}).get(name, 1)
        osl = TEMPLATE % {"samples": count, "headers": headers, "arrays": parameters, "code": code}
        request |= {f"{name}.osl": osl, f"{name}.table": tables[name], f"{name}.samples": count}
    np.savez(folder / "request.npz", **request)
    run_script("osl_probe.py", folder / "request.npz", folder / "answer.npz")
    with np.load(folder / "answer.npz") as stored:
        values = {name: stored[name].astype(np.float64) for name in stored.files}
    return {name: table.astype(np.float64) for name, table in tables.items()}, values


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
    from lookdev.lifetime import leaving

    with leaving():
        main(*sys.argv[1:])
