import numpy as np
import pytest

from lookdev.asset import BUILTINS
from lookdev.asset.builtin import make_sphere
from lookdev.asset.mesh import Mesh
from lookdev.asset.tangents import corner_tangents, handedness, perpendicular

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)


def tangents_of(uvs, points=SQUARE, corners=(0, 1, 2, 3), sizes=(4,), normals=None):
    corners = np.array(corners, np.int32)
    if normals is None:
        normals = np.tile(np.float32([0, 0, 1]), (len(corners), 1))
    return corner_tangents(points, corners, np.array(sizes, np.int32), normals, np.array(uvs, np.float32))


@pytest.mark.parametrize("angle", [0.0, 0.3, 1.5707963, 2.0, 4.0])
@pytest.mark.parametrize("mirror", [1.0, -1.0])
def test_the_tangent_is_the_direction_of_growing_u(angle, mirror):
    # u grows along (cos, sin); v along its left, or its right where the UVs are mirrored.
    u = SQUARE[:, :2] @ [np.cos(angle), np.sin(angle)]
    v = mirror * 3.0 * (SQUARE[:, :2] @ [-np.sin(angle), np.cos(angle)])
    expected = [np.cos(angle), np.sin(angle), 0.0]
    np.testing.assert_allclose(tangents_of(np.stack([u, v], -1)), np.tile(expected, (4, 1)), atol=1e-6)


def test_sheared_uvs_give_the_direction_of_constant_v():
    uvs = SQUARE[:, :2] @ np.array([[1.0, 0.0], [0.7, 1.0]])  # u = x + 0.7 y, v = y
    np.testing.assert_allclose(tangents_of(uvs), np.tile([1.0, 0.0, 0.0], (4, 1)), atol=1e-6)


def test_a_polygon_with_a_straight_corner_is_no_special_case():
    points = np.insert(SQUARE, 1, [0.5, 0, 0], axis=0)
    got = tangents_of(points[:, 1::-1], points, range(5), [5])  # u = y, v = x
    np.testing.assert_allclose(got, np.tile([0.0, 1.0, 0.0], (5, 1)), atol=1e-6)


def test_triangles_are_averaged_where_position_normal_and_uv_agree():
    # Two triangles that share a diagonal; u runs along x in one and along (1, -0.4, 0) in the other.
    points = SQUARE.copy()
    points[3, 1] = 1.4
    corners = [0, 1, 2, 0, 2, 3]
    got = tangents_of(SQUARE[corners][:, :2], points, corners, [3, 3])
    x, slanted = np.array([1.0, 0.0, 0.0]), np.array([1.0, -0.4, 0.0]) / np.hypot(1.0, 0.4)
    mean = (x + slanted) / np.linalg.norm(x + slanted)
    np.testing.assert_allclose(got, [mean, x, mean, mean, mean, slanted], atol=1e-6)


@pytest.mark.parametrize("same", ["flat", "mirrored"])
def test_islands_keep_their_own_tangent_along_a_seam(same):
    # Two squares side by side; the second island's u is rotated, or reversed.
    points = np.float32([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, 0], [2, 1, 0]])
    corners = [0, 1, 2, 3, 1, 4, 5, 2]
    uvs = points[corners][:, :2].copy()
    uvs[4:] = uvs[4:, ::-1] * [-1, 1] if same == "flat" else [2, 0] + uvs[4:] * [-1, 1]
    got = tangents_of(uvs, points, corners, [4, 4])
    np.testing.assert_allclose(got[:4], np.tile([1.0, 0, 0], (4, 1)), atol=1e-6)
    other = [0.0, -1.0, 0.0] if same == "flat" else [-1.0, 0.0, 0.0]
    np.testing.assert_allclose(got[4:], np.tile(other, (4, 1)), atol=1e-6)


@pytest.mark.parametrize(
    "uvs",
    [
        np.zeros((4, 2)),
        np.full((4, 2), 1e6),
        SQUARE[:, :1] * [1.0, 2.0],  # all on a line
        np.float32([1e4, 0]) + SQUARE[:, :2] * np.float32([1e-5, 1e-5]),  # an area below float32's rounding
    ],
)
def test_uvs_without_area_get_the_basis_of_the_normal(uvs):
    np.testing.assert_array_equal(tangents_of(uvs), np.tile([1.0, 0.0, 0.0], (4, 1)))


def test_handedness_is_negative_on_the_mirrored_island_alone():
    # Three squares in a row: not mirrored, mirrored, and with UVs on a line; a second UV set has no effect.
    points = np.float32([[x, y, 0] for x in range(4) for y in range(2)])
    corners = np.concatenate([[2 * i, 2 * i + 2, 2 * i + 3, 2 * i + 1] for i in range(3)]).astype(np.int32)
    sizes, normals = np.full(3, 4, np.int32), np.tile(np.float32([0, 0, 1]), (12, 1))
    uvs = points[corners][:, :2].copy()
    uvs[4:8, 0] *= -1.0
    uvs[8:, 1] = uvs[8:, 0]
    mesh = Mesh(
        name="/islands",
        points=points,
        corner_points=corners,
        face_sizes=sizes,
        face_slots=np.zeros(3, np.int32),
        normals=normals,
        tangents=corner_tangents(points, corners, sizes, normals, uvs),
        uvs={"st": uvs, "other": uvs[:, ::-1].copy()},
    )
    sign = handedness(mesh)
    assert sign.dtype == np.float32
    np.testing.assert_array_equal(sign, np.repeat([1.0, -1.0, 1.0], 4))
    # The bitangent points to increasing v, which is +y on both islands.
    bitangents = sign[:, None] * np.cross(mesh.normals, mesh.tangents)
    np.testing.assert_allclose(bitangents[:8], np.tile([0.0, 1.0, 0.0], (8, 1)), atol=1e-6)


@pytest.mark.parametrize("name", ["plane", "sphere", "shaderball"])
def test_builtins_are_mirrored_nowhere(name):
    for mesh in BUILTINS[name]().meshes:
        np.testing.assert_array_equal(handedness(mesh), 1.0)


def test_anything_gives_unit_orthogonal_tangents():
    rng = np.random.default_rng(3)
    points = rng.normal(size=(30, 3)).astype(np.float32) * np.float32(1e-3)
    corners = rng.integers(0, 30, 3000).astype(np.int32)  # some faces have a point twice
    normals = rng.normal(size=(3000, 3))
    normals = (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32)
    got = tangents_of(rng.integers(0, 3, (3000, 2)), points, corners, [3] * 1000, normals)
    np.testing.assert_allclose(np.linalg.norm(got, axis=1), 1.0, atol=5e-7)
    np.testing.assert_allclose((got * normals).sum(axis=1), 0.0, atol=5e-7)


def test_on_a_sphere_they_run_around_the_axis():
    segments = 64
    mesh = make_sphere(segments, 32).meshes[0]
    got = corner_tangents(mesh.points, mesh.corner_points, mesh.face_sizes, mesh.normals, mesh.uvs["st"])
    quads = np.repeat(mesh.face_sizes == 4, mesh.face_sizes)
    # Inside the mesh the errors of both sides cancel; along the seam, where u jumps, half a segment remains.
    cosine = (got * mesh.tangents).sum(axis=1)[quads]
    assert np.arccos(np.clip(cosine, -1, 1)).max() <= np.pi / segments * 1.01
    inside = (mesh.uvs["st"][quads, 0] % 1.0) != 0.0
    assert np.arccos(np.clip(cosine[inside], -1, 1)).max() < 0.1 * np.pi / segments


def test_perpendicular_has_no_singularity():
    axes = np.vstack([np.eye(3), -np.eye(3), [[0.0, 0.0, -0.0 - 1.0]], [[0.6, 0.0, -0.8]], [[1.0, 0.0, -0.0]]])
    got = perpendicular(axes)
    np.testing.assert_allclose((got * axes).sum(axis=1), 0.0, atol=1e-15)
    np.testing.assert_allclose(np.linalg.norm(got, axis=1), 1.0, atol=1e-15)
