"""Evaluation of OSL snippets inside Cycles: each pixel reads a row of numbers."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from warm_blender import BlenderProcess

from lookdev.arrays import Floats

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
    blender: BlenderProcess,
    probes: Probes,
    headers: str,
    parameters: str = "",
    arrays: Mapping[str, Any] | None = None,
    samples: Mapping[str, int] | None = None,
) -> tuple[dict[str, Floats], dict[str, Floats]]:
    """Return the tables rounded to float32, as Cycles reads them, and the values of the snippets.

    A pixel has one sample, unless `samples` has a number for the snippet. Only code that reads an array declares it.
    """
    shaders = {}
    for name, (table, code) in probes.items():
        count = (samples or {}).get(name, 1)
        declared = parameters if any(array in code for array in arrays or ()) else ""
        osl = TEMPLATE % {"samples": count, "headers": headers, "arrays": declared, "code": code}
        shaders[name] = osl, table.astype(np.float32), count
    values = blender.call("probes.render_tables", shaders, arrays or {})
    tables = {name: table.astype(np.float64) for name, (_, table, _) in shaders.items()}
    return tables, {name: value.astype(np.float64) for name, value in values.items()}
