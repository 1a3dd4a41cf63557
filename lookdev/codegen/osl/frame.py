"""Write the shading frame (`lookdev.scene.shading`) as OSL, for the surface shader.

The code calls OSL's own vector functions, which round as the vector functions of Cycles do. Rounding matters because
the position of a path's next point seeds the random numbers there. If a direction differs in its last digit, the
picture has other noise, though not more noise.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from lookdev.codegen.operators import CODE, strip_parentheses
from lookdev.codegen.osl.block import literal
from lookdev.codegen.trace.graph import Graph, GraphNode, Scalar, Symbol
from lookdev.codegen.trace.lobes import WO
from lookdev.codegen.trace.symbolic import elements_of, symbol, vector_symbols
from lookdev.codegen.trace.vectors import Triple, match_cross, match_dot, match_normalize
from lookdev.scene.shading import shading_frame

# The variables of the surface shader that the frame depends on.
_VECTORS = ("mesh_normal", "mesh_facet", "I")
_TANGENT = "mesh_tangent"


def emit_frame(*, reads_tangent: bool, bends_normals: bool) -> Sequence[str]:
    """Return the lines that define ``vector t b n facet`` and ``float wo_x wo_y wo_z``.

    These are the frame's tangent, bitangent and normal, the facet's normal, and the direction to the viewer in the
    frame. The lines read ``vector mesh_normal mesh_facet I``. With `reads_tangent`, for a look that depends on the
    tangent's direction, they also read ``vector mesh_tangent``. With `bends_normals`, for a look with bumps or normal
    maps, they read ``float hand``, -1 if the instance's matrix mirrors, else 1.
    """
    graph = Graph()
    vectors = {name: vector_symbols(graph, name) for name in (*_VECTORS, *[_TANGENT] * reads_tangent)}
    normal, facet, viewer = (vectors[name] for name in _VECTORS)
    hand = symbol(graph, "hand") if bends_normals else 1.0
    frame = shading_frame(normal, vectors.get(_TANGENT), facet, viewer, hand)
    writer = _FrameWriter({tuple(elements_of(vector)): name for name, vector in vectors.items()})
    for name, vector in (("facet", frame.facet), ("n", frame.normal), ("t", frame.tangent), ("b", frame.bitangent)):
        x, y, z = elements_of(vector)
        writer.define(f"vector {name}", (x, y, z))
    for name, element in zip(WO, elements_of(frame.to_local(viewer)), strict=True):
        writer.define(f"float {name}", element)
    return writer.lines


class _FrameWriter:
    """Writes lines of code, and remembers the names of the vectors and numbers that they define."""

    def __init__(self, names: dict[Scalar | tuple[Scalar, ...], str]) -> None:
        self.lines: list[str] = []
        self._names = names

    def define(self, variable: str, value: Scalar | Triple) -> None:
        """Write a variable, given as its type and name, that has the value of a number or a vector."""
        self.lines.append(f"    {variable} = {strip_parentheses(self._compute(value))};")
        name = self._names[value] = variable.split()[1]
        if isinstance(value, tuple):
            self._names |= {
                component: f"{name}[{i}]" for i, component in enumerate(value) if isinstance(component, GraphNode)
            }

    def _code(self, value: Scalar | Triple) -> str:
        """Return the name of a variable that has the value, or else an expression of the value."""
        if value not in self._names and isinstance(value, GraphNode) and (match_dot(value) or value.op == "where"):
            # Costly numbers first become variables. Vectors stay inline.
            code = self._compute(value)
            self._names[value] = f"g{len(self.lines)}"
            self.lines.append(f"    float {self._names[value]} = {strip_parentheses(code)};")
        return self._names.get(value) or self._compute(value)

    def _compute(self, value: Scalar | Triple) -> str:
        """Return the expression of a number or of a vector."""
        if not isinstance(value, GraphNode | tuple):
            return literal(value)
        if isinstance(value, GraphNode):
            if isinstance(value, Symbol):
                return value.name
            factors = match_dot(value)
            return self._call("dot", factors) if factors else self._operation(value.op, value.args)
        vector, factors = match_normalize(value), match_cross(value)
        if vector or factors:
            return self._call("normalize", [vector]) if vector else self._call("cross", factors or ())
        nodes = [component for component in value if isinstance(component, GraphNode)]
        if len(nodes) < 3 or len({node.op for node in nodes}) > 1:
            return self._call("vector", value)
        # All components have the same operation, so OSL applies it to vectors, or to a number that all three share.
        triples = zip(*(node.args for node in nodes), strict=True)
        return self._operation(nodes[0].op, (triple[0] if len(set(triple)) == 1 else triple for triple in triples))

    def _call(self, function: str, operands: Iterable[Scalar | Triple]) -> str:
        return f"{function}({', '.join(strip_parentheses(self._code(operand)) for operand in operands)})"

    def _operation(self, op: str, operands: Iterable[Scalar | Triple]) -> str:
        return CODE[op].format(*map(self._code, operands))
