"""Assignment of looks to the parts of an asset, for one ``[[look]]`` of a job.

A *part* is a mesh or a GeomSubset of a mesh (`lookdev.scene.parts`). A part gets the first of these that exists:

1. the material of the first ``assign`` table of the ``[[look]]`` with a pattern that fits the part
2. the ``material`` of the ``[[look]]``
3. the material that the asset binds to the part
4. a look that is made from the primvar displayColor
5. the grey of a photographer's card, with a note
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lookdev.asset import Asset, Mesh
from lookdev.asset.usd.collections import is_collection
from lookdev.build.assets import ComposedAsset
from lookdev.build.faults import Findings
from lookdev.errors import AssetError, Fault
from lookdev.job.parts import JobAssign, JobLook
from lookdev.material import Layer, Look
from lookdev.material.translate import display_color_look
from lookdev.material.usd.bound import read_any_look
from lookdev.scene.parts import Part, assign_to_parts, fit_patterns, path_hint

NEUTRAL_LOOK = Look("neutral", (Layer("Neutral", "disney", {"baseColor": (0.18, 0.18, 0.18), "roughness": 1.0}),))
_COLOR, _OPACITY = "displayColor", "displayOpacity"


@dataclass(frozen=True, eq=False)
class AssignedAsset:
    """An asset with the look of each slot; a slot is a part to which one look is assigned.

    `looks` has the look of each slot, by the slot's path. `bound` has the paths of the slots whose looks come from the
    asset itself: from its materials, or from its displayColor.
    """

    asset: Asset
    looks: Mapping[str, Look]
    bound: frozenset[str]


@dataclass(frozen=True)
class Assignment:
    """The statement in a ``[[look]]`` that gives a part its material.

    `assign` is the index of the ``assign`` table, and `pattern` is the pattern of this table that fits the part. If
    `assign` is None, the part has the ``material`` of the ``[[look]]`` itself.
    """

    assign: int | None = None
    pattern: str = ""


def read_materials(look: JobLook, key: str, findings: Findings) -> list[Look]:
    """Read the looks of the ``assign`` tables of a ``[[look]]``, then the look of its own ``material``, if any.

    `key` is the key of the ``[[look]]`` in the job file. A material with faults is replaced by grey.
    """
    materials: list[Look] = []
    tables: tuple[JobAssign | JobLook, ...] = (*look.assign, look)
    for number, table in enumerate(tables):
        if table.material is None:
            continue
        table_key, name = (key, look.name) if table is look else (f"{key}.assign[{number}]", None)
        materials.append(NEUTRAL_LOOK)
        with findings.collect(table_key):
            opened = read_any_look(table.material, table.prim, table.variants, name)
            materials[-1] = opened.look
            findings.note(*loss_notes(opened.losses))
    return materials


def assign_looks(
    look: JobLook, materials: Sequence[Look], composed: ComposedAsset, key: str, findings: Findings
) -> AssignedAsset:
    """Return the asset with the look of each of its slots, for a ``[[look]]`` of a job.

    Parameters
    ----------
    materials
        The result of `read_materials`.
    key
        The key of the ``[[look]]`` in the job file. A pattern that fits no part is a fault of a key below it.

    Raises
    ------
    LookError, FaultsError
        A material that the asset binds cannot be read.
    """
    assignments = assignments_of_parts(look, composed, key, findings)

    def material_number(part: Part) -> int | None:
        """Return the index in `materials` of the material of a part; None if the job assigns none to it."""
        assignment = assignments.get(part.path)
        if assignment is None:
            return None
        return len(look.assign) if assignment.assign is None else assignment.assign

    parts = [part for parts in composed.parts.values() for part in parts]
    uncovered = [part for part in parts if material_number(part) is None]
    bound = composed.bound_looks(part.slot.material for part in uncovered if part.slot.material is not None)

    def choose(part: Part) -> int | str | None:
        """Return an index in `materials`, else the path of a bound material, else the name of a primvar, else None."""
        if (number := material_number(part)) is not None:
            return number
        return part.slot.material if part.slot.material in bound else _display_primvar(part.mesh)

    asset, choices = assign_to_parts(composed.asset, composed.parts, choose)
    looks: dict[int | str | None, Look] = {**dict(enumerate(materials)), None: NEUTRAL_LOOK}
    looks |= {path: material.look for path, material in bound.items()}
    looks |= {name: display_color_look(_COLOR, opacity=name == _OPACITY) for name in (_COLOR, _OPACITY)}
    findings.note(*loss_notes(fault for material in bound.values() for fault in material.losses))
    for number in sorted(set(range(len(materials))) - {material_number(part) for part in parts}):
        table = f"assign[{number}]" if number < len(look.assign) else "'material'"
        findings.note(f"look '{look.name}': {table} covers no part: others come first for all that it fits")
    if grey_paths := [part.path for part in uncovered if choose(part) is None]:
        more = f" and {len(grey_paths) - 1} more; they are" if len(grey_paths) > 1 else "; it is"
        findings.note(f"look '{look.name}': nothing covers {grey_paths[0]}{more} rendered neutral grey")
    bound_paths = frozenset(path for path, choice in choices.items() if isinstance(choice, str))
    return AssignedAsset(asset, {path: looks[choice] for path, choice in choices.items()}, bound_paths)


def assignments_of_parts(look: JobLook, composed: ComposedAsset, key: str, findings: Findings) -> dict[str, Assignment]:
    """Return the assignments of parts by the part's path; parts without a material from the job are left out.

    Patterns that fit no part are faults.
    """
    numbers_and_patterns = [(number, pattern) for number, assign in enumerate(look.assign) for pattern in assign.prims]
    patterns = [(f"{key}.assign[{number}].prims", pattern) for number, pattern in numbers_and_patterns]
    first_assign = _match_patterns(patterns, composed, findings)
    allowed = _match_patterns([(f"{key}.parts", pattern) for pattern in look.parts or ()], composed, findings)
    assignments = {path: Assignment(*numbers_and_patterns[index]) for path, index in first_assign.items()}
    if look.material is not None:
        assignments |= {
            path: Assignment()
            for path in composed.paths
            if path not in first_assign and (look.parts is None or path in allowed)
        }
    return assignments


def loss_notes(lost: Iterable[Fault]) -> Iterator[str]:
    """Yield notes on inputs that were lost in the translation of materials, one note for equal names and reasons."""
    alike: dict[tuple[str, str, str, str], list[Fault]] = {}
    for fault in lost:
        alike.setdefault((fault.file, fault.where.rpartition(".")[2], fault.what, fault.hint), []).append(fault)
    for faults in alike.values():
        more = f" and {len(faults) - 1} more" if len(faults) > 1 else ""
        yield str(replace(faults[0], where=f"{faults[0].where}{more}"))


def _display_primvar(mesh: Mesh) -> str | None:
    """Return the primvar that gives a mesh without a material its look: displayOpacity or displayColor.

    displayOpacity counts if it is below 1 anywhere. Without both primvars, the result is None.
    """
    if (mesh.primvars.get(_OPACITY, np.ones(1)) < 1.0).any():
        return _OPACITY
    return _COLOR if _COLOR in mesh.primvars else None


def _match_patterns(
    patterns: Sequence[tuple[str, str]], composed: ComposedAsset, findings: Findings
) -> Mapping[str, int]:
    """Return the index of the first pattern that fits each part, by the part's path; other parts are not in the result.

    `patterns` are pairs of a key in the job file and a pattern. A pattern that fits no part is a fault of the key.
    """
    members: dict[str, frozenset[str]] = {}
    broken = set()
    for key, pattern in patterns:
        if is_collection(pattern):
            try:
                members[pattern] = composed.members(pattern)
            except AssetError as error:
                findings.add(key, str(error))
                broken.add(pattern)
                members[pattern] = frozenset()
    fits = fit_patterns([pattern for _, pattern in patterns], composed.paths, members)
    for key, pattern in (patterns[number] for number in fits.unmatched):
        if pattern in broken:
            continue
        if pattern in members:
            hint = "it includes none that is rendered"
        elif composed.has_prim(pattern):
            hint = "the asset has this prim, but renders nothing of it"
        else:
            hint = path_hint(pattern, composed.paths)
        findings.add(key, f"'{pattern}' fits no part", hint)
    return fits.first
