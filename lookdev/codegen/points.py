"""Define a table with the inputs of a stack of layers at many points, for checks that evaluate BSDFs in a renderer.

Each row of the table belongs to a point. Generated code reads two directions and the layers' inputs from the row, and
evaluates the BSDF (`codegen.osl.points`).
"""

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
    """One layer: the inputs on which its generated code depends. The table has the layer's other inputs.

    The mask and all parameters that are not tokens are called numbers; they have one or three components.

    Attributes
    ----------
    model
        The name of the layer's reflectance model.
    tokens
        The tokens that differ from their defaults, by parameter.
    mode
        How the layer is combined with the layers below it.
    constants
        The numbers that are the same at every point, by name. They fold as in the shader of a look.
    following
        The names of the numbers that have the value of the parameter that they follow (`Parameter.follows`).
    formulas
        The text of the numbers that are expressions of the cosine between view and normal, by name.
    """

    model: str
    tokens: Mapping[str, str]
    mode: Mode = "over"
    constants: Mapping[str, float | Sequence[float]] = field(default_factory=dict)
    following: frozenset[str] = frozenset()
    formulas: Mapping[str, str] = field(default_factory=dict)

    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Return the shapes at one point, () or (3,), of the mask and the other numbers, by name.

        Numbers in `following` and `formulas` are left out: they are computed from others.
        """
        parameters = MODELS[self.model].parameters.items()
        numbers = {name: parameter for name, parameter in parameters if parameter.kind != "token"}
        shapes = {name: () if number.kind == "float" else (3,) for name, number in numbers.items()}
        computed = {*self.following, *self.formulas}
        return {name: shape for name, shape in ({"mask": ()} | shapes).items() if name not in computed}

    def stack_layer(self, numbers: Mapping[str, Array], view: Array) -> StackLayer:
        """Return the layer with all its inputs.

        `numbers` has the inputs that are in the table, by name. `view` (...) is the cosine between view and normal.
        """
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
    """Return the BSDF of layers, base first.

    The numbers that the table has are symbols of `graph`, named like the table's columns (`point_columns`).
    """
    stack = []
    for number, layer in enumerate(layers):
        columns = _layer_columns(number, layer).items()
        values = {name: symbols(graph, names) if len(names) > 1 else symbol(graph, *names) for name, names in columns}
        stack.append(layer.stack_layer(values, symbol(graph, WO[2])))
    return stack_bsdf(stack)


def point_columns(layers: Sequence[PointLayer]) -> tuple[str, ...]:
    """Return the names of a table's columns: wo, wi, then, for each layer, the numbers that the table has."""
    columns = (_layer_columns(number, layer).values() for number, layer in enumerate(layers))
    return (*WO, *WI, *chain(*chain(*columns)))


def point_cells(layers: Sequence[PointLayer]) -> int:
    """Return the number of texels in a row of a table; a texel has three columns.

    The number is a power of two, so that texel centres are exact in float32. A look-up at a centre then returns the
    texel, although it interpolates.
    """
    return 1 << (-(-len(point_columns(layers)) // 3) - 1).bit_length()


def _layer_columns(number: int, layer: PointLayer) -> dict[str, list[str]]:
    """Return the names of the columns of each input that the table has for a layer, by the input's name.

    `number` is the layer's index.
    """
    return {
        name: [f"layer{number}_{name}_{i}" for i in range(3)] if shape else [f"layer{number}_{name}"]
        for name, shape in layer.shapes().items()
        if name not in layer.constants
    }
