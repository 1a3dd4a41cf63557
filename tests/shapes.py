"""A sphere and a plane as analytic scenes of the reference renderer, each with one BSDF everywhere.

They have the shapes of the built-in assets of these names. A hit (3,) is the point of the surface. It is exact, so no
tolerance is needed to decide whether a surface shades itself.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from lookdev.arrays import Bools, Floats, Ints
from lookdev.brdf import Bsdf
from lookdev.scene import Camera, Pose

# A view of both shapes.
POSE = Pose(30.0, 75.0)
CAMERA = Camera(30.0, 20.0, (0.0, 0.0, 0.0), 5.9)
SIZE = (64, 64)
INSIDE = np.array([[32, 32], [25, 36], [38, 22]])  # column and row of pixels that both shapes cover completely


@dataclass(frozen=True)
class Shape:
    """The methods of a `lookdev.reference.render.ReferenceScene` that all shapes share; they are described there."""

    bsdf: Bsdf | None = field(default=None, kw_only=True)

    def points(self, hits: Floats) -> Floats:
        return hits

    def is_inside(self, hits: Floats, wo: Floats) -> Bools:
        return np.asarray(_dot(self._outward(hits), wo)[:, 0] < 0.0)

    def is_reached_by(self, hits: Floats, light: int) -> None:
        """Return None: all lights light all of the shape."""

    def bsdfs(self, hits: Floats, view: Floats) -> Iterator[tuple[Ints, Bsdf]]:
        assert self.bsdf is not None
        yield np.arange(len(hits)), self.bsdf


@dataclass(frozen=True)
class Sphere(Shape):
    """The built-in ``sphere``, a closed thin shell.

    The texture coordinate u runs around z, counter-clockwise from above.
    """

    center: tuple[float, float, float] = (0.0, 0.0, 0.0)
    radius: float = 1.0

    def intersect(self, origin: Floats, ray: Floats) -> tuple[Bools, Floats]:
        """Return the rays that hit, and the hits; `origin` (3,) is outside of the sphere."""
        start = origin - np.array(self.center)
        b = ray @ start
        discriminant = b * b - (start @ start - self.radius**2)
        hit = (discriminant > 0.0) & (b < 0.0)
        distance = -b - np.sqrt(np.where(hit, discriminant, 0.0))
        return hit, origin + distance[:, None] * ray

    def trace_onward(self, hits: Floats, direction: Floats) -> tuple[Bools, Floats]:
        cosine = _dot(self._outward(hits), direction)
        return cosine[:, 0] < 0.0, hits - 2.0 * self.radius * cosine * direction

    def frame(self, hits: Floats, wo: Floats) -> tuple[Floats, Floats]:
        normal = self._outward(hits)
        azimuth = np.arctan2(normal[:, 1], normal[:, 0])
        tangent = np.stack([-np.sin(azimuth), np.cos(azimuth), np.zeros_like(azimuth)], axis=-1)
        return _facing(tangent, normal, wo)

    def _outward(self, hits: Floats) -> Floats:
        normal = hits - np.array(self.center)
        # Divided by its length: if it were divided by the radius, rounding errors would grow from bounce to bounce.
        return np.asarray(normal / np.linalg.norm(normal, axis=-1, keepdims=True))


@dataclass(frozen=True)
class Plane(Shape):
    """The built-in ``plane``: a thin square card about the origin, 2 m wide.

    Its front faces -y, and the texture coordinate u runs along +x.
    """

    def intersect(self, origin: Floats, ray: Floats) -> tuple[Bools, Floats]:
        """Return the rays that hit, and the hits; a ray parallel to the card misses it."""
        ahead = origin[1] * ray[:, 1] < 0.0
        distance = -origin[1] / np.where(ahead, ray[:, 1], 1.0)
        point = (origin + distance[:, None] * ray) * (1.0, 0.0, 1.0)
        return ahead & (np.abs(point) < 1.0).all(axis=-1), point

    def trace_onward(self, hits: Floats, direction: Floats) -> tuple[Bools, Floats]:
        return np.zeros(len(direction), np.bool_), hits

    def frame(self, hits: Floats, wo: Floats) -> tuple[Floats, Floats]:
        return _facing(np.broadcast_to(np.array([1.0, 0.0, 0.0]), hits.shape), self._outward(hits), wo)

    def _outward(self, hits: Floats) -> Floats:
        return np.broadcast_to(np.array([0.0, -1.0, 0.0]), hits.shape)


def _facing(tangent: Floats, normal: Floats, wo: Floats) -> tuple[Floats, Floats]:
    """Return frames (N, 3, 3) and normals (N, 3), flipped to the side of the viewer."""
    frame = np.stack([tangent, np.cross(normal, tangent), normal], axis=1)
    frame = np.where(_dot(normal, wo)[..., None] < 0.0, -frame, frame)
    return frame, frame[:, 2]


def _dot(a: Floats, b: Floats) -> Floats:
    """Return the dot product over the last axis, kept as an axis of length 1."""
    return np.asarray(np.einsum("ni,ni->n", a, b)[:, None])
