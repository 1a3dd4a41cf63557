"""The task of the .blend exporter: the scenes of a job, as plain data.

`lookdev export blend` sends it as JSON to a process that imports Blender (`lookdev.cycles.export_blend`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from pydantic import TypeAdapter

from lookdev.cache import Content
from lookdev.light import AnyLight
from lookdev.rendering.task import SceneTask
from lookdev.scene import Pose


@dataclass(frozen=True)
class BlendRig:
    """The lights of a rig.

    `strength` multiplies the radiance of all lights. `turn` is an angle in degrees about z, which is added to the
    lighting angle of every pose.
    """

    name: str
    lights: tuple[AnyLight, ...]
    strength: float
    turn: float


@dataclass(frozen=True)
class BlendTurntable:
    """A turntable, which becomes a range of the timeline: one frame for each pose."""

    name: str
    poses: tuple[Pose, ...]


@dataclass(frozen=True)
class BlendImage:
    """An image that looks or lights read, and its path relative to the .blend."""

    content: Content
    path: str


@dataclass(frozen=True)
class BlendTask:
    """The .blend file to write, and its content.

    Rigs and turntables are in the order of the job. There is at least one of each.
    """

    file: Path
    scenes: Mapping[str, SceneTask]  # by the name of the look; sources are nodes, and lights are from the first rig
    rigs: tuple[BlendRig, ...]
    turntables: tuple[BlendTurntable, ...]  # their frames are numbered consecutively from 1
    images: tuple[BlendImage, ...]
    pack: bool  # whether images go into the .blend; if not, they lie at their relative paths
    view: str  # the OpenColorIO view of the job's pictures
    show_light: bool  # whether the light is visible behind the asset


BLEND_TASK = TypeAdapter(BlendTask)
"""Writes a task as JSON and reads it; floats survive exactly."""
