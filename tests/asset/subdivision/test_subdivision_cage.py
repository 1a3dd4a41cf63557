"""Tags, boundaries, holes, and cages that are wrong."""

from dataclasses import replace

import numpy as np
import pytest
from cages import CAGES, CUBE, CUBE_FACES, bend, cage, lattice, with_rules

from lookdev.asset.subdivision import refine, refine_all
from lookdev.errors import AssetError

EPS = float(np.finfo(np.float32).eps)


@pytest.mark.parametrize("level", [0, 2])
def test_a_hole_is_refined_and_not_shown(level):
    points, faces = lattice(4, 4)
    whole = refine(cage(bend(points), faces), level)
    pierced = refine(cage(bend(points), faces, holes=[5, 10]), level)
    visible = ~np.isin(whole.face_slots, [5, 10])
    np.testing.assert_array_equal(pierced.face_slots, whole.face_slots[visible])
    corners = np.repeat(visible, whole.face_sizes)
    np.testing.assert_array_equal(pierced.points[pierced.corner_points], whole.points[whole.corner_points[corners]])
    np.testing.assert_array_equal(pierced.normals, whole.normals[corners])


@pytest.mark.parametrize("level", [0, 1, 2])
def test_points_that_no_face_has_are_left_out(level):
    points, faces = lattice(2, 2)
    refined = refine(cage([*bend(points), [1e6, 0.0, 0.0]], faces), level)
    assert np.abs(refined.points).max() < 10.0
    np.testing.assert_array_equal(np.unique(refined.corner_points), np.arange(len(refined.points)))


def test_indices_of_many_points_do_not_overflow():
    # 50,000 points: the number of a pair does not fit into 32 bits.
    points = np.zeros((50_000, 3))
    points[-8:] = CUBE
    refined = refine(cage(points, (np.array(CUBE_FACES) + 49_992).tolist()), 1)
    np.testing.assert_array_equal(refined.points, refine(cage(CUBE, CUBE_FACES), 1).points)


def test_a_sharpness_of_10_is_infinite_and_less_than_0_is_none():
    edges = np.array([[0, 1], [1, 3], [3, 2], [2, 0]], np.int32)
    mesh = cage(bend(CUBE), CUBE_FACES)

    def points(sharpness):
        return refine(
            with_rules(mesh, crease_edges=edges, crease_sharpness=np.full(4, sharpness, np.float32)), 3
        ).points

    np.testing.assert_array_equal(points(10.0), points(np.inf))
    np.testing.assert_array_equal(points(10.0), points(25.0))
    np.testing.assert_array_equal(points(-3.0), refine(mesh, 3).points)
    assert np.abs(points(9.9) - points(10.0)).max() > 1e-6


def test_a_crease_between_points_without_an_edge_has_no_effect():
    stray = cage(bend(CUBE), CUBE_FACES, creases={(0, 7): 10.0, (3, 3): 10.0})
    np.testing.assert_array_equal(refine(stray, 2).points, refine(cage(bend(CUBE), CUBE_FACES), 2).points)


@pytest.mark.parametrize(
    ("rules", "message"),
    [
        ({"creases": {(0, 8): 1.0}}, "a crease has index 8, but there are 8 points"),
        ({"creases": {(-1, 2): 1.0}}, "a crease has index -1"),
        ({"corners": {9: 1.0}}, "a corner has index 9"),
        ({"holes": [6]}, "a hole has index 6, but there are 6 faces"),
        ({"creases": {(0, 1): np.nan}}, "the sharpness of crease 0 is not a number"),
        ({"corners": {1: 1.0, 2: np.nan}}, "the sharpness of corner 1 is not a number"),
        ({"crease_count": 2}, "1 creases have 2 values of sharpness"),
        ({"scheme": "loop"}, "face 0 has 4 corners; subdivision scheme 'loop' refines triangles only"),
        ({"holes": [0, 1, 2, 3, 4, 5]}, "every face of the subdivision surface is a hole"),
    ],
)
@pytest.mark.parametrize("level", [0, 1])
def test_wrong_tags_are_errors_that_name_the_mesh(rules, message, level):
    count = rules.get("crease_count")
    mesh = cage(CUBE, CUBE_FACES, **{key: value for key, value in rules.items() if key != "crease_count"})
    if count:
        edges, sharpness = np.array([[0, 1]], np.int32), np.ones(count, np.float32)
        mesh = with_rules(mesh, crease_edges=edges, crease_sharpness=sharpness)
    with pytest.raises(AssetError, match=f"^/cage: {message}"):
        refine(mesh, level)


def test_a_cage_without_faces_is_an_error():
    none = np.zeros(0, np.int32)
    with pytest.raises(AssetError, match=r"^/cage: the cage .* has no face"):
        refine(replace(CAGES["cube"], face_sizes=none, corner_points=none, face_slots=none), 1)


def test_a_boundary_of_none_around_every_face_is_an_error():
    points, faces = lattice(2, 2)
    with pytest.raises(AssetError, match="interpolateBoundary 'none'"):
        refine(cage(points, faces, interpolate_boundary="none"), 1)
    assert len(refine(cage(points, faces, "bilinear", interpolate_boundary="none"), 1).face_sizes) == 16


@pytest.mark.parametrize(
    ("points", "faces"),
    [
        pytest.param(CUBE, [*CUBE_FACES, CUBE_FACES[0]], id="a face twice"),
        pytest.param(CUBE, [*CUBE_FACES, CUBE_FACES[0][::-1]], id="a face twice, once backwards"),
        pytest.param(CUBE, [CUBE_FACES[0][::-1], *CUBE_FACES[1:]], id="one face backwards"),
        pytest.param(CUBE, [[0, 1, 1, 3], *CUBE_FACES[1:]], id="a point twice"),
        pytest.param(CUBE, [[0, 1, 0, 3, 2], *CUBE_FACES[1:]], id="an edge twice in a face"),
        pytest.param(CUBE, [[0, 0, 0]], id="one point alone"),
        pytest.param(np.concatenate([CUBE, CUBE[1:] + 2.0]), [*CUBE_FACES, [7, 8, 9]], id="cones at a point"),
    ],
)
@pytest.mark.parametrize("level", [0, 1, 2])
@pytest.mark.parametrize("scheme", ["catmullClark", "bilinear"])
def test_faces_that_are_no_manifold_are_refined(points, faces, level, scheme):
    refined = refine(cage(points, faces, scheme, uv=np.ones((sum(map(len, faces)), 2))), level)
    assert np.isfinite(refined.points).all()
    np.testing.assert_allclose(np.linalg.norm(refined.normals, axis=1), 1.0, atol=4.0 * EPS)


def test_a_mesh_without_subdivision_is_returned_as_it_is():
    mesh = replace(CAGES["cube"], subdivision=None)
    assert refine(mesh, 3) is mesh
    assert refine_all([mesh, CAGES["cube"]], [2, 1])[0] is mesh
    assert refine_all([], []) == []


@pytest.mark.parametrize("levels", [[2] * 30, [i % 3 for i in range(30)]])
def test_many_cages_are_refined_as_each_is_alone(levels, monkeypatch):
    monkeypatch.setattr("lookdev.asset.subdivision.batch._BATCH_CORNERS", 3000)
    meshes = [replace(CAGES[name], name=f"/{i}") for i, name in enumerate([*CAGES, *CAGES][: len(levels)])]
    for mesh, level, together in zip(meshes, levels, refine_all(meshes, levels), strict=True):
        alone = refine(mesh, level)
        assert together.name == mesh.name
        assert list(together.uvs) == list(alone.uvs)
        for field in ("points", "corner_points", "face_sizes", "face_slots", "normals"):
            np.testing.assert_array_equal(getattr(together, field), getattr(alone, field))
        for name, values in alone.uvs.items():
            np.testing.assert_array_equal(together.uvs[name], values)
