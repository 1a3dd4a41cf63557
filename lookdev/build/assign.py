"""The look of each part of an asset, for a look of a job.

It is that of the first `assign` that fits the part, else the job look's `material`, else the material that the asset
binds, else the primvar displayColor. A part without any of these gets the grey of a photographer's card, with a note.
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
    """An asset with the look of each slot, by the slot's path; `bound` are the slots with the asset's own looks."""

    asset: Asset
    looks: Mapping[str, Look]
    bound: frozenset[str]


@dataclass(frozen=True)
class Assignment:
    """The material that covers a part: that of the look's `assign` with this number, whose `pattern` fits the part.

    If `assign` is None, it is the look's own `material`.
    """

    assign: int | None = None
    pattern: str = ""


def read_materials(look: JobLook, key: str, findings: Findings) -> list[Look]:
    """Return a look for each `assign` of a job's look, then one for its `material`; grey in place of a faulty one."""
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
    """Return the asset with the look of each of its slots, for a look of a job.

    Parameters
    ----------
    materials
        As `read_materials` returns them.
    key
        The key of the look in the job: patterns that fit no part are faults below it.

    Raises
    ------
    LookError, FaultsError
        A material that the asset binds cannot be read.
    """
    assignments = assignments_of_parts(look, composed, key, findings)

    def material_number(part: Part) -> int | None:
        """Return the number of the material of the job that covers a part."""
        assignment = assignments.get(part.path)
        if assignment is None:
            return None
        return len(look.assign) if assignment.assign is None else assignment.assign

    parts = [part for parts in composed.parts.values() for part in parts]
    uncovered = [part for part in parts if material_number(part) is None]
    bound = composed.bound_looks(part.slot.material for part in uncovered if part.slot.material is not None)

    def choose(part: Part) -> int | str | None:
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
    """Return the assignment of each part that a material of the job covers; patterns that fit no part are faults."""
    owners = [(number, pattern) for number, assign in enumerate(look.assign) for pattern in assign.prims]
    patterns = [(f"{key}.assign[{number}].prims", pattern) for number, pattern in owners]
    first_assign = _match_patterns(patterns, composed, findings)
    allowed = _match_patterns([(f"{key}.parts", pattern) for pattern in look.parts or ()], composed, findings)
    assignments = {path: Assignment(*owners[number]) for path, number in first_assign.items()}
    if look.material is not None:
        assignments |= {
            path: Assignment()
            for path in composed.paths
            if path not in first_assign and (look.parts is None or path in allowed)
        }
    return assignments


def loss_notes(lost: Iterable[Fault]) -> Iterator[str]:
    """Yield notes on lost inputs of materials, one note for inputs of the same name and reason."""
    alike: dict[tuple[str, str, str, str], list[Fault]] = {}
    for fault in lost:
        alike.setdefault((fault.file, fault.where.rpartition(".")[2], fault.what, fault.hint), []).append(fault)
    for faults in alike.values():
        more = f" and {len(faults) - 1} more" if len(faults) > 1 else ""
        yield str(replace(faults[0], where=f"{faults[0].where}{more}"))


def _display_primvar(mesh: Mesh) -> str | None:
    """Return the primvar for the look of a mesh without a material, opacity before colour; None without both."""
    if (mesh.primvars.get(_OPACITY, np.ones(1)) < 1.0).any():
        return _OPACITY
    return _COLOR if _COLOR in mesh.primvars else None


def _match_patterns(
    patterns: Sequence[tuple[str, str]], composed: ComposedAsset, findings: Findings
) -> Mapping[str, int]:
    """Return the number of the first pattern that fits each part; `patterns` are pairs of a key and a pattern."""
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
