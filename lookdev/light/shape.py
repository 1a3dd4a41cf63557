"""Shapes that emit light, in a light's own space, and the formulas that the renderers share.

A shape's fields are numbers, or symbolic arrays in their place: the generated code is traced from the same methods
(`lookdev.codegen.program.lamps`). Points and directions are (..., 3); directions are unit vectors away from the point.
"""

from __future__ import annotations

import math
from dataclasses import Field
from typing import ClassVar, Protocol

import numpy as np

from lookdev.arrays import Floats
from lookdev.brdf.frames import ZENITH
from lookdev.brdf.vectors import Real, dot

FAR = 1e30
"""The distance in metres for a miss. It is finite because generated code has no infinity."""

INFINITE_DISTANCE = 1e20
"""The distance in metres to a light that is infinitely far."""


class LampShape(Protocol):
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
    """Return the cone (`LampShape.cone`) of directions from points (..., 3) to a sphere about the origin."""
    squared = dot(point, point)
    away = np.expand_dims(squared > 0, -1)
    axis = np.where(away, -point, ZENITH) / np.expand_dims(np.sqrt(np.where(squared > 0, squared, 1)), -1)
    return axis, np.minimum(reach * reach / np.where(squared > 0, squared, reach * reach), 1)


def greatest_cosine(axis: Floats, squared_sine: Floats, normal: Floats) -> Floats:
    """Return the largest cosine (...) between a normal (..., 3) and the directions of a cone, at least 0."""
    cosine = dot(axis, normal)
    rotated = cosine * np.sqrt(1 - squared_sine) + np.sqrt(squared_sine * np.maximum(1 - cosine * cosine, 0))
    inside = (squared_sine >= 1) | ((cosine > 0) & (cosine * cosine >= 1 - squared_sine))
    return np.where(inside, 1, np.maximum(rotated, 0))


def uniform_pdf(versine: Real) -> Real:
    """Return the pdf (...) per steradian of `draw_uniform`; `versine` is 1 - cos of the cone's half angle."""
    return 1 / (2 * math.pi * versine)


def draw_uniform(versine: Real, u: Floats) -> Floats:
    """Map points u (..., 2) of the unit square to directions (..., 3), uniform in cones about z."""
    versine_drawn = u[..., 0] * versine
    sine, angle = np.sqrt(versine_drawn * (2 - versine_drawn)), 2 * math.pi * u[..., 1]
    return np.stack([sine * np.cos(angle), sine * np.sin(angle), 1 - versine_drawn], axis=-1)


def orient_to_axis(axis: Floats, local: Floats) -> Floats:
    """Transform vectors `local` (..., 3) from frames about the unit vectors `axis` (..., 3), their z, to the world.

    Duff et al., "Building an Orthonormal Basis, Revisited", 2017.
    """
    x, y, z = np.moveaxis(axis, -1, 0)
    sign = np.where(z < 0, -np.ones_like(z), np.ones_like(z))
    a = -1 / (sign + z)
    b = x * y * a
    tangent = np.stack([1 + sign * x * x * a, sign * b, -sign * x], axis=-1)
    bitangent = np.stack([b, sign + y * y * a, -y], axis=-1)
    world: Floats = local[..., :1] * tangent + local[..., 1:2] * bitangent + local[..., 2:] * axis
    return world
