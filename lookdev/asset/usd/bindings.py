"""Which materials the prims of a stage are bound to, by the rules of UsdShade, and bindings that lead nowhere."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from pxr import Sdf, Usd, UsdShade

from lookdev.stage import bound_paths


def bound_materials(prims: Sequence[Usd.Prim]) -> list[Usd.Prim | None]:
    """Return the material of each prim for final renders: of purpose full, else of all purposes."""
    if not prims:
        return []
    materials, _ = UsdShade.MaterialBindingAPI.ComputeBoundMaterials(list(prims), UsdShade.Tokens.full)
    return [material.GetPrim() if material else None for material in materials]


def dangling(prims: Sequence[Usd.Prim]) -> Iterator[tuple[str, Sdf.Path, Usd.Prim]]:
    """Yield each binding on these prims and above them whose material is not there: its name, target and prim."""
    seen: set[Sdf.Path] = set()
    for prim in prims:
        while prim and prim.GetPath() not in seen:
            seen.add(prim.GetPath())
            for name, path in bound_paths(prim).items():
                if not UsdShade.Material(prim.GetStage().GetPrimAtPath(path)):
                    yield name, path, prim
            prim = prim.GetParent()
