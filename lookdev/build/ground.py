"""The ground of a job under each of its looks."""

from __future__ import annotations

from collections.abc import Mapping

from lookdev.asset import Asset
from lookdev.build.assign import loss_notes
from lookdev.build.faults import Findings
from lookdev.build.geometry_cache import cached_outline
from lookdev.errors import AssetError
from lookdev.job.surroundings import JobGround
from lookdev.material import Look
from lookdev.material.usd.bound import read_any_look
from lookdev.scene import Camera
from lookdev.scene.ground import GREY, Ground


def ground_under(table: JobGround, asset: Asset, look: Look | None, camera: Camera) -> Ground:
    """Return the ground of an asset; raise AssetError if the camera is not above it."""
    height = float(cached_outline(asset)[:, 2].min()) if table.height is None else table.height
    above = float(camera.position[2]) - height
    if above <= 0.0:
        raise AssetError(
            f"the camera is {-above:g} m below the ground, and sees none of the asset; a greater elevation, or a "
            "lower 'height' would be right"
        )
    return Ground(look or GREY, table.size * asset.radius, height, table.kind == "catcher")


def job_grounds(
    table: JobGround, assets: Mapping[str, Asset], cameras: Mapping[str, Camera], findings: Findings
) -> dict[str, Ground]:
    """Return the ground for each look of a job; all grounds have the same material.

    Raises LookError as `read_any_look`, and AssetError as `ground_under`.
    """
    look = None
    if table.material is not None:
        bound = read_any_look(table.material, table.prim, table.variants, "ground")
        findings.note(*loss_notes(bound.lost))
        look = bound.look
        if look.displacement is not None:
            findings.note(f"{table.material}: the ground is flat: the displacement of its look is left out")
    return {name: ground_under(table, asset, look, cameras[name]) for name, asset in assets.items()}
