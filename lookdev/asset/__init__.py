"""What is turned: geometry as arrays, from USD or built in.

`mesh` defines an asset; `usd` and `usd_mesh` read one from a file, `builtin` makes one (`revolve`, `shaderball`);
`normals`, `tangents` and `bounds` compute what a file lacks; `store` has its digest and its file in the cache.
"""

from __future__ import annotations

from pathlib import Path

from lookdev.asset.builtin import BUILTINS
from lookdev.asset.mesh import Asset, Instance, Mesh, Slot
from lookdev.asset.store import read_asset, save_asset
from lookdev.errors import AssetError, nearest_hint

__all__ = ["BUILTINS", "Asset", "Instance", "Mesh", "Slot", "load_asset", "read_asset", "save_asset"]


def load_asset(usd: Path | None = None, builtin: str | None = None, prim: str | None = None) -> Asset:
    """Return an asset from a USD file (all of it, or the prim `prim`) or by the name of a built-in.

    Raises
    ------
    AssetError
        Not exactly one of `usd` and `builtin` is given, the name is unknown, or the file has a fault.
    """
    if (usd is None) == (builtin is None):
        raise AssetError(f"an asset is either a USD file or a built-in, got usd={usd} and builtin={builtin}")
    if usd is not None:
        # Not at the top: the render worker, which reads assets from the cache, needs no USD.
        from lookdev.asset.usd import read_usd

        return read_usd(usd, prim)
    if prim is not None:
        raise AssetError(f"prim {prim}: a built-in asset has no prims to choose from; leave prim out")
    if builtin not in BUILTINS:
        raise AssetError(f"there is no built-in asset '{builtin}' ({nearest_hint(str(builtin), list(BUILTINS))})")
    return BUILTINS[builtin]()
