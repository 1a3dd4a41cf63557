"""The shading frame (`lookdev.scene.shading`) as OSL.

It is written with OSL's own vector functions, which round as Cycles' do: the place that a path reaches next seeds its
random numbers, so one unit in the last place of a direction makes another picture of the same noise.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from lookdev.codegen.osl.block import CODE, bare, literal
from lookdev.codegen.trace.graph import Graph, Node
from lookdev.codegen.trace.lobes import WO
from lookdev.codegen.trace.symbolic import elements_of, symbol, symbols
from lookdev.codegen.trace.vectors import Triple, match_cross, match_dot, match_normalize
from lookdev.scene.shading import shading_frame

_GIVEN = ("mesh_normal", "mesh_facet", "I")
_TANGENT = "mesh_tangent"


def emit_frame(*, directed: bool, leaning: bool) -> Sequence[str]:
    """Write the lines that define ``vector t b n facet`` and ``float wo_x wo_y wo_z``.

    They read ``vector mesh_normal mesh_facet I``, ``vector mesh_tangent`` where the look depends on its direction, and
    ``float hand`` where the look bends normals.
    """
    graph = Graph()
    given: dict[str, Any] = {
        name: symbols(graph, [f"{name}[{i}]" for i in range(3)]) for name in (*_GIVEN, *[_TANGENT] * directed)
    }
    normal, facet, viewer = (given[name] for name in _GIVEN)
    hand: Any = symbol(graph, "hand") if leaning else 1.0
    frame = shading_frame(normal, given.get(_TANGENT), facet, viewer, hand)
    text = _Text({tuple(elements_of(vector)): name for name, vector in given.items()})
    for name, vector in (("facet", frame.facet), ("n", frame.normal), ("t", frame.tangent), ("b", frame.bitangent)):
        text.define(f"vector {name}", tuple(elements_of(vector)))
    for name, element in zip(WO, elements_of(frame.to_local(viewer)), strict=True):
        text.define(f"float {name}", element)
    return text.lines


class _Text:
    """Lines of code, and the names of the vectors and numbers that they define."""

    def __init__(self, named: dict[Any, str]) -> None:
        self.lines: list[str] = []
        self._named = named

    def define(self, variable: str, value: Node | Triple) -> None:
        """Compute a number, or a vector, into a variable."""
        self.lines.append(f"    {variable} = {bare(self._computed(value))};")
        name = self._named[value] = variable.split()[1]
        if isinstance(value, tuple):
            self._named |= {each: f"{name}[{i}]" for i, each in enumerate(value) if isinstance(each, Node)}

    def _code(self, value: Any) -> str:
        if not isinstance(value, Node | tuple):
            return literal(value)
        if value not in self._named and isinstance(value, Node) and (match_dot(value) or value.op == "where"):
            # Numbers that cost something have a name; vectors stand where they are used.
            code = self._computed(value)
            self._named[value] = f"g{len(self.lines)}"
            self.lines.append(f"    float {self._named[value]} = {bare(code)};")
        return self._named.get(value) or self._computed(value)

    def _computed(self, value: Node | Triple) -> str:
        if isinstance(value, Node):
            if value.op == "symbol":
                return str(value.args[0])
            factors = match_dot(value)
            return self._called("dot", factors) if factors else self._operation(value.op, value.args)
        vector, factors = match_normalize(value), match_cross(value)
        if vector or factors:
            return self._called("normalize", [vector]) if vector else self._called("cross", factors or ())
        if len({node.op if isinstance(node, Node) else "" for node in value}) > 1:
            return self._called("vector", value)
        # Component by component the same operation, of vectors and of numbers that all three share.
        operands = zip(*(node.args for node in value), strict=True)
        return self._operation(value[0].op, (each[0] if len(set(each)) == 1 else each for each in operands))

    def _called(self, function: str, operands: Iterable[Any]) -> str:
        return f"{function}({', '.join(bare(self._code(each)) for each in operands)})"

    def _operation(self, op: str, operands: Iterable[Any]) -> str:
        return CODE[op].format(*map(self._code, operands))
