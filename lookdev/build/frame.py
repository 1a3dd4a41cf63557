"""The geometry that each look of a job renders, and the cameras, which frame it or come from a USD file.

Cages are refined by their size in the frame of a camera that frames the cages themselves. The camera of the scenes
frames the rendered geometry: the displaced limit surface.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from lookdev.arrays import Floats
from lookdev.asset import Asset
from lookdev.asset.bounds import bounding_sphere
from lookdev.asset.mesh import Instance, Mesh
from lookdev.asset.usd_camera import UsdCamera, read_camera
from lookdev.build.assets import ComposedAsset
from lookdev.build.assign import AssignedAsset
from lookdev.build.charts import camera_beside_strip, overlap_notes
from lookdev.build.faults import Findings
from lookdev.build.geometry_cache import cached_outline
from lookdev.build.refine import Refiner, cages_of_displaced
from lookdev.job.schema import Job
from lookdev.scene import Camera, frame_camera, frame_fill
from lookdev.scene.displace import displace
from lookdev.scene.framing import DEFAULT_FILL, Arc
from lookdev.scene.shot import shot_camera, shot_notes
from lookdev.scene.uvs import absent_primvars, with_uvs
from lookdev.stage import open_stage


def refine_and_frame(
    job: Job,
    assigned: Mapping[str, AssignedAsset],
    shot: UsdCamera | None,
    keys: Mapping[str, str],
    findings: Findings,
) -> tuple[dict[str, Asset], dict[str, Camera]]:
    """Return the refined and displaced asset of each look, and its camera.

    Parameters
    ----------
    shot
        The camera that the job names.
    keys
        The key of each look in the job.

    Raises
    ------
    FaultsError
        With the faults of all looks.
    """
    cages = {
        name: cages_of_displaced(assigned_asset.asset, assigned_asset.looks)
        for name, assigned_asset in assigned.items()
    }
    with findings.collect("camera"):
        cameras, camera_notes = job_cameras(job, {name: asset for name, (asset, _) in cages.items()}, shot)
    findings.raise_faults()
    refiner = Refiner(job.asset.subdivision, job.render.resolution[0])
    assets: dict[str, Asset] = {}
    for name, assigned_asset in assigned.items():
        asset, displaced = cages[name]
        with findings.collect(keys[name]):
            refined, level_notes = refiner.refine(asset, cameras[name], displaced)
            complete, uv_notes = with_uvs(refined, assigned_asset.looks, assigned_asset.bound)
            assets[name] = displace(complete, assigned_asset.looks)
            findings.note(*level_notes, *uv_notes, *absent_primvars(complete, assigned_asset.looks))
    findings.raise_faults()
    if any(mesh.subdivision is not None for asset, _ in cages.values() for mesh in asset.meshes):
        cameras, camera_notes = job_cameras(job, assets, shot)
    findings.note(*camera_notes)
    return assets, cameras


def read_shot(job: Job, composed: ComposedAsset) -> UsdCamera | None:
    """Return the camera that a job names, from the composed asset or from another file; None without a name."""
    if job.camera.usd is None:
        return None
    if job.camera.file is not None:
        return read_camera(open_stage(job.camera.file), job.camera.usd)
    assert composed.composed is not None, "a built-in asset has no camera"
    return read_camera(composed.composed.stage, job.camera.usd)


def job_cameras(
    job: Job, assets: Mapping[str, Asset], shot: UsdCamera | None = None
) -> tuple[dict[str, Camera], tuple[str, ...]]:
    """Return the camera of each look, and notes for the user.

    Parameters
    ----------
    assets
        The refined and displaced asset of each look.
    shot
        The camera that ``camera.usd`` names.

    Raises
    ------
    AssetError
        An asset has no size.
    """
    different = {asset.digest: asset for asset in assets.values()}
    if shot is None and job.camera.framing == "each":
        cameras = {digest: _frame(job, [asset]) for digest, asset in different.items()}
        return {look: cameras[asset.digest] for look, asset in assets.items()}, ()
    if shot is None:
        return dict.fromkeys(assets, _frame(job, list(different.values()))), ()
    points = _outlines(list(different.values()))
    camera, notes = shot_camera(shot, points), list(shot_notes(shot, points, job.render.resolution))
    if job.charts is not None:
        notes += overlap_notes(job.charts.strip(job.render.resolution), camera, points, element_arcs(job))
    return dict.fromkeys(assets, camera), tuple(notes)


def element_arcs(job: Job) -> tuple[Arc, ...]:
    """Return the ranges of `Pose.element` in a job: the full range of a turntable of the asset, else one angle."""
    azimuth = job.camera.azimuth
    arcs = []
    for turntable in job.turntable:
        turns_asset = turntable.kind == "element"
        start = turntable.start - azimuth if turns_asset else -azimuth
        arcs.append((start, turntable.degrees if turns_asset and turntable.frames > 1 else 0.0))
    return tuple(dict.fromkeys(arcs))


def _frame(job: Job, assets: list[Asset]) -> Camera:
    camera, resolution = job.camera, job.render.resolution
    elevation, arcs = camera.elevation, element_arcs(job)
    fill = DEFAULT_FILL if camera.fill is None else camera.fill

    def frame(resolution: tuple[float, float], fov: float) -> Camera:
        if camera.margin is not None:
            center, radius = _common_sphere(assets)
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
    """Return the points of all outlines, (n, 3)."""
    return np.concatenate([cached_outline(asset) for asset in assets])


def _common_sphere(assets: list[Asset]) -> tuple[tuple[float, float, float], float]:
    """Return centre and radius of the sphere that bounds all assets."""
    if len(assets) == 1:
        return assets[0].center, assets[0].radius
    meshes: list[Mesh] = []
    instances: list[Instance] = []
    for asset in assets:
        instances += [Instance(instance.mesh + len(meshes), instance.matrix) for instance in asset.instances]
        meshes += asset.meshes
    return bounding_sphere(meshes, instances)
