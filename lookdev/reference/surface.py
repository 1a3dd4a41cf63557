"""A look at points of a surface, in float64: constants, textures, primvars and expressions as arrays of numbers.

The rules are those by which `lookdev.codegen.inputs` writes shader code; nothing of that is used here.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lookdev.brdf import MASK, PARAMETERS, Bsdf, Parameter, StackLayer, complete_parameters, stack_bsdf
from lookdev.brdf.vectors import Array
from lookdev.material import Bump, Coordinates, Formula, Layer, Look, Primvar, Source, Texture, Varying
from lookdev.material.textures import sample_slopes, sample_texture

Floats = NDArray[np.float64]


class SurfacePoints(Protocol):
    """Points of a surface, as many as the arrays are long, and what the surface carries there."""

    def uv(self, name: str) -> Floats:
        """Return the coordinates (N, 2) of a UV set."""

    def primvar(self, primvar: Primvar) -> Floats:
        """Return the values of a primvar: (N,), or (N, 3) where its fallback is a colour."""

    def handedness(self) -> Floats:
        """Return on which side of the tangent v grows, (N,): +1 along cross(normal, tangent), or -1."""


def look_bsdf(look: Look, points: SurfacePoints) -> Bsdf:
    """Combine the layers of a look at some points.

    Parameters
    ----------
    look
        Its textures are looked up bilinearly, in float64.
    points
        Where; the BSDF takes directions (N, 3), one for each.

    Raises
    ------
    ModelError
        A constant is outside its hard range, or the layers do not fit together.
    TextureError
        An image is missing or unreadable.
    """
    return stack_bsdf(look_layers(look, points))


def look_layers(look: Look, points: SurfacePoints) -> list[StackLayer]:
    """Return the layers of a look at some points, base first: what is constant as it is, the rest an array of values.

    Raises
    ------
    ModelError, TextureError
        As `look_bsdf`.
    """
    values = _Values(points)
    return [
        StackLayer(layer.model, _parameters(layer, values), values.value(layer.mask, MASK), layer.mode)
        for layer in look.layers
    ]


def _parameters(layer: Layer, values: _Values) -> dict[str, Array]:
    known = PARAMETERS[layer.model]
    varying = {name: source for name, source in layer.inputs.items() if isinstance(source, Varying)}
    constants = {name: source for name, source in layer.inputs.items() if name not in varying}
    parameters = complete_parameters(layer.model, constants)
    for name in constants:
        if known[name].kind == "normal":
            parameters[name] = values.handed(parameters[name])
    return parameters | {name: values.value(source, known[name]) for name, source in varying.items()}


@dataclass(frozen=True)
class _Values:
    """What sources are worth at some points."""

    points: SurfacePoints

    def value(self, source: Varying | float, parameter: Parameter) -> Array:
        """Return an input, within its hard range: the number, or an array of one value a point."""
        if isinstance(source, Bump):
            slopes = sample_slopes(source.height, self.points.uv(source.height.st)) * source.scale
            value = np.stack([-slopes[:, 0], -slopes[:, 1], np.ones(len(slopes))], axis=-1)
        else:
            value = np.clip(self._read(source, parameter.kind == "color"), *parameter.hard)
        return self.handed(value) if parameter.kind == "normal" else value

    def handed(self, normal: Array) -> Array:
        """Bring normals (..., 3) from the frame of the UVs into the shading frame, whose bitangent is not v's."""
        if not normal[..., 1].any():
            return normal
        x, y, z = (np.broadcast_to(normal[..., i], self.points.handedness().shape) for i in range(3))
        return np.stack([x, y * self.points.handedness(), z], axis=-1)

    def _read(self, source: Source, color: bool) -> Array:
        """Return a value as it is; floats stand for three equal channels where a colour is wanted."""
        if isinstance(source, Texture):
            value, is_color = sample_texture(source, self.points.uv(source.st)), source.channel == "rgb"
        elif isinstance(source, Primvar):
            value, is_color = self.points.primvar(source), isinstance(source.fallback, tuple)
        elif isinstance(source, Coordinates):
            value, is_color = self._coordinates(source), True
        elif isinstance(source, Formula):
            read = {name: self._read(each, source.kinds[name] == "color") for name, each in source.inputs.items()}
            value = source.expression.evaluate(read, source.kinds)
            is_color = source.expression.check(source.kinds) == "color"
        else:
            value, is_color = np.asarray(source, dtype=np.float64), isinstance(source, tuple)
        return np.stack([value] * 3, axis=-1) if color and not is_color else value

    def _coordinates(self, place: Coordinates) -> Floats:
        matrix = np.array(place.transform).reshape(2, 3)
        st = self.points.uv(place.st) @ matrix[:, :2].T + matrix[:, 2]
        return np.concatenate([st, np.zeros((len(st), 1))], axis=-1)
