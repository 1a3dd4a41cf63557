"""The rendered geometry of each look of a job, the camera, and the ground.

A camera either frames the geometry, or comes from a USD file. If there are control cages, the camera is computed twice.
The first camera frames the cages. Their size in its frame determines the level of refinement. The second camera is the
camera of the scenes. It frames the rendered geometry: the refined and displaced meshes.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace

import numpy as np

from lookdev.arrays import Floats
from lookdev.asset import Asset
from lookdev.asset.bounds import bounding_sphere
from lookdev.asset.mesh import Instance, Mesh
from lookdev.asset.usd_camera import UsdCamera, read_camera
from lookdev.build.assets import ComposedAsset
from lookdev.build.assign import AssignedAsset, loss_notes
from lookdev.build.faults import Findings
from lookdev.build.refine import Refiner, cached_outline, cages_of_displaced
from lookdev.errors import AssetError
from lookdev.job.schema import Job
from lookdev.job.surroundings import JobGround
from lookdev.material import Look
from lookdev.material.usd.bound import read_any_look
from lookdev.scene import Camera, frame_camera, frame_fill
from lookdev.scene.charts.props import Strip
from lookdev.scene.displace import displace
from lookdev.scene.framing import DEFAULT_FILL, Arc
from lookdev.scene.ground import GREY_LOOK, Ground
from lookdev.scene.shot import shot_camera, shot_notes
from lookdev.scene.uvs import add_missing_uvs, missing_primvar_notes
from lookdev.stage import open_stage

_STEP = 5.0  # degrees between two angles of the asset at which `overlap_notes` projects its outline


def refine_and_frame(
    job: Job, assigned: Mapping[str, AssignedAsset], shot: UsdCamera | None, keys: Mapping[str, str], findings: Findings
) -> tuple[dict[str, Asset], dict[str, Camera]]:
    """Return the refined and displaced asset of each look, and its camera, both by the look's name.

    Parameters
    ----------
    assigned
        The asset and its looks, by the name of the look of the job.
    shot
        The camera of a USD file that the job names; None if the job has none.
    keys
        The key of each look in the job file, by the look's name.

    Raises
    ------
    FaultsError
        The error has the faults of all looks.
    """
    cages = {name: cages_of_displaced(item.asset, item.looks) for name, item in assigned.items()}
    with findings.collect("camera"):
        cameras, camera_notes = job_cameras(job, {name: asset for name, (asset, _) in cages.items()}, shot)
    findings.raise_faults()
    refiner = Refiner(job.asset.subdivision, job.render.resolution[0])
    assets: dict[str, Asset] = {}
    for name, assigned_asset in assigned.items():
        asset, displaced = cages[name]
        with findings.collect(keys[name]):
            refined, level_notes = refiner.refine(asset, cameras[name], displaced)
            complete, uv_notes = add_missing_uvs(refined, assigned_asset.looks, assigned_asset.bound)
            assets[name] = displace(complete, assigned_asset.looks)
            findings.note(*level_notes, *uv_notes, *missing_primvar_notes(complete, assigned_asset.looks))
    findings.raise_faults()
    if any(mesh.subdivision is not None for asset, _ in cages.values() for mesh in asset.meshes):
        cameras, camera_notes = job_cameras(job, assets, shot)
    findings.note(*camera_notes)
    return assets, cameras


def read_shot(job: Job, composed: ComposedAsset) -> UsdCamera | None:
    """Read the camera that ``camera.usd`` of a job names, from the asset or another file; None if it names none."""
    if job.camera.usd is None:
        return None
    if job.camera.file is not None:
        return read_camera(open_stage(job.camera.file), job.camera.usd)
    assert composed.composed is not None, "a built-in asset has no camera"
    return read_camera(composed.composed.stage, job.camera.usd)


def job_cameras(
    job: Job, assets: Mapping[str, Asset], shot: UsdCamera | None = None
) -> tuple[dict[str, Camera], tuple[str, ...]]:
    """Return the camera of each look by its name, and notes for the user.

    Parameters
    ----------
    assets
        The asset of each look, either with control cages, or refined and displaced.
    shot
        The camera that ``camera.usd`` names.

    Raises
    ------
    AssetError
        An asset has no size.
    """
    distinct_assets = {asset.digest: asset for asset in assets.values()}
    if shot is None and job.camera.framing == "each":
        cameras = {digest: _frame(job, [asset]) for digest, asset in distinct_assets.items()}
        return {look: cameras[asset.digest] for look, asset in assets.items()}, ()
    if shot is None:
        return dict.fromkeys(assets, _frame(job, list(distinct_assets.values()))), ()
    points = _outlines(list(distinct_assets.values()))
    camera, notes = shot_camera(shot, points), list(shot_notes(shot, points, job.render.resolution))
    if job.charts is not None:
        notes += overlap_notes(job.charts.strip(job.render.resolution), camera, points, element_arcs(job))
    return dict.fromkeys(assets, camera), tuple(notes)


def element_arcs(job: Job) -> tuple[Arc, ...]:
    """Return the range of `Pose.element` in each turntable of a job, without duplicates.

    If a turntable does not turn the asset, or has only one frame, its range is a single angle.
    """
    azimuth = job.camera.azimuth
    arcs = []
    for turntable in job.turntable:
        turns_asset = turntable.kind == "element"
        start = turntable.start - azimuth if turns_asset else -azimuth
        arcs.append((start, turntable.degrees if turns_asset and turntable.frames > 1 else 0.0))
    return tuple(dict.fromkeys(arcs))


def _frame(job: Job, assets: list[Asset]) -> Camera:
    """Return a camera that frames assets, and keeps them out of the strip of reference props if the job has one."""
    camera, resolution = job.camera, job.render.resolution
    elevation, arcs = camera.elevation, element_arcs(job)
    fill = DEFAULT_FILL if camera.fill is None else camera.fill

    def frame(resolution: tuple[float, float], fov: float) -> Camera:
        if camera.margin is not None:
            center, radius = _common_sphere(assets)
            return frame_camera(center, radius, resolution, fov=fov, elevation=elevation, margin=camera.margin)
        return frame_fill(_outlines(assets), resolution, fov=fov, elevation=elevation, fill=fill, arcs=arcs)

    if job.charts is None:
        return frame(resolution, camera.horizontal_fov)
    strip, fov = job.charts.strip(resolution), camera.horizontal_fov
    reach = math.tan(math.radians(0.5 * fov))
    pixels_across_strip = strip.resolution[0 if strip.is_vertical else 1]
    half_angle = math.atan(reach * pixels_across_strip / resolution[0])
    # The largest fraction of the frame that the asset covers, in the direction across the strip. With `margin`, it is a
    # ratio of two tangents: of half the angle that the asset's sphere subtends, and of half the angle of view.
    covered = (
        fill
        if camera.margin is None
        else math.tan(math.asin(math.sin(half_angle) / camera.margin)) / math.tan(half_angle)
    )
    # If the strip fits beside the asset, the asset is framed in the whole frame, otherwise in the rest of the frame.
    if 0.5 * (1.0 - covered) * pixels_across_strip >= strip.thickness:
        return frame(resolution, fov)
    picture_fov = math.degrees(2.0 * math.atan(reach * strip.picture_size[0] / resolution[0]))
    return replace(frame(strip.picture_size, picture_fov), fov=fov, shift=strip.shift)


def _outlines(assets: list[Asset]) -> Floats:
    """Return the points (n, 3) of the outlines of all assets."""
    return np.concatenate([cached_outline(asset) for asset in assets])


def _common_sphere(assets: list[Asset]) -> tuple[tuple[float, float, float], float]:
    """Return the centre and the radius of a sphere that bounds all assets."""
    if len(assets) == 1:
        return assets[0].center, assets[0].radius
    meshes: list[Mesh] = []
    instances: list[Instance] = []
    for asset in assets:
        instances += [Instance(instance.mesh + len(meshes), instance.matrix) for instance in asset.instances]
        meshes += asset.meshes
    return bounding_sphere(meshes, instances)


def overlap_notes(strip: Strip, camera: Camera, points: Floats, arcs: Iterable[Arc]) -> Iterator[str]:
    """Yield a note if an asset reaches into the strip of reference props.

    Parameters
    ----------
    points : (n, 3)
        The outline of the asset.
    arcs
        The ranges of the asset's rotation in the job, as `element_arcs` returns them.
    """
    (width, height), box = strip.resolution, strip.box
    for start, sweep in arcs:
        for angle in np.linspace(start, start + sweep, 1 + math.ceil(abs(sweep) / _STEP)):
            orbited = camera.orbit(-angle)
            right, up, back = ((points - orbited.position) @ orbited.frame.T).T
            depth = np.where(back < 0.0, -back, np.inf)
            x = 0.5 * width * (1.0 + right / depth / camera.half_width - 2.0 * camera.shift[0])
            y = 0.5 * height - 0.5 * width * (up / depth / camera.half_width - 2.0 * camera.shift[1])
            across = x.max() > box.left and x.min() < box.left + box.width
            if across and y.max() > box.top and y.min() < box.top + box.height:
                yield (
                    f"[charts] hides a part of the asset at the {strip.side} edge of the frame, where the camera "
                    "of 'usd' leaves no room; another place or a smaller size would be right"
                )
                return


def ground_under(table: JobGround, asset: Asset, look: Look | None, camera: Camera) -> Ground:
    """Return the ground of an asset; raise AssetError if the camera is not above the ground.

    `table` is the table ``[ground]`` of the job file: the ground's kind, material, height and size.
    """
    height = float(cached_outline(asset)[:, 2].min()) if table.height is None else table.height
    above = float(camera.position[2]) - height
    if above <= 0.0:
        raise AssetError(
            f"the camera is {-above:g} m below the ground, and sees none of the asset; a greater elevation, or a "
            "lower 'height' would be right"
        )
    return Ground(look or GREY_LOOK, table.size * asset.radius, height, table.kind == "catcher")


def job_grounds(
    table: JobGround, assets: Mapping[str, Asset], cameras: Mapping[str, Camera], findings: Findings
) -> dict[str, Ground]:
    """Return the ground for each look of a job; all grounds have the same material.

    `table` is the table ``[ground]`` of the job file. Raises the LookError of `read_any_look` and the AssetError of
    `ground_under`.
    """
    look = None
    if table.material is not None:
        bound = read_any_look(table.material, table.prim, table.variants, "ground")
        findings.note(*loss_notes(bound.losses))
        look = bound.look
        if look.displacement is not None:
            findings.note(f"{table.material}: the ground is flat: the displacement of its look is left out")
    return {name: ground_under(table, asset, look, cameras[name]) for name, asset in assets.items()}
