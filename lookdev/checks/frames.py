"""Frames of checks: their task, and the function that renders them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lookdev.codegen import ShaderSource, Source
from lookdev.rendering.task import FrameTask, SceneTask

Image = NDArray[np.float32]
Alter = Callable[[str], str]
"""Takes the text of a shader and returns the one to run; tests plant faults by it."""


class Halves(Protocol):
    """Independent halves (H, W, 3) of a frame, premultiplied, without exposure, and their coverage (H, W)."""

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

    def changed(source: Source) -> Source:
        return replace(source, osl=alter(source.osl)) if isinstance(source, ShaderSource) else source

    return replace(scene, shaders=tuple(map(changed, scene.shaders)))
