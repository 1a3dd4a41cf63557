"""The setting that a source is generated for, besides its look."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from lookdev.codegen.source import Catching
from lookdev.light import Light
from lookdev.scene import Sampling
from lookdev.space import REC709, Space

if TYPE_CHECKING:
    from lookdev.material import Bump, Texture


@dataclass(frozen=True)
class SourceSetting:
    """The lights and the sampling that a source is generated for.

    Attributes
    ----------
    lights
        Their code and its constants are part of a source, their files and numbers are not.
    resolution
        Width and height of the picture in pixels: each pixel has a scramble of its own.
    sampling
        Directions that are None are as many as suit the look.
    shadows
        Whether the asset can occlude light; without shadows there are no bounces either.
    catching
        In a scene with a shadow catcher: whether the look is that of the ground or of the asset.
    resolve
        Returns the linear EXR file of a texture, or that of the slopes of a height map; None: those of the cache.
    light_groups
        The number of the group of each light, where a pass records them.
    space
        The space of the lights, and of the light that is reflected.
    """

    lights: tuple[Light, ...]
    resolution: tuple[int, int]
    sampling: Sampling
    shadows: bool = True
    catching: Catching = ""
    resolve: Callable[[Texture | Bump], Path] | None = None
    light_groups: tuple[int, ...] = ()
    space: Space = REC709

    def image_file(self, source: Texture | Bump) -> Path:
        """Return the file of an image."""
        # Imported where it is needed: workers decode sources, and read no texture's material.
        from lookdev.material.textures import image_file

        return (self.resolve or image_file)(source)
