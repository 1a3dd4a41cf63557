"""What each part of an asset wears in a look of a job.

That is the first `assign` that fits it, else the look's `material`, else what the asset binds: a material, or the
primvar displayColor. What nothing covers is the grey of a photographer's card, with a note.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lookdev.asset import Asset, Mesh
from lookdev.asset.usd.collections import is_collection
from lookdev.build.assets import Turned
from lookdev.errors import AssetError, Fault
from lookdev.job.parts import JobLook
from lookdev.material import Layer, Look
from lookdev.material.translate import display_color_look
from lookdev.scene.dress import Part, dress, fit_patterns, path_hint

NEUTRAL = Look("neutral", (Layer("Neutral", "disney", {"baseColor": (0.18, 0.18, 0.18), "roughness": 1.0}),))
_COLOR, _OPACITY = "displayColor", "displayOpacity"


@dataclass(frozen=True, eq=False)
class Dressed:
    """An asset with the look of each slot, as in `Scene`; those of the slots `own` are the asset's own."""

    asset: Asset
    wears: Mapping[str, Look]
    own: frozenset[str]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Place:
    """A table of a job file, in which faults are."""

    file: str
    key: str

    def fault(self, key: str, what: str, hint: str = "") -> Fault:
        """Return the fault of a key of the table."""
        return Fault(self.file, f"{self.key}.{key}", what, hint)


def dress_as(given: JobLook, materials: Sequence[Look], turned: Turned, place: Place, faults: list[Fault]) -> Dressed:
    """Dress an asset as a look of a job; adds patterns that fit nothing to `faults`.

    `materials` are the looks of each `assign`, and last that of `material`, if the look has one. Errors as
    `Turned.bound`.
    """
    covered = covering(given, turned, place, faults)

    def own_material(part: Part) -> int | None:
        """Return the number of the material of the job that covers a part."""
        cover = covered.get(part.path)
        return None if cover is None else len(given.assign) if cover.assign is None else cover.assign

    parts = [part for own in turned.parts.values() for part in own]
    left = [part for part in parts if own_material(part) is None]
    bound = turned.bound(part.slot.material for part in left if part.slot.material is not None)

    def choose(part: Part) -> int | str | None:
        if (number := own_material(part)) is not None:
            return number
        if part.slot.material in bound:
            return part.slot.material
        return _displayed(part.mesh)

    asset, chosen = dress(turned.asset, turned.parts, choose)
    looks: dict[int | str | None, Look] = {**dict(enumerate(materials)), None: NEUTRAL}
    looks |= {path: each.look for path, each in bound.items()}
    looks |= {name: display_color_look(_COLOR, opacity=name == _OPACITY) for name in (_COLOR, _OPACITY)}
    notes = list(lost_notes(fault for each in bound.values() for fault in each.lost))
    worn = {own_material(part) for part in parts}
    for number in range(len(materials)):
        if number not in worn:
            which = f"assign[{number}]" if number < len(given.assign) else "'material'"
            notes.append(f"look '{given.name}': {which} covers no part: others come first for all that it fits")
    if bare := [part.path for part in left if choose(part) is None]:
        more = f" and {len(bare) - 1} more; they are" if len(bare) > 1 else "; it is"
        notes.append(f"look '{given.name}': nothing covers {bare[0]}{more} rendered neutral grey")
    own = frozenset(path for path, key in chosen.items() if isinstance(key, str))
    return Dressed(asset, {path: looks[key] for path, key in chosen.items()}, own, tuple(notes))


@dataclass(frozen=True)
class Cover:
    """What of a look of a job covers a part: the number of an `assign` and its pattern, or the look's `material`."""

    assign: int | None = None
    pattern: str = ""


def covering(given: JobLook, turned: Turned, place: Place, faults: list[Fault]) -> dict[str, Cover]:
    """Return what covers each part that wears a material of the job; adds patterns that fit nothing to `faults`."""
    assigned = [
        (f"assign[{number}].prims", pattern) for number, each in enumerate(given.assign) for pattern in each.prims
    ]
    owners = [number for number, each in enumerate(given.assign) for _ in each.prims]
    first = _fit(assigned, turned, place, faults)
    whole = _fit([("parts", pattern) for pattern in given.parts or ()], turned, place, faults)
    found = {path: Cover(owners[number], assigned[number][1]) for path, number in first.items()}
    if given.material is not None:
        found |= {
            path: Cover() for path in turned.paths if path not in first and (given.parts is None or path in whole)
        }
    return found


def lost_notes(lost: Iterable[Fault]) -> Iterator[str]:
    """Yield what materials lose, once for all that lose an input of the same name for the same reason."""
    alike: dict[tuple[str, str, str, str], list[Fault]] = {}
    for fault in lost:
        alike.setdefault((fault.file, fault.where.rpartition(".")[2], fault.what, fault.hint), []).append(fault)
    for faults in alike.values():
        more = f" and {len(faults) - 1} more" if len(faults) > 1 else ""
        yield str(replace(faults[0], where=f"{faults[0].where}{more}"))


def _displayed(mesh: Mesh) -> str | None:
    """Return the primvar that says most of how a mesh without a material looks; None where it has neither."""
    if (mesh.primvars.get(_OPACITY, np.ones(1)) < 1.0).any():
        return _OPACITY
    return _COLOR if _COLOR in mesh.primvars else None


def _fit(patterns: Sequence[tuple[str, str]], turned: Turned, place: Place, faults: list[Fault]) -> Mapping[str, int]:
    """Return the number of the first pattern that fits each part; `patterns` are beside the keys of their lists."""
    members: dict[str, frozenset[str]] = {}
    broken = set()
    for key, pattern in patterns:
        if is_collection(pattern):
            try:
                members[pattern] = turned.members(pattern)
            except AssetError as error:
                faults.append(place.fault(key, str(error)))
                broken.add(pattern)
                members[pattern] = frozenset()
    fits = fit_patterns([pattern for _, pattern in patterns], turned.paths, members)
    for key, pattern in (patterns[number] for number in fits.unfit):
        if pattern in broken:
            continue
        if pattern in members:
            hint = "it includes none that is rendered"
        elif turned.has_prim(pattern):
            hint = "the asset has this prim, but renders nothing of it"
        else:
            hint = path_hint(pattern, turned.paths)
        faults.append(place.fault(key, f"'{pattern}' fits no part", hint))
    return fits.first
