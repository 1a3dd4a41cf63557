"""The task of the .blend exporter: the scenes of a job, as plain data."""

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
    """The lights of a rig: `strength` multiplies their radiance, `turn` adds degrees about z to those of a pose."""

    name: str
    lights: tuple[AnyLight, ...]
    strength: float
    turn: float


@dataclass(frozen=True)
class BlendTurntable:
    """A range of the timeline: one frame for each pose."""

    name: str
    poses: tuple[Pose, ...]


@dataclass(frozen=True)
class BlendImage:
    """An image that looks or lights read, and its path relative to the .blend."""

    content: Content
    path: str


@dataclass(frozen=True)
class BlendTask:
    """The .blend to write. Rigs and turntables are in the order of the job, at least one of each."""

    file: Path
    scenes: Mapping[str, SceneTask]  # by the name of the look; with node sources, and the lights of the first rig
    rigs: tuple[BlendRig, ...]
    turntables: tuple[BlendTurntable, ...]  # their frames are numbered consecutively from 1
    images: tuple[BlendImage, ...]
    pack: bool  # whether images go into the .blend; if not, they lie at their relative paths
    view: str  # the OpenColorIO view of the job's pictures
    show_light: bool  # whether the light is visible behind the asset


BLEND_TASK = TypeAdapter(BlendTask)
"""A task as JSON and back; floats survive exactly."""
