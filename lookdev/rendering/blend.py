"""The task of the exporter of a .blend: the scenes of a job, as plain data."""

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
    """Lights of a job: `strength` multiplies their radiance, `turn` degrees about z are beyond those of the poses."""

    name: str
    lights: tuple[AnyLight, ...]
    strength: float
    turn: float


@dataclass(frozen=True)
class BlendTurntable:
    """A stretch of the timeline: one frame for each pose."""

    name: str
    poses: tuple[Pose, ...]


@dataclass(frozen=True)
class BlendImage:
    """An image that looks or lights read, and its path relative to the .blend."""

    content: Content
    path: str


@dataclass(frozen=True)
class BlendTask:
    """A .blend to be written. Rigs and turntables are in the order of the job, at least one of each."""

    file: Path
    scenes: Mapping[str, SceneTask]  # by the name of the look; sources are nodes, the lights those of the first rig
    rigs: tuple[BlendRig, ...]
    turntables: tuple[BlendTurntable, ...]  # their frames are numbered consecutively from 1
    images: tuple[BlendImage, ...]
    pack: bool  # images into the .blend; otherwise they lie at their relative paths
    view: str  # of the pictures of a job
    show_light: bool  # behind the asset


BLEND_TASK = TypeAdapter(BlendTask)
"""A task as JSON and back; floats survive exactly."""
