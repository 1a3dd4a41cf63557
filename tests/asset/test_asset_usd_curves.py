"""UsdGeom's curves and points: bases, wraps, widths and primvars against closed forms and SciPy."""

from __future__ import annotations

import re

import numpy as np
import pytest
from pxr import Usd, UsdGeom, Vt
from scipy.interpolate import BSpline
from scipy.spatial import cKDTree
from shape_measures import area, at_corners, corner_st, corners, facets, volume

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


@pytest.fixture
def curves():
    """A function that makes BasisCurves in a stage of its own."""
    stages = []  # a prim does not keep its stage

    def make(points, counts=None, kind="cubic", basis="bspline", wrap="nonperiodic", widths=(0.1,), of="vertex"):
        stages.append(Usd.Stage.CreateInMemory())
        made = UsdGeom.BasisCurves.Define(stages[-1], "/Hair")
        made.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy(np.asarray(points, np.float32)))
        made.GetCurveVertexCountsAttr().Set(counts or [len(points)])
        made.GetTypeAttr().Set(kind)
        made.GetBasisAttr().Set(basis)
        made.GetWrapAttr().Set(wrap)
        if widths is not None:
            made.GetWidthsAttr().Set(list(widths))
            made.SetWidthsInterpolation(of)
        return made.GetPrim()

    return make


def shape_of(prim, *attributes):
    return curve_shape(prim, TIME, 1.0, attributes)


def middles(shape, columns=SIDES + 1):
    """Return the middle of each ring of a tube without ends, (r, 3), or of each row of a ribbon."""
    around = np.repeat(1.0 / (columns - 1), columns - 1)
    rings = len(shape.points) // columns
    return np.einsum("j,rjc->rc", around, shape.points[: rings * columns].reshape(rings, columns, 3)[:, :-1])


def test_a_straight_tube_is_a_cylinder(curves):
    shape = shape_of(curves(LINE, kind="linear", widths=[1.0]))
    assert area(shape) == pytest.approx(2.0 * np.pi * PERIMETER + 0.5 * np.pi * AREA)
    assert volume(shape) == pytest.approx(0.5 * np.pi * AREA)
    side = np.abs(facets(shape)[:, 2]) < 0.5
    normals = at_corners(shape, shape.normals)
    outward = corners(shape) * [1, 1, 0]
    np.testing.assert_allclose(normals[side], 2.0 * outward[side], atol=1e-12)
    np.testing.assert_allclose(normals[~side], facets(shape)[~side], atol=1e-12)
    np.testing.assert_allclose(corner_st(shape)[side, 1], corners(shape)[side, 2] / 2.0, atol=1e-12)


def test_a_tube_that_tapers_to_a_point_is_a_cone(curves):
    shape = shape_of(curves(LINE, kind="linear", widths=[1.0, 0.0]))
    assert volume(shape) == pytest.approx(0.5 * np.pi * AREA / 3.0)
    assert sorted(shape.face_sizes) == [3] * SIDES + [SIDES]
    side = facets(shape)[:, 2] > -0.5
    np.testing.assert_allclose(at_corners(shape, shape.normals)[side, 2], 0.5 / np.hypot(0.5, 2.0), atol=1e-12)
    assert (at_corners(shape, shape.normals) * facets(shape)).sum(axis=1).min() > np.cos(np.pi / SIDES) - 1e-9


@pytest.mark.parametrize("wrap", ["nonperiodic", "periodic"])
def test_corners_of_a_line_are_cut_and_closed(curves, wrap):
    square = [(0, 0, 0), (0, 0, 1), (0, 1, 1), (0, 1, 0)]
    shape = shape_of(curves(square, kind="linear", wrap=wrap, widths=[0.2]))
    # A cut in the bisecting plane leaves as much on one side as it takes from the other.
    sides = 4 if wrap == "periodic" else 3
    assert volume(shape) == pytest.approx(0.01 * np.pi * AREA * sides)
    assert len(shape.face_sizes) == sides * SIDES + (0 if wrap == "periodic" else 2)
    far = np.unique(np.round(shape.points, 9), axis=0)
    assert len(far) == 4 * SIDES  # the pieces share their cross-sections
    assert (at_corners(shape, shape.normals) * facets(shape)).sum(axis=1).min() > np.cos(np.pi / SIDES) - 1e-9


def test_a_periodic_spline_is_a_ring_without_ends_or_seam(curves):
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


def bezier(points, t):
    p = np.asarray(points, float)
    number = np.minimum((t * ((len(p) - 1) // 3)).astype(int), (len(p) - 1) // 3 - 1)
    s = (t * ((len(p) - 1) // 3) - number)[:, None]
    a, b, c, d = (p[3 * number + i] for i in range(4))
    return (1 - s) ** 3 * a + 3 * (1 - s) ** 2 * s * b + 3 * (1 - s) * s**2 * c + s**3 * d


def catmull_rom(points, t):
    """Through the inner points, with tangents along the chords between their neighbours."""
    p = np.asarray(points, float)
    number = np.minimum((t * (len(p) - 3)).astype(int), len(p) - 4)
    s = (t * (len(p) - 3) - number)[:, None]
    a, b, c, d = (p[number + i] for i in range(4))
    hermite = (2 * s**3 - 3 * s**2 + 1, s**3 - 2 * s**2 + s, -2 * s**3 + 3 * s**2, s**3 - s**2)
    return hermite[0] * b + hermite[1] * (c - a) / 2 + hermite[2] * c + hermite[3] * (d - b) / 2


def bspline(points, t):
    p = np.asarray(points, float)
    return BSpline(np.arange(len(p) + 4), p, 3)(3 + t * (len(p) - 3))


def phantoms(points):
    p = np.asarray(points, float)
    return np.concatenate([2 * p[:1] - p[1:2], p, 2 * p[-1:] - p[-2:-1]])


def linear(points, t):
    x = t * (len(points) - 1)
    return np.stack([np.interp(x, np.arange(len(points)), column) for column in np.transpose(points)], axis=-1)


BASES = {
    ("cubic", "bezier", "nonperiodic"): (bezier, lambda p: p),
    ("cubic", "bspline", "nonperiodic"): (bspline, lambda p: p),
    ("cubic", "catmullRom", "nonperiodic"): (catmull_rom, lambda p: p),
    ("cubic", "bspline", "pinned"): (bspline, phantoms),
    ("cubic", "catmullRom", "pinned"): (catmull_rom, phantoms),
    ("cubic", "bezier", "pinned"): (bezier, lambda p: p),
    ("cubic", "bspline", "periodic"): (bspline, lambda p: np.concatenate([p, p[:3]])),
    ("cubic", "catmullRom", "periodic"): (catmull_rom, lambda p: np.concatenate([p, p[:3]])),
    ("cubic", "bezier", "periodic"): (bezier, lambda p: np.concatenate([p, p[:1]])),
    ("linear", "bezier", "nonperiodic"): (linear, lambda p: p),
    ("linear", "bezier", "pinned"): (linear, lambda p: p),
    ("linear", "bezier", "periodic"): (linear, lambda p: np.concatenate([p, p[:1]])),
}


@pytest.mark.parametrize(("kind", "basis", "wrap"), BASES)
def test_every_basis_and_wrap_is_the_curve_of_its_definition(curves, kind, basis, wrap):
    points = np.array(WIGGLE[:6] if (basis, wrap, kind) == ("bezier", "periodic", "cubic") else WIGGLE, float)
    prim = curves(points, kind=kind, basis=basis, wrap=wrap, widths=[1e-4])
    evaluate, extended = BASES[kind, basis, wrap]
    fine = evaluate(extended(points), np.linspace(0.0, 1.0, 200_001))
    prim.GetAttribute("normals").Set([(0.3, 0.5, 0.8)])  # the middle of a ribbon's rows is on the curve
    rings = shape_of(prim).points.reshape(-1, 2, 3).mean(axis=1)
    steps = np.linalg.norm(np.diff(fine, axis=0), axis=1)
    assert cKDTree(fine).query(rings)[0].max() < steps.max()
    np.testing.assert_allclose(rings[[0, -1]], fine[[0, -1]], atol=1e-6)
    assert np.linalg.norm(np.diff(rings, axis=0), axis=1).sum() == pytest.approx(steps.sum(), rel=2e-3)


@pytest.mark.parametrize(("wrap", "segments"), [("nonperiodic", 3), ("pinned", 5), ("periodic", 6)])
@pytest.mark.parametrize("of", ["vertex", "varying"])
def test_vertex_widths_follow_the_basis_and_varying_ones_are_linear(curves, wrap, segments, of):
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


def test_pinned_curves_take_as_many_varying_values_as_usd_counts(curves):
    prim = curves([(0, 0, z) for z in range(6)], wrap="pinned", widths=[0.2, 0.4, 0.6, 0.8], of="varying")
    assert UsdGeom.BasisCurves(prim).ComputeVaryingDataSize(TIME) == 4
    shape = shape_of(prim)
    first, last = shape.points[: SIDES + 1], shape.points[-SIDES:]
    assert np.linalg.norm(first[0] - first[SIDES // 2]) == pytest.approx(0.2)
    assert np.linalg.norm(last[0] - last[SIDES // 2]) == pytest.approx(0.8)


def test_primvars_go_to_points_and_faces(curves):
    points = [(x, 0, z) for x in range(2) for z in range(4)]
    prim = curves(points, [4, 4], "linear", widths=[0.1])
    given = [
        Attribute("all", np.array([7.0]), "constant"),
        Attribute("each", np.array([1.0, 2.0]), "uniform"),
        Attribute("root", np.array([[0.1, 0.2], [0.3, 0.4]]), "uniform", is_uv=True),
        Attribute("along", np.arange(8.0), "vertex"),
        Attribute("tint", np.arange(24.0).reshape(8, 3), "varying"),
        Attribute("widths", np.array([1.0]), "constant"),
    ]
    shape = shape_of(prim, *given)
    got = {each.name: each for each in shape.attributes}
    assert list(got) == ["st", "all", "each", "root", "along", "tint"]
    face_curve = (
        np.add.reduceat(corners(shape)[:, 0], np.cumsum(shape.face_sizes) - shape.face_sizes) / shape.face_sizes
    )
    np.testing.assert_array_equal(got["all"].values, [7.0])
    np.testing.assert_array_equal(got["each"].values, 1.0 + np.round(face_curve))
    assert got["root"].is_uv
    np.testing.assert_array_equal(got["root"].values, np.where(face_curve[:, None] < 0.5, [[0.1, 0.2]], [[0.3, 0.4]]))
    x, z = np.round(shape.points[:, 0]), shape.points[:, 2]
    np.testing.assert_allclose(got["along"].values, 4.0 * x + z, atol=1e-6)
    np.testing.assert_allclose(got["tint"].values, (3.0 * (4.0 * x + z))[:, None] + [0.0, 1.0, 2.0], atol=1e-5)


def test_an_authored_st_replaces_the_generated_one(curves):
    shape = shape_of(curves(LINE, kind="linear"), Attribute("st", np.array([[0.5, 0.25]]), "constant", is_uv=True))
    (st,) = shape.attributes
    np.testing.assert_array_equal(st.values, [[0.5, 0.25]])


def test_curves_with_normals_are_ribbons_that_face_along_them(curves):
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


def test_widths_are_1_where_none_are_authored_and_lengths_are_in_metres(curves):
    shape = curve_shape(curves(LINE, kind="linear", widths=None), TIME, 0.01)
    np.testing.assert_allclose(np.ptp(shape.points, axis=0), [0.01, 0.01, 0.02])


def test_a_primvar_of_widths_goes_before_the_attribute(curves):
    prim = curves(LINE, kind="linear", widths=[5.0])
    UsdGeom.PrimvarsAPI(prim).CreatePrimvar("widths", prim.GetAttribute("widths").GetTypeName(), "constant").Set([0.5])
    assert np.ptp(shape_of(prim).points[:, 0]) == pytest.approx(0.5)


def test_points_can_replace_those_of_the_file(curves):
    moved = curve_shape(curves(LINE, kind="linear"), TIME, 1.0, points=np.array([[0.0, 0.0, 5.0], [0.0, 0.0, 6.0]]))
    assert moved.points[:, 2].min() == pytest.approx(5.0)


def test_coinciding_vertices_do_not_matter(curves):
    plain = shape_of(curves([(0, 0, 0), (0, 0, 1), (0, 1, 1)], kind="linear"))
    doubled = shape_of(curves([(0, 0, 0), (0, 0, 1), (0, 0, 1), (0, 1, 1)], kind="linear"))
    np.testing.assert_array_equal(doubled.points, plain.points)
    straight = shape_of(curves([(0, 0, 0), (0, 0, 0), (0, 0, 2), (0, 0, 2)], basis="bezier", widths=[1.0]))
    assert volume(straight) == pytest.approx(0.5 * np.pi * AREA)


def test_many_curves_have_fewer_sides(curves):
    rng = np.random.default_rng(5)
    roots = rng.uniform(size=(2000, 1, 3))
    points = (roots + np.cumsum(rng.uniform(0.0, 0.1, (2000, 8, 3)), axis=1)).reshape(-1, 3)
    shape = shape_of(curves(points, [8] * 2000, widths=[0.01]))
    assert 100_000 < len(shape.face_sizes) < 1_010_000
    assert shape.face_sizes.max() < SIDES  # the ends
    # Each curve begins where its first segment does: (p0 + 4 p1 + p2) / 6.
    first = points.reshape(-1, 8, 3)[:, :3]
    starts = (first[:, 0] + 4.0 * first[:, 1] + first[:, 2]) / 6.0
    ring = shape.points[np.linalg.norm(shape.points - starts[7], axis=1).argmin()]
    assert np.linalg.norm(ring - starts[7]) == pytest.approx(0.005, rel=1e-3)


@pytest.mark.parametrize(
    "prim",
    [{"points": []}, {"points": LINE, "widths": [0.0]}, {"points": [(1, 2, 3)] * 2}],
    ids=["no", "thin", "short"],
)
def test_what_has_no_surface_has_no_faces(curves, prim):
    points = np.reshape(prim.pop("points"), (-1, 3))
    made = curves(points, kind="linear", **prim)
    if len(points) == 0:
        made.GetAttribute("curveVertexCounts").Set(Vt.IntArray())
    assert len(shape_of(made).face_sizes) == 0


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (
            lambda p: p.GetAttribute("curveVertexCounts").Set([6]),
            "curveVertexCounts add up to 6, but there are 7 points",
        ),
        (lambda p: p.GetAttribute("curveVertexCounts").Set([8, -1]), "curveVertexCounts add up to 7, but"),
        (lambda p: p.GetAttribute("curveVertexCounts").Set([4, 3]), "curveVertexCounts[1] is 3; a nonperiodic bspline"),
        (lambda p: p.GetAttribute("points").Set([(0, 0, 0)] * 6 + [(0, np.inf, 0)]), "points[6] is inf"),
        (lambda p: p.GetAttribute("widths").Set([0.1, -0.1] + [0.1] * 5), "widths[1] is negative"),
        (
            lambda p: p.GetAttribute("widths").Set([0.1, 0.1]),
            "widths has 2 values; interpolation 'vertex' of curves needs 7",
        ),
        (lambda p: p.GetAttribute("widths").Set([float("nan")]), "widths[0] is nan"),
        (lambda p: p.GetAttribute("normals").Set([(0, 0, 1)] * 3), "normals has 3 values; interpolation 'vertex'"),
        (lambda p: p.GetAttribute("basis").Set("hermite"), "basis is 'hermite' (known: bezier, bspline, catmullRom)"),
        (lambda p: p.GetAttribute("wrap").Set("loop"), "wrap is 'loop' (known"),
        (lambda p: p.GetAttribute("type").Set("quintic"), "type is 'quintic' (known"),
    ],
)
def test_faults_of_curves_are_named(curves, spoil, message):
    prim = curves(WIGGLE)
    spoil(prim)
    with pytest.raises(AssetError, match="^/Hair: .*" + re.escape(message)):
        shape_of(prim)


@pytest.mark.parametrize(
    ("interpolation", "count", "needed"),
    [("uniform", 3, 1), ("vertex", 2, 7), ("varying", 4, 5), ("faceVarying", 7, 1)],
)
def test_a_wrong_number_of_primvars_is_named(curves, interpolation, count, needed):
    with pytest.raises(
        AssetError, match=f"^/Hair: primvars:wear has {count} values; .*'{interpolation}'.* needs {needed}"
    ):
        shape_of(curves(WIGGLE), Attribute("wear", np.arange(float(count)), interpolation))


@pytest.fixture
def nurbs():
    """A function that makes NurbsCurves: by default a circle of radius 1 and width 0.2."""
    stages = []
    half = np.sqrt(0.5)
    corner = [(1, 0, 0), (1, 1, 0), (0, 1, 0), (-1, 1, 0), (-1, 0, 0), (-1, -1, 0), (0, -1, 0), (1, -1, 0), (1, 0, 0)]

    def make(**changed):
        stages.append(Usd.Stage.CreateInMemory())
        prim = UsdGeom.NurbsCurves.Define(stages[-1], "/Wire").GetPrim()
        values = {
            "points": corner,
            "curveVertexCounts": [9],
            "order": [3],
            "knots": [0, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 4],
            "pointWeights": [1, half] * 4 + [1],
            "widths": [0.2],
        }
        for name, value in (values | changed).items():
            if value is not None:
                prim.GetAttribute(name).Set(value)
        return prim

    return make


def test_a_rational_circle_is_a_torus_without_ends(nurbs):
    shape = shape_of(nurbs())
    np.testing.assert_allclose(np.linalg.norm(middles(shape), axis=1), 1.0, atol=1e-6)
    assert volume(shape) == pytest.approx(2.0 * np.pi * 0.01 * np.pi * AREA, rel=2e-3)
    assert (shape.face_sizes == 4).all()


def test_a_range_cuts_a_nurbs_curve(nurbs):
    shape = shape_of(nurbs(ranges=[(0.5, 1.5)]))
    assert volume(shape) == pytest.approx(0.5 * np.pi * 0.01 * np.pi * AREA, rel=2e-3)  # a quarter, about the top
    assert shape.points[:, 1].max() == pytest.approx(1.1, rel=1e-3)


def test_nurbs_without_weights_are_splines(nurbs):
    points = np.array(WIGGLE, float)
    knots = [0, 0, 0, 0, 1, 2, 3, 4, 4, 4, 4]
    changed = {"points": WIGGLE, "curveVertexCounts": [7], "order": [4], "knots": knots, "pointWeights": None}
    prim = nurbs(**changed)
    prim.GetAttribute("normals").Set([(0.3, 0.5, 0.8)])
    rings = shape_of(prim).points.reshape(-1, 2, 3).mean(axis=1)
    fine = BSpline(knots, points, 3)(np.linspace(0.0, 4.0, 200_001))
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
def test_faults_of_nurbs_are_named(nurbs, changed, message):
    with pytest.raises(AssetError, match=f"^/Wire: {message}"):
        shape_of(nurbs(**changed))


@pytest.fixture
def dots():
    stages = []

    def make(points=((0, 0, 0), (1, 2, 3)), widths=None, of="vertex"):
        stages.append(Usd.Stage.CreateInMemory())
        made = UsdGeom.Points.Define(stages[-1], "/Dust")
        made.GetPointsAttr().Set(list(points))
        if widths is not None:
            made.GetWidthsAttr().Set(widths)
            made.SetWidthsInterpolation(of)
        return made.GetPrim()

    return make


@pytest.mark.parametrize(
    ("widths", "of", "radii"),
    [
        (None, "vertex", [0.5, 0.5]),
        ([3.0], "constant", [1.5, 1.5]),
        ([1.0, 4.0], "varying", [0.5, 2.0]),
        ([0.0, 1.0], "vertex", [0.5]),
    ],
)
def test_points_are_a_sphere_and_its_placements(dots, widths, of, radii):
    shape, placed = point_shape(dots(widths=widths, of=of), TIME, 0.01, 1e-2)
    np.testing.assert_allclose(np.linalg.norm(shape.points, axis=1), 0.01)  # the stage's unit
    row = np.array([[1.0, 1.0, 1.0, 1.0]]) @ placed
    centers = np.array([(0, 0, 0), (1, 2, 3)])[-len(radii) :]
    np.testing.assert_allclose(row[:, 0, :3], centers + np.array(radii)[:, None])


@pytest.mark.parametrize(
    ("widths", "message"),
    [([1.0, 2.0, 3.0], "there are 3 widths, but 2 points"), ([1.0, -1.0], r"widths\[1\] is negative")],
)
def test_faults_of_points_are_named(dots, widths, message):
    with pytest.raises(AssetError, match=f"^/Dust: {message}"):
        point_shape(dots(widths=widths), TIME, 1.0)


def test_a_point_that_is_not_finite_is_named(dots):
    with pytest.raises(AssetError, match=r"^/Dust: points\[0\] is nan"):
        point_shape(dots(points=[(0, np.nan, 0)]), TIME, 1.0)
