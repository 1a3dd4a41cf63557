"""Digests of all inputs of a frame's pixels; a frame is rendered again if and only if its digest changes."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict

from lookdev.rendering.backends import BACKENDS
from lookdev.rendering.task import SceneTask
from lookdev.scene import Pose
from lookdev.space import REC709

PARTS = ("asset", "look", "ibl", "camera", "pose", "render")
"""The parts of a frame's inputs. Each has a digest of its own, so that a plan can state which part has changed."""


def part_digests(scene: SceneTask, pose: Pose, exposure: float) -> dict[str, str]:
    """Return the digest of each of `PARTS`, the parts of a frame's inputs.

    No digest depends on paths of files: geometry, textures and tables of lights are identified by their content.
    """
    return {**scene_digests(scene, exposure), "pose": pose_digest(pose)}


def pose_digest(pose: Pose) -> str:
    """Return the digest of the part ``pose``: the angles of asset and light."""
    return _digest(asdict(pose))


def scene_digests(scene: SceneTask, exposure: float) -> dict[str, str]:
    """Return the digest of each part except ``pose``; all frames of a scene share them.

    `exposure` is the exposure of the light, in stops.
    """
    sampling = asdict(scene.sampling)
    if scene.sampling.passes:
        sampling["prims"] = scene.prims
        if scene.light_groups:
            sampling["light_groups"] = scene.light_groups
    else:
        del sampling["passes"]
    render = {
        "resolution": scene.resolution,
        "sampling": sampling,
        "device": scene.device,
        "backend": scene.backend,
        "version": BACKENDS[scene.backend].version(),
    }
    if scene.space != REC709:
        render["space"] = scene.space
    return {
        "asset": scene.asset.digest,
        "look": _digest([[source.digest for source in scene.shaders], scene.slot_shaders]),
        "ibl": _digest([*(light.digest for light in scene.lights), *scene.shader_lights, *scene.groups, exposure]),
        "camera": _digest(asdict(scene.camera)),
        "render": _digest(render),
    }


def frame_digest(parts: Mapping[str, str]) -> str:
    """Return the digest of a frame from the digests of its parts."""
    return _digest(parts)


def _digest(value: object) -> str:
    text = json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()
