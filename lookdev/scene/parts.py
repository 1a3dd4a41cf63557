"""The parts of an asset, patterns over their paths, and the assignment of looks or lights to parts.

A part is a mesh, or a GeomSubset of a mesh, at the path of one or more instances. All instances of a mesh share its
slots: a slot (`Asset.slots`) is the entry of a part in the asset. If a look or light is assigned to some of the
instances only, the mesh is copied: the copies share all arrays but `face_slots`, and have slots of their own.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Callable, Collection, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import translate
from typing import TypeVar

import numpy as np

from lookdev.asset import Asset, Mesh, Slot
from lookdev.asset.store import asset_digest

Key = TypeVar("Key", bound=Hashable)

MeshAtPath = tuple[int, str]
"""The index of a mesh in its asset, and a path that one or more of its instances have."""

_MAX_HINTS = 8  # the maximum number of paths that a hint lists


@dataclass(frozen=True, eq=False)
class Part:
    """A mesh, or a GeomSubset of a mesh, to which a look or lights are assigned.

    `path` is the path of instances of the mesh, followed by the name of the GeomSubset if the part is one. `slot` is
    the slot of the part's faces.
    """

    path: str
    mesh: Mesh
    slot: Slot


def asset_parts(asset: Asset) -> dict[MeshAtPath, tuple[Part, ...]]:
    """Return the parts of each mesh at each path of its instances; a mesh without instances has its name as path."""
    slots = [np.unique(mesh.face_slots).tolist() for mesh in asset.meshes]
    meshes_at_paths = dict.fromkeys((instance.mesh, instance.path) for instance in asset.instances)
    hidden = set(range(len(asset.meshes))) - {number for number, _ in meshes_at_paths}
    meshes_at_paths |= dict.fromkeys((number, asset.meshes[number].name) for number in sorted(hidden))
    return {
        (number, path): tuple(_part(asset.meshes[number], asset.slots[slot], path) for slot in slots[number])
        for number, path in meshes_at_paths
    }


def assign_to_parts(
    asset: Asset, parts: Mapping[MeshAtPath, Sequence[Part]], choose: Callable[[Part], Key]
) -> tuple[Asset, dict[str, Key]]:
    """Return an asset in which all parts of a slot have the same choice, and the choice of each slot by its path.

    `choose` returns the choice for a part, for example its look; `parts` is the result of `asset_parts`. Meshes whose
    instances have different choices are split. If no mesh is split, the asset is the same object.
    """
    meshes, slots = list(asset.meshes), list(asset.slots)
    choice_of_slot: dict[str, Key] = {}
    # The new mesh, by the old mesh and the choices for its parts. The first choices for a mesh leave it unchanged.
    mesh_numbers: dict[tuple[int, tuple[Key, ...]], int] = {}
    number_at_path: dict[MeshAtPath, int] = {}
    assigned: set[int] = set()
    for mesh_at_path, mesh_parts in parts.items():
        number, keys = mesh_at_path[0], tuple(choose(part) for part in mesh_parts)
        if (number, keys) not in mesh_numbers:
            if number in assigned:
                mesh_numbers[number, keys] = len(meshes)
                meshes.append(_split_mesh(meshes[number], mesh_at_path[1], len(slots)))
                slots += [Slot(part.path, part.slot.material) for part in mesh_parts]
                choice_of_slot |= zip([part.path for part in mesh_parts], keys, strict=True)
            else:
                mesh_numbers[number, keys] = number
                assigned.add(number)
                choice_of_slot |= zip([part.slot.path for part in mesh_parts], keys, strict=True)
        number_at_path[mesh_at_path] = mesh_numbers[number, keys]
    if len(meshes) == len(asset.meshes):
        return asset, choice_of_slot
    instances = tuple(
        replace(instance, mesh=number_at_path[instance.mesh, instance.path]) for instance in asset.instances
    )
    split = replace(asset, meshes=tuple(meshes), slots=tuple(slots), instances=instances)
    return replace(split, digest=asset_digest(split)), choice_of_slot


@dataclass(frozen=True)
class PatternFits:
    """The result of `fit_patterns`.

    `first` has, by path, the index of the first pattern that fits the path; it lacks paths that no pattern fits.
    `unmatched` has the indices of the patterns that fit no path.
    """

    first: Mapping[str, int]
    unmatched: tuple[int, ...]


def fit_patterns(
    patterns: Sequence[str], paths: Iterable[str], members: Mapping[str, Collection[str]] | None = None
) -> PatternFits:
    """Find the first pattern that fits each path.

    A pattern is a glob (`fnmatch`: ``*`` matches any characters, including ``/``). It fits a prim and all descendants
    of the prim. Patterns that are keys of `members` are names of collections instead, and fit only the paths that
    `members` has for them.
    """
    members = members or {}
    # For each path, the indices of the collections that include it, and of the patterns that are equal to it.
    collected: dict[str, list[int]] = {}
    literal: dict[str, list[int]] = {}
    globs: list[tuple[int, re.Pattern[str]]] = []
    for number, pattern in enumerate(patterns):
        if pattern in members:
            for path in members[pattern]:
                collected.setdefault(path, []).append(number)
        elif any(character in pattern for character in "*?["):
            globs.append((number, re.compile(translate(pattern))))
        else:
            literal.setdefault(pattern, []).append(number)
    fitted: set[int] = set()
    first_fits: dict[str, float] = {"": math.inf}

    def first_fit(path: str) -> float:
        """Return the index of the first pattern that fits a path or one of its ancestors; inf if none does."""
        if path not in first_fits:
            fitting = [*literal.get(path, ()), *(number for number, glob in globs if glob.match(path))]
            fitted.update(fitting)
            first_fits[path] = min([*fitting, first_fit(path.rpartition("/")[0])])
        return first_fits[path]

    first: dict[str, int] = {}
    for path in paths:
        fitting = collected.get(path, ())
        fitted.update(fitting)
        if (number := min([first_fit(path), *fitting])) < math.inf:
            first[path] = int(number)
    return PatternFits(first, tuple(number for number in range(len(patterns)) if number not in fitted))


def path_hint(pattern: str, paths: Iterable[str]) -> str:
    """Return a hint for a pattern that fits no path: a path that resembles it, or else the known paths."""
    known_paths = {parent for path in paths for parent in _path_and_ancestors(path)}
    folded = {
        key.casefold(): path for path in sorted(known_paths, reverse=True) for key in (path, path.rpartition("/")[2])
    }
    plain = pattern.strip("</>").casefold()
    if alike := folded.get(f"/{plain}", folded.get(plain)):
        return f"did you mean '{alike}'?"
    parent = pattern.rpartition("/")[0]
    while parent and parent not in known_paths:
        parent = parent.rpartition("/")[0]
    children = {path.rpartition("/")[2]: path for path in sorted(known_paths) if path.rpartition("/")[0] == parent}
    close = difflib.get_close_matches(pattern.removeprefix(parent).strip("/").partition("/")[0], children, n=1)
    if close:
        return f"did you mean '{children[close[0]]}'?"
    more = f", ... ({len(children)})" if len(children) > _MAX_HINTS else ""
    return f"known: {', '.join(list(children.values())[:_MAX_HINTS])}{more}"


def _part(mesh: Mesh, slot: Slot, path: str) -> Part:
    """Return the part that a slot of a mesh is, at a path of instances; slot paths begin with the mesh's name."""
    return Part(path + slot.path.removeprefix(mesh.name) if path else slot.path, mesh, slot)


def _split_mesh(mesh: Mesh, path: str, first: int) -> Mesh:
    """Return a copy of the mesh with a path as its name, and with slots that are numbered from `first` on."""
    _, compact = np.unique(mesh.face_slots, return_inverse=True)
    return replace(mesh, name=path, face_slots=(compact + first).astype(np.int32))


def _path_and_ancestors(path: str) -> Iterator[str]:
    """Yield a path and the paths of its ancestors, without the root."""
    while path:
        yield path
        path = path.rpartition("/")[0]
