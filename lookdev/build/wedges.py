"""What the wedges of a job stand for: more looks and lights, which of them are shown together, and sheets of them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import product

from lookdev.errors import Fault, ModelError, nearest_hint
from lookdev.job.schema import Job, JobIbl, JobRig
from lookdev.job.wedge import LIGHT_KEYS, JobAxis, JobWedge, Value, light_key_error
from lookdev.material import Look
from lookdev.material.change import changed_look


@dataclass(frozen=True)
class WedgeSheet:
    """A sheet of a wedge: the pairs of a look and a light that are on it, row by row, and their labels."""

    name: str
    title: str
    look: str
    rig: str
    cells: tuple[tuple[str, str], ...]
    labels: tuple[str, ...]
    columns: int | None


@dataclass(frozen=True)
class Varied:
    """A look or a light of a wedge: that of the job which it comes from, what differs, and the place in the job."""

    base: str
    changes: tuple[tuple[str, Value], ...]
    place: str


@dataclass(frozen=True)
class Wedges:
    """What wedges add to a job; `pairs` are all that is shown, those of the job first."""

    looks: dict[str, Varied] = field(default_factory=dict)
    rigs: dict[str, Varied] = field(default_factory=dict)
    pairs: dict[tuple[str, str], None] = field(default_factory=dict)
    sheets: tuple[WedgeSheet, ...] = ()


def expand_wedges(job: Job, faults: list[Fault]) -> Wedges:
    """Return what the wedges of a job stand for, whose variants are looks already; adds to `faults`."""
    looks, rigs = [look.name for look in job.look], [rig.name for rig in job.rigs]
    made = Wedges(pairs=dict.fromkeys(product(looks, rigs)))
    sheets: dict[tuple[str, str, str], WedgeSheet] = {}
    for number, wedge in enumerate(job.wedge):
        place = f"wedge[{number}]"
        before = len(faults)
        for key, name, names in (("look", wedge.look, looks), ("rig", wedge.rig, rigs)):
            if name is not None and name not in names:
                what = f"the job has no {key} '{name}'"
                faults.append(Fault(str(job.file), f"{place}.{key}", what, nearest_hint(name, names)))
        faults += _doubled(job, wedge, place)
        if len(faults) > before:
            continue
        for look, rig in product([wedge.look] if wedge.look else looks, [wedge.rig] if wedge.rig else rigs):
            sheet = _sheet(made, wedge, place, look, rig)
            if (look, rig, wedge.title) in sheets:
                hint = "give each wedge its own name"
                faults.append(Fault(str(job.file), place, f"another wedge is called '{wedge.title}'", hint))
                break
            sheets[look, rig, wedge.title] = sheet
    for kind, taken, added in (("look", looks, made.looks), ("light", rigs, made.rigs)):
        lower = {name.casefold() for name in taken}
        for name, varied in added.items():
            if name.casefold() in lower:
                what = f"makes a {kind} called '{name}', as another one is"
                faults.append(Fault(str(job.file), varied.place, what, "rename that one"))
    return Wedges(made.looks, made.rigs, made.pairs, tuple(sheets.values()))


def varied_looks(looks: Sequence[Look], varied: Varied, job: Job, faults: list[Fault]) -> list[Look]:
    """Return the materials of a look of a wedge, from those of the look that it comes from; adds to `faults`."""
    made = list(looks)
    for parameter, value in varied.changes:
        reasons = []
        for number, look in enumerate(made):
            try:
                made[number] = changed_look(look, parameter, value)
            except ModelError as error:
                reasons.append(str(error))
        if len(reasons) == len(made):
            reason = reasons[-1] if reasons else f"look '{varied.base}' has no 'material' of its own"
            faults.append(Fault(str(job.file), varied.place, reason))
    return made


def varied_rig(given: JobIbl | JobRig, name: str, varied: Varied, job: Job, faults: list[Fault]) -> JobIbl | JobRig:
    """Return the table of a light of a wedge; adds to `faults`."""
    update: dict[str, object] = {"name": name}
    for parameter, value in varied.changes:
        if parameter in LIGHT_KEYS:
            if error := light_key_error(parameter, value):
                what = f"{parameter} cannot be {value!r}: {error}"
                faults.append(Fault(str(job.file), varied.place, what))
            else:
                update[parameter] = value
        elif isinstance(given, JobIbl):
            what, hint = f"'{given.name}' is one image", "a [[rig]] has lights with values; of an [[ibl]] 'exposure'"
            faults.append(Fault(str(job.file), varied.place, what, hint))
    return given.model_copy(update=update)


def _sheet(made: Wedges, wedge: JobWedge, place: str, look: str, rig: str) -> WedgeSheet:
    """Add the looks and lights of a wedge of one look under one light; return its sheet."""
    cells, labels = [], []
    for steps in product(*(axis.steps for axis in wedge.axes)):
        cell = []
        for base, of_light, added in ((look, False, made.looks), (rig, True, made.rigs)):
            own = [(axis, step) for axis, step in zip(wedge.axes, steps, strict=True) if axis.of_light == of_light]
            name = "_".join([base, *(f"{axis.short}_{_in_name(axis, step)}" for axis, step in own)])
            if own:
                changes = tuple((axis.parameter, step) for axis, step in own)
                added.setdefault(name, Varied(base, changes, place))
            cell.append(name)
        cells.append((cell[0], cell[1]))
        made.pairs[cell[0], cell[1]] = None
        labels.append(", ".join(map(_shown, steps)))
    columns = len(wedge.axes[1].steps) if wedge.by else None
    across = f" down, {wedge.axes[1].parameter} across" if wedge.by else ""
    title = f"{look} / {rig}: {wedge.parameter}{across}"
    return WedgeSheet(wedge.title, title, look, rig, tuple(cells), tuple(labels), columns)


def _doubled(job: Job, wedge: JobWedge, place: str) -> list[Fault]:
    """Return faults of values that are there twice, and of a parameter that is."""
    found = []
    keys = [(axis, f"{place}{'.by' * number}") for number, axis in enumerate(wedge.axes)]
    for axis, key in keys:
        names = [_in_name(axis, step) for step in axis.steps]
        if twice := sorted({name for name in names if names.count(name) > 1}):
            found.append(Fault(str(job.file), f"{key}.values", f"{twice[0]} is there twice", "give each value once"))
        if not axis.short:
            found.append(Fault(str(job.file), f"{key}.parameter", f"'{axis.parameter}' has no name"))
    if len({axis.parameter for axis, _ in keys}) < len(keys):
        found.append(Fault(str(job.file), f"{place}.by.parameter", "varies what the wedge varies already"))
    return found


def _shown(value: Value) -> str:
    """Return a value as a label."""
    if isinstance(value, tuple):
        return " ".join(f"{each:.6g}" for each in value)
    return value if isinstance(value, str) else f"{value:.6g}"


def _in_name(axis: JobAxis, value: Value) -> str:
    """Return a value as a part of a file's name; an expression, which is none, by its number."""
    text = value if isinstance(value, str) else _shown(value).replace(" ", "_").replace("+", "")
    if re.fullmatch(r"[A-Za-z0-9._-]{1,40}", text):
        return text
    return str(axis.steps.index(value) + 1)
