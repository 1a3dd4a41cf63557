"""Shapes that send light, in a light's own space, and the formulas that the renderers share.

A shape's fields are numbers, or symbolic arrays in their place: generated code follows the same methods
(`lookdev.codegen.osl.rig`). Places and directions are (..., 3), directions are unit vectors away from the place.
"""

from __future__ import annotations

from typing import Any, Protocol, TypeAlias

import numpy as np

from lookdev.brdf.frames import ZENITH
from lookdev.brdf.vectors import dot

Floats: TypeAlias = Any
"""An array, or a symbolic one in its place."""

FAR = 1e30
"""Metres to what is missed: finite, since generated code has no infinity."""

INFINITE = 1e20
"""Metres to what is infinitely far."""


class Shape(Protocol):
    """What places see of a light."""

    def distance(self, place: Floats, direction: Floats) -> Floats:
        """Return metres (...) to the side that emits; `FAR` where it is missed, or met from behind."""

    def pdf(self, place: Floats, direction: Floats) -> Floats:
        """Return the density (...) per steradian of `sample`."""

    def sample(self, place: Floats, u: Floats) -> Floats:
        """Map points `u` (..., 2) of the unit square to directions, nearly all of which meet the shape."""

    def solid_angle(self, place: Floats) -> Floats:
        """Return steradians (...) at which it is seen, roughly: positive wherever it can be met, 0 from behind."""

    def cone(self, place: Floats) -> tuple[Floats, Floats]:
        """Return a cone that contains it: axis (..., 3), square (...) of the sine of its half angle, up to 1."""


def cone_about(place: Floats, reach: Any) -> tuple[Floats, Floats]:
    """Return the cone (`Shape.cone`) in which places see a sphere about the origin."""
    squared = dot(place, place)
    away = np.expand_dims(squared > 0, -1)
    axis = np.where(away, -place, ZENITH) / np.expand_dims(np.sqrt(np.where(squared > 0, squared, 1)), -1)
    return axis, np.minimum(reach * reach / np.where(squared > 0, squared, reach * reach), 1)


def greatest_cosine(axis: Floats, squared_sine: Floats, normal: Floats) -> Floats:
    """Return the largest cosine (...) of a normal (..., 3) to the directions of a cone, at least 0."""
    cosine = dot(axis, normal)
    turned = cosine * np.sqrt(1 - squared_sine) + np.sqrt(squared_sine * np.maximum(1 - cosine * cosine, 0))
    inside = (squared_sine >= 1) | ((cosine > 0) & (cosine * cosine >= 1 - squared_sine))
    return np.where(inside, 1, np.maximum(turned, 0))
