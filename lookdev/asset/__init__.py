"""Loads assets: the geometry that a job renders, as arrays, from a USD file or from the built-in shapes.

`mesh` defines an asset. `usd` reads one from a file, `builtin` makes one (with `revolve` and `shaderball`). A `shape`
is a surface as a file defines it. `finish` converts shapes to meshes: `faces` finds the valid faces, `normals` computes
normals. `bounds` computes the bounding sphere of an asset; `store` computes its digest and writes it to the cache.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from lookdev.asset.builtin import BUILTINS
from lookdev.asset.mesh import Asset, Instance, Mesh, Slot
from lookdev.asset.store import make_asset, read_asset, save_asset
from lookdev.errors import AssetError, nearest_hint

__all__ = ["BUILTINS", "Asset", "Instance", "Mesh", "Slot", "load_asset", "make_asset", "read_asset", "save_asset"]


def load_asset(usd: Path | None = None, builtin: str | None = None, prim: str | None = None) -> Asset:
    """Return the asset of a USD file (the whole stage, or the prim at path `prim`), or a built-in asset by name.

    Subdivision surfaces are not refined: the asset has the polygons of their control cages.

    Raises
    ------
    AssetError
        Not exactly one of `usd` and `builtin` is given, the name is unknown, or the geometry has a fault.
    StageError
        The file cannot be opened or composed.
    """
    if (usd is None) == (builtin is None):
        raise AssetError(f"an asset is either a USD file or a built-in, got usd={usd} and builtin={builtin}")
    if usd is not None:
        # Imported here because the render worker, which imports this package to read cached assets, needs no USD.
        from lookdev.asset.usd import read_usd
        from lookdev.stage import Composition, compose

        return _without_subdivision(read_usd(compose(Composition(usd, prim=prim))))
    if prim is not None:
        raise AssetError(f"prim {prim}: a built-in asset has no prims to choose from; leave prim out")
    if builtin not in BUILTINS:
        raise AssetError(f"there is no built-in asset '{builtin}' ({nearest_hint(str(builtin), list(BUILTINS))})")
    return BUILTINS[builtin]()


def _without_subdivision(asset: Asset) -> Asset:
    """Return an asset in which each control cage is replaced by a mesh of its polygons, without the holes."""
    if all(mesh.subdivision is None for mesh in asset.meshes):
        return asset
    polygonal = make_asset(asset.name, [_polygon_mesh(mesh) for mesh in asset.meshes], asset.instances, asset.slots)
    return replace(polygonal, unit=asset.unit, notes=asset.notes)


def _polygon_mesh(mesh: Mesh) -> Mesh:
    """Return a mesh of the polygons of a control cage, without the holes; other meshes are returned unchanged."""
    if mesh.subdivision is None:
        return mesh
    keep = np.ones(len(mesh.face_sizes), bool)
    keep[mesh.subdivision.holes] = False
    polygonal = mesh.with_corners(np.repeat(keep, mesh.face_sizes), mesh.face_sizes[keep], keep)
    return replace(polygonal, subdivision=None)
