"""A composed USD stage as an asset: the surfaces that are shown, their placements and their bound materials.

`walk` finds the visible gprims; `gprims` says how each type of them becomes a shape: `mesh`, `curves` (and points) and
`primitives`; `skinning` deforms them, `primvars` reads what varies over them, `bindings` their materials. Prims of
other types are named in the asset's notes.

Scene-graph instances and point instances share one mesh for each surface of their prototype, as do equal primitives.
Where other materials are bound, or other primvars inherited, they have a `Mesh` of their own that shares its arrays;
its slots have the path of the first such instance. Instances without volume (scale 0, the usual way to hide one) are
left out.
"""

from __future__ import annotations

from dataclasses import replace

from lookdev.asset.mesh import Asset
from lookdev.asset.usd.scene import UsdScene, name_file_in_errors
from lookdev.stage import Composed, reading

__all__ = ["read_usd"]


def read_usd(composed: Composed, time: float | None = None, purposes: tuple[str, ...] = ("default", "render")) -> Asset:
    """Read the surfaces of a stage, or of its composition's `prim`, into world space: z up, metres.

    Surfaces with a subdivision are control cages; refine them before they are rendered. Without a `time` they are taken
    at the stage's startTimeCode, else at the earliest time. The ancestors of `prim` place it, and hidden ones do not
    hide it. What is not rendered, and bindings that lead nowhere, are in the asset's notes.

    Raises
    ------
    AssetError
        Geometry contradicts itself, or none is visible; a line for each fault.
    """
    file = composed.composition.file
    with reading(file) as warnings, name_file_in_errors(str(file)):
        asset = UsdScene(composed, time, purposes).asset()
    return replace(asset, notes=(*composed.notes, *(f"{file}: {note}" for note in (*asset.notes, *warnings))))
