"""The UV sets and primvars that looks ask for, found on the meshes that wear them.

A set that a mesh lacks is its default set, `st` or else the only one, under the name that was asked for. Where a mesh
has neither, what a shader really reads is known only after its source is generated: `lookdev.plan` reports the fault.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace

import numpy as np

from lookdev.asset import Asset, Mesh
from lookdev.asset.mesh import Floats
from lookdev.asset.store import asset_digest
from lookdev.material import Bump, Coordinates, Look, Primvar, Texture
from lookdev.material.look import leaves


def look_uvs(look: Look) -> tuple[str, ...]:
    """Return the UV sets that a look asks for, in order."""
    return tuple(dict.fromkeys(leaf.st for leaf in _leaves(look) if not isinstance(leaf, Primvar)))


def with_uvs(asset: Asset, wears: Mapping[str, Look], own: Collection[str] = ()) -> tuple[Asset, tuple[str, ...]]:
    """Return the asset with the UV sets that its looks ask for, and notes on those found under another name.

    `wears` is as in `Scene`; `own` are the slots whose look is the asset's own. Where these alone ask a mesh
    without any UV set, they read (0, 0), as USD's own readers do.
    """
    looks = [wears[slot.path] for slot in asset.slots]
    asked = {id(look): look_uvs(look) for look in looks}
    mine = [slot.path in own for slot in asset.slots]
    lacking: dict[tuple[str, str], list[Mesh]] = {}
    every = {name for names in asked.values() for name in names}
    meshes = []
    for mesh in asset.meshes:
        if every <= mesh.uvs.keys():
            meshes.append(mesh)
            continue
        added: dict[str, Floats] = {}
        slots = np.unique(mesh.face_slots).tolist()
        bare = not mesh.uvs and all(mine[slot] or not asked[id(looks[slot])] for slot in slots)
        for slot in slots:
            for name in asked[id(looks[slot])]:
                if name in mesh.uvs or not (mesh.default_uv or bare):
                    continue
                added[name] = mesh.uvs[mesh.default_uv] if mesh.default_uv else _zeros(mesh)
        for name in added:
            lacking.setdefault((name, mesh.default_uv), []).append(mesh)
        meshes.append(replace(mesh, uvs={**mesh.uvs, **added}) if added else mesh)
    if not lacking:
        return asset, ()
    made = replace(asset, meshes=tuple(meshes))
    return replace(made, digest=asset_digest(made)), tuple(_note(*key, found) for key, found in lacking.items())


def absent_primvars(asset: Asset, wears: Mapping[str, Look]) -> tuple[str, ...]:
    """Return notes on primvars that looks ask for and meshes lack, whose fallback is read; `wears` as in `Scene`."""
    looks = [wears[slot.path] for slot in asset.slots]
    asked = {id(look): {each.name for each in _leaves(look) if isinstance(each, Primvar)} for look in looks}
    lacking: dict[str, list[Mesh]] = {}
    for mesh in asset.meshes if any(asked.values()) else ():
        names = {name for slot in np.unique(mesh.face_slots).tolist() for name in asked[id(looks[slot])]}
        for name in sorted(names - mesh.primvars.keys()):
            lacking.setdefault(name, []).append(mesh)
    return tuple(f"{_which(found, 'primvar', name)}: its fallback is read" for name, found in lacking.items())


def _note(asked: str, found: str, meshes: list[Mesh]) -> str:
    taken = f"'{found}' is read" if found else "nor another; textures are read at (0, 0)"
    return f"{_which(meshes, 'UV set', asked)}: {taken}"


def _which(meshes: list[Mesh], what: str, name: str) -> str:
    more = f" and {len(meshes) - 1} more have" if len(meshes) > 1 else " has"
    return f"{meshes[0].name}{more} no {what} '{name}', which looks ask for"


def _zeros(mesh: Mesh) -> Floats:
    return np.zeros((len(mesh.corner_points), 2), np.float32)


def _leaves(look: Look) -> Iterator[Texture | Coordinates | Primvar]:
    """Yield what the geometry has to give a look: coordinates of textures, coordinates and primvars."""
    sources = [source for layer in look.layers for source in (*layer.inputs.values(), layer.mask)]
    if look.displacement is not None:
        sources.append(look.displacement.height)
    for source in leaves(sources):
        match source:
            case Texture() | Coordinates() | Primvar():
                yield source
            case Bump():
                yield source.height
