"""The UV sets and primvars that looks read: replacement of UV sets that meshes lack, and notes on what is missing.

If a mesh lacks a UV set, its default set (``st``, or else its only set) is added under the missing name. If it has no
default set either, `lookdev.plan` reports the fault later, because only the generated source shows whether a shader
reads the set.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace

import numpy as np

from lookdev.asset import Asset, Mesh
from lookdev.asset.store import asset_digest
from lookdev.material import Bump, Coordinates, Look, Primvar, Texture, leaf_sources


def look_uvs(look: Look) -> tuple[str, ...]:
    """Return the names of the UV sets that a look reads, in the order in which it reads them."""
    return tuple(dict.fromkeys(leaf.st for leaf in _leaves(look) if not isinstance(leaf, Primvar)))


def add_missing_uvs(
    asset: Asset, look_of_slot: Mapping[str, Look], bound: Collection[str] = ()
) -> tuple[Asset, tuple[str, ...]]:
    """Return the asset with the UV sets that its looks read, and notes on replaced sets.

    `look_of_slot` maps the paths of slots to looks, as `Scene.look_of_slot`. `bound` has the paths of slots whose look
    comes from the asset itself. If a mesh has no UV set, and only such looks read a UV set of it, they read (0, 0), as
    USD's own readers do.
    """
    looks = [look_of_slot[slot.path] for slot in asset.slots]
    uv_names = {id(look): look_uvs(look) for look in looks}
    is_bound = [slot.path in bound for slot in asset.slots]
    lacking: dict[tuple[str, str], list[Mesh]] = {}  # by the missing set, and the set that replaces it or ""
    all_names = {name for names in uv_names.values() for name in names}
    meshes = []
    for mesh in asset.meshes:
        if all_names <= mesh.uvs.keys():
            meshes.append(mesh)
            continue
        slots = np.unique(mesh.face_slots).tolist()
        reads_zeros = not mesh.uvs and all(is_bound[slot] or not uv_names[id(looks[slot])] for slot in slots)
        zeros = np.zeros((len(mesh.corner_points), 2), np.float32)
        fallback = mesh.uvs[mesh.default_uv] if mesh.default_uv else zeros
        missing = [name for slot in slots for name in uv_names[id(looks[slot])] if name not in mesh.uvs]
        added = dict.fromkeys(missing, fallback) if mesh.default_uv or reads_zeros else {}
        for name in added:
            lacking.setdefault((name, mesh.default_uv), []).append(mesh)
        meshes.append(replace(mesh, uvs={**mesh.uvs, **added}) if added else mesh)
    if not lacking:
        return asset, ()
    completed = replace(asset, meshes=tuple(meshes))
    notes = tuple(_replacement_note(*key, meshes_without) for key, meshes_without in lacking.items())
    return replace(completed, digest=asset_digest(completed)), notes


def missing_primvar_notes(asset: Asset, look_of_slot: Mapping[str, Look]) -> tuple[str, ...]:
    """Return notes on primvars that looks read and meshes lack; `look_of_slot` is `Scene.look_of_slot`."""
    looks = [look_of_slot[slot.path] for slot in asset.slots]
    primvar_names = {id(look): {leaf.name for leaf in _leaves(look) if isinstance(leaf, Primvar)} for look in looks}
    lacking: dict[str, list[Mesh]] = {}
    for mesh in asset.meshes if any(primvar_names.values()) else ():
        names = {name for slot in np.unique(mesh.face_slots).tolist() for name in primvar_names[id(looks[slot])]}
        for name in sorted(names - mesh.primvars.keys()):
            lacking.setdefault(name, []).append(mesh)
    return tuple(
        f"{_missing_phrase(meshes, 'primvar', name)}: its fallback is read" for name, meshes in lacking.items()
    )


def _replacement_note(name: str, fallback: str, meshes: list[Mesh]) -> str:
    replacement = f"'{fallback}' is read" if fallback else "nor another; textures are read at (0, 0)"
    return f"{_missing_phrase(meshes, 'UV set', name)}: {replacement}"


def _missing_phrase(meshes: list[Mesh], kind: str, name: str) -> str:
    """Return the statement that meshes lack a primvar or UV set; `kind` is the word for it."""
    more = f" and {len(meshes) - 1} more have" if len(meshes) > 1 else " has"
    return f"{meshes[0].name}{more} no {kind} '{name}', which looks ask for"


def _leaves(look: Look) -> Iterator[Texture | Coordinates | Primvar]:
    """Yield the inputs of a look that read the geometry: textures, coordinates and primvars."""
    sources = [source for layer in look.layers for source in (*layer.inputs.values(), layer.mask)]
    if look.displacement is not None:
        sources.append(look.displacement.height)
    for source in leaf_sources(sources):
        match source:
            case Texture() | Coordinates() | Primvar():
                yield source
            case Bump():
                yield source.height
