"""The ground under an asset, `[ground]` of a job: a horizontal disc with a look of its own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from lookdev.asset import Asset, Instance, Mesh, Slot, make_asset
from lookdev.material import Layer, Look

GROUND_PATH = "/lookdev/ground"
"""The path of the ground as a part of the asset; light links can name it."""

GREY_LOOK = Look("ground", (Layer("Ground", "lambert", {"reflectance": (0.18, 0.18, 0.18)}),))
"""The look of a ground without a material."""

_SEGMENTS = 128  # triangles of the disc


@dataclass(frozen=True, eq=False)
class Ground:
    """A horizontal disc about the axis of the turntable; `radius` and `height` (its z) are in metres.

    If `catcher`, it is a shadow catcher: the frame shows only the effect of the asset on the light of the ground.
    """

    look: Look
    radius: float
    height: float
    catcher: bool


def add_ground(
    asset: Asset, look_of_slot: Mapping[str, Look], ground: Ground, axis: tuple[float, float]
) -> tuple[Asset, dict[str, Look]]:
    """Return the asset with the ground as an additional part, and the look of each slot by its path.

    `axis` is the x and y of the centre of the disc.
    """
    meshes = [*asset.meshes, replace(_disc(ground.radius), face_slots=np.full(_SEGMENTS, len(asset.slots), np.int32))]
    matrix = np.eye(4)
    matrix[:3, 3] = (*axis, ground.height)
    instances = [*asset.instances, Instance(len(asset.meshes), matrix, GROUND_PATH)]
    revolved = asset.revolved and bool(np.hypot(*np.subtract(axis, asset.center[:2])) <= 1e-5 * asset.radius)
    combined = make_asset(asset.name, meshes, instances, [*asset.slots, Slot(GROUND_PATH)], revolved=revolved)
    return replace(combined, unit=asset.unit, notes=asset.notes), {**look_of_slot, GROUND_PATH: ground.look}


def _disc(radius: float) -> Mesh:
    """Return a disc of triangles that faces up, with a UV set st from 0 to 1 over its bounding square."""
    angles = 2.0 * np.pi * np.arange(_SEGMENTS) / _SEGMENTS
    rim = np.stack([np.cos(angles), np.sin(angles), np.zeros(_SEGMENTS)], axis=-1)
    points = np.concatenate([rim, np.zeros((1, 3))])
    first = np.arange(_SEGMENTS)
    corners = np.stack([np.full(_SEGMENTS, _SEGMENTS), first, (first + 1) % _SEGMENTS], axis=-1).ravel()
    return Mesh(
        name=GROUND_PATH,
        points=(radius * points).astype(np.float32),
        corner_points=corners.astype(np.int32),
        face_sizes=np.full(_SEGMENTS, 3, np.int32),
        face_slots=np.zeros(_SEGMENTS, np.int32),
        normals=np.tile(np.array([0, 0, 1], np.float32), (len(corners), 1)),
        tangents=np.tile(np.array([1, 0, 0], np.float32), (len(corners), 1)),
        uvs={"st": (0.5 + 0.5 * points[corners, :2]).astype(np.float32)},
        default_uv="st",
    )
