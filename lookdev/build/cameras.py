"""The cameras of a job: framed by what its looks show, or read from a USD file."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from lookdev.asset import Asset
from lookdev.asset.bounds import bounding_sphere
from lookdev.asset.mesh import Instance, Mesh
from lookdev.asset.usd_camera import UsdCamera
from lookdev.build.charts import camera_beside_strip, overlap_notes
from lookdev.build.geometry_cache import kept_outline
from lookdev.job.schema import Job
from lookdev.scene import Camera, frame_camera, frame_fill
from lookdev.scene.framing import DEFAULT_FILL, Arc
from lookdev.scene.shot import shot_camera, shot_notes

Floats = NDArray[np.float64]


def job_cameras(
    job: Job, shown: Mapping[str, Asset], shot: UsdCamera | None = None
) -> tuple[dict[str, Camera], tuple[str, ...]]:
    """Return the camera of each look, and notes for the user.

    Parameters
    ----------
    shown
        The asset that each look shows, as it is rendered: refined, displaced.
    shot
        The camera that ``camera.usd`` names.

    Raises
    ------
    AssetError
        An asset has no size.
    """
    different = {asset.digest: asset for asset in shown.values()}
    if shot is None and job.camera.framing == "each":
        framed = {digest: _framed(job, [asset]) for digest, asset in different.items()}
        return {look: framed[asset.digest] for look, asset in shown.items()}, ()
    assets = list(different.values())
    if shot is None:
        return dict.fromkeys(shown, _framed(job, assets)), ()
    points = _outlines(assets)
    camera, notes = shot_camera(shot, points), list(shot_notes(shot, points, job.render.resolution))
    if job.charts is not None:
        notes += overlap_notes(job.charts.strip(job.render.resolution), camera, points, element_arcs(job))
    return dict.fromkeys(shown, camera), tuple(notes)


def element_arcs(job: Job) -> tuple[Arc, ...]:
    """Return the angles at which a job shows its asset, as `Pose.element`: whole turns, however many their frames."""
    azimuth = job.camera.azimuth
    arcs = []
    for each in job.turntable:
        turned = each.kind == "element"
        start = each.start - azimuth if turned else -azimuth
        arcs.append((start, each.degrees if turned and each.frames > 1 else 0.0))
    return tuple(dict.fromkeys(arcs))


def _framed(job: Job, assets: list[Asset]) -> Camera:
    camera, resolution = job.camera, job.render.resolution
    elevation, arcs = camera.elevation, element_arcs(job)
    fill = DEFAULT_FILL if camera.fill is None else camera.fill

    def frame(resolution: tuple[float, float], fov: float) -> Camera:
        if camera.margin is not None:
            center, radius = _sphere(assets)
            return frame_camera(center, radius, resolution, fov=fov, elevation=elevation, margin=camera.margin)
        return frame_fill(_outlines(assets), resolution, fov=fov, elevation=elevation, fill=fill, arcs=arcs)

    def share(half: float) -> float:
        """Return the part of the tangent of half an angle of view that the asset covers at most."""
        if camera.margin is None:
            return fill
        return math.tan(math.asin(math.sin(half) / camera.margin)) / math.tan(half)

    if job.charts is None:
        return frame(resolution, camera.horizontal_fov)
    return camera_beside_strip(job.charts.strip(resolution), camera.horizontal_fov, share, frame)


def _outlines(assets: list[Asset]) -> Floats:
    return np.concatenate([kept_outline(asset) for asset in assets])


def _sphere(assets: list[Asset]) -> tuple[tuple[float, float, float], float]:
    if len(assets) == 1:
        return assets[0].center, assets[0].radius
    meshes: list[Mesh] = []
    instances: list[Instance] = []
    for asset in assets:
        instances += [Instance(each.mesh + len(meshes), each.matrix) for each in asset.instances]
        meshes += asset.meshes
    return bounding_sphere(meshes, instances)
