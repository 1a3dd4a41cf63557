"""Cameras of USD files: as USD's own frustum has them, in metres and z up; everything else is refused by name."""

import math

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, Vt

from lookdev.asset.usd_camera import read_camera
from lookdev.errors import FaultsError

PATH = "/Cameras/shot"


def stage_of(up="Z", unit=1.0):
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, up)
    UsdGeom.SetStageMetersPerUnit(stage, unit)
    UsdGeom.Xform.Define(stage, "/Cameras").AddTranslateOp().Set(Gf.Vec3d(1.0, 2.0, 3.0))
    camera = UsdGeom.Camera.Define(stage, PATH)
    camera.AddTranslateOp().Set(Gf.Vec3d(4.0, -1.0, 2.5))
    camera.AddRotateXYZOp().Set(Gf.Vec3f(60.0, 10.0, 35.0))
    lens = {"focalLength": 35.0, "horizontalAperture": 24.0, "verticalAperture": 12.0, "fStop": 2.8}
    lens |= {"horizontalApertureOffset": 1.5, "verticalApertureOffset": -0.75, "focusDistance": 6.0}
    for name, value in lens.items():
        camera.GetPrim().GetAttribute(name).Set(value)
    return stage, camera


def faults(stage, path=PATH):
    with pytest.raises(FaultsError) as caught:
        read_camera(stage, path)
    return [(fault.where, fault.what, fault.hint) for fault in caught.value.faults]


@pytest.mark.parametrize(("up", "unit"), [("Z", 1.0), ("Z", 0.01), ("Y", 1.0), ("Y", 0.01)])
def test_a_camera_is_that_of_usds_own_frustum(up: str, unit: float) -> None:
    stage, camera = stage_of(up, unit)
    shot = read_camera(stage, PATH)
    frustum = camera.GetCamera(0.0).frustum
    z_up = np.eye(3) if up == "Z" else np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    np.testing.assert_allclose(shot.position, z_up @ frustum.position * unit)
    # Corners at the distance 1, from the lower left.
    right, up_axis, back = np.array(shot.frame)
    for corner, (x, y) in zip(frustum.ComputeCornersAtDistance(1.0), [(-1, -1), (1, -1), (-1, 1), (1, 1)], strict=True):
        across, along = (np.array([x, y]) * shot.apertures / 2.0 + shot.offsets) / shot.focal_length
        expected = z_up @ (np.array(corner) - frustum.position)
        np.testing.assert_allclose(across * right + along * up_axis - back, expected, atol=1e-6)
    assert shot.focal_length == pytest.approx(3.5 * unit)  # tenths of a scene unit
    assert (shot.f_stop, shot.focus_distance) == (pytest.approx(2.8), pytest.approx(6.0 * unit))
    assert shot.notes == ()


def test_a_scale_does_not_count() -> None:
    stage, camera = stage_of()
    plain = read_camera(stage, PATH)
    camera.AddScaleOp().Set(Gf.Vec3f(0.01, 0.02, 3.0))
    scaled = read_camera(stage, PATH)
    np.testing.assert_allclose(scaled.frame, plain.frame, atol=1e-6)
    assert scaled.position == pytest.approx(plain.position)


def test_what_is_not_applied_is_a_note() -> None:
    stage, camera = stage_of()
    camera.GetFocusDistanceAttr().Set(0.0)
    camera.CreateExposureAttr(1.5)
    camera.CreateClippingPlanesAttr(Vt.Vec4fArray([Gf.Vec4f(0.0, 0.0, 1.0, 2.0)]))
    notes = read_camera(stage, PATH).notes
    assert notes == (
        "/Cameras/shot: fStop is 2.8, but no focusDistance is given: everything is sharp",
        "/Cameras/shot: not applied: clippingPlanes, exposure",
    )
    camera.GetExposureAttr().Set(0.0)
    camera.GetClippingPlanesAttr().Set(Vt.Vec4fArray())
    assert len(read_camera(stage, PATH).notes) == 1


def test_what_is_no_camera_is_refused() -> None:
    stage, hint = stage_of()[0], "did you mean '/Cameras/shot'?"
    assert faults(stage, "/Cameras/shto") == [("/Cameras/shto", "there is no such prim", hint)]
    assert faults(stage, "/Cameras") == [("/Cameras", "is a Xform, not a Camera", hint)]
    assert faults(Usd.Stage.CreateInMemory()) == [(PATH, "there is no such prim", "the file has no camera")]


LENS = ["focalLength", "horizontalAperture", "fStop", "focusDistance", "verticalApertureOffset"]


@pytest.mark.parametrize("name", LENS)
def test_an_animated_lens_is_refused(name: str) -> None:
    stage, camera = stage_of()
    attribute = camera.GetPrim().GetAttribute(name)
    attribute.Set(1.0, 1.0)
    assert read_camera(stage, PATH)  # one sample does not move
    attribute.Set(2.0, 5.0)
    assert faults(stage)[0][:2] == (f"{PATH}.{name}", "is animated; a camera must stand still")


def animate(stage, path):
    """Move a prim by its first operation."""
    operation = UsdGeom.Xformable(stage.GetPrimAtPath(path)).GetOrderedXformOps()[0]
    for time in (1.0, 2.0):
        operation.Set(Gf.Vec3d(time, 0.0, 0.0), time)


@pytest.mark.parametrize("path", ["/Cameras", PATH])
def test_an_animated_transform_is_refused_that_of_ancestors_too(path: str) -> None:
    stage, camera = stage_of()
    animate(stage, path)
    assert faults(stage) == [(PATH, f"moves: {path} is animated; a camera must stand still", "")]
    if path != PATH:  # an ancestor that does not place it
        camera.SetResetXformStack(True)
        assert read_camera(stage, PATH).position == pytest.approx((4.0, -1.0, 2.5))


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("focalLength", 0.0, "is 0; a positive length is needed"),
        ("focalLength", math.nan, "is nan"),
        ("horizontalAperture", -3.0, "is -3; a positive length is needed"),
        ("verticalAperture", math.inf, "is inf"),
        ("horizontalApertureOffset", math.nan, "is nan"),
        ("fStop", -1.0, "is -1; it must not be negative"),
        ("focusDistance", -1.0, "is -1; it must not be negative"),
        ("projection", "orthographic", "the projection is 'orthographic'; only perspective cameras render"),
    ],
)
def test_a_lens_without_sense_is_refused(name: str, value: object, message: str) -> None:
    stage, camera = stage_of()
    camera.GetPrim().GetAttribute(name).Set(value)
    assert [fault[:2] for fault in faults(stage)] == [(f"{PATH}.{name}", message)]


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ([[1, 0, 0], [0, 0, 0], [0, 0, 1]], "singular"),
        ([[1, 0, 0], [0.5, 1, 0], [0, 0, 1]], "shears"),
        ([[-1, 0, 0], [0, 1, 0], [0, 0, 1]], "mirrors"),
        ([[1, 0, math.nan], [0, 1, 0], [0, 0, 1]], "not within"),
    ],
)
def test_a_transform_that_places_no_camera_is_refused(rows: list[list[float]], message: str) -> None:
    stage, camera = stage_of()
    camera.ClearXformOpOrder()
    camera.AddTransformOp().Set(Gf.Matrix4d(Gf.Matrix3d(*(number for row in rows for number in row)), Gf.Vec3d(0.0)))
    assert message in faults(stage)[0][1]
