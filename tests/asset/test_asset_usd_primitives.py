"""UsdGeom's implicit surfaces: areas, volumes, normals and texture coordinates against closed forms."""

import numpy as np
import pytest
from asset_arrays import area, corner_st, corners, facets, volume
from pxr import Usd
from usd_file import prim_of

from lookdev.asset.normals import area_vectors
from lookdev.asset.usd.primitives import PRIMITIVES, primitive_key, primitive_shape, sphere_shape, surface_errors
from lookdev.errors import AssetError

TIME = Usd.TimeCode.EarliestTime()
AXES = {"X": 0, "Y": 1, "Z": 2}
ERROR = 1e-4
# A mesh inside a curved surface, at most ERROR of a radius away, lacks at most so much of its area and volume: the
# volume between two spheres is three times their distance, relative to the radius; other surfaces bend less.
SLACK = 3.0 * ERROR


def shape_of(kind, error=ERROR, **attributes):
    return primitive_shape(prim_of(kind, **attributes), TIME, 1.0, error)


def frustum(bottom, top, height):
    area = np.pi * (bottom**2 + top**2 + (bottom + top) * np.hypot(height, bottom - top))
    return area, np.pi * height * (bottom**2 + bottom * top + top**2) / 3.0


def capsule(bottom, top, height):
    """Area and volume of the convex hull of two spheres: two caps of a sphere, and a frustum between their rims."""
    sine = (bottom - top) / height
    cosine = np.sqrt(1.0 - sine**2)
    rim = frustum(bottom * cosine, top * cosine, height - (bottom - top) * sine)
    lids = np.pi * cosine**2 * (bottom**2 + top**2)
    area, volume = rim[0] - lids, rim[1]
    for radius, tall in ((bottom, bottom * (1.0 + sine)), (top, top * (1.0 - sine))):
        area += 2.0 * np.pi * radius * tall
        volume += np.pi * tall**2 * (3.0 * radius - tall) / 3.0
    return area, volume


CASES = [
    ("Cube", {"size": 3.0}, (54.0, 27.0)),
    ("Sphere", {"radius": 2.0}, (16.0 * np.pi, 32.0 / 3.0 * np.pi)),
    ("Cylinder", {"radius": 0.5, "height": 3.0}, frustum(0.5, 0.5, 3.0)),
    ("Cylinder_1", {"radiusBottom": 2.0, "radiusTop": 0.5, "height": 1.5}, frustum(2.0, 0.5, 1.5)),
    ("Cylinder_1", {"radiusBottom": 0.0, "radiusTop": 0.5, "height": 1.5}, frustum(0.0, 0.5, 1.5)),
    ("Cone", {"radius": 1.5, "height": 4.0}, frustum(1.5, 0.0, 4.0)),
    ("Capsule", {"radius": 0.5, "height": 2.0}, capsule(0.5, 0.5, 2.0)),
    ("Capsule", {"radius": 0.5, "height": 0.0}, (np.pi, np.pi / 6.0)),
    ("Capsule_1", {"radiusBottom": 1.0, "radiusTop": 0.25, "height": 2.0}, capsule(1.0, 0.25, 2.0)),
    ("Capsule_1", {"radiusBottom": 0.25, "radiusTop": 1.0, "height": 2.0}, capsule(0.25, 1.0, 2.0)),
    ("Capsule_1", {"radiusBottom": 0.0, "radiusTop": 1.0, "height": 2.0}, capsule(0.0, 1.0, 2.0)),
    ("Capsule_1", {"radiusBottom": 1.0, "radiusTop": 0.9, "height": 0.5}, capsule(1.0, 0.9, 0.5)),
    ("Capsule_1", {"radiusBottom": 1.0, "radiusTop": 0.25, "height": 0.5}, (4.0 * np.pi, 4.0 / 3.0 * np.pi)),
]


@pytest.mark.parametrize(("kind", "sizes", "expected"), CASES)
def test_a_solid_has_its_area_volume_normals_and_texture_coordinates(kind, sizes, expected):
    shape = shape_of(kind, **sizes)
    for size, measure in zip(expected, (area(shape), volume(shape)), strict=True):
        assert (1.0 - SLACK) * size <= measure <= (1.0 + 1e-12) * size
    normals = shape.normals.values
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-12)
    # On the outside: facets of 316 around deviate by half their angle in both directions.
    assert (normals * facets(shape)).sum(axis=1).min() > np.cos(np.sqrt(2.0) * np.pi / 316.0) - 1e-9
    # They fill the unit square, unmirrored.
    st = corner_st(shape)
    assert (st.min(), st.max()) == (0.0, 1.0)
    assert area_vectors(np.pad(st, ((0, 0), (0, 1))), shape.face_sizes)[:, 2].min() > 0.0


@pytest.mark.parametrize(("kind", "sizes", "expected"), CASES)
def test_every_face_is_there_once_and_closes_the_surface(kind, sizes, expected):
    shape = shape_of(kind, error=1e-2, **sizes)
    ends = np.cumsum(shape.face_sizes)
    following = np.arange(1, len(shape.face_points) + 1)
    following[ends - 1] = ends - shape.face_sizes
    edges = np.stack([shape.face_points, shape.face_points[following]], axis=-1)
    assert len(np.unique(edges, axis=0)) == len(edges)  # each directed edge once
    np.testing.assert_array_equal(np.unique(edges, axis=0), np.unique(edges[:, ::-1], axis=0))  # and its neighbour's
    assert set(shape.face_points) == set(range(len(shape.points)))
    assert len(np.unique(shape.points, axis=0)) == len(shape.points)


def test_a_spheres_normals_are_its_directions():
    shape = shape_of("Sphere", radius=3.0)
    at_pole = np.abs(corners(shape)[:, 2]) == 3.0
    assert at_pole.sum() == 2 * 316
    np.testing.assert_allclose(shape.normals.values[~at_pole], corners(shape)[~at_pole] / 3.0, atol=1e-15)
    np.testing.assert_allclose(np.abs(shape.normals.values[at_pole, 2]), 1.0)


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize(("bottom", "top"), [(1.0, 1.0), (2.0, 0.5), (0.0, 1.0)])
def test_the_normals_of_a_cylinder_are_sharp_at_its_rims(axis, bottom, top):
    shape = shape_of("Cylinder_1", radiusBottom=bottom, radiusTop=top, height=2.0, axis=axis)
    spine = AXES[axis]
    across = [(spine + 1) % 3, (spine + 2) % 3]
    normals, points = shape.normals.values, corners(shape)
    cap = np.abs(normals[:, spine]) == 1.0
    assert cap.any()
    np.testing.assert_allclose(points[cap, spine], normals[cap, spine], atol=1e-12)
    side = ~cap
    slope = (bottom - top) / np.hypot(2.0, bottom - top)
    np.testing.assert_allclose(normals[side, spine], slope, atol=1e-12)
    away = side & (np.linalg.norm(points[:, across], axis=1) > 0.0)  # not at an apex
    radial = points[np.ix_(away, across)] / np.linalg.norm(points[away][:, across], axis=1, keepdims=True)
    np.testing.assert_allclose(normals[np.ix_(away, across)], np.sqrt(1.0 - slope**2) * radial, atol=1e-12)


@pytest.mark.parametrize(("bottom", "top", "center"), [(1.0, 0.25, -0.25), (0.25, 1.0, 0.25)])
def test_a_capsule_whose_spheres_contain_each_other_is_the_larger_one(bottom, top, center):
    heights = shape_of("Capsule_1", radiusBottom=bottom, radiusTop=top, height=0.5).points[:, 2]
    np.testing.assert_allclose([heights.min(), heights.max()], [center - 1.0, center + 1.0])


def test_a_tapered_capsule_is_tangent_to_both_spheres():
    shape = shape_of("Capsule_1", radiusBottom=1.0, radiusTop=0.25, height=2.0)
    np.testing.assert_allclose(shape.points[:, 2].min(), -2.0)
    np.testing.assert_allclose(shape.points[:, 2].max(), 1.25)
    # By its own normal, each point is on one of the spheres or on the cone between them.
    point, normal = corners(shape), shape.normals.values
    axial = point[:, 2] - np.hypot(*point[:, :2].T) * normal[:, 2] / np.hypot(*normal[:, :2].T).clip(1e-12)
    used = np.hypot(*point[:, :2].T) > 0.0
    assert axial[used].min() > -1.0 - 1e-9
    assert axial[used].max() < 1.0 + 1e-9
    np.testing.assert_allclose(np.diff(np.unique(np.round(normal[:, 2], 9))).max(), 0.0, atol=2.0 * np.pi / 316.0)


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize("kind", ["Cylinder", "Cone", "Capsule"])
def test_every_axis_is_the_z_axis_turned(kind, axis):
    upright, turned = shape_of(kind, error=1e-2), shape_of(kind, error=1e-2, axis=axis)
    order = np.roll([0, 1, 2], AXES[axis] + 1)  # a cyclic order keeps the winding
    np.testing.assert_array_equal(turned.points, upright.points[:, order])
    np.testing.assert_array_equal(turned.normals.values, upright.normals.values[:, order])
    np.testing.assert_array_equal(turned.face_points, upright.face_points)


@pytest.mark.parametrize(
    ("axis", "u", "v"), [("X", (0, 0, -1), (0, 1, 0)), ("Y", (1, 0, 0), (0, 0, -1)), ("Z", (1, 0, 0), (0, 1, 0))]
)
def test_a_plane_spans_its_width_and_length(axis, u, v):
    shape = shape_of("Plane", width=4.0, length=2.0, axis=axis)
    s, t = corner_st(shape).T[..., None]
    np.testing.assert_allclose(corners(shape), (2 * s - 1) * 2.0 * np.array(u) + (2 * t - 1) * np.array(v), atol=1e-15)
    np.testing.assert_array_equal(shape.normals.values, np.eye(3)[[AXES[axis]] * 4])
    np.testing.assert_array_equal(facets(shape), shape.normals.values)


def test_u_goes_around_and_v_along():
    shape = shape_of("Capsule", radius=1.0, height=2.0)
    (u, v), (x, y, z) = corner_st(shape).T, corners(shape).T
    off_axis = np.hypot(x, y) > 0.0
    np.testing.assert_allclose(np.cos(2 * np.pi * u[off_axis]), (x / np.hypot(x, y).clip(1e-9))[off_axis], atol=1e-12)
    np.testing.assert_allclose(np.sin(2 * np.pi * u[off_axis]), (y / np.hypot(x, y).clip(1e-9))[off_axis], atol=1e-12)
    # Along the profile: a quarter circle, 2 m of cylinder, a quarter circle; chords are shorter by 2e-5.
    side = np.isclose(np.abs(z), 1.0) & np.isclose(np.hypot(x, y), 1.0)
    np.testing.assert_allclose(v[side], (np.pi / 2 + z[side] + 1.0) / (np.pi + 2.0), atol=2e-5)


@pytest.mark.parametrize(("up", "spine"), [("Y", 1), ("Z", 2)])
def test_a_cubes_sides_are_upright(up, spine):
    shape = shape_of("Cube", up=up)
    sides = np.abs(shape.normals.values[:, spine]) == 0.0
    assert sides.sum() == 16
    np.testing.assert_array_equal(corner_st(shape)[sides, 1], (corners(shape)[sides, spine] + 1.0) / 2.0)


@pytest.mark.parametrize("error", [1e-2, 1e-3, 1e-4])
def test_no_silhouette_deviates_by_more_than_the_error(error):
    sphere = sphere_shape("ball", 1.0, error)
    planes = (corners(sphere) * facets(sphere)).sum(axis=1)  # a face that is seen edge-on is a silhouette
    assert 1.0 - error <= planes.min()
    assert planes.min() < 1.0 - 0.8 * error  # and no finer than needed
    tube = shape_of("Cylinder", error=error)
    side = np.abs(facets(tube)[:, 2]) < 0.5
    assert (corners(tube) * facets(tube)).sum(axis=1)[side].min() >= 1.0 - error


def test_many_surfaces_share_the_faces():
    def faces(radii):
        return sum(0.5 * np.pi**2 / surface_errors(np.array(radii)))

    np.testing.assert_array_equal(surface_errors(np.array([1.0, 2.0, 0.1])), 1e-4)
    assert faces([1.0] * 20_000) == pytest.approx(4e6)
    giant, *pebbles = surface_errors(np.array([1.0] + [0.01] * 20_000))
    assert giant == pytest.approx(2.5e-4, rel=0.02)
    np.testing.assert_allclose(pebbles, 0.0248, rtol=0.01)
    assert surface_errors(np.array([1.0] * 100_000)).max() == 0.03


def test_sizes_are_in_metres_and_at_the_time():
    prim = prim_of("Sphere")
    prim.GetAttribute("radius").Set(1.0, 0.0)
    prim.GetAttribute("radius").Set(3.0, 10.0)
    assert primitive_shape(prim, Usd.TimeCode(5.0), 0.01, 1e-2).points.max() == pytest.approx(0.02)
    assert primitive_shape(prim, TIME, 1.0, 1e-2).points.max() == pytest.approx(1.0)


def test_equal_keys_mean_equal_shapes():
    assert primitive_key(prim_of("Cone", height=3.0), TIME) == primitive_key(prim_of("Cone", height=3.0), TIME)
    others = [prim_of("Cone"), prim_of("Cylinder", height=3.0), prim_of("Cone", height=3.0, axis="X")]
    assert len({primitive_key(prim, TIME) for prim in [prim_of("Cone", height=3.0), *others]}) == 4


NO_AREA = [("Cube", "size"), ("Sphere", "radius"), ("Cylinder", "height"), ("Cylinder", "radius")]
NO_AREA += [("Cone", "radius"), ("Capsule", "radius"), ("Plane", "width"), ("Plane", "length")]


@pytest.mark.parametrize(("kind", "size"), NO_AREA)
def test_what_has_no_area_has_no_faces(kind, size):
    shape = shape_of(kind, **{size: 0.0})
    assert len(shape.face_sizes) == len(shape.face_points) == len(shape.points) == len(shape.normals.values) == 0


@pytest.mark.parametrize("kind", PRIMITIVES)
@pytest.mark.parametrize("value", [-1.0, float("nan"), float("inf")])
def test_a_wrong_size_is_named(kind, value):
    name = {"Cube": "size", "Sphere": "radius", "Plane": "width"}.get(kind, "height")
    with pytest.raises(AssetError, match=f"^/Thing: {name} is {value:g}; a number from 0"):
        shape_of(kind, **{name: value})


def test_a_wrong_axis_is_named():
    with pytest.raises(AssetError, match=r"^/Thing: axis is 'W' \(known: X, Y, Z\)"):
        shape_of("Cone", axis="W")


@pytest.mark.parametrize("size", [1e-3, 1e5])
def test_scale_does_not_matter(size):
    shape, one = shape_of("Capsule", error=1e-2, radius=size, height=size), shape_of("Capsule", error=1e-2, radius=1.0)
    np.testing.assert_allclose(shape.points / size, one.points, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(corner_st(shape), corner_st(one), atol=1e-12)
