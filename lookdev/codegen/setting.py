"""Define `SourceSetting`, all that the generated code of a look depends on, except the look itself.

The renderer makes a setting for each scene, and passes it to the code generators with each look.
"""

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
    """The lights, the sampling and the picture for which code (a `GeneratedSource`) is generated.

    Attributes
    ----------
    lights
        The lights of the scene. The code of a light's kind is part of the generated code; the light's files and numbers
        are not.
    resolution
        Width and height of the picture in pixels. The code depends on them because each pixel has its own scramble of
        the sample sequence.
    sampling
        How light is sampled. If a number of directions is None, it is chosen for each look.
    shadows
        Whether the asset can occlude light. Without shadows there are no bounces either.
    catching
        In a scene with a shadow catcher, ``"ground"`` or ``"asset"``: the one that has the look. Else ``""``.
    resolve
        A function that returns the linear EXR file of a texture, or the file of the slopes of a height map. If it is
        None, the files are those of the cache.
    light_groups
        If a pass records groups of lights: the number of each light's group, in the order of `lights`. Else empty.
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
        # The import is local because worker processes load this module to decode sources, and do not read materials.
        from lookdev.material.textures import image_file

        return (self.resolve or image_file)(source)
