"""Points and instances between samples, carried on by velocities from the sample before."""

from __future__ import annotations

import numpy as np
import pytest
from asset_arrays import world_points
from pxr import UsdGeom, Vt

from lookdev.errors import AssetError

TRIANGLE = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)]
SQUARE = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (0.0, 1.0, 0.0)]


def splashing(file, velocities):
    """A triangle at frame 24, which rises by a unit a frame, and a square at 48, at 24 frames a second."""
    mesh = UsdGeom.Mesh.Define(file.stage, "/Splash")
    for time, points, speeds in ((24, TRIANGLE, velocities), (48, SQUARE, [(0.0, 0.0, 0.0)] * 4)):
        mesh.GetPointsAttr().Set(Vt.Vec3fArray(points), time)
        mesh.GetVelocitiesAttr().Set(Vt.Vec3fArray(speeds), time)
        mesh.GetFaceVertexCountsAttr().Set([len(points)], time)
        mesh.GetFaceVertexIndicesAttr().Set(list(range(len(points))), time)
    return mesh


@pytest.mark.parametrize(
    ("time", "expected"),
    [(None, 0.0), (24.0, 0.0), (30.0, 6.0), (47.5, 23.5), (48.0, 0.0)],
    ids=["earliest", "at a sample", "after it", "before the next", "at the next"],
)
def test_points_are_carried_from_the_sample_before(file, time, expected):
    splashing(file, [(0.0, 0.0, 24.0)] * 3)
    (points,) = world_points(file.read(time=time))
    np.testing.assert_allclose(points[:, 2], expected, atol=1e-5)
    assert len(points) == (4 if time == 48.0 else 3)


@pytest.mark.parametrize("kind", ["Points", "BasisCurves", "NurbsCurves"])
def test_other_point_based_prims_are_carried_too(file, kind):
    prim = file.stage.DefinePrim("/Drop", kind)
    based = UsdGeom.PointBased(prim)
    based.GetPointsAttr().Set(Vt.Vec3fArray([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)]), 24)
    based.GetVelocitiesAttr().Set(Vt.Vec3fArray([(0.0, 0.0, 24.0)] * 2), 24)
    if kind != "Points":
        prim.GetAttribute("curveVertexCounts").Set([2])
        prim.GetAttribute("widths").Set([0.5])
        prim.GetAttribute("type" if kind == "BasisCurves" else "order").Set("linear" if kind == "BasisCurves" else [2])
    if kind == "NurbsCurves":
        prim.GetAttribute("knots").Set([0.0, 0.0, 1.0, 1.0])
    heights = np.concatenate(world_points(file.read(time=30.0)))[:, 2]
    assert (heights.min() + heights.max()) / 2 == pytest.approx(6.0, abs=1e-5)


def test_instances_stay_at_the_earliest_time(file):
    file.mesh("/Set/Cube")
    made = UsdGeom.PointInstancer.Define(file.stage, "/Set")
    made.GetPrototypesRel().SetTargets(["/Set/Cube"])
    made.GetProtoIndicesAttr().Set([0])
    made.GetPositionsAttr().Set(Vt.Vec3fArray([(5.0, 0.0, 0.0)]), 24)
    made.GetVelocitiesAttr().Set(Vt.Vec3fArray([(24.0, 0.0, 0.0)]), 24)
    for time, expected in ((None, 5.0), (30.0, 11.0)):
        (points,) = world_points(file.read(time=time))
        np.testing.assert_allclose(points.mean(axis=0), (expected, 0.0, 0.0), atol=1e-5)


@pytest.mark.parametrize("count", [0, 2, 4])
def test_velocities_that_do_not_fit_have_no_effect(file, count):
    splashing(file, [(0.0, 0.0, 24.0)] * count)
    asset = file.read(time=30.0)
    np.testing.assert_allclose(world_points(asset)[0][:, 2], 0.0)
    assert count == 0 or "/Splash -- found" in " ".join(asset.notes)


def test_velocities_that_are_not_finite_are_a_fault(file):
    splashing(file, [(0.0, np.nan, 24.0)] * 3)
    with pytest.raises(AssetError, match=r"/Splash: velocities\[0\] is nan"):
        file.read(time=30.0)
