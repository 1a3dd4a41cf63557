"""Reads the camera that a job names in a USD file, as plain numbers in world space: z up, in metres."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from pxr import Gf, Tf, Usd, UsdGeom

from lookdev.arrays import Floats
from lookdev.asset.shape import MAX_COORDINATE
from lookdev.asset.usd.walk import faulty_transform_path, is_affine
from lookdev.errors import Fault, FaultsError, nearest_hint
from lookdev.stage import error_message, quote
from lookdev.stage.units import Z_UP, is_y_up

_TIME = Usd.TimeCode.EarliestTime()
_LENGTHS = ("horizontalAperture", "verticalAperture", "focalLength")
_OFFSETS = ("horizontalApertureOffset", "verticalApertureOffset")
_LENS = ("projection", *_LENGTHS, *_OFFSETS, "fStop", "focusDistance")
# Attributes of USD's cameras that have no effect here. A note names the attributes that are set.
_UNSUPPORTED = (
    "clippingPlanes",
    "exposure",
    *(f"exposure:{name}" for name in ("fStop", "iso", "responsivity", "time")),
)
_LENS_UNIT = 0.1  # in scene units, the unit of focal length, apertures and offsets (UsdGeomCamera, "Units")
_MAX_COSINE = 1e-4  # the largest cosine of the angle between two axes that count as orthogonal


@dataclass(frozen=True)
class UsdCamera:
    """A perspective camera. Lengths are in metres, and vectors in world space.

    `path` is the path of the prim. `frame` has three unit vectors: to the right, up and backwards. `apertures` are the
    width and the height of the sensor, and `offsets` the position of the sensor's centre relative to the optical axis,
    to the right and up. With `f_stop` 0 everything is sharp. `clipping` has the near and the far distance. `notes` are
    lines for the user about settings without effect.
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
    """Read the camera at a path of a stage. As in USD, the scale of the camera's transform has no effect.

    Raises
    ------
    FaultsError
        There is no camera at the path; or it is animated, not perspective, mirrored or sheared; or an attribute has an
        invalid value.
    """
    file = stage.GetRootLayer().realPath or stage.GetRootLayer().identifier
    prim = stage.GetPrimAtPath(path)
    if not prim or not prim.IsA(UsdGeom.Camera):
        cameras = [str(candidate.GetPath()) for candidate in stage.TraverseAll() if candidate.IsA(UsdGeom.Camera)]
        problem = f"is a {prim.GetTypeName() or 'prim without type'}, not a Camera" if prim else "there is no such prim"
        hint = nearest_hint(path, cameras) if cameras else "the file has no camera"
        raise FaultsError([Fault(file, path, problem, hint)])
    faults = list(_camera_faults(file, prim))
    if faults:
        raise FaultsError(faults)
    values = {name: prim.GetAttribute(name).Get(_TIME) for name in (*_LENS, "clippingRange")}
    unit = UsdGeom.GetStageMetersPerUnit(stage)
    lens = _LENS_UNIT * unit
    axes, position = _camera_axes(prim), _stage_matrix(prim)[3, :3] * unit
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
        notes=tuple(_camera_notes(prim, values)),
    )


def _camera_faults(file: str, prim: Usd.Prim) -> Iterator[Fault]:
    """Yield the faults of a camera's attributes and of its transform."""
    path = str(prim.GetPath())
    for name in _LENS:
        attribute, location = prim.GetAttribute(name), f"{path}.{name}"
        value = attribute.Get(_TIME)
        if attribute.ValueMightBeTimeVarying():
            yield Fault(file, location, "is animated; a camera must stand still", "give it a single value")
        elif name == "projection":
            if value != UsdGeom.Tokens.perspective:
                value_text = quote(value) if isinstance(value, str) else "no text"
                yield Fault(file, location, f"the projection is {value_text}; only perspective cameras render")
        elif not (isinstance(value, float) and abs(value) <= MAX_COORDINATE):
            value_text = f"is {value:g}" if isinstance(value, float) else "has a value of another type"
            yield Fault(file, location, value_text, f"a number within +-{MAX_COORDINATE:g} is needed")
        elif name in _LENGTHS and value <= 0.0:
            yield Fault(file, location, f"is {value:g}; a positive length is needed")
        elif name in ("fStop", "focusDistance") and value < 0.0:
            yield Fault(file, location, f"is {value:g}; it must not be negative")
    if not _is_range(prim.GetAttribute("clippingRange").Get(_TIME)):
        yield Fault(file, f"{path}.clippingRange", "is not two numbers, the first below the second", "(0.1, 1000)")
    moving = [
        str(xformable.GetPath())
        for xformable in _xformable_ancestors(prim)
        if UsdGeom.Xformable(xformable).TransformMightBeTimeVarying()
    ]
    if moving:
        yield Fault(file, path, f"moves: {', '.join(moving)} is animated; a camera must stand still")
    else:
        try:
            problem = _transform_problem(_stage_matrix(prim))
        except Tf.ErrorException as error:
            problem = f"USD cannot compute its transform: {error_message(error)}"
        if problem:
            yield Fault(
                file, faulty_transform_path(prim, _TIME), problem, "a camera is placed by translation and rotation"
            )


def _is_range(value: object) -> bool:
    """Return whether a value is a pair of floats, the first below the second; the second may be infinite."""
    return isinstance(value, Gf.Vec2f) and abs(value[0]) <= MAX_COORDINATE and value[0] < value[1]


def _xformable_ancestors(prim: Usd.Prim) -> Iterator[Usd.Prim]:
    """Yield the prims whose transforms place a prim.

    They are the prim itself and its transformable ancestors, up to the first that resets the transform.
    """
    while prim:
        xformable = UsdGeom.Xformable(prim)
        if xformable:
            yield prim
            if xformable.GetResetXformStack():
                return
        prim = prim.GetParent()


def _transform_problem(matrix: Floats) -> str:
    """Return why a matrix (4, 4) for row vectors cannot place a camera, or "" if it can."""
    axes = matrix[:3, :3]
    sizes = np.linalg.norm(axes, axis=1)
    if not (is_affine(matrix) and (sizes > 0.0).all()):
        return f"its transform is singular, not affine, or has a number not within +-{MAX_COORDINATE:g}"
    unit = axes / sizes[:, None]
    if np.abs(unit @ unit.T - np.eye(3)).max() > _MAX_COSINE:
        return "its transform shears it"
    return "its transform mirrors it" if np.linalg.det(unit) < 0.0 else ""


def _camera_axes(prim: Usd.Prim) -> Floats:
    """Return a camera's unit vectors to the right, up and backwards, exactly orthogonal, as rows of a matrix (3, 3)."""
    _, up, back = _stage_matrix(prim)[:3, :3]
    back = back / np.linalg.norm(back)
    right = np.cross(up, back)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(back, right), back])


def _stage_matrix(prim: Usd.Prim) -> Floats:
    """Return the matrix (4, 4), for row vectors, from a prim's space to the stage's."""
    return np.array(UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(_TIME), np.float64)


def _camera_notes(prim: Usd.Prim, values: dict[str, float]) -> Iterator[str]:
    """Yield notes about settings of a camera that have no effect; `values` has the camera's attributes by name."""
    path = prim.GetPath()
    if values["fStop"] > 0.0 and values["focusDistance"] == 0.0:
        yield f"{path}: fStop is {values['fStop']:g}, but no focusDistance is given: everything is sharp"
    unsupported = [name for name in _UNSUPPORTED if _is_set(prim, name)]
    if unsupported:
        yield f"{path}: not applied: {', '.join(unsupported)}"


def _is_set(prim: Usd.Prim, name: str) -> bool:
    """Return whether a prim's attribute differs from its default; older versions of USD lack some attributes."""
    value = prim.GetAttribute(name).Get(_TIME) if prim.HasAttribute(name) else None
    return bool(value) and value != prim.GetPrimDefinition().GetAttributeFallbackValue(name)
