"""Stacks of layers at points: generated code reads the inputs of each point from a row of a table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain

import numpy as np

from lookdev.brdf import MASK, MODELS, Array, Bsdf, Mode, Real, StackLayer, stack_bsdf
from lookdev.brdf.parameters import add_followers
from lookdev.codegen.trace.graph import Graph
from lookdev.codegen.trace.lobes import WI, WO
from lookdev.codegen.trace.symbolic import symbol, symbols
from lookdev.material.values import view_dependent_value


@dataclass(frozen=True)
class PointLayer:
    """The part of a layer on which its code depends; its other numbers are read from a table, point by point.

    Attributes
    ----------
    tokens
        Tokens that differ from their defaults.
    constants
        Numbers that are the same at every point: they fold as in the shader of a look.
    following
        Names of numbers that have the value of the number that they follow.
    formulas
        Numbers that are expressions of the view alone.
    """

    model: str
    tokens: Mapping[str, str]
    mode: Mode = "over"
    constants: Mapping[str, float | Sequence[float]] = field(default_factory=dict)
    following: frozenset[str] = frozenset()
    formulas: Mapping[str, str] = field(default_factory=dict)

    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Return the shapes at one point, () or (3,), of the mask and the numbers, by name.

        Numbers that follow others, and formulas, are left out.
        """
        parameters = MODELS[self.model].parameters.items()
        numbers = {name: parameter for name, parameter in parameters if parameter.kind != "token"}
        shapes = {name: () if number.kind == "float" else (3,) for name, number in numbers.items()}
        computed = {*self.following, *self.formulas}
        return {name: shape for name, shape in ({"mask": ()} | shapes).items() if name not in computed}

    def stack_layer(self, numbers: Mapping[str, Array], view: Array) -> StackLayer:
        """Return the layer with `numbers` from the table; `view` (...) is the cosine between view and normal."""
        parameters = dict(MODELS[self.model].parameters)
        constants = {name: np.asarray(value, dtype=np.float64) for name, value in self.constants.items()}
        computed = {
            name: view_dependent_value(text, (parameters | {"mask": MASK})[name], view)
            for name, text in self.formulas.items()
        }
        values: dict[str, Real] = {**constants, **numbers, **computed}
        mask = values.pop("mask")
        all_values = add_followers(parameters, {**MODELS[self.model].tokens(self.tokens), **values})
        return StackLayer(self.model, all_values, mask, self.mode)


def point_bsdf(graph: Graph, layers: Sequence[PointLayer]) -> Bsdf:
    """Return the BSDF of layers whose numbers are symbols, named by `point_columns`."""
    stack = []
    for number, layer in enumerate(layers):
        columns = _layer_columns(number, layer).items()
        values = {name: symbols(graph, names) if len(names) > 1 else symbol(graph, *names) for name, names in columns}
        stack.append(layer.stack_layer(values, symbol(graph, WO[2])))
    return stack_bsdf(stack)


def point_columns(layers: Sequence[PointLayer]) -> tuple[str, ...]:
    """Return the columns of a table of points: wo, wi, then the mask and inputs of each layer except constants."""
    columns = (_layer_columns(number, layer).values() for number, layer in enumerate(layers))
    return (*WO, *WI, *chain(*chain(*columns)))


def point_cells(layers: Sequence[PointLayer]) -> int:
    """Return the number of texels of three channels in a row of a table of points.

    It is a power of two, so that texel centres are exact in float32, and a look-up that interpolates returns the texel.
    """
    return 1 << (-(-len(point_columns(layers)) // 3) - 1).bit_length()


def _layer_columns(number: int, layer: PointLayer) -> dict[str, list[str]]:
    """Return the columns of the numbers of a layer that are read, by the numbers' names."""
    return {
        name: [f"layer{number}_{name}_{i}" for i in range(3)] if shape else [f"layer{number}_{name}"]
        for name, shape in layer.shapes().items()
        if name not in layer.constants
    }
