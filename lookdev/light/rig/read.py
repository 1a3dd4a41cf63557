"""Reading of a rig: from a composed USD stage to its lights.

The prims are read first, then their images. If neither has a fault, the lights are made, with the files that shaders
read.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pxr import Tf, Usd, UsdGeom, Vt

from lookdev.arrays import Floats
from lookdev.errors import Fault, RigError
from lookdev.light.base import Light
from lookdev.light.dome.environment import exposure_fault
from lookdev.light.emission import Emission
from lookdev.light.placement import checked_axes, placement, vector
from lookdev.light.rig.attributes import LightPrim, RigReport, time_label
from lookdev.light.rig.change import LightValue, change_values
from lookdev.light.rig.emission import read_emission
from lookdev.light.rig.find import ALL_PRIMS, USD_LIGHTS, check_attribute_owners, find_lights, is_light
from lookdev.light.rig.images import LightImage, load_light_image
from lookdev.light.usd import PlacedPrim, UsdLightShape
from lookdev.stage import Composed, Composition, compose, error_message, prim_and_ancestors, quote, usd_errors_as_faults
from lookdev.stage.units import Z_UP, is_y_up, unit_faults

_Images = dict[tuple[object, ...], LightImage]  # the images that are read, by `_PendingLight.key`

_MIN_LENGTH, _MAX_LENGTH = 1e-9, 1e9  # metres: limits of a light's sizes; _MAX_LENGTH also of its coordinates
_MAX_NUMBER = 1e15  # the largest number in a transform's matrix, in units of the stage


@dataclass(frozen=True)
class RigLight:
    """A light of a rig, with values for reports.

    `path` is the path of its prim, and `peak` its largest radiance in any channel. `mean` is the mean of its image, 1
    without an image. `image` is the image file, "" without one.
    """

    path: str
    light: Light
    peak: float
    mean: tuple[float, ...]
    image: str


@dataclass(frozen=True)
class LightRig:
    """The lights of a rig, with z up, and notes for the user.

    Lengths are in metres. If `fit`, the rig fits an asset of any size, and lengths are in radii of its bounding sphere.
    """

    file: str
    rig_lights: tuple[RigLight, ...]
    fit: bool
    notes: tuple[str, ...]

    @property
    def lights(self) -> tuple[Light, ...]:
        """The lights, in the order of their paths."""
        return tuple(rig_light.light for rig_light in self.rig_lights)

    def check_exposed(self, exposure: float = 0.0) -> None:
        """Raise RigError if shaders, in float32, cannot compute with the radiance of a light times 2^exposure."""
        report = RigReport(self.file)
        for rig_light in self.rig_lights:
            if fault := exposure_fault(rig_light.peak, exposure):
                report.fault(rig_light.path, *fault)
        if report.faults:
            raise RigError(report.faults)


def load_rig(
    file: Path, prim: str | None = None, values: Mapping[str, LightValue] | None = None, *, sampled: bool = True
) -> LightRig:
    """Compose a USD file, set values of its lights with `change_values`, and read them with `read_rig`.

    Raises StageError if the file cannot be composed, and the errors of these two functions.
    """
    composed = compose(Composition(file, prim=prim))
    if values:
        change_values(composed, values)
    return read_rig(composed, sampled=sampled)


def read_rig(composed: Composed, *, sampled: bool = True) -> LightRig:
    """Read the lights at and below the composition's prim, else the stage's default prim, else all lights.

    Values are read at the stage's startTimeCode, else at the earliest time. The transforms of the prim's ancestors
    apply. Without `sampled`, domes have no tables with which shaders draw directions.

    Raises
    ------
    RigError
        The rig has faults: unsupported lights, wrong values or files, or no light at all. The error lists all of them.
    OutputError
        The cache cannot be written.
    """
    file, report = composed.composition.file, RigReport(str(composed.composition.file))
    with usd_errors_as_faults(file) as warnings:
        fit, pending = _Reader(composed, sampled, report).read()
    # Images are read and checked outside of `usd_errors_as_faults`: a dome's tables take longer than this context
    # allows.
    images: _Images = {}
    for pending_light in pending:
        _read_image(pending_light, images, report)
    if report.faults:
        raise RigError(report.faults)
    made_lights = (_make_light(pending_light, images, report) for pending_light in pending)
    rig_lights = tuple(light for light in made_lights if light is not None)
    if not rig_lights:
        raise RigError([_no_light_fault(report, composed.composition.prim or "", "")])
    notes = (*composed.notes, *report.notes, *(f"{file}: {warning}" for warning in warnings))
    rig = LightRig(report.file, rig_lights, fit, notes)
    rig.check_exposed()
    return rig


def holds_only_lights(composed: Composed) -> bool:
    """Return whether a stage has lights and no geometry, at and below the composition's prim if it has one."""
    with usd_errors_as_faults(composed.composition.file):
        prims = Usd.PrimRange(composed.stage.GetPrimAtPath(composed.composition.prim or "/"), ALL_PRIMS)
        is_light_flags = [is_light(prim) for prim in prims if is_light(prim) or prim.IsA(UsdGeom.Gprim)]
    return bool(is_light_flags) and all(is_light_flags)


@dataclass(frozen=True)
class _PendingLight:
    """A light whose prim is read, and whose image is not yet read."""

    path: str
    shape: UsdLightShape
    emission: Emission

    @property
    def key(self) -> tuple[object, ...]:
        """The key of its image: equal keys have the same pixels."""
        return self.shape.image, self.shape.space, self.shape.format


class _Reader:
    """Reads the prims of a stage."""

    def __init__(self, composed: Composed, sampled: bool, report: RigReport) -> None:
        stage, path = composed.stage, composed.composition.prim
        self._stage = stage
        self._sampled = sampled
        self._report = report
        self._root = stage.GetPrimAtPath(path) if path else stage.GetDefaultPrim() or stage.GetPseudoRoot()
        authored = stage.HasAuthoredMetadata("startTimeCode")
        self._time = Usd.TimeCode(stage.GetStartTimeCode()) if authored else Usd.TimeCode.EarliestTime()
        self._transforms = UsdGeom.XformCache(self._time)

    def read(self) -> tuple[bool, list[_PendingLight]]:
        """Return `LightRig.fit` and the lights of the rig; raise RigError if the stage has no valid unit."""
        report, stage = self._report, self._stage
        fit = self._fit_flag()
        unit, y_up = 1.0 if fit else UsdGeom.GetStageMetersPerUnit(stage), is_y_up(stage)
        for problem, right in unit_faults(stage, unit):
            report.fault("", problem, f"{right} would be right")
        if report.faults:
            raise RigError(report.faults)
        check_attribute_owners(self._root, report)
        pending = []
        for prim in find_lights(self._root, self._time, report):
            with report.collect(prim.GetPath()):
                if (light := self._read(prim, unit, y_up)) is not None:
                    pending.append(light)
        if not pending and not report.faults:
            raise RigError([_no_light_fault(report, str(self._root.GetPath()), self._other_lights_hint())])
        return fit, pending

    def _fit_flag(self) -> bool:
        """Return ``lookdev:fit`` of the root, or of its nearest ancestor that has this attribute; else False."""
        for prim in prim_and_ancestors(self._root):
            if prim.HasAttribute("lookdev:fit"):
                return LightPrim(prim, self._time, self._report).flag("lookdev:fit")
        return False

    def _other_lights_hint(self) -> str:
        """Return a hint with the paths of other lights of the stage; "" without any."""
        lights = find_lights(self._stage.GetPseudoRoot(), self._time, RigReport(""))
        paths = ", ".join(str(prim.GetPath()) for prim in lights[:3])
        return f"there are lights at {paths}" if paths else ""

    def _read(self, prim: Usd.Prim, unit: float, y_up: bool) -> _PendingLight | None:
        """Return a light; if its transform or its shape is wrong, add a fault and return None.

        `unit` is the stage's unit of length in metres.
        """
        report, path = self._report, prim.GetPath()
        light, kind = LightPrim(prim, self._time, report), USD_LIGHTS[str(prim.GetTypeName())]
        light.check_names((*kind.attributes, "fit") if prim == self._root else kind.attributes)
        matrix = self._matrix(prim)
        if matrix is None:
            return None
        position, axes, scale = placement(Z_UP @ matrix if y_up else matrix)
        # The axes are rounded, so that a rotation by a right angle is exact; adding 0 turns -0 into 0.
        axes = checked_axes(np.round(np.array(axes), 12) + 0.0)
        metres, sizes = vector(unit * np.array(position)), vector(unit * np.array(scale))
        if (away := max(map(abs, metres))) > _MAX_LENGTH:
            report.fault(path, f"it is {away:.3g} m away", f"at most {_MAX_LENGTH:g} m would be right")
        shape = None
        with report.collect(path):
            shape = kind.read(PlacedPrim(light, metres, axes, sizes, y_up, self._sampled))
        for length in shape.lengths if shape else ():
            if not _MIN_LENGTH <= length <= _MAX_LENGTH:
                right = f"{_MIN_LENGTH:g} to {_MAX_LENGTH:g} m would be right"
                report.fault(path, f"a side or radius of it is {length:.3g} m", right)
        emission = read_emission(light, _size_in_units(shape, unit), unit, report)
        return _PendingLight(str(path), shape, emission) if shape else None

    def _matrix(self, prim: Usd.Prim) -> Floats | None:
        """Return a light's matrix (4, 4) to the stage, for column vectors; None with a fault if it is wrong."""
        if not all(map(self._has_operations, prim_and_ancestors(prim))):
            return None
        try:
            matrix = np.array(self._transforms.GetLocalToWorldTransform(prim), np.float64).T
        except Tf.ErrorException as error:
            self._report.fault(prim.GetPath(), f"USD cannot compute its transform: {error_message(error)}")
            return None
        if not (np.abs(matrix) <= _MAX_NUMBER).all() or not np.allclose(matrix[3], (0.0, 0.0, 0.0, 1.0), 0.0, 1e-9):
            right = f"numbers within +-{_MAX_NUMBER:g}, and a last column of 0 0 0 1, would be right"
            self._report.fault(prim.GetPath(), "its transform does not place it", right)
            return None
        return matrix

    def _has_operations(self, prim: Usd.Prim) -> bool:
        """Return whether all operations of a prim's transform exist, and add a fault if not.

        USD ignores missing operations without a message. A transform that is animated adds a note.
        """
        xform, path = UsdGeom.Xformable(prim), prim.GetPath().AppendProperty("xformOpOrder")
        order = prim.GetAttribute("xformOpOrder").Get() if xform else None
        if not isinstance(order, Vt.TokenArray | None):
            self._report.fault(path, f"has a value of type {type(order).__name__}", "token[] would be right")
            return False
        for name in order or ():
            operation = name.removeprefix("!invert!")
            if name != "!resetXformStack!" and not (operation and prim.HasAttribute(operation)):
                self._report.fault(path, f"names {quote(name)}, which is not there")
                return False
        if xform and xform.TransformMightBeTimeVarying():
            self._report.note(prim.GetPath(), f"its transform is animated, and taken at {time_label(self._time)}")
        return True


def _size_in_units(shape: UsdLightShape | None, unit: float) -> float:
    """Return UsdLux's divisor of the radiance if the power is normalized; areas are in the stage's square units."""
    if shape is None:
        return 1.0
    return shape.size if shape.area is None else shape.area / (unit * unit)


def _read_image(pending: _PendingLight, images: _Images, report: RigReport) -> None:
    """Read the image of a light into `images`, unless another light has the same image."""
    shape, path = pending.shape, f"{pending.path}.inputs:texture:file"
    if shape.image is None:
        return
    with report.collect(path):
        if pending.key not in images:
            images[pending.key] = load_light_image(shape.image, shape.space, shape.format)
        image = images[pending.key]
        if image.environment.repairs:
            report.note(path, f"{shape.image}: {image.environment.repairs}")
        if image.error is not None:
            height, width = image.environment.radiance.shape[:2]
            size, off = f"{width} x {height}", f"{100.0 * image.error:.2g} %"
            text = f"converted from a ball to a lat-long map of {size}; its power is off by {off}"
            report.note(path, f"{shape.image}: {text}")


def _make_light(pending: _PendingLight, images: _Images, report: RigReport) -> RigLight | None:
    """Return the light of a prim; if it is black, add a note and return None."""
    image = images.get(pending.key)
    largest, mean = (float(image.environment.radiance.max()), image.mean) if image else (1.0, (1.0, 1.0, 1.0))
    peak = largest * max(pending.emission.color)
    profile = pending.emission.shaping and pending.emission.shaping.profile
    if peak == 0.0 or (profile and profile.largest == 0.0):
        report.note(pending.path, "sends no light, left out")
        return None
    light = pending.shape.make(image.environment if image else None).with_emission(pending.emission)
    return RigLight(pending.path, light, peak, mean, str(pending.shape.image or ""))


def _no_light_fault(report: RigReport, path: str, elsewhere: str) -> Fault:
    """Return the fault of a rig without lights; its hint is `elsewhere`, or else the notes on lights left out."""
    left_out = "; ".join(note.removeprefix(f"{report.file}: ") for note in report.notes)
    hint = elsewhere or left_out or f"a light is one of {', '.join(USD_LIGHTS)}"
    return Fault(report.file, path, "has no light that shines", hint)
