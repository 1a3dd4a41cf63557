"""Generate the shader that evaluates a stack of layers at points in the renderer, for ``lookdev check`` and ``eval``.

The shader reads the directions and the layers' inputs of each point from a table (`codegen.points`).
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

from lookdev.codegen.osl.bsdf import emit_brdf, trace_lobes
from lookdev.codegen.osl.tables import bind_tables
from lookdev.codegen.points import PointLayer, point_bsdf, point_cells, point_columns
from lookdev.codegen.source import ShaderSource
from lookdev.codegen.templates import expand_template
from lookdev.codegen.trace.graph import Graph
from lookdev.codegen.trace.lobes import present_lobes


def generate_point_shader(layers: Sequence[PointLayer], lobes: Sequence[str] | None = None) -> ShaderSource:
    """Generate the shader of a stack of layers, base first, or only of its lobes with the names `lobes`.

    The shader's table is a texture with a row for each point. A row has the values of `point_columns`, in `point_cells`
    texels of three channels.
    """
    graph = Graph()
    bsdf = point_bsdf(graph, layers)
    present = [lobe for lobe in present_lobes(graph, bsdf) if lobes is None or lobe.name in lobes]
    code = emit_brdf(trace_lobes(graph, present))
    columns = point_columns(layers)
    lines = [f"    float {name} = 0;" for name in columns]
    for index in range(0, len(columns), 3):
        lines.append(f"    cell = points_cell(points_file, {index // 3}, number);")
        lines += [f"    {name} = cell[{k}];" for k, name in enumerate(columns[index : index + 3])]
    constants = [
        f"#define POINT_CELLS {point_cells(layers)}",
        f"#define TRANSMITS {int(code.transmits or code.crosses_surface)}",
        f"#define TWO_SIDED {int(bsdf.two_sided)}",
    ]
    table_parameters, tables = bind_tables(code.tables)
    sections = {"constants": constants, "parameters": table_parameters, "columns": lines, **code.sections}
    osl = expand_template("points.osl", sections)
    digest = hashlib.sha256(osl.encode()).hexdigest()
    return ShaderSource("points", osl, (), (), digest, code.transmits, tables=tables)
