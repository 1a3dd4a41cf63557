"""The materials to which prims are bound, by the rules of UsdShade, and bindings whose target does not exist."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from pxr import Sdf, Usd, UsdShade

from lookdev.stage import binding_targets


def bound_materials(prims: Sequence[Usd.Prim]) -> list[Usd.Prim | None]:
    """Return the bound material of each prim for final renders: that of purpose full, else that of all purposes."""
    if not prims:
        return []
    materials, _ = UsdShade.MaterialBindingAPI.ComputeBoundMaterials(list(prims), UsdShade.Tokens.full)
    return [material.GetPrim() if material else None for material in materials]


def dangling_bindings(prims: Sequence[Usd.Prim]) -> Iterator[tuple[str, Sdf.Path, Usd.Prim]]:
    """Yield (name, target, prim) of each binding on the prims and their ancestors whose target is not a material."""
    visited: set[Sdf.Path] = set()
    for prim in prims:
        while prim and prim.GetPath() not in visited:
            visited.add(prim.GetPath())
            for name, path in binding_targets(prim).items():
                if not UsdShade.Material(prim.GetStage().GetPrimAtPath(path)):
                    yield name, path, prim
            prim = prim.GetParent()
