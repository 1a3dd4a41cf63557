"""Reads an asset from a composed USD stage: its visible surfaces, their placements and their bound materials.

`walk` finds the visible gprims. `gprims` converts a gprim to a shape, by `mesh`, `curves` (also for points) or
`primitives`, according to its type. `skinning` deforms gprims, `primvars` reads their primvars. `scene` makes the asset
with its bound materials, and notes for prims of types that are not rendered.

Scene-graph instances and point instances share one mesh for each surface of their prototype. Equal primitives share a
mesh, too. Instances whose bound materials or inherited primvars differ have different `Mesh`es, which share arrays; the
slots of such a mesh have the path of its first instance. Instances without volume are dropped; scale 0 is the usual way
to hide an instance.
"""

from __future__ import annotations

from dataclasses import replace

from lookdev.asset.mesh import Asset
from lookdev.asset.usd.scene import UsdScene, name_file_in_errors
from lookdev.stage import Composed, usd_errors_as_faults

__all__ = ["read_usd"]


def read_usd(composed: Composed, time: float | None = None, purposes: tuple[str, ...] = ("default", "render")) -> Asset:
    """Read the surfaces of a stage into an asset in world space: z up, in metres.

    If the composition names a prim, only the surfaces at and below this prim are read. The transforms of its ancestors
    place the prim, but hidden ancestors do not hide it. Subdivision surfaces are control cages, which have to be
    refined before they are rendered. The surfaces are read at `time`, by default at the stage's startTimeCode, or else
    the earliest time. The asset's notes list content that is not rendered and bindings whose target does not exist.

    Raises
    ------
    AssetError
        Geometry contradicts itself, or none is visible. The message has a line for each fault.
    """
    file = composed.composition.file
    with usd_errors_as_faults(file) as warnings, name_file_in_errors(str(file)):
        asset = UsdScene(composed, time, purposes).read_asset()
    return replace(asset, notes=(*composed.notes, *(f"{file}: {note}" for note in (*asset.notes, *warnings))))
