"""The shading frame (`lookdev.scene.shading`) as OSL."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from lookdev.codegen.osl.block import Block
from lookdev.codegen.trace.graph import Graph
from lookdev.codegen.trace.lobes import WO
from lookdev.codegen.trace.symbolic import elements_of, symbol, symbols
from lookdev.scene.shading import shading_frame


def emit_frame(*, leaning: bool) -> Sequence[str]:
    """Write the lines that define ``vector t b n facet`` and ``float wo_x wo_y wo_z``.

    They read ``vector mesh_normal mesh_tangent mesh_facet I``, and ``float hand`` where the look bends normals.
    """
    graph = Graph()
    names = ("mesh_normal", "mesh_tangent", "mesh_facet", "I")
    normal, tangent, facet, viewer = (symbols(graph, [f"{name}[{i}]" for i in range(3)]) for name in names)
    hand: Any = symbol(graph, "hand") if leaning else 1.0
    frame = shading_frame(normal, tangent, facet, viewer, hand)
    vectors = {"t": frame.tangent, "b": frame.bitangent, "n": frame.normal, "facet": frame.facet}
    wo = elements_of(frame.to_local(viewer))
    block = Block("g", indent=1)
    block.prepare([*(element for each in vectors.values() for element in elements_of(each)), *wo])
    for name, value in vectors.items():
        components = ", ".join(block.name(element) for element in elements_of(value))
        block.write(f"vector {name} = vector({components});")
    for name, element in zip(WO, wo, strict=True):
        block.define(name, element)
    return block.lines
