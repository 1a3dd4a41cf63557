"""From dressed assets to those that are rendered, and the cameras that see them.

Cages are refined by their size in the frame of a camera that frames the cages themselves. The camera of the scenes
frames what is rendered: the limit surface, displaced.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from lookdev.asset import Asset
from lookdev.asset.usd_camera import UsdCamera
from lookdev.build.assign import Dressed
from lookdev.build.cameras import job_cameras
from lookdev.build.faults import collected, raise_all
from lookdev.build.refine import Refinery
from lookdev.errors import Fault
from lookdev.job.schema import Job
from lookdev.material import Look
from lookdev.scene import Camera
from lookdev.scene.displace import as_cage, displace, is_displaced
from lookdev.scene.uvs import absent_primvars, with_uvs


def rendered(
    job: Job, dressed: Mapping[str, Dressed], shot: UsdCamera | None, places: Mapping[str, str], notes: list[str]
) -> tuple[dict[str, Asset], dict[str, Camera]]:
    """Return the asset and the camera of each look, and add to `notes`.

    `shot` is the camera that the job names, `places` are the keys of looks in its file. Raises FaultsError with the
    faults of all looks.
    """
    faults: list[Fault] = []
    cages = {name: _with_cages(each.asset, each.wears) for name, each in dressed.items()}
    with collected(job, "camera", faults):
        cameras, found = job_cameras(job, {name: asset for name, (asset, _) in cages.items()}, shot)
    raise_all(faults)
    refinery = Refinery(job.asset.subdivision, job.render.resolution[0])
    shown: dict[str, Asset] = {}
    for name, each in dressed.items():
        asset, displaced = cages[name]
        with collected(job, places[name], faults):
            refined, on_levels = refinery.refined(asset, cameras[name], displaced)
            complete, on_uvs = with_uvs(refined, each.wears, each.own)
            shown[name] = displace(complete, each.wears)
            notes += (*on_levels, *on_uvs, *absent_primvars(complete, each.wears))
    raise_all(faults)
    if any(mesh.subdivision is not None for asset, _ in cages.values() for mesh in asset.meshes):
        cameras, found = job_cameras(job, shown, shot)
    notes += found
    return shown, cameras


def _with_cages(asset: Asset, wears: Mapping[str, Look]) -> tuple[Asset, Sequence[int]]:
    """Return the asset with cages for the meshes that its looks displace, and the numbers of these."""
    looks = [wears[slot.path] for slot in asset.slots]
    if all(look.displacement is None for look in looks):
        return asset, ()
    displaced = [number for number, mesh in enumerate(asset.meshes) if is_displaced(mesh, looks)]
    meshes = list(asset.meshes)
    for number in displaced:
        meshes[number] = as_cage(meshes[number])
    return replace(asset, meshes=tuple(meshes)), displaced
