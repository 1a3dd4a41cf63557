"""Points of a surface in float64, with images looked up bilinearly."""

from __future__ import annotations

from abc import ABC, abstractmethod

from lookdev.arrays import Floats
from lookdev.material import Texture
from lookdev.material.textures import image_slopes, image_texels


class ImagePoints(ABC):
    """N points as a `lookdev.material.values.Surface`; subclasses define `uv`, `primvar`, `handedness` and `view`."""

    @abstractmethod
    def uv(self, name: str) -> Floats:
        """Return the coordinates (N, 2) of a UV set."""

    def texels(self, texture: Texture) -> Floats:
        return image_texels(texture, self.uv(texture.st))

    def slopes(self, height: Texture) -> Floats:
        return image_slopes(height, self.uv(height.st))
