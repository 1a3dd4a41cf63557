"""Expansion of the wedges of a job: the looks and lights that they add, and their contact sheets.

A wedge renders looks under lights (an ``[[ibl]]`` or ``[[rig]]``) with a series of values of a parameter. Each value
makes another look or light. A wedge has one or two *axes*. An axis is a parameter with its values, the *steps*.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import product

from lookdev.build.faults import Findings
from lookdev.errors import ModelError, nearest_hint
from lookdev.job.schema import Job, JobIbl, JobRig
from lookdev.job.wedge import LIGHT_KEYS, JobAxis, JobWedge, WedgeInput, light_key_error
from lookdev.material import Look
from lookdev.material.change import look_with_value


@dataclass(frozen=True)
class WedgeSheet:
    """A contact sheet of a wedge, for one look under one light of the job.

    `name` is the name of the sheet, and `title` is its heading. `look` and `rig` are the names of the look and the
    light of the job. The sheet has a frame for each of `cells`, row by row. A cell is the name of the frame's look and
    the name of its light. `labels` has the label of each cell. `columns` is the number of columns; it is None if the
    sheet has only one axis.
    """

    name: str
    title: str
    look: str
    rig: str
    cells: tuple[tuple[str, str], ...]
    labels: tuple[str, ...]
    columns: int | None


@dataclass(frozen=True)
class Variation:
    """A look or a light that a wedge adds to a job."""

    base: str  # the name of the look or light of the job that is varied
    changes: tuple[tuple[str, WedgeInput], ...]  # pairs of a parameter and its value
    key: str  # the key of the wedge in the job file


@dataclass(frozen=True)
class Wedges:
    """The looks and lights that wedges add to a job.

    `looks` and `rigs` have the added looks and lights, by name. The keys of `pairs` are pairs of the name of a look and
    the name of a light. All these pairs are rendered; the pairs of the job without wedges come first. The values of
    `pairs` are not used.
    """

    looks: dict[str, Variation] = field(default_factory=dict)
    rigs: dict[str, Variation] = field(default_factory=dict)
    pairs: dict[tuple[str, str], None] = field(default_factory=dict)
    sheets: tuple[WedgeSheet, ...] = ()


def expand_wedges(job: Job, findings: Findings) -> Wedges:
    """Return the looks, lights and sheets of the wedges of a job whose looks are expanded."""
    looks, rigs = [look.name for look in job.look], [rig.name for rig in job.rigs]
    wedges = Wedges(pairs=dict.fromkeys(product(looks, rigs)))
    sheets: dict[tuple[str, str, str], WedgeSheet] = {}
    for number, wedge in enumerate(job.wedge):
        wedge_key = f"wedge[{number}]"
        before = len(findings.faults)
        for key, name, names in (("look", wedge.look, looks), ("rig", wedge.rig, rigs)):
            if name is not None and name not in names:
                findings.add(f"{wedge_key}.{key}", f"the job has no {key} '{name}'", nearest_hint(name, names))
        _find_duplicates(wedge, wedge_key, findings)
        if len(findings.faults) > before:
            continue
        for look, rig in product([wedge.look] if wedge.look else looks, [wedge.rig] if wedge.rig else rigs):
            sheet = _add_sheet(wedges, wedge, wedge_key, look, rig)
            if (look, rig, wedge.title) in sheets:
                findings.add(wedge_key, f"another wedge is called '{wedge.title}'", "give each wedge its own name")
                break
            sheets[look, rig, wedge.title] = sheet
    for kind, taken, added in (("look", looks, wedges.looks), ("light", rigs, wedges.rigs)):
        lower = {name.casefold() for name in taken}
        for name, variation in added.items():
            if name.casefold() in lower:
                findings.add(variation.key, f"makes a {kind} called '{name}', the name of another", "rename the other")
    return Wedges(wedges.looks, wedges.rigs, wedges.pairs, tuple(sheets.values()))


def vary_looks(looks: Sequence[Look], variation: Variation, findings: Findings) -> list[Look]:
    """Return the materials of a look that a wedge adds; `looks` are the materials of the look that the wedge varies.

    A change applies to all materials that have the parameter. If no material has it, the change is a fault.
    """
    varied = list(looks)
    for parameter, value in variation.changes:
        reasons = []
        for number, look in enumerate(varied):
            try:
                varied[number] = look_with_value(look, parameter, value)
            except ModelError as error:
                reasons.append(str(error))
        if len(reasons) == len(varied):
            reason = reasons[-1] if reasons else f"look '{variation.base}' has no 'material' of its own"
            findings.add(variation.key, reason)
    return varied


def vary_rig(table: JobIbl | JobRig, name: str, variation: Variation, findings: Findings) -> JobIbl | JobRig:
    """Return the table, ``[[ibl]]`` or ``[[rig]]``, of a light that a wedge adds.

    `table` is the table of the light that the wedge varies. Only the parameters in `LIGHT_KEYS` are keys of these
    tables; other parameters are values of a rig's lights.
    """
    update: dict[str, object] = {"name": name}
    for parameter, value in variation.changes:
        if parameter in LIGHT_KEYS:
            if error := light_key_error(parameter, value):
                findings.add(variation.key, f"{parameter} cannot be {value!r}: {error}")
            else:
                update[parameter] = value
        elif isinstance(table, JobIbl):
            hint = "a wedge can vary values of the lights of a [[rig]], and 'exposure' and 'rotation' of an [[ibl]]"
            findings.add(variation.key, f"'{table.name}' is one image", hint)
    return table.model_copy(update=update)


def _add_sheet(wedges: Wedges, wedge: JobWedge, key: str, look: str, rig: str) -> WedgeSheet:
    """Vary one look under one light by a wedge: add the new looks and lights to `wedges`, and return their sheet."""
    cells, labels = [], []
    for steps in product(*(axis.steps for axis in wedge.axes)):
        cell = []
        for base, varies_light, added in ((look, False, wedges.looks), (rig, True, wedges.rigs)):
            axis_steps = [pair for pair in zip(wedge.axes, steps, strict=True) if pair[0].varies_light == varies_light]
            name = "_".join([base, *(f"{axis.short_name}_{_name_part(axis, step)}" for axis, step in axis_steps)])
            if axis_steps:
                changes = tuple((axis.parameter, step) for axis, step in axis_steps)
                added.setdefault(name, Variation(base, changes, key))
            cell.append(name)
        cells.append((cell[0], cell[1]))
        wedges.pairs[cell[0], cell[1]] = None
        labels.append(", ".join(map(_label, steps)))
    columns = len(wedge.axes[1].steps) if wedge.by else None
    across = f" down, {wedge.axes[1].parameter} across" if wedge.by else ""
    title = f"{look} / {rig}: {wedge.parameter}{across}"
    return WedgeSheet(wedge.title, title, look, rig, tuple(cells), tuple(labels), columns)


def _find_duplicates(wedge: JobWedge, wedge_key: str, findings: Findings) -> None:
    """Add a fault for a duplicate value of an axis, and for a parameter that both axes vary."""
    for number, axis in enumerate(wedge.axes):
        key = f"{wedge_key}{'.by' * number}"
        names = [_name_part(axis, step) for step in axis.steps]
        if duplicates := sorted({name for name in names if names.count(name) > 1}):
            findings.add(f"{key}.values", f"{duplicates[0]} is there twice", "give each value once")
        if not axis.short_name:
            findings.add(f"{key}.parameter", f"'{axis.parameter}' has no name")
    if len({axis.parameter for axis in wedge.axes}) < len(wedge.axes):
        findings.add(f"{wedge_key}.by.parameter", "varies what the wedge varies already")


def _label(value: WedgeInput) -> str:
    """Return the text of a value for labels."""
    if isinstance(value, tuple):
        return " ".join(f"{channel:.6g}" for channel in value)
    return value if isinstance(value, str) else f"{value:.6g}"


def _name_part(axis: JobAxis, value: WedgeInput) -> str:
    """Return a value as a part of a file name, or the number of the step if the value's text is unfit for that."""
    text = value if isinstance(value, str) else _label(value).replace(" ", "_").replace("+", "")
    if re.fullmatch(r"[A-Za-z0-9._-]{1,40}", text):
        return text
    return str(axis.steps.index(value) + 1)
