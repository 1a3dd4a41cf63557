"""Frames as checks render them: what is rendered, and by what."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lookdev.codegen import ShaderSource
from lookdev.render.task import FrameTask, SceneTask

Image = NDArray[np.float32]
Alter = Callable[[str], str]
"""Takes the text of a shader and returns the one to run: how a test plants a fault."""


class Halves(Protocol):
    """Two independent renders of a frame, (H, W, 3), premultiplied, without exposure, and their coverage (H, W)."""

    @property
    def a(self) -> Image: ...

    @property
    def b(self) -> Image: ...

    @property
    def alpha(self) -> Image: ...


Render = Callable[[FrameTask], Halves]
"""Renders a frame by the worker of its backend."""


def unaltered(osl: str) -> str:
    """Return the text of a shader as it is."""
    return osl


def altered(scene: SceneTask, alter: Alter) -> SceneTask:
    """Return a scene with the text of its shaders altered."""
    sources = [
        replace(source, osl=alter(source.osl)) if isinstance(source, ShaderSource) else source
        for source in scene.shaders
    ]
    return replace(scene, shaders=tuple(sources))
