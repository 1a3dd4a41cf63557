"""UsdGeom's curves and points: bases, wraps, widths and primvars against closed forms and SciPy."""

import re

import numpy as np
import pytest
from asset_arrays import area, at_corners, corner_st, corners, facets, volume
from pxr import Usd, UsdGeom, Vt
from scipy.interpolate import BPoly, BSpline, CubicHermiteSpline
from scipy.spatial import cKDTree
from usd_file import prim_of

from lookdev.asset.shape import Attribute
from lookdev.asset.usd.curves import curve_shape, point_shape
from lookdev.errors import AssetError

TIME = Usd.TimeCode.EarliestTime()
SIDES = 32
# Of a regular polygon of 32 sides against its circle.
PERIMETER = SIDES / np.pi * np.sin(np.pi / SIDES)
AREA = SIDES / (2.0 * np.pi) * np.sin(2.0 * np.pi / SIDES)

LINE = [(0, 0, 0), (0, 0, 2)]
TURNS = 2.0 * np.pi * np.arange(12) / 12
CIRCLE = np.stack([np.cos(TURNS), np.sin(TURNS), 0.0 * TURNS], axis=-1)
WIGGLE = [(0, 0, 0), (1, 2, 0), (2, -1, 1), (3, 1, -1), (4, 0, 0.5), (5, 2, 0), (6, 0, 0)]


def curves(points, counts=None, kind="cubic", basis="bspline", wrap="nonperiodic", widths=(0.1,), of="vertex"):
    vertices, counts = Vt.Vec3fArray.FromNumpy(np.asarray(points, np.float32)), counts or [len(points)]
    widths = None if widths is None else list(widths)
    values = {"points": vertices, "curveVertexCounts": counts, "type": kind, "basis": basis, "wrap": wrap}
    prim = prim_of("BasisCurves", **values, widths=widths)
    if widths is not None:
        UsdGeom.Curves(prim).SetWidthsInterpolation(of)
    return prim


def shape_of(prim, *attributes):
    return curve_shape(prim, TIME, 1.0, attributes)


def middles(shape, columns=SIDES + 1):
    """Return the middle of each ring of a tube without ends, (r, 3), or of each row of a ribbon."""
    around = np.repeat(1.0 / (columns - 1), columns - 1)
    rings = len(shape.points) // columns
    return np.einsum("j,rjc->rc", around, shape.points[: rings * columns].reshape(rings, columns, 3)[:, :-1])


def test_a_straight_tube_is_a_cylinder():
    shape = shape_of(curves(LINE, kind="linear", widths=[1.0]))
    assert area(shape) == pytest.approx(2.0 * np.pi * PERIMETER + 0.5 * np.pi * AREA)
    assert volume(shape) == pytest.approx(0.5 * np.pi * AREA)
    side = np.abs(facets(shape)[:, 2]) < 0.5
    normals = at_corners(shape, shape.normals)
    outward = corners(shape) * [1, 1, 0]
    np.testing.assert_allclose(normals[side], 2.0 * outward[side], atol=1e-12)
    np.testing.assert_allclose(normals[~side], facets(shape)[~side], atol=1e-12)
    np.testing.assert_allclose(corner_st(shape)[side, 1], corners(shape)[side, 2] / 2.0, atol=1e-12)


def test_a_tube_that_tapers_to_a_point_is_a_cone():
    shape = shape_of(curves(LINE, kind="linear", widths=[1.0, 0.0]))
    assert volume(shape) == pytest.approx(0.5 * np.pi * AREA / 3.0)
    assert sorted(shape.face_sizes) == [3] * SIDES + [SIDES]
    side = facets(shape)[:, 2] > -0.5
    np.testing.assert_allclose(at_corners(shape, shape.normals)[side, 2], 0.5 / np.hypot(0.5, 2.0), atol=1e-12)
    assert (at_corners(shape, shape.normals) * facets(shape)).sum(axis=1).min() > np.cos(np.pi / SIDES) - 1e-9


@pytest.mark.parametrize("wrap", ["nonperiodic", "periodic"])
def test_corners_of_a_line_are_cut_and_closed(wrap):
    shape = shape_of(curves([(0, 0, 0), (0, 0, 1), (0, 1, 1), (0, 1, 0)], kind="linear", wrap=wrap, widths=[0.2]))
    # A cut in the bisecting plane leaves as much on one side as it takes from the other.
    sides = 4 if wrap == "periodic" else 3
    assert volume(shape) == pytest.approx(0.01 * np.pi * AREA * sides)
    assert len(shape.face_sizes) == sides * SIDES + (0 if wrap == "periodic" else 2)
    far = np.unique(np.round(shape.points, 9), axis=0)
    assert len(far) == 4 * SIDES  # the pieces share their cross-sections
    assert (at_corners(shape, shape.normals) * facets(shape)).sum(axis=1).min() > np.cos(np.pi / SIDES) - 1e-9


def test_a_periodic_spline_is_a_ring_without_ends_or_seam():
    shape = shape_of(curves(CIRCLE, wrap="periodic", widths=[0.2]))
    # A uniform cubic B-spline on a circle of 12 vertices has this radius at its knots; in between it is 2.1e-4 less.
    radius = (2.0 + np.cos(2.0 * np.pi / 12)) / 3.0
    np.testing.assert_allclose(np.linalg.norm(middles(shape), axis=1), radius, rtol=2.2e-4)
    assert volume(shape) == pytest.approx(2.0 * np.pi * radius * 0.01 * np.pi * AREA, rel=3e-3)
    assert (shape.face_sizes == 4).all()
    points = np.round(shape.points, 7)
    where = np.unique(points, axis=0, return_inverse=True)[1].ravel()[shape.face_points].reshape(-1, 4)
    edges = np.concatenate([where, np.roll(where, -1, axis=1)]).reshape(2, -1).T
    both = np.unique(np.concatenate([edges, edges[:, ::-1]]), axis=0, return_counts=True)[1]
    np.testing.assert_array_equal(both, 2)  # each edge lies between two faces
    st = corner_st(shape)
    assert (st.min(), st.max()) == (0.0, 1.0)


@pytest.mark.parametrize("scale", [1.0, 1e-8])
def test_a_spline_that_returns_to_its_start_is_closed_at_any_scale(scale):
    loop = np.concatenate([CIRCLE, CIRCLE[:3]])
    for points, ends in ((loop, 0), (loop[:-1], 2)):
        shape = shape_of(curves(points * scale, widths=[0.2 * scale]))
        assert (shape.face_sizes == SIDES).sum() == ends


def bezier(points, t):
    p = np.asarray(points, float)
    pieces = (len(p) - 1) // 3
    return BPoly([p[i::3][:pieces] for i in range(4)], np.linspace(0.0, 1.0, pieces + 1))(t)


def catmull_rom(points, t):
    """Through the inner points, with tangents along the chords between their neighbours."""
    p = np.asarray(points, float)
    return CubicHermiteSpline(np.linspace(0.0, 1.0, len(p) - 2), p[1:-1], (p[2:] - p[:-2]) / 2 * (len(p) - 3))(t)


def bspline(points, t):
    p = np.asarray(points, float)
    return BSpline(np.arange(len(p) + 4), p, 3)(3 + t * (len(p) - 3))


def phantoms(points):
    p = np.asarray(points, float)
    return np.concatenate([2 * p[:1] - p[1:2], p, 2 * p[-1:] - p[-2:-1]])


def linear(points, t):
    return BSpline(np.linspace(-1.0, len(points), len(points) + 2), points, 1)(t * (len(points) - 1))


def identity(points):
    return points


def close_curve(count):
    """Return a function that repeats the first points at the end."""
    return lambda points: np.concatenate([points, points[:count]])


WRAPS = ("nonperiodic", "pinned", "periodic")
EXTENDED = {
    ("cubic", "bezier"): (bezier, (identity, identity, close_curve(1))),
    ("cubic", "bspline"): (bspline, (identity, phantoms, close_curve(3))),
    ("cubic", "catmullRom"): (catmull_rom, (identity, phantoms, close_curve(3))),
    ("linear", "bezier"): (linear, (identity, identity, close_curve(1))),
}
BASES = {
    (*key, wrap): (evaluate, extended)
    for key, (evaluate, ends) in EXTENDED.items()
    for wrap, extended in zip(WRAPS, ends, strict=True)
}


@pytest.mark.parametrize(("kind", "basis", "wrap"), BASES)
def test_every_basis_and_wrap_is_the_curve_of_its_definition(kind, basis, wrap):
    points = np.array(WIGGLE[:6] if (basis, wrap, kind) == ("bezier", "periodic", "cubic") else WIGGLE, float)
    prim = curves(points, kind=kind, basis=basis, wrap=wrap, widths=[1e-4])
    evaluate, extended = BASES[kind, basis, wrap]
    fine = evaluate(extended(points), np.linspace(0.0, 1.0, 50_001))
    prim.GetAttribute("normals").Set([(0.3, 0.5, 0.8)])  # the middle of a ribbon's rows is on the curve
    rings = shape_of(prim).points.reshape(-1, 2, 3).mean(axis=1)
    steps = np.linalg.norm(np.diff(fine, axis=0), axis=1)
    assert cKDTree(fine).query(rings)[0].max() < steps.max()
    np.testing.assert_allclose(rings[[0, -1]], fine[[0, -1]], atol=1e-6)
    assert np.linalg.norm(np.diff(rings, axis=0), axis=1).sum() == pytest.approx(steps.sum(), rel=2e-3)


@pytest.mark.parametrize(("wrap", "segments"), [("nonperiodic", 3), ("pinned", 5), ("periodic", 6)])
@pytest.mark.parametrize("of", ["vertex", "varying"])
def test_vertex_widths_follow_the_basis_and_varying_ones_are_linear(wrap, segments, of):
    points = [(0, 0, z) for z in range(6)] if wrap != "periodic" else CIRCLE[::2]
    widths = np.array([0.2, 0.8, 0.3, 0.9, 0.1, 0.6])
    if of == "vertex":
        evaluate, extended = BASES["cubic", "bspline", wrap]
    else:
        evaluate, extended = BASES["linear", "bezier", wrap]
        widths = widths[: segments + (wrap != "periodic")]
    shape = shape_of(curves(points, wrap=wrap, widths=widths, of=of))
    expected = evaluate(extended(widths[:, None]), np.linspace(0.0, 1.0, 10001))[:, 0] / 2.0
    rings = (shape.face_sizes == 4).sum() // SIDES + segments
    rings = shape.points[: rings * (SIDES + 1)].reshape(rings, SIDES + 1, 3)
    radii = np.linalg.norm(rings[:, 0] - rings[:, SIDES // 2], axis=1) / 2.0
    np.testing.assert_allclose([radii.min(), radii.max()], [expected.min(), expected.max()], atol=2e-3)
    np.testing.assert_allclose(radii[[0, -1]], expected[[0, -1]], atol=1e-6)


def test_pinned_curves_take_as_many_varying_values_as_usd_counts():
    prim = curves([(0, 0, z) for z in range(6)], wrap="pinned", widths=[0.2, 0.4, 0.6, 0.8], of="varying")
    assert UsdGeom.BasisCurves(prim).ComputeVaryingDataSize(TIME) == 4
    shape = shape_of(prim)
    first, last = shape.points[: SIDES + 1], shape.points[-SIDES:]
    assert np.linalg.norm(first[0] - first[SIDES // 2]) == pytest.approx(0.2)
    assert np.linalg.norm(last[0] - last[SIDES // 2]) == pytest.approx(0.8)


def test_primvars_go_to_points_and_faces():
    prim = curves([(x, 0, z) for x in range(2) for z in range(4)], [4, 4], "linear", widths=[0.1])
    attributes = [
        Attribute("all", np.array([7.0]), "constant"),
        Attribute("each", np.array([1.0, 2.0]), "uniform"),
        Attribute("root", np.array([[0.1, 0.2], [0.3, 0.4]]), "uniform", is_uv=True),
        Attribute("along", np.arange(8.0), "vertex"),
        Attribute("tint", np.arange(24.0).reshape(8, 3), "varying"),
        Attribute("widths", np.array([1.0]), "constant"),
    ]
    shape = shape_of(prim, *attributes)
    got = {attribute.name: attribute for attribute in shape.attributes}
    assert list(got) == ["st", "all", "each", "root", "along", "tint"]
    first = np.cumsum(shape.face_sizes) - shape.face_sizes
    face_curve = np.add.reduceat(corners(shape)[:, 0], first) / shape.face_sizes
    np.testing.assert_array_equal(got["all"].values, [7.0])
    np.testing.assert_array_equal(got["each"].values, 1.0 + np.round(face_curve))
    assert got["root"].is_uv
    np.testing.assert_array_equal(got["root"].values, np.where(face_curve[:, None] < 0.5, [[0.1, 0.2]], [[0.3, 0.4]]))
    x, z = np.round(shape.points[:, 0]), shape.points[:, 2]
    np.testing.assert_allclose(got["along"].values, 4.0 * x + z, atol=1e-6)
    np.testing.assert_allclose(got["tint"].values, (3.0 * (4.0 * x + z))[:, None] + [0.0, 1.0, 2.0], atol=1e-5)


def test_an_authored_st_replaces_the_generated_one():
    shape = shape_of(curves(LINE, kind="linear"), Attribute("st", np.array([[0.5, 0.25]]), "constant", is_uv=True))
    (st,) = shape.attributes
    np.testing.assert_array_equal(st.values, [[0.5, 0.25]])


def test_curves_with_normals_are_ribbons_that_face_along_them():
    prim = curves([(0, 0, 0), (0, 0, 1), (0, 0, 3)], kind="linear", widths=[0.5])
    prim.GetAttribute("normals").Set([(0, -2, 1)] * 3)
    shape = shape_of(prim)
    assert (shape.face_sizes == 4).all()
    assert area(shape) == pytest.approx(1.5)
    np.testing.assert_allclose(facets(shape), np.tile([0.0, -1.0, 0.0], (8, 1)), atol=1e-12)
    np.testing.assert_allclose(shape.normals.values, np.tile([0.0, -1.0, 0.0], (8, 1)), atol=1e-12)
    u, v = corner_st(shape).T
    np.testing.assert_allclose(corners(shape)[:, 0], (u - 0.5) * 0.5, atol=1e-12)
    np.testing.assert_allclose(corners(shape)[:, 2], 3.0 * v, atol=1e-12)


def test_widths_are_1_where_none_are_authored_and_lengths_are_in_metres():
    shape = curve_shape(curves(LINE, kind="linear", widths=None), TIME, 0.01)
    np.testing.assert_allclose(np.ptp(shape.points, axis=0), [0.01, 0.01, 0.02])


def test_a_primvar_of_widths_goes_before_the_attribute():
    prim = curves(LINE, kind="linear", widths=[5.0])
    UsdGeom.PrimvarsAPI(prim).CreatePrimvar("widths", prim.GetAttribute("widths").GetTypeName(), "constant").Set([0.5])
    assert np.ptp(shape_of(prim).points[:, 0]) == pytest.approx(0.5)


def test_points_can_replace_those_of_the_file():
    moved = curve_shape(curves(LINE, kind="linear"), TIME, 1.0, points=np.array([[0.0, 0.0, 5.0], [0.0, 0.0, 6.0]]))
    assert moved.points[:, 2].min() == pytest.approx(5.0)


def test_coinciding_vertices_do_not_matter():
    plain = shape_of(curves([(0, 0, 0), (0, 0, 1), (0, 1, 1)], kind="linear"))
    doubled = shape_of(curves([(0, 0, 0), (0, 0, 1), (0, 0, 1), (0, 1, 1)], kind="linear"))
    np.testing.assert_array_equal(doubled.points, plain.points)
    straight = shape_of(curves([(0, 0, 0), (0, 0, 0), (0, 0, 2), (0, 0, 2)], basis="bezier", widths=[1.0]))
    assert volume(straight) == pytest.approx(0.5 * np.pi * AREA)


def test_many_curves_have_fewer_sides(monkeypatch):
    monkeypatch.setattr("lookdev.asset.usd.curves._MAX_FACES", 100_000)
    rng = np.random.default_rng(5)
    roots = rng.uniform(size=(200, 1, 3))
    points = (roots + np.cumsum(rng.uniform(0.0, 0.1, (200, 8, 3)), axis=1)).reshape(-1, 3)
    shape = shape_of(curves(points, [8] * 200, widths=[0.01]))
    assert 10_000 < len(shape.face_sizes) < 101_000
    assert shape.face_sizes.max() < SIDES  # the ends
    # Each curve begins where its first segment does: (p0 + 4 p1 + p2) / 6.
    first = points.reshape(-1, 8, 3)[:, :3]
    starts = (first[:, 0] + 4.0 * first[:, 1] + first[:, 2]) / 6.0
    ring = shape.points[np.linalg.norm(shape.points - starts[7], axis=1).argmin()]
    assert np.linalg.norm(ring - starts[7]) == pytest.approx(0.005, rel=1e-3)


def test_what_has_no_surface_has_no_faces():
    empty = curves(np.zeros((0, 3)), kind="linear")
    empty.GetAttribute("curveVertexCounts").Set(Vt.IntArray())
    for prim in (empty, curves(LINE, kind="linear", widths=[0.0]), curves([(1, 2, 3)] * 2, kind="linear")):
        assert len(shape_of(prim).face_sizes) == 0


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("curveVertexCounts", [6], "curveVertexCounts add up to 6, but there are 7 points"),
        ("curveVertexCounts", [8, -1], "curveVertexCounts add up to 7, but"),
        ("curveVertexCounts", [4, 3], "curveVertexCounts[1] is 3; a nonperiodic bspline"),
        ("points", [(0, 0, 0)] * 6 + [(0, np.inf, 0)], "points[6] is inf"),
        ("widths", [0.1, -0.1] + [0.1] * 5, "widths[1] is negative"),
        ("widths", [0.1, 0.1], "widths has 2 values; interpolation 'vertex' of curves needs 7"),
        ("widths", [float("nan")], "widths[0] is nan"),
        ("normals", [(0, 0, 1)] * 3, "normals has 3 values; interpolation 'vertex'"),
        ("basis", "hermite", "basis is 'hermite' (known: bezier, bspline, catmullRom)"),
        ("wrap", "loop", "wrap is 'loop' (known"),
        ("type", "quintic", "type is 'quintic' (known"),
    ],
)
def test_faults_of_curves_are_named(name, value, message):
    prim = curves(WIGGLE)
    prim.GetAttribute(name).Set(value)
    with pytest.raises(AssetError, match="^/Thing: .*" + re.escape(message)):
        shape_of(prim)


def test_the_basis_of_linear_curves_has_no_effect() -> None:
    prim = curves(WIGGLE, kind="linear")
    expected = shape_of(prim)
    prim.GetAttribute("basis").Set("")
    np.testing.assert_array_equal(shape_of(prim).points, expected.points)


@pytest.mark.parametrize(
    ("interpolation", "count", "needed"),
    [("uniform", 3, 1), ("vertex", 2, 7), ("varying", 4, 5), ("faceVarying", 7, 1)],
)
def test_a_wrong_number_of_primvars_is_named(interpolation, count, needed):
    wear = Attribute("wear", np.arange(float(count)), interpolation)
    with pytest.raises(AssetError, match=f"^/Thing: primvars:wear has {count} val.*'{interpolation}'.* needs {needed}"):
        shape_of(curves(WIGGLE), wear)


CORNERS = [(1, 0, 0), (1, 1, 0), (0, 1, 0), (-1, 1, 0), (-1, 0, 0), (-1, -1, 0), (0, -1, 0), (1, -1, 0), (1, 0, 0)]
KNOTS = [0, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 4]


def nurbs(**changed):
    """Return NurbsCurves: by default a circle of radius 1 and width 0.2."""
    weights = [1, np.sqrt(0.5)] * 4 + [1]
    values = {"points": CORNERS, "curveVertexCounts": [9], "order": [3], "knots": KNOTS, "pointWeights": weights}
    return prim_of("NurbsCurves", **(values | {"widths": [0.2]} | changed))


def test_a_rational_circle_is_a_torus_without_ends():
    shape = shape_of(nurbs())
    np.testing.assert_allclose(np.linalg.norm(middles(shape), axis=1), 1.0, atol=1e-6)
    assert volume(shape) == pytest.approx(2.0 * np.pi * 0.01 * np.pi * AREA, rel=2e-3)
    assert (shape.face_sizes == 4).all()


def test_a_range_cuts_a_nurbs_curve():
    shape = shape_of(nurbs(ranges=[(0.5, 1.5)]))
    assert volume(shape) == pytest.approx(0.5 * np.pi * 0.01 * np.pi * AREA, rel=2e-3)  # a quarter, about the top
    assert shape.points[:, 1].max() == pytest.approx(1.1, rel=1e-3)


def test_nurbs_without_weights_are_splines():
    points = np.array(WIGGLE, float)
    knots = [0, 0, 0, 0, 1, 2, 3, 4, 4, 4, 4]
    prim = nurbs(**{"points": WIGGLE, "curveVertexCounts": [7], "order": [4], "knots": knots, "pointWeights": None})
    prim.GetAttribute("normals").Set([(0.3, 0.5, 0.8)])
    rings = shape_of(prim).points.reshape(-1, 2, 3).mean(axis=1)
    fine = BSpline(knots, points, 3)(np.linspace(0.0, 4.0, 50_001))
    assert cKDTree(fine).query(rings)[0].max() < np.linalg.norm(np.diff(fine, axis=0), axis=1).max()
    np.testing.assert_allclose(rings[[0, -1]], points[[0, -1]], atol=1e-6)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"order": [10]}, "order must be 2 or more and at most"),
        ({"order": [1]}, "order must be 2 or more"),
        ({"order": [3, 3]}, "order must be 2 or more"),
        ({"knots": [0, 1, 2]}, "there are 3 knots; vertices and orders need 12"),
        ({"knots": [0, 0, 0, 1, 1, 3, 2, 3, 3, 4, 4, 4]}, "knots of curve 0 must grow"),
        ({"knots": [0.0] * 12}, "knots of curve 0 must grow"),
        ({"ranges": [(3, 2)]}, "knots of curve 0 must grow and leave a range"),
        ({"ranges": [(0, 1), (0, 1)]}, "there are 2 ranges, but 1 curves"),
        ({"pointWeights": [1, 0] * 4 + [1]}, "pointWeights must be positive"),
        ({"pointWeights": [1.0]}, "pointWeights must be positive numbers, one for each of 9 points"),
        ({"knots": [float("nan")] * 12}, r"knots\[0\] is nan"),
    ],
)
def test_faults_of_nurbs_are_named(changed, message):
    with pytest.raises(AssetError, match=f"^/Thing: {message}"):
        shape_of(nurbs(**changed))


def dots(points=((0, 0, 0), (1, 2, 3)), widths=None, of="vertex"):
    prim = prim_of("Points", points=list(points), widths=widths)
    if widths is not None:
        UsdGeom.Points(prim).SetWidthsInterpolation(of)
    return prim


@pytest.mark.parametrize(
    ("widths", "of", "radii"),
    [
        (None, "vertex", [0.5, 0.5]),
        ([3.0], "constant", [1.5, 1.5]),
        ([1.0, 4.0], "varying", [0.5, 2.0]),
        ([0.0, 1.0], "vertex", [0.5]),
    ],
)
def test_points_are_a_sphere_and_its_placements(widths, of, radii):
    shape, placed = point_shape(dots(widths=widths, of=of), TIME, 0.01, 1e-2)
    np.testing.assert_allclose(np.linalg.norm(shape.points, axis=1), 0.01)  # the stage's unit
    row = np.array([[1.0, 1.0, 1.0, 1.0]]) @ placed
    centers = np.array([(0, 0, 0), (1, 2, 3)])[-len(radii) :]
    np.testing.assert_allclose(row[:, 0, :3], centers + np.array(radii)[:, None])


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"widths": [1.0, 2.0, 3.0]}, "there are 3 widths, but 2 points"),
        ({"widths": [1.0, -1.0]}, r"widths\[1\] is negative"),
        ({"points": [(0, np.nan, 0)]}, r"points\[0\] is nan"),
    ],
)
def test_faults_of_points_are_named(changed, message):
    with pytest.raises(AssetError, match=f"^/Thing: {message}"):
        point_shape(dots(**changed), TIME, 1.0)
