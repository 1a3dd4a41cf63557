"""The shader that evaluates a stack of layers at listed points, whose numbers it reads from a table."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from lookdev.brdf import MASK, MODELS, Array, Mode, StackLayer, stack_bsdf
from lookdev.brdf.parameters import with_followers
from lookdev.codegen.osl.bsdf import emit_brdf, trace_lobes
from lookdev.codegen.osl.surface import expand_template
from lookdev.codegen.osl.tables import bind_tables
from lookdev.codegen.source import ShaderSource
from lookdev.codegen.trace.graph import Graph
from lookdev.codegen.trace.lobes import WI, WO, present_lobes
from lookdev.codegen.trace.symbolic import symbol, symbols
from lookdev.material.values import seen


@dataclass(frozen=True)
class PointLayer:
    """The part of a layer at listed points that its code depends on.

    `tokens` that are not given have their defaults. `constants` has the numbers that are the same at every point: they
    fold as in the shader of a look. Those `following` have the value of the number that they follow, and `formulas` has
    expressions of the view alone. All others are read from a table.
    """

    model: str
    tokens: Mapping[str, str]
    mode: Mode = "over"
    constants: Mapping[str, float | Sequence[float]] = field(default_factory=dict)
    following: frozenset[str] = frozenset()
    formulas: Mapping[str, str] = field(default_factory=dict)

    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Return the shape at one point, () or (3,), of the mask and of every number, by name.

        Numbers that follow others or are formulas are left out.
        """
        numbers = {name: each for name, each in MODELS[self.model].parameters.items() if each.kind != "token"}
        shapes = {name: () if number.kind == "float" else (3,) for name, number in numbers.items()}
        computed = {*self.following, *self.formulas}
        return {name: shape for name, shape in ({"mask": ()} | shapes).items() if name not in computed}

    def at(self, numbers: Mapping[str, Any], view: Array) -> StackLayer:
        """Return the layer with `numbers`, those that are read, seen at the cosines `view` (...) to its normal."""
        known = dict(MODELS[self.model].parameters)
        constants = {name: np.asarray(value, dtype=np.float64) for name, value in self.constants.items()}
        computed = {name: seen(text, (known | {"mask": MASK})[name], view) for name, text in self.formulas.items()}
        values = {**MODELS[self.model].tokens(self.tokens), **constants, **numbers, **computed}
        mask = values.pop("mask")
        return StackLayer(self.model, with_followers(known, values), mask, self.mode)


def generate_points(layers: Sequence[PointLayer], lobes: Sequence[str] | None = None) -> ShaderSource:
    """Generate the shader of a stack of layers, or of some of its lobes.

    A row of its table has `point_columns`, in `point_cells` texels of three channels.
    """
    graph = Graph()
    stack = []
    for number, layer in enumerate(layers):
        values: dict[str, Any] = {}
        for name, shape in layer.shapes().items():
            if name not in layer.constants:
                names = _columns(number, name, shape)
                values[name] = symbols(graph, names) if shape else symbol(graph, *names)
        stack.append(layer.at(values, symbol(graph, WO[2])))
    bsdf = stack_bsdf(stack)
    kept = [lobe for lobe in present_lobes(graph, bsdf) if lobes is None or lobe.name in lobes]
    code = emit_brdf(trace_lobes(graph, kept))
    columns = point_columns(layers)
    rows = [f"    float {name} = 0;" for name in columns]
    for index in range(0, len(columns), 3):
        rows.append(f"    cell = points_cell(points_file, {index // 3}, number);")
        rows += [f"    {name} = cell[{k}];" for k, name in enumerate(columns[index : index + 3])]
    constants = [
        f"#define POINT_CELLS {point_cells(layers)}",
        f"#define TRANSMITS {int(code.transmits or code.crosses)}",
        f"#define TWO_SIDED {int(bsdf.two_sided)}",
    ]
    tables = bind_tables(code.tables)
    sections = {"constants": constants, "parameters": tables.parameters, "columns": rows, **code.sections}
    osl = expand_template("points.osl", sections)
    digest = hashlib.sha256(osl.encode()).hexdigest()
    return ShaderSource("points", osl, (), (), digest, code.transmits, tables=tables.bindings)


def point_columns(layers: Sequence[PointLayer]) -> tuple[str, ...]:
    """Return the columns of a table of points: wo, wi, then the mask and inputs of each layer but its constants."""
    columns = [*WO, *WI]
    for number, layer in enumerate(layers):
        for name, shape in layer.shapes().items():
            if name not in layer.constants:
                columns += _columns(number, name, shape)
    return tuple(columns)


def point_cells(layers: Sequence[PointLayer]) -> int:
    """Return the number of texels of three channels in a row of a table of points.

    A power of two: then texel centres are exact in float32, and a look-up that always interpolates returns the texel.
    """
    return 1 << (-(-len(point_columns(layers)) // 3) - 1).bit_length()


def _columns(layer: int, name: str, shape: tuple[int, ...]) -> list[str]:
    return [f"layer{layer}_{name}_{i}" for i in range(3)] if shape else [f"layer{layer}_{name}"]
