"""Digests of all that affects a frame's pixels: a frame is rendered again exactly when they change."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict
from functools import cache
from importlib.metadata import version

from lookdev.codegen import PrincipledSource, Source
from lookdev.render.task import SceneTask
from lookdev.scene.camera import Pose

RENDER_VERSION = 1
"""Raised when the program renders the same frame task to other pixels than before."""


def part_digests(scene: SceneTask, pose: Pose, exposure: float) -> dict[str, str]:
    """Return the digest of each part of a frame's inputs: what changed can then be told by its name.

    The parts are ``asset look ibl camera pose render``. Paths are in none of them: geometry, textures and
    light tables count by the digest of their content, which an asset file bears as its name.
    """
    return {
        "asset": _digest(scene.asset_file.stem),
        "look": _digest([_source_digest(source) for source in scene.shaders]),
        "ibl": _digest([scene.light.digest, exposure]),
        "camera": _digest(asdict(scene.camera)),
        "pose": _digest(asdict(pose)),
        "render": _digest(
            {
                "resolution": scene.resolution,
                "sampling": asdict(scene.sampling),
                "device": scene.device,
                "bpy": blender_version(),
                "version": RENDER_VERSION,
            }
        ),
    }


def frame_digest(parts: Mapping[str, str]) -> str:
    """Return the digest of a frame from those of its parts."""
    return _digest(parts)


@cache
def blender_version() -> str:
    """Return the version of the installed bpy, without importing it."""
    return version("bpy")


def _source_digest(source: Source) -> str:
    return _digest(asdict(source)) if isinstance(source, PrincipledSource) else source.digest


def _digest(value: object) -> str:
    """Return the SHA-256 of a value's canonical JSON."""
    text = json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()
