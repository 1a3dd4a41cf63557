"""A composed USD stage as an asset: its visible surfaces, their placements and their bound materials.

`walk` finds the visible gprims. `gprims` converts each type of gprim to a shape, by `mesh`, `curves` (and points) or
`primitives`. `skinning` deforms gprims, `primvars` reads their primvars. `scene` makes the asset, with its bound
materials; its notes name prims of other types.

Scene-graph instances and point instances share one mesh for each surface of their prototype, as do equal primitives.
Instances with other bound materials or other inherited primvars have a `Mesh` of their own that shares the arrays; its
slots have the path of the first such instance. Instances without volume (scale 0, the usual way to hide one) are
dropped.
"""

from __future__ import annotations

from dataclasses import replace

from lookdev.asset.mesh import Asset
from lookdev.asset.usd.scene import UsdScene, name_file_in_errors
from lookdev.stage import Composed, usd_errors_as_faults

__all__ = ["read_usd"]


def read_usd(composed: Composed, time: float | None = None, purposes: tuple[str, ...] = ("default", "render")) -> Asset:
    """Read the surfaces of a stage, or of its composition's `prim`, into world space: z up, in metres.

    Surfaces with a subdivision are control cages, which have to be refined before they are rendered. The time is
    `time`, else the stage's startTimeCode, else the earliest time. The ancestors of `prim` place it; hidden ancestors
    do not hide it. The asset's notes list content that is not rendered and bindings whose target does not exist.

    Raises
    ------
    AssetError
        Geometry contradicts itself, or none is visible. The message has a line for each fault.
    """
    file = composed.composition.file
    with usd_errors_as_faults(file) as warnings, name_file_in_errors(str(file)):
        asset = UsdScene(composed, time, purposes).read_asset()
    return replace(asset, notes=(*composed.notes, *(f"{file}: {note}" for note in (*asset.notes, *warnings))))
