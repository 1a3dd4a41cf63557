"""The task of the exporter of a .blend: the scenes of a job, as plain data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from pydantic import TypeAdapter

from lookdev.cache import Content
from lookdev.light import AnyLight
from lookdev.render.task import SceneTask
from lookdev.scene import Pose


@dataclass(frozen=True)
class BlendWorld:
    """A light of a job: `strength` multiplies its radiance, `turn` degrees about z are beyond those of the poses."""

    name: str
    light: AnyLight
    strength: float
    turn: float


@dataclass(frozen=True)
class BlendTurntable:
    """A stretch of the timeline: one frame for each pose."""

    name: str
    poses: tuple[Pose, ...]


@dataclass(frozen=True)
class BlendImage:
    """An image that looks or worlds read, and its path relative to the .blend."""

    content: Content
    path: str


@dataclass(frozen=True)
class BlendTask:
    """A .blend to be written. Worlds and turntables are in the order of the job, at least one of each."""

    file: Path
    scenes: Mapping[str, SceneTask]  # by the name of the look; sources are nodes, the light is that of the first world
    worlds: tuple[BlendWorld, ...]
    turntables: tuple[BlendTurntable, ...]  # their frames are numbered consecutively from 1
    images: tuple[BlendImage, ...]
    pack: bool  # images into the .blend; otherwise they lie at their relative paths
    view: str  # of lookdev.output.display.VIEWS
    show_light: bool  # behind the asset


BLEND_TASK = TypeAdapter(BlendTask)
"""A task as JSON and back; floats survive exactly."""
