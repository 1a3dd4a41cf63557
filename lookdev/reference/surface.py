"""Points of a surface in float64: images are looked up bilinearly, as arrays of numbers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lookdev.brdf import Bsdf, StackLayer
from lookdev.material import Look, Primvar, Texture, values
from lookdev.material.textures import image_slopes, image_texels

Floats = NDArray[np.float64]


class SurfacePoints(Protocol):
    """Points of a surface, as many as the arrays are long, and what the geometry carries there."""

    def uv(self, name: str) -> Floats:
        """Return the coordinates (N, 2) of a UV set."""

    def primvar(self, primvar: Primvar) -> Floats:
        """Return the values of a primvar: (N,), or (N, 3) where its fallback is a colour."""

    def handedness(self) -> Floats:
        """Return on which side of the tangent v grows, (N,): +1 along cross(normal, tangent), or -1."""


@dataclass(frozen=True)
class _Sampled:
    """Points with images: a `lookdev.material.values.Surface`."""

    points: SurfacePoints

    def uv(self, name: str) -> Floats:
        return self.points.uv(name)

    def texels(self, texture: Texture) -> Floats:
        return image_texels(texture, self.points.uv(texture.st))

    def slopes(self, height: Texture) -> Floats:
        return image_slopes(height, self.points.uv(height.st))

    def primvar(self, primvar: Primvar) -> Floats:
        return self.points.primvar(primvar)

    def handedness(self) -> Floats:
        return self.points.handedness()


def look_bsdf(look: Look, points: SurfacePoints) -> Bsdf:
    """Combine the layers of a look at some points, as `lookdev.material.values.look_bsdf`.

    The BSDF takes directions (N, 3), one for each point.
    """
    return values.look_bsdf(look, _Sampled(points))


def look_layers(look: Look, points: SurfacePoints) -> list[StackLayer]:
    """Return the layers of a look at some points, as `lookdev.material.values.look_layers`."""
    return values.look_layers(look, _Sampled(points))
