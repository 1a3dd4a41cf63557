"""The inputs of a look at random points of a surface, as numbers."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lookdev.brdf import MODELS, StackLayer
from lookdev.checks.evaluate import Batch
from lookdev.material import Formula, Layer, Look, Primvar
from lookdev.material.expression import Kind
from lookdev.material.look import depends_on_view
from lookdev.material.points import ImagePoints
from lookdev.material.values import Values, look_layers

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class _RandomPoints(ImagePoints):
    """Random points with all UV sets and primvars, in [0, 1), and views.

    A quarter lacks a primvar, half have mirrored UVs.
    """

    rng: np.random.Generator
    count: int
    _known: dict[object, Floats] = field(default_factory=dict)

    def uv(self, name: str) -> Floats:
        return self._keep(("uv", name), lambda: self.rng.random((self.count, 2)))

    def primvar(self, primvar: Primvar) -> Floats:
        shape = (self.count, 3) if isinstance(primvar.fallback, tuple) else (self.count,)

        def draw() -> Floats:
            values = self.rng.random(shape)
            values[: self.count // 4] = primvar.fallback
            return values

        return self._keep(primvar, draw)

    def handedness(self) -> Floats:
        return self._keep("handedness", lambda: self.rng.choice([-1.0, 1.0], self.count))

    def view(self) -> Floats:
        return self._keep("view", lambda: 1.0 - self.rng.random(self.count))

    def _keep(self, key: object, draw: Any) -> Floats:
        if key not in self._known:
            self._known[key] = draw()
        return self._known[key]


def sample_layers(look: Look, count: int, rng: np.random.Generator) -> list[StackLayer]:
    """Return the layers of a look at random points, (count,), constants as they are; errors as `look_bsdf`."""
    return look_layers(look, _RandomPoints(rng, count))


def varying(layer: StackLayer) -> dict[str, Floats]:
    """Return the mask and the numbers of a layer that differ from point to point, by name."""
    return {name: value for name, value in _numbers(layer).items() if value.ndim > len(_shape(layer, name))}


def constant(layer: StackLayer) -> dict[str, float | list[float]]:
    """Return the mask and the numbers of a layer that are the same everywhere, by name."""
    return {name: value.tolist() for name, value in _numbers(layer).items() if value.ndim == len(_shape(layer, name))}


def tokens(layer: StackLayer) -> dict[str, str]:
    """Return the tokens of a layer, by name."""
    return {name: value for name, value in layer.parameters.items() if isinstance(value, str)}


def following(layer: StackLayer) -> frozenset[str]:
    """Return the numbers of a layer that are not given: they have the value of those that they follow."""
    known, values = MODELS[layer.model].parameters, layer.parameters
    return frozenset(name for name, each in known.items() if each.follows and values[name] is values[each.follows])


def constant_looks(look: Look, count: int, rng: np.random.Generator) -> list[Look]:
    """Return the look that is constant at each of `count` random points, or one where all of them are equal.

    What depends on the view remains an expression of it.
    """
    points = _RandomPoints(rng, count)
    places = [_At(points, index) for index in range(count)]
    looks = [replace(look, layers=tuple(each for own in look.layers for each in at.layers(own))) for at in places]
    return looks if any(each != looks[0] for each in looks) else looks[:1]


@dataclass(frozen=True)
class _At:
    """One of some random points."""

    points: _RandomPoints
    index: int
    _formulas: dict[int, Formula] = field(default_factory=dict)

    def layers(self, own: Layer) -> Iterator[Layer]:
        """Yield the constant layers that a layer of a look is here."""
        of_view = {name: each for name, each in {**own.inputs, "mask": own.mask}.items() if depends_on_view(each)}
        for values in look_layers(Look("", (own,)), self.points):
            numbers = constant(values) | {
                name: value[self.index].tolist() for name, value in varying(values).items() if name not in of_view
            }
            inputs: dict[str, Any] = {
                name: tuple(value) if isinstance(value, list) else value for name, value in numbers.items()
            }
            inputs |= {name: self._source(each, "float") for name, each in of_view.items()}
            mask = inputs.pop("mask")
            yield Layer(values.name, values.model, tokens(values) | inputs, mask, values.mode)

    def _source(self, source: Any, kind: Kind) -> Any:
        """Return a source with numbers for what it reads, but for the view; otherwise the number that it is."""
        if not depends_on_view(source):
            color = kind == "color"
            value = np.asarray(Values(self.points).read(source, color))
            number = (value[self.index] if value.ndim > color else value).tolist()
            return tuple(number) if color else number
        if isinstance(source, Formula) and id(source) not in self._formulas:
            inputs = {name: self._source(each, source.kinds[name]) for name, each in source.inputs.items()}
            self._formulas[id(source)] = replace(source, inputs=inputs)
        return self._formulas.get(id(source), source)


def case_layer(model: str, values: Mapping[str, Any], mode: str) -> dict[str, Any]:
    """Return a layer, its mask among the values, as `lookdev eval` takes it, without inputs that have their default."""

    def plain(value: Any) -> Any:
        return list(value) if isinstance(value, tuple) else value

    inputs = {name: plain(value) for name, value in values.items() if name != "mask"}
    known = MODELS[model].parameters
    usual = {name: inputs.get(parameter.follows, parameter.default) for name, parameter in known.items()}
    params = {name: value for name, value in inputs.items() if value != plain(usual[name])}
    return {"model": model, "params": params, "mask": values["mask"], "mode": mode}


def case_line(batch: Batch, index: int, **extra: object) -> str:
    """Return one case as a line for `lookdev eval`, with the keys of `extra`."""
    layers = []
    for layer, numbers in zip(batch.layers, batch.numbers, strict=True):
        values = {**layer.constants, **{name: value[index].tolist() for name, value in numbers.items()}}
        layers.append(case_layer(layer.model, {**layer.tokens, **values}, layer.mode))
    case = {"model": "stack", "layers": layers, "wo": batch.wo[index].tolist(), "wi": batch.wi[index].tolist()}
    return json.dumps(case | extra)


def _numbers(layer: StackLayer) -> dict[str, Floats]:
    values = {"mask": layer.mask, **layer.parameters}
    left_out = {*tokens(layer), *following(layer)}
    return {name: np.asarray(value, dtype=np.float64) for name, value in values.items() if name not in left_out}


def _shape(layer: StackLayer, name: str) -> tuple[int, ...]:
    return () if name == "mask" or MODELS[layer.model].parameters[name].kind == "float" else (3,)
