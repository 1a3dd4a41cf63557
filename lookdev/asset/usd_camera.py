"""A camera of a USD file, as plain numbers in the world of assets: z up, metres."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from pxr import Gf, Tf, Usd, UsdGeom

from lookdev.asset.shape import LARGEST, Doubles
from lookdev.asset.usd.walk import affine, misplaced_by
from lookdev.errors import Fault, FaultsError, nearest_hint
from lookdev.stage import error_words, shown
from lookdev.stage.units import Z_UP, is_y_up

_TIME = Usd.TimeCode.EarliestTime()
_LENS = (
    "projection",
    "horizontalAperture",
    "verticalAperture",
    "horizontalApertureOffset",
    "verticalApertureOffset",
    "focalLength",
    "fStop",
    "focusDistance",
)
_IGNORED = ("clippingPlanes", "exposure", *(f"exposure:{name}" for name in ("fStop", "iso", "responsivity", "time")))
_TENTH = 0.1  # of a scene unit: the unit of focal length, apertures and offsets (UsdGeomCamera, "Units")
_SQUARE = 1e-4  # largest cosine between axes at right angles


@dataclass(frozen=True)
class UsdCamera:
    """A perspective camera. Lengths in metres.

    `frame` has the unit vectors to the right, up and backwards. `apertures` are the width and height of the sensor,
    `offsets` its centre from the line of sight. `f_stop` 0: everything is sharp.
    """

    path: str
    position: tuple[float, float, float]
    frame: tuple[tuple[float, float, float], ...]
    focal_length: float
    apertures: tuple[float, float]
    offsets: tuple[float, float]
    f_stop: float
    focus_distance: float
    clipping: tuple[float, float]
    notes: tuple[str, ...]


def read_camera(stage: Usd.Stage, path: str) -> UsdCamera:
    """Read a camera of a stage; a scale of its transform does not count, as everywhere in USD.

    Raises
    ------
    FaultsError
        There is no camera at that path, or it is animated, not perspective, mirrored or sheared, or an attribute has no
        usable value.
    """
    file = stage.GetRootLayer().realPath or stage.GetRootLayer().identifier
    prim = stage.GetPrimAtPath(path)
    if not prim or not prim.IsA(UsdGeom.Camera):
        cameras = [str(each.GetPath()) for each in stage.TraverseAll() if each.IsA(UsdGeom.Camera)]
        what = f"is a {prim.GetTypeName() or 'prim without type'}, not a Camera" if prim else "there is no such prim"
        hint = nearest_hint(path, cameras) if cameras else "the file has no camera"
        raise FaultsError([Fault(file, path, what, hint)])
    faults = list(_faults(file, prim))
    if faults:
        raise FaultsError(faults)
    values = {name: prim.GetAttribute(name).Get(_TIME) for name in (*_LENS, "clippingRange")}
    unit = UsdGeom.GetStageMetersPerUnit(stage)
    lens = _TENTH * unit
    axes, position = _axes(prim), _to_stage(prim)[3, :3] * unit
    if is_y_up(stage):
        to_z_up = Z_UP[:3, :3]
        axes, position = axes @ to_z_up.T, to_z_up @ position
    right, up, back = (tuple(axis) for axis in axes.tolist())
    x, y, z = position.tolist()
    near, far = values["clippingRange"]
    return UsdCamera(
        path=path,
        position=(x, y, z),
        frame=(right, up, back),
        focal_length=values["focalLength"] * lens,
        apertures=(values["horizontalAperture"] * lens, values["verticalAperture"] * lens),
        offsets=(values["horizontalApertureOffset"] * lens, values["verticalApertureOffset"] * lens),
        f_stop=values["fStop"],
        focus_distance=values["focusDistance"] * unit,
        clipping=(near * unit, far * unit),
        notes=tuple(_notes(prim, values)),
    )


def _faults(file: str, prim: Any) -> Iterator[Fault]:
    path = str(prim.GetPath())
    for name in _LENS:
        attribute, where = prim.GetAttribute(name), f"{path}.{name}"
        value = attribute.Get(_TIME)
        if attribute.ValueMightBeTimeVarying():
            yield Fault(file, where, "is animated; a camera must stand still", "give it a single value")
        elif name == "projection":
            if value != UsdGeom.Tokens.perspective:
                what = shown(value) if isinstance(value, str) else "no text"
                yield Fault(file, where, f"the projection is {what}; only perspective cameras render")
        elif not (isinstance(value, float) and abs(value) <= LARGEST):
            what = f"is {value:g}" if isinstance(value, float) else "has a value of another type"
            yield Fault(file, where, what, f"a number within +-{LARGEST:g} is needed")
        elif name in ("focalLength", "horizontalAperture", "verticalAperture") and value <= 0.0:
            yield Fault(file, where, f"is {value:g}; a positive length is needed")
        elif name in ("fStop", "focusDistance") and value < 0.0:
            yield Fault(file, where, f"is {value:g}; it must not be negative")
    if not _is_range(prim.GetAttribute("clippingRange").Get(_TIME)):
        yield Fault(file, f"{path}.clippingRange", "is not two numbers, the first below the second", "(0.1, 1000)")
    moving = [str(each.GetPath()) for each in _placed_by(prim) if UsdGeom.Xformable(each).TransformMightBeTimeVarying()]
    if moving:
        yield Fault(file, path, f"moves: {', '.join(moving)} is animated; a camera must stand still")
    else:
        try:
            problem = _transform_problem(_to_stage(prim))
        except Tf.ErrorException as error:
            problem = f"USD cannot compute its transform: {error_words(error)}"
        if problem:
            yield Fault(file, misplaced_by(prim, _TIME), problem, "a camera is placed by translation and rotation")


def _is_range(value: Any) -> bool:
    """Return whether a value is a pair of numbers that grow; the far end may be infinite."""
    return isinstance(value, Gf.Vec2f) and abs(value[0]) <= LARGEST and value[0] < value[1]


def _placed_by(prim: Any) -> Iterator[Any]:
    """Yield a prim and the ancestors whose transforms place it."""
    while prim:
        xformable = UsdGeom.Xformable(prim)
        if xformable:
            yield prim
            if xformable.GetResetXformStack():
                return
        prim = prim.GetParent()


def _transform_problem(matrix: Doubles) -> str:
    """Return why a matrix for row vectors, (4, 4), places no camera; '' where it does."""
    axes = matrix[:3, :3]
    sizes = np.linalg.norm(axes, axis=1)
    if not (affine(matrix) and (sizes > 0.0).all()):
        return f"its transform is singular, not affine, or has a number not within +-{LARGEST:g}"
    unit = axes / sizes[:, None]
    if np.abs(unit @ unit.T - np.eye(3)).max() > _SQUARE:
        return "its transform shears it"
    return "its transform mirrors it" if np.linalg.det(unit) < 0.0 else ""


def _axes(prim: Any) -> Doubles:
    """Return the unit vectors (3, 3) to the right, up and backwards, exactly at right angles."""
    _, up, back = _to_stage(prim)[:3, :3]
    back = back / np.linalg.norm(back)
    right = np.cross(up, back)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(back, right), back])


def _to_stage(prim: Any) -> Doubles:
    return np.array(UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(_TIME), np.float64)


def _notes(prim: Any, values: dict[str, Any]) -> Iterator[str]:
    path = prim.GetPath()
    if values["fStop"] > 0.0 and values["focusDistance"] == 0.0:
        yield f"{path}: fStop is {values['fStop']:g}, but no focusDistance is given: everything is sharp"
    ignored = [name for name in _IGNORED if _is_set(prim, name)]
    if ignored:
        yield f"{path}: not applied: {', '.join(ignored)}"


def _is_set(prim: Any, name: str) -> bool:
    """Return whether an attribute, which older versions of USD lack, has another value than its default."""
    value = prim.GetAttribute(name).Get(_TIME) if prim.HasAttribute(name) else None
    return bool(value) and value != prim.GetPrimDefinition().GetAttributeFallbackValue(name)
