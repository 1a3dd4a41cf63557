"""Shapes become meshes: together as alone, whatever their faces are."""

from dataclasses import replace

import numpy as np
import pytest
from asset_arrays import check_mesh

from lookdev.asset.finish import make_meshes
from lookdev.asset.mesh import Mesh, Subdivision
from lookdev.asset.shape import Attribute, PolygonShape
from lookdev.asset.tangents import tangents_of
from lookdev.errors import AssetError

ARRAYS = ("points", "corner_points", "face_sizes", "face_slots", "normals")
INTERPOLATIONS = ("constant", "uniform", "varying", "vertex", "faceVarying")


def random_shape(rng: np.random.Generator, name: str) -> PolygonShape:
    """Return a shape of random polygons, some degenerate, with attributes of random interpolations."""
    points = rng.normal(size=(int(rng.integers(4, 12)), 3)) + rng.normal(size=3) * 100.0
    sizes = rng.integers(0, 6, int(rng.integers(0, 12)))
    corners = rng.integers(0, len(points), sizes.sum())
    counts = dict(zip(INTERPOLATIONS, (1, len(sizes), len(points), len(points), sizes.sum()), strict=True))

    def attribute(name: str, width: int, is_uv: bool = False) -> Attribute:
        interpolation = str(rng.choice(INTERPOLATIONS))
        values = (
            rng.normal(size=(counts[interpolation], width)) if width > 1 else rng.normal(size=counts[interpolation])
        )
        return Attribute(name, values, interpolation, is_uv)  # type: ignore[arg-type]

    attributes = [attribute("wear", 1), attribute("tint", 3)]
    if rng.random() < 0.5:
        attributes += [attribute("map1", 2, True), attribute("st", 2, True)]
    is_cage = rng.random() < 0.3
    return PolygonShape(
        name,
        points,
        sizes,
        corners,
        attributes=tuple(attributes),
        normals=attribute("normals", 3) if not is_cage and rng.random() < 0.5 else None,
        flat=not is_cage and rng.random() < 0.5,
        left_handed=rng.random() < 0.5,
        holes=np.flatnonzero(rng.random(len(sizes)) < 0.2),
        subdivision=Subdivision("catmullClark") if is_cage else None,
        face_parts=rng.integers(0, 3, len(sizes)) if rng.random() < 0.5 else None,
    )


def assert_same(left: Mesh | None, right: Mesh | None) -> None:
    if left is None or right is None:
        assert left is right
        return
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(left, name), getattr(right, name))
    for left_values, right_values in ((left.uvs, right.uvs), (left.primvars, right.primvars)):
        assert list(left_values) == list(right_values)
        for name in left_values:
            np.testing.assert_array_equal(left_values[name], right_values[name])
    assert (left.name, left.default_uv) == (right.name, right.default_uv)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("y_up", [False, True])
def test_shapes_are_finished_together_as_alone(seed: int, y_up: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(seed)
    shapes = [random_shape(rng, f"/{i}") for i in range(60)]
    alone = [make_meshes([shape], y_up)[0] for shape in shapes]
    for batch in (1 << 18, 100):
        monkeypatch.setattr("lookdev.asset.normals._BATCH_CORNERS", batch)
        for left, right in zip(make_meshes(shapes, y_up), alone, strict=True):
            assert_same(left, right)
        meshes = [mesh for mesh in alone if mesh is not None]
        for mesh, tangents in zip(meshes, tangents_of(meshes), strict=True):
            np.testing.assert_array_equal(tangents, tangents_of([mesh])[0])
    assert sum(mesh is None for mesh in alone) < 40
    for mesh in alone:
        if mesh is not None:
            check_mesh(mesh)


def square(**changes: object) -> PolygonShape:
    """Return two squares side by side in the plane z = 0."""
    points = np.array([(0, 0, 0), (1, 0, 0), (2, 0, 0), (0, 1, 0), (1, 1, 0), (2, 1, 0)], np.float64)
    shape = PolygonShape("/Square", points, np.array([4, 4]), np.array([0, 1, 4, 3, 1, 2, 5, 4]))
    return replace(shape, **changes)  # type: ignore[arg-type]


def finish_one(shape: PolygonShape) -> Mesh:
    (mesh,) = make_meshes([shape])
    assert mesh is not None
    check_mesh(mesh)
    return mesh


# A third face beside two squares, which is left out, or is not.
DROPPED = {
    "the first one again": [0, 1, 4, 3], "begun elsewhere": [4, 3, 0, 1], "one point twice": [0, 1, 1, 3],
    "an edge twice": [0, 1, 0, 3], "two points": [0, 1], "nothing": [],
}  # fmt: skip
SHOWN = {"its back": [3, 4, 1, 0], "a bow tie": [0, 4, 1, 3], "a triangle": [0, 1, 4], "without area": [0, 2, 1]}


@pytest.mark.parametrize("name", [*DROPPED, *SHOWN])
def test_which_faces_are_left_out(name: str) -> None:
    face = (DROPPED | SHOWN)[name]
    shape = square(face_sizes=np.array([4, 4, len(face)]), face_points=np.array([0, 1, 4, 3, 1, 2, 5, 4, *face]))
    assert len(finish_one(shape).face_sizes) == 2 + (name in SHOWN)


def test_a_face_is_no_copy_of_one_that_has_the_first_point_twice() -> None:
    shape = square(face_sizes=np.array([4, 3]), face_points=np.array([1, 0, 0, 3, 3, 1, 0]))
    np.testing.assert_array_equal(finish_one(shape).face_sizes, [3])


def test_an_edge_of_three_faces_is_no_fault() -> None:
    points = np.array([(0, 0, 0), (0, 0, 1), (1, 0, 0), (-1, 1, 0), (-1, -1, 0)], np.float64)
    assert (
        len(
            finish_one(
                PolygonShape("/Fan", points, np.array([3, 3, 3]), np.array([0, 1, 2, 0, 1, 3, 0, 1, 4]))
            ).face_sizes
        )
        == 3
    )


def test_points_without_a_face_do_not_matter() -> None:
    points = np.vstack([square().points[:3], [[np.nan, 0, 1e300]], square().points[3:]])
    mesh = finish_one(square(points=points, face_points=np.array([0, 1, 5, 4, 1, 2, 6, 5])))
    np.testing.assert_array_equal(mesh.points, square().points)
    np.testing.assert_array_equal(mesh.corner_points, square().face_points)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e5])
@pytest.mark.parametrize("at", [0.0, 1e3])
def test_normals_and_tangents_do_not_depend_on_scale(scale: float, at: float) -> None:
    uv = Attribute("st", square().points[:, :2], "vertex", is_uv=True)
    mesh = finish_one(square(points=(square().points + at) * scale, attributes=(uv,)))
    np.testing.assert_allclose(mesh.normals, np.tile([0.0, 0.0, 1.0], (8, 1)), atol=1e-6)
    np.testing.assert_allclose(tangents_of([mesh])[0], np.tile([1.0, 0.0, 0.0], (8, 1)), atol=1e-6)


def test_nothing_is_nothing() -> None:
    assert make_meshes([]) == []
    assert make_meshes([square(face_sizes=np.zeros(0, np.intp), face_points=np.zeros(0, np.intp))]) == [None]


def test_faults_of_all_shapes_are_reported() -> None:
    far = square(name="/Far", points=square().points + np.array([np.inf, 1.0, 1.0]))
    wrong = square(name="/Wrong", face_sizes=np.array([4, 5]))
    attributes = (Attribute("st", np.zeros((5, 2)), "vertex", is_uv=True),)
    with pytest.raises(AssetError) as caught:
        make_meshes([square(), far, replace(square(), name="/Uv", attributes=attributes)])
    uv, points = sorted(str(caught.value).splitlines(), reverse=True)
    assert uv == "/Uv: primvars:st has 5 values; interpolation 'vertex' needs 6"
    assert points == "/Far: points[0] is not a number of metres within +-1e+18"
    with pytest.raises(AssetError, match=r"(?s)/Wrong: faceVertexCounts add up to 9 .*\n/W2: faceVertexCounts add up"):
        make_meshes([wrong, square(), replace(wrong, name="/W2")])
