"""Shapes that emit light, in a light's own space, and the formulas that the renderers share.

A shape's fields are numbers, or symbolic arrays in their place: the generated code is traced from the same methods
(`lookdev.codegen.osl.rig`). Points and directions are (..., 3); directions are unit vectors away from the point.
"""

from __future__ import annotations

from dataclasses import Field
from typing import ClassVar, Protocol

import numpy as np

from lookdev.arrays import Floats
from lookdev.brdf.frames import ZENITH
from lookdev.brdf.vectors import Real, dot

FAR = 1e30
"""The distance in metres for a miss. It is finite because generated code has no infinity."""

INFINITE = 1e20
"""The distance in metres to a light that is infinitely far."""


class Shape(Protocol):
    """The shape of a lamp as seen from shading points: a dataclass of at most two sizes."""

    __dataclass_fields__: ClassVar[dict[str, Field[object]]]

    def __init__(self, *sizes: Real) -> None: ...

    def distance(self, point: Floats, direction: Floats) -> Floats:
        """Return metres (...) to the side that emits; `FAR` for misses, and from behind."""

    def pdf(self, point: Floats, direction: Floats) -> Floats:
        """Return the density (...) per steradian of `sample`."""

    def sample(self, point: Floats, u: Floats) -> Floats:
        """Map points `u` (..., 2) of the unit square to directions, nearly all of which hit the shape."""

    def solid_angle(self, point: Floats) -> Floats | float:
        """Return its rough solid angle (...) in steradians: positive wherever a ray can hit it, 0 from behind."""

    def cone(self, point: Floats) -> tuple[Floats, Floats]:
        """Return a cone that contains it: its axis (..., 3) and the squared sine (...) of its half angle, up to 1."""


def cone_about(point: Floats, reach: Real) -> tuple[Floats, Floats]:
    """Return the cone (`Shape.cone`) of directions from points (..., 3) to a sphere about the origin."""
    squared = dot(point, point)
    away = np.expand_dims(squared > 0, -1)
    axis = np.where(away, -point, ZENITH) / np.expand_dims(np.sqrt(np.where(squared > 0, squared, 1)), -1)
    return axis, np.minimum(reach * reach / np.where(squared > 0, squared, reach * reach), 1)


def greatest_cosine(axis: Floats, squared_sine: Floats, normal: Floats) -> Floats:
    """Return the largest cosine (...) of a normal (..., 3) to the directions of a cone, at least 0."""
    cosine = dot(axis, normal)
    rotated = cosine * np.sqrt(1 - squared_sine) + np.sqrt(squared_sine * np.maximum(1 - cosine * cosine, 0))
    inside = (squared_sine >= 1) | ((cosine > 0) & (cosine * cosine >= 1 - squared_sine))
    return np.where(inside, 1, np.maximum(rotated, 0))
