"""Rigs: the lights of a USD stage.

`find` says which prims are lights, `kinds` has a builder for each type, `emission` reads what all share, `attributes`
is the door through which values come. All faults of a rig are reported together, each at its prim.

A rig whose root carries ``custom bool lookdev:fit = true`` is made for an asset of any size: its unit is the radius of
the asset's bounding sphere, about whose centre it stands. Its lights are read with a unit of 1 m, for
`lookdev.light.fit.fitted`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Tf, Usd, UsdGeom, Vt

from lookdev.errors import RigError
from lookdev.light.distant import DistantLight
from lookdev.light.dome.environment import LEAST, MOST
from lookdev.light.dome.local import LocalDome
from lookdev.light.placed import PlacedLight
from lookdev.light.placement import checked_axes, placement, vector
from lookdev.light.protocol import Light
from lookdev.light.rig.attributes import LightPrim, stated_time
from lookdev.light.rig.emission import read_emission
from lookdev.light.rig.find import ALL_PRIMS, find_lights, is_light
from lookdev.light.rig.kinds import KINDS, Built, Placed
from lookdev.light.rig.report import Report
from lookdev.stage import Composed, Composition, compose, error_words, reading, shown

Floats = NDArray[np.float64]

_Z_UP = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
_MOST_UNIT = 1e18  # metersPerUnit, as of assets
_SMALLEST, _LARGEST = 1e-9, 1e9  # metres, of a light
_FARTHEST = 1e15  # units of the stage


@dataclass(frozen=True)
class RigLight:
    """A light of a rig: the path of its prim, its largest radiance, and its image's mean and file."""

    path: str
    light: Light
    peak: float
    mean: tuple[float, ...]
    image: str


@dataclass(frozen=True)
class Rig:
    """The lights of a rig, in metres and with z up, or of unit 1 if `fit`; notes are for the user."""

    file: str
    given: tuple[RigLight, ...]
    fit: bool
    notes: tuple[str, ...]

    @property
    def lights(self) -> tuple[Light, ...]:
        """The lights, in the order of their paths."""
        return tuple(each.light for each in self.given)

    def check_exposed(self, exposure: float = 0.0) -> None:
        """Raise RigError where shaders, in float32, cannot compute with the radiance of a light times 2^exposure."""
        report = Report(self.file)
        for each in self.given:
            peak = each.peak * 2.0**exposure
            if peak and not LEAST <= peak <= MOST:
                exposed = f" times 2^{exposure:g}" if exposure else ""
                what = f"its largest radiance{exposed} is {peak:g}"
                report.fault(each.path, what, f"from {LEAST:g} to {MOST:g} would be right")
        if report.faults:
            raise RigError(report.faults)


def load_rig(file: Path, prim: str | None = None, *, sampled: bool = True) -> Rig:
    """Compose a USD file and read its lights, as `read_rig`; raises StageError where it cannot be composed."""
    return read_rig(compose(Composition(file, prim=prim)), sampled=sampled)


def read_rig(composed: Composed, *, sampled: bool = True) -> Rig:
    """Read the lights at and below a prim of a stage: its composition's, else the default prim, else all.

    Values are taken at the stage's startTimeCode, else at the earliest time. The ancestors of the prim place it.
    Without `sampled`, domes have no tables by which shaders draw directions.

    Raises
    ------
    RigError
        Every fault: what is no light that can be rendered, values and files that are not right, or no light at all.
    OutputError
        The cache cannot be written.
    """
    file = composed.composition.file
    with reading(file) as warnings:
        rig = _Reader(composed, sampled).rig()
    return replace(rig, notes=(*composed.notes, *rig.notes, *(f"{file}: {each}" for each in warnings)))


def holds_only_lights(composed: Composed) -> bool:
    """Return whether there are lights at and below the prim of a composition, by default anywhere, and no geometry."""
    with reading(composed.composition.file):
        prims = Usd.PrimRange(composed.stage.GetPrimAtPath(composed.composition.prim or "/"), ALL_PRIMS)
        found = [is_light(prim) for prim in prims if is_light(prim) or prim.IsA(UsdGeom.Gprim)]
    return bool(found) and all(found)


class _Reader:
    def __init__(self, composed: Composed, sampled: bool) -> None:
        stage, path = composed.stage, composed.composition.prim
        self._stage = stage
        self._sampled = sampled
        self._report = Report(str(composed.composition.file))
        self._root = stage.GetPrimAtPath(path) if path else stage.GetDefaultPrim() or stage.GetPseudoRoot()
        authored = stage.HasAuthoredMetadata("startTimeCode")
        self._time = Usd.TimeCode(stage.GetStartTimeCode()) if authored else Usd.TimeCode.EarliestTime()
        self._transforms = UsdGeom.XformCache(self._time)

    def rig(self) -> Rig:
        report, stage = self._report, self._stage
        fit = self._fit()
        unit = 1.0 if fit else UsdGeom.GetStageMetersPerUnit(stage)
        if not 1.0 / _MOST_UNIT <= unit <= _MOST_UNIT:
            report.fault("", f"metersPerUnit is {unit:g}", "a positive number would be right")
        axis = UsdGeom.GetStageUpAxis(stage)
        if axis not in (UsdGeom.Tokens.y, UsdGeom.Tokens.z):
            report.fault("", f"upAxis is {axis!r:.60}", "'Y' or 'Z' would be right")
        if report.faults:
            raise RigError(report.faults)
        given = []
        for prim in find_lights(self._root, self._time, report):
            with report.collected(prim.GetPath()):
                if (light := self._read(prim, unit, axis == UsdGeom.Tokens.y)) is not None:
                    given.append(light)
        if not given and not report.faults:
            report.fault(self._root.GetPath(), *self._empty())
        if report.faults:
            raise RigError(report.faults)
        rig = Rig(report.file, tuple(given), fit, tuple(report.notes))
        rig.check_exposed()
        return rig

    def _fit(self) -> bool:
        """Return ``lookdev:fit`` of the root, or of the nearest prim above it that has it."""
        prim = self._root
        while prim and not prim.IsPseudoRoot():
            if prim.HasAttribute("lookdev:fit"):
                return LightPrim(prim, self._time, self._report).flag("lookdev:fit")
            prim = prim.GetParent()
        return False

    def _empty(self) -> tuple[str, str]:
        """Return what is wrong with a rig without a light, and where there are lights."""
        elsewhere = find_lights(self._stage.GetPseudoRoot(), self._time, Report(""))
        paths = ", ".join(str(prim.GetPath()) for prim in elsewhere[:3])
        left_out = "; ".join(note.partition(": ")[2] for note in self._report.notes)
        hint = f"there are lights at {paths}" if paths else left_out or f"a light is one of {', '.join(KINDS)}"
        return "has no light that shines", hint

    def _read(self, prim: Usd.Prim, unit: float, y_up: bool) -> RigLight | None:
        report, before = self._report, len(self._report.faults)
        light, kind = LightPrim(prim, self._time, report), KINDS[str(prim.GetTypeName())]
        light.check_names(kind.ours)
        matrix = self._matrix(prim)
        if matrix is None:
            return None
        if y_up:
            matrix = _Z_UP @ matrix
        position, axes, scale = placement(matrix)
        # Rounded, so that a turn by a right angle is exact.
        axes = checked_axes(np.round(np.array(axes), 12) + 0.0)
        metres = vector(unit * np.array(position)), vector(unit * np.array(scale))
        built = None
        with report.collected(prim.GetPath()):
            built = kind.build(Placed(light, metres[0], axes, metres[1], y_up, self._sampled, report))
        emission = read_emission(light, _size(built, unit), unit, report)
        if built is None or len(report.faults) > before:
            return None
        if not any(emission.color) or built.largest == 0.0:
            report.note(prim.GetPath(), "sends no light, left out")
            return None
        made = built.light
        if problem := _out_of_range(made):
            report.fault(prim.GetPath(), problem)
            return None
        if isinstance(made, LocalDome):
            made = replace(made, dome=replace(made.dome, emission=emission))
        else:
            made = replace(made, emission=emission)  # type: ignore[type-var]
        return RigLight(str(prim.GetPath()), made, built.largest * max(emission.color), built.mean, built.image)

    def _matrix(self, prim: Usd.Prim) -> Floats | None:
        """Return the matrix (4, 4), for column vectors, that places a light in the stage; None, with a fault."""
        each = prim
        while each and not each.IsPseudoRoot():
            if not self._has_operations(each):
                return None
            each = each.GetParent()
        try:
            matrix = np.array(self._transforms.GetLocalToWorldTransform(prim), np.float64).T
        except Tf.ErrorException as error:
            self._report.fault(prim.GetPath(), f"USD cannot compute its transform: {error_words(error)}")
            return None
        if not (np.abs(matrix) <= _FARTHEST).all() or not np.allclose(matrix[3], (0.0, 0.0, 0.0, 1.0), 0.0, 1e-9):
            right = f"numbers within +-{_FARTHEST:g}, and a last column of 0 0 0 1, would be right"
            self._report.fault(prim.GetPath(), "its transform does not place it", right)
            return None
        return matrix

    def _has_operations(self, prim: Usd.Prim) -> bool:
        """Return whether all operations of a prim's transform are there: USD leaves out those that are not."""
        xform, place = UsdGeom.Xformable(prim), prim.GetPath().AppendProperty("xformOpOrder")
        order = prim.GetAttribute("xformOpOrder").Get() if xform else None
        if not isinstance(order, Vt.TokenArray | None):
            self._report.fault(place, f"has a value of type {type(order).__name__}", "token[] would be right")
            return False
        for name in order or ():
            operation = name.removeprefix("!invert!")
            if name != "!resetXformStack!" and not (operation and prim.HasAttribute(operation)):
                self._report.fault(place, f"names {shown(name)}, which is not there")
                return False
        if xform and xform.TransformMightBeTimeVarying():
            self._report.note(prim.GetPath(), f"its transform is animated, and taken at {stated_time(self._time)}")
        return True


def _out_of_range(light: Light) -> str:
    """Return what is wrong with the lengths of a light, in metres: shaders compute with float32."""
    if not isinstance(light, PlacedLight | LocalDome):
        return ""
    lengths = [getattr(light, name) for name in ("width", "height", "length", "radius") if hasattr(light, name)]
    for length in (*lengths, *getattr(light, "radii", ())):
        if not _SMALLEST <= length <= _LARGEST:
            return f"a side or radius of it is {length:.3g}; {_SMALLEST:g} to {_LARGEST:g} m would be right"
    away = max(map(abs, light.position))
    return f"it is {away:.3g} away; at most {_LARGEST:g} m would be right" if away > _LARGEST else ""


def _size(built: Built | None, unit: float) -> float:
    """Return what radiance is divided by where the power is normalized: areas are those "in world space", in units."""
    match built:
        case Built(light=PlacedLight() as light):
            return light.size_factor / (unit * unit)
        case Built(light=DistantLight() as light):
            return light.size_factor
    return 1.0


__all__ = ["Rig", "RigLight", "holds_only_lights", "load_rig", "read_rig"]
