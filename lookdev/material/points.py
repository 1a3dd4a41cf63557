"""Points of a surface with values in float64, at which `lookdev.material.values` evaluates a look.

Textures are looked up bilinearly in their images. Code that needs the look without a renderer uses these classes.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from lookdev.arrays import Floats
from lookdev.material import Primvar, Texture
from lookdev.material.textures import image_slopes, image_texels


class ImagePoints(ABC):
    """N points as a `lookdev.material.values.Surface` whose textures are read from their image files.

    Subclasses define `uv`, `primvar`, `handedness` and `view`.
    """

    @abstractmethod
    def uv(self, name: str) -> Floats:
        """Return the coordinates (N, 2) of a UV set."""

    def texels(self, texture: Texture) -> Floats:
        return image_texels(texture, self.uv(texture.st))

    def slopes(self, height: Texture) -> Floats:
        return image_slopes(height, self.uv(height.st))


@dataclass(frozen=True)
class SinglePoint(ImagePoints):
    """One point of a surface without primvars, seen from one or more directions.

    `cosine` has the cosines of these directions with the shading normal. `at` is the point's (s, t) in every UV set.
    """

    cosine: Floats
    at: tuple[float, float] = (0.5, 0.5)

    def uv(self, name: str) -> Floats:
        return np.array([self.at])

    def primvar(self, primvar: Primvar) -> Floats:
        return np.array([primvar.fallback], np.float64)

    def handedness(self) -> Floats:
        return np.ones(1)

    def view(self) -> Floats:
        return self.cosine
