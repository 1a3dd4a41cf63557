"""The parts of an asset, patterns over their paths, and an asset that is dressed: each slot wears one thing.

A part is a mesh, or a GeomSubset of one, as the instances at one path show it. Instances share their mesh, and its
slots; where only some of them are to wear something else, the mesh is split in two that share all arrays but
`face_slots`.
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

Shown = tuple[int, str]
"""A mesh, by its number, and the path of the instances that show it."""

_MOST_KNOWN = 8  # paths that a hint lists


@dataclass(frozen=True, eq=False)
class Part:
    """What takes one look; `path` is that of its instances, with the name of a GeomSubset, `slot` that of the mesh."""

    path: str
    mesh: Mesh
    slot: Slot


def asset_parts(asset: Asset) -> dict[Shown, tuple[Part, ...]]:
    """Return the parts of each mesh at each path; those of a mesh without an instance are at the path of its name."""
    slots = [np.unique(mesh.face_slots).tolist() for mesh in asset.meshes]
    shown = dict.fromkeys((each.mesh, each.path) for each in asset.instances)
    hidden = set(range(len(asset.meshes))) - {number for number, _ in shown}
    shown |= dict.fromkeys((number, asset.meshes[number].name) for number in sorted(hidden))
    return {
        (number, path): tuple(_part(asset.meshes[number], asset.slots[slot], path) for slot in slots[number])
        for number, path in shown
    }


def dress(
    asset: Asset, parts: Mapping[Shown, Sequence[Part]], choose: Callable[[Part], Key]
) -> tuple[Asset, dict[str, Key]]:
    """Return the asset with slots that wear one thing each, and what the slot of each path wears.

    `parts` are those of `asset_parts`. Where all instances of each mesh wear the same, it is the asset that was given.
    """
    meshes, slots = list(asset.meshes), list(asset.slots)
    wears: dict[str, Key] = {}
    dressed: dict[tuple[int, tuple[Key, ...]], int] = {}
    numbers: dict[Shown, int] = {}
    taken: set[int] = set()
    for shown, own in parts.items():
        number, keys = shown[0], tuple(choose(part) for part in own)
        if (number, keys) not in dressed:
            if number in taken:
                dressed[number, keys] = len(meshes)
                meshes.append(_split(meshes[number], shown[1], len(slots)))
                slots += [Slot(part.path, part.slot.material) for part in own]
                wears |= zip([part.path for part in own], keys, strict=True)
            else:
                dressed[number, keys] = number
                taken.add(number)
                wears |= zip([part.slot.path for part in own], keys, strict=True)
        numbers[shown] = dressed[number, keys]
    if len(meshes) == len(asset.meshes):
        return asset, wears
    instances = tuple(replace(each, mesh=numbers[each.mesh, each.path]) for each in asset.instances)
    split = replace(asset, meshes=tuple(meshes), slots=tuple(slots), instances=instances)
    return replace(split, digest=asset_digest(split)), wears


@dataclass(frozen=True)
class Fits:
    """Which pattern each path takes, by number, the first that fits; and the numbers of those that fit no path."""

    first: Mapping[str, int]
    unfit: tuple[int, ...]


def fit_patterns(
    patterns: Sequence[str], paths: Iterable[str], members: Mapping[str, Collection[str]] | None = None
) -> Fits:
    """Find the first pattern that fits each path.

    A pattern is a glob (`fnmatch`: ``*`` stands for any characters, ``/`` too), and fits a prim with all that is below
    it. `members` has the paths of patterns that are collections, which fit these alone.
    """
    members = members or {}
    # By path: the collections of which it is a member, and the patterns that are this path.
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
    covering: dict[str, float] = {"": math.inf}

    def cover(path: str) -> float:
        """Return the first pattern that fits a path or one above it."""
        if path not in covering:
            fitting = [*literal.get(path, ()), *(number for number, glob in globs if glob.match(path))]
            fitted.update(fitting)
            covering[path] = min([*fitting, cover(path.rpartition("/")[0])])
        return covering[path]

    first: dict[str, int] = {}
    for path in paths:
        fitting = collected.get(path, ())
        fitted.update(fitting)
        if (number := min([cover(path), *fitting])) < math.inf:
            first[path] = int(number)
    return Fits(first, tuple(number for number in range(len(patterns)) if number not in fitted))


def path_hint(pattern: str, paths: Iterable[str]) -> str:
    """Return a hint with the paths nearest to a pattern that fits none."""
    known = {above for path in paths for above in _ancestry(path)}
    folded = {key.casefold(): path for path in sorted(known, reverse=True) for key in (path, path.rpartition("/")[2])}
    plain = pattern.strip("</>").casefold()
    if alike := folded.get(f"/{plain}", folded.get(plain)):
        return f"did you mean '{alike}'?"
    above = pattern.rpartition("/")[0]
    while above and above not in known:
        above = above.rpartition("/")[0]
    near = {path.rpartition("/")[2]: path for path in sorted(known) if path.rpartition("/")[0] == above}
    close = difflib.get_close_matches(pattern.removeprefix(above).strip("/").partition("/")[0], near, n=1)
    if close:
        return f"did you mean '{near[close[0]]}'?"
    more = f", ... ({len(near)})" if len(near) > _MOST_KNOWN else ""
    return f"known: {', '.join(list(near.values())[:_MOST_KNOWN])}{more}"


def _part(mesh: Mesh, slot: Slot, path: str) -> Part:
    return Part(path + slot.path.removeprefix(mesh.name) if path else slot.path, mesh, slot)


def _split(mesh: Mesh, path: str, first: int) -> Mesh:
    """Return the mesh of the instances at a path, with slots of its own from number `first`."""
    _, compact = np.unique(mesh.face_slots, return_inverse=True)
    return replace(mesh, name=path, face_slots=(compact + first).astype(np.int32))


def _ancestry(path: str) -> Iterator[str]:
    while path:
        yield path
        path = path.rpartition("/")[0]
