"""Analytic shapes, the built-in assets of the same names, and how rays meet them.

A point handed to `onward` or `frame` lies on the surface: where a ray goes on from is known exactly, so that no
tolerance decides whether a surface shades itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]


class Shape(Protocol):
    """A surface in world space, seen from outside. All directions are unit vectors (N, 3)."""

    def hit(self, origin: Floats, ray: Floats) -> tuple[Mask, Floats]:
        """Return which rays from `origin` (3,) meet the shape, (N,), and where first, (N, 3)."""

    def onward(self, point: Floats, direction: Floats) -> tuple[Mask, Floats]:
        """Return which rays that leave `point` (N, 3) meet the shape again, (N,), and where, (N, 3)."""

    def frame(self, point: Floats, wo: Floats) -> Floats:
        """Return the shading frames (N, 3, 3) at `point` (N, 3) seen along `wo`.

        Rows are the tangent, along increasing u; the bitangent, cross(normal, tangent); and the normal. For a
        viewer behind the surface all three are turned about: the normal faces every viewer.
        """


@dataclass(frozen=True)
class Sphere:
    """The built-in ``sphere``, a closed thin shell: u runs around z, counter-clockwise from above."""

    center: tuple[float, float, float] = (0.0, 0.0, 0.0)
    radius: float = 1.0

    def hit(self, origin: Floats, ray: Floats) -> tuple[Mask, Floats]:
        """See `Shape.hit`; `origin` is outside."""
        start = origin - np.array(self.center)
        b = ray @ start
        discriminant = b * b - (start @ start - self.radius**2)
        hit = (discriminant > 0.0) & (b < 0.0)
        distance = -b - np.sqrt(np.where(hit, discriminant, 0.0))
        return hit, origin + distance[:, None] * ray

    def onward(self, point: Floats, direction: Floats) -> tuple[Mask, Floats]:
        """See `Shape.onward`: a ray that goes in meets the far wall, one that goes out meets nothing."""
        normal = self._outward(point)
        cosine = _dot(normal, direction)
        chord = -2.0 * self.radius * cosine
        return cosine[:, 0] < 0.0, point + chord * direction

    def frame(self, point: Floats, wo: Floats) -> Floats:
        """See `Shape.frame`."""
        normal = self._outward(point)
        azimuth = np.arctan2(normal[:, 1], normal[:, 0])
        tangent = np.stack([-np.sin(azimuth), np.cos(azimuth), np.zeros_like(azimuth)], axis=-1)
        return _facing(tangent, normal, wo)

    def _outward(self, point: Floats) -> Floats:
        normal = point - np.array(self.center)
        # Not by the radius: rounding would grow from bounce to bounce.
        return np.asarray(normal / np.linalg.norm(normal, axis=-1, keepdims=True))


@dataclass(frozen=True)
class Plane:
    """The built-in ``plane``: a thin square card about the origin, 2 m wide, front along -y, u along +x."""

    def hit(self, origin: Floats, ray: Floats) -> tuple[Mask, Floats]:
        """See `Shape.hit`; a ray along the card misses it."""
        ahead = origin[1] * ray[:, 1] < 0.0
        distance = -origin[1] / np.where(ahead, ray[:, 1], 1.0)
        point = (origin + distance[:, None] * ray) * (1.0, 0.0, 1.0)
        return ahead & (np.abs(point) < 1.0).all(axis=-1), point

    def onward(self, point: Floats, direction: Floats) -> tuple[Mask, Floats]:
        """See `Shape.onward`: nothing that leaves a card meets it again."""
        return np.zeros(len(direction), np.bool_), point

    def frame(self, point: Floats, wo: Floats) -> Floats:
        """See `Shape.frame`."""
        tangent = np.broadcast_to(np.array([1.0, 0.0, 0.0]), point.shape)
        normal = np.broadcast_to(np.array([0.0, -1.0, 0.0]), point.shape)
        return _facing(tangent, normal, wo)


def _facing(tangent: Floats, normal: Floats, wo: Floats) -> Floats:
    frame = np.stack([tangent, np.cross(normal, tangent), normal], axis=1)
    return np.where(_dot(normal, wo)[..., None] < 0.0, -frame, frame)


def _dot(a: Floats, b: Floats) -> Floats:
    """Return the dot product over the last axis, kept as an axis of length 1."""
    return np.asarray(np.einsum("ni,ni->n", a, b)[:, None])
