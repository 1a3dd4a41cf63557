"""The setting for which a source is generated: everything except the look on which the source depends."""

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
    """The lights, the sampling and the picture for which a source is generated.

    Attributes
    ----------
    lights
        Their code and its constants are part of a source; their files and numbers are not.
    resolution
        Width and height of the picture in pixels: each pixel has a scramble of its own.
    sampling
        Numbers of directions that are None depend on the look.
    shadows
        Whether the asset can occlude light. Without shadows there are no bounces either.
    catching
        In a scene with a shadow catcher: whether the look is that of the ground or of the asset.
    resolve
        Returns the linear EXR file of a texture, or that of the slopes of a height map. If it is None, the files are
        those of the cache.
    light_groups
        The number of the group of each light, if a pass records groups.
    space
        The colour space of the lights and of reflected light.
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
        """Return the file of a texture, or of the slopes of a height map."""
        # This import is local as workers decode sources but do not read materials.
        from lookdev.material.textures import image_file

        return (self.resolve or image_file)(source)
