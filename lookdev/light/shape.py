"""Shapes that emit light: intersection, sampling and bounds, for NumPy and for generated shader code.

`lookdev.codegen.program.lamps` traces the methods of a shape: it calls them with symbolic arrays instead of numbers,
and writes their operations as code. Points and directions are (..., 3), in the light's own space. Directions are unit
vectors away from the point.
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
    """The shape of a lamp as seen from shading points: a dataclass whose fields are at most two sizes."""

    __dataclass_fields__: ClassVar[dict[str, Field[object]]]

    def __init__(self, *sizes: Real) -> None: ...

    def distance(self, point: Floats, direction: Floats) -> Floats:
        """Return metres (...) along the ray to the emitting side; `FAR` for a miss, and for a ray from behind."""

    def pdf(self, point: Floats, direction: Floats) -> Floats:
        """Return the density (...) per steradian of `sample`."""

    def sample(self, point: Floats, u: Floats) -> Floats:
        """Map points `u` (..., 2) of the unit square to directions, nearly all of which hit the shape."""

    def solid_angle(self, point: Floats) -> Floats | float:
        """Return an estimate (...) of the shape's solid angle in steradians: 0 only where no ray can hit it."""

    def cone(self, point: Floats) -> tuple[Floats, Floats]:
        """Return the axis (..., 3) and the squared sine (...) of the half angle of a cone that contains the shape.

        A squared sine of 1 stands for all directions.
        """


def cone_about(point: Floats, reach: Real) -> tuple[Floats, Floats]:
    """Return the `LampShape.cone` of a sphere of radius `reach` about the origin, seen from points (..., 3)."""
    squared = dot(point, point)
    away = np.expand_dims(squared > 0, -1)
    axis = np.where(away, -point, ZENITH) / np.expand_dims(np.sqrt(np.where(squared > 0, squared, 1)), -1)
    return axis, np.minimum(reach * reach / np.where(squared > 0, squared, reach * reach), 1)


def greatest_cosine(axis: Floats, squared_sine: Floats, normal: Floats) -> Floats:
    """Return the largest cosine (...) between a normal (..., 3) and directions of a `LampShape.cone`, at least 0."""
    cosine = dot(axis, normal)
    rotated = cosine * np.sqrt(1 - squared_sine) + np.sqrt(squared_sine * np.maximum(1 - cosine * cosine, 0))
    inside = (squared_sine >= 1) | ((cosine > 0) & (cosine * cosine >= 1 - squared_sine))
    return np.where(inside, 1, np.maximum(rotated, 0))


def uniform_pdf(versine: Real) -> Real:
    """Return the pdf (...) per steradian of `draw_uniform` in a cone; `versine` is 1 - cos of its half angle."""
    return 1 / (2 * math.pi * versine)


def draw_uniform(versine: Real, u: Floats) -> Floats:
    """Map points u (..., 2) of the unit square to directions (..., 3), uniform in cones about z; see `uniform_pdf`."""
    versine_drawn = u[..., 0] * versine
    sine, angle = np.sqrt(versine_drawn * (2 - versine_drawn)), 2 * math.pi * u[..., 1]
    return np.stack([sine * np.cos(angle), sine * np.sin(angle), 1 - versine_drawn], axis=-1)


def orient_to_axis(axis: Floats, local: Floats) -> Floats:
    """Transform vectors `local` (..., 3) from frames whose z axes are the unit vectors `axis` (..., 3).

    The frames are those of Duff et al., "Building an Orthonormal Basis, Revisited", 2017.
    """
    x, y, z = np.moveaxis(axis, -1, 0)
    sign = np.where(z < 0, -np.ones_like(z), np.ones_like(z))
    a = -1 / (sign + z)
    b = x * y * a
    tangent = np.stack([1 + sign * x * x * a, sign * b, -sign * x], axis=-1)
    bitangent = np.stack([b, sign + y * y * a, -y], axis=-1)
    world: Floats = local[..., :1] * tangent + local[..., 1:2] * bitangent + local[..., 2:] * axis
    return world
