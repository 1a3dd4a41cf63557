"""The types of the frames that checks render, and functions that alter the shaders of a scene."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Protocol

from lookdev.arrays import Floats32
from lookdev.codegen.source import GeneratedSource, ShaderSource
from lookdev.rendering.task import FrameTask, SceneTask

AlterShader = Callable[[str], str]
"""A function that takes the text of a shader and returns the text to run in its place. Tests plant faults with it."""


class Halves(Protocol):
    """A frame as two independent renders `a` and `b`, (H, W, 3), and their coverage `alpha`, (H, W).

    The halves are premultiplied and have no exposure applied.
    """

    @property
    def a(self) -> Floats32: ...

    @property
    def b(self) -> Floats32: ...

    @property
    def alpha(self) -> Floats32: ...


RenderHalves = Callable[[FrameTask], Halves]
"""A function that renders a frame in the worker of its backend."""


def keep_shader(osl: str) -> str:
    """Return the text of a shader unchanged; it is the default where an `AlterShader` is a parameter."""
    return osl


def alter_shaders(scene: SceneTask, alter: AlterShader) -> SceneTask:
    """Return a scene with the texts of its OSL shaders altered."""

    def alter_source(source: GeneratedSource) -> GeneratedSource:
        return replace(source, osl=alter(source.osl)) if isinstance(source, ShaderSource) else source

    return replace(scene, shaders=tuple(map(alter_source, scene.shaders)))
