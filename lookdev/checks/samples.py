"""Evaluates the inputs of a look, such as textures, at random points of a surface, for the checks.

A check gets the layers of a look with numbers in place of textures and primvars. This module also writes such layers
as lines for `lookdev eval`, to reproduce a case.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import chain

import numpy as np

from lookdev.arrays import Floats
from lookdev.brdf import MODELS, StackLayer
from lookdev.checks.evaluate import Batch
from lookdev.codegen.points import PointLayer
from lookdev.material import Formula, Input, InputSource, Layer, Look, Primvar, depends_on_view
from lookdev.material.expression import ExpressionKind
from lookdev.material.points import ImagePoints
from lookdev.material.values import SourceValues, look_layers


@dataclass(frozen=True)
class _RandomPoints(ImagePoints):
    """`count` random points of a surface, with random cosines of the view, UVs and primvars.

    UVs and primvars are in [0, 1). At the first quarter of the points, primvars are missing and have their fallback.
    About half of the points have mirrored UVs.
    """

    rng: np.random.Generator
    count: int
    _drawn_values: dict[object, Floats] = field(default_factory=dict)

    def uv(self, name: str) -> Floats:
        return self._draw_once(("uv", name), lambda: self.rng.random((self.count, 2)))

    def primvar(self, primvar: Primvar) -> Floats:
        shape = (self.count, 3) if isinstance(primvar.fallback, tuple) else (self.count,)

        def draw() -> Floats:
            values = self.rng.random(shape)
            values[: self.count // 4] = primvar.fallback
            return values

        return self._draw_once(primvar, draw)

    def handedness(self) -> Floats:
        return self._draw_once("handedness", lambda: self.rng.choice([-1.0, 1.0], self.count))

    def view(self) -> Floats:
        """Return cosines in (0, 1]."""
        return self._draw_once("view", lambda: 1.0 - self.rng.random(self.count))

    def _draw_once(self, key: object, draw: Callable[[], Floats]) -> Floats:
        """Return the values that `draw` returned for a key, so that all inputs of a look read the same values."""
        if key not in self._drawn_values:
            self._drawn_values[key] = draw()
        return self._drawn_values[key]


def sample_layers(look: Look, count: int, rng: np.random.Generator) -> list[StackLayer]:
    """Return the layers of a look, with the values of its inputs at `count` random points.

    An input that varies becomes an array whose first axis is the point. A constant has no such axis. Raises as
    `look_bsdf`.
    """
    return look_layers(look, _RandomPoints(rng, count))


def varying_numbers(layer: StackLayer) -> dict[str, Floats]:
    """Return the numbers of a layer that differ from point to point, by name; the mask is one of the numbers."""
    return {name: value for name, value in _all_numbers(layer).items() if value.ndim > len(_shape(layer, name))}


def constant_numbers(layer: StackLayer) -> dict[str, float | list[float]]:
    """Return the numbers of a layer that are the same at all points, by name; the mask is one of the numbers."""
    return {
        name: value.tolist() for name, value in _all_numbers(layer).items() if value.ndim == len(_shape(layer, name))
    }


def layer_tokens(layer: StackLayer) -> dict[str, str]:
    """Return the parameters of a layer whose values are tokens, by name."""
    return {name: value for name, value in layer.parameters.items() if isinstance(value, str)}


def following_numbers(layer: StackLayer) -> frozenset[str]:
    """Return the names of the numbers of a layer that are not authored, but have the value of another number."""
    parameters, values = MODELS[layer.model].parameters, layer.parameters
    return frozenset(name for name, p in parameters.items() if p.follows and values[name] is values[p.follows])


def point_layer(layer: StackLayer, constants: Mapping[str, float | list[float]]) -> PointLayer:
    """Return the part of a layer that determines its generated code, without the numbers that vary.

    `constants` has the numbers that are constants in the code, by name.
    """
    return PointLayer(layer.model, layer_tokens(layer), layer.mode, constants, following_numbers(layer))


def constant_looks(look: Look, count: int, rng: np.random.Generator) -> list[Look]:
    """Return constant looks with the inputs of a look at `count` random points, or one look if they are all equal.

    Inputs that depend on the view become expressions of the view alone.
    """
    points = _RandomPoints(rng, count)
    looks = []
    for index in range(count):
        point = _RandomPoint(points, index)
        looks.append(replace(look, layers=tuple(chain.from_iterable(map(point.layers, look.layers)))))
    return looks if any(other != looks[0] for other in looks) else looks[:1]


@dataclass(frozen=True)
class _RandomPoint:
    """One of several random points, by its index."""

    points: _RandomPoints
    index: int
    # Formulas at this point, by the id of the original formula: inputs that share a formula also share its copy.
    _formulas: dict[int, Formula] = field(default_factory=dict)

    def layers(self, layer: Layer) -> Iterator[Layer]:
        """Yield the constant layer that equals a layer at this point; if its model is translated, several layers."""
        view_inputs = {
            name: source
            for name, source in {**layer.inputs, "mask": layer.mask}.items()
            if isinstance(source, Formula) and depends_on_view(source)
        }
        for values in look_layers(Look("", (layer,)), self.points):
            numbers = constant_numbers(values) | {
                name: value[self.index].tolist()
                for name, value in varying_numbers(values).items()
                if name not in view_inputs
            }
            inputs: dict[str, Input] = {
                name: tuple(value) if isinstance(value, list) else value for name, value in numbers.items()
            }
            inputs |= {name: self._fix_formula(source) for name, source in view_inputs.items()}
            mask = inputs.pop("mask")
            assert isinstance(mask, float | Formula), "masks are numbers"
            yield Layer(values.name, values.model, layer_tokens(values) | inputs, mask, values.mode)

    def _fix_source(self, source: InputSource, kind: ExpressionKind) -> InputSource:
        """Return the number of a source at this point or, if it depends on the view, an expression of just the view."""
        if depends_on_view(source):
            return self._fix_formula(source) if isinstance(source, Formula) else source
        # As a number, this is also the number of axes that a value has at one point: 0 for a number, 1 for a colour.
        color = kind == "color"
        value = np.asarray(SourceValues(self.points).source_value(source, color))
        number = (value[self.index] if value.ndim > color else value).tolist()
        return tuple(number) if color else number

    def _fix_formula(self, source: Formula) -> Formula:
        """Return a formula of the view whose other inputs have their values at this point."""
        if id(source) not in self._formulas:
            inputs = {name: self._fix_source(argument, source.kinds[name]) for name, argument in source.inputs.items()}
            self._formulas[id(source)] = replace(source, inputs=inputs)
        return self._formulas[id(source)]


def case_layer(model: str, values: Mapping[str, object], mode: str) -> dict[str, object]:
    """Return a layer as an object for `lookdev eval`, without parameters that have their default.

    `values` has the parameters and the mask by name.
    """

    def to_list(value: object) -> object:
        return list(value) if isinstance(value, tuple) else value

    inputs = {name: to_list(value) for name, value in values.items() if name != "mask"}
    parameters = MODELS[model].parameters
    defaults = {name: inputs.get(parameter.follows, parameter.default) for name, parameter in parameters.items()}
    params = {name: value for name, value in inputs.items() if value != to_list(defaults[name])}
    return {"model": model, "params": params, "mask": values["mask"], "mode": mode}


def case_line(batch: Batch, index: int, **extra: object) -> str:
    """Return one case of a batch, by its index, as a line for `lookdev eval`; `extra` has further keys of the line."""
    layers = []
    for layer, numbers in zip(batch.layers, batch.numbers, strict=True):
        values = {**layer.constants, **{name: value[index].tolist() for name, value in numbers.items()}}
        layers.append(case_layer(layer.model, {**layer.tokens, **values}, layer.mode))
    case = {"model": "stack", "layers": layers, "wo": batch.wo[index].tolist(), "wi": batch.wi[index].tolist()}
    return json.dumps(case | extra)


def _all_numbers(layer: StackLayer) -> dict[str, Floats]:
    """Return the mask and the numbers of a layer, by name, without numbers that follow others."""
    values = {"mask": layer.mask, **layer.parameters}
    left_out = {*layer_tokens(layer), *following_numbers(layer)}
    return {name: np.asarray(value, dtype=np.float64) for name, value in values.items() if name not in left_out}


def _shape(layer: StackLayer, name: str) -> tuple[int, ...]:
    """Return the shape of a number at one point."""
    return () if name == "mask" or MODELS[layer.model].parameters[name].kind == "float" else (3,)
