import numpy as np
import pytest
from asset_arrays import check_asset, face_areas, facets, world_points
from scipy.spatial import cKDTree

from lookdev.asset import BUILTINS, Slot, load_asset
from lookdev.asset.builtin import make_sphere
from lookdev.asset.normals import next_corners
from lookdev.errors import AssetError


@pytest.fixture(scope="module")
def assets():
    return {name: load_asset(builtin=name) for name in BUILTINS}


@pytest.mark.parametrize("name", BUILTINS)
def test_invariants_and_flags(assets, name):
    asset = assets[name]
    check_asset(asset)
    assert asset.name == name
    assert all(slot.path.startswith(f"/{name}") and slot.material is None for slot in asset.slots)
    assert asset.convex == (name in ("plane", "sphere"))
    assert asset.sheet == (name == "plane")
    assert asset.revolved == (name == "sphere")
    assert asset.digest == load_asset(builtin=name).digest


@pytest.mark.parametrize("name", [name for name in BUILTINS if name != "plane"])
def test_normals_agree_with_the_winding_and_the_winding_faces_outwards(assets, name):
    for mesh in assets[name].meshes:
        areas = face_areas(mesh)
        assert ((mesh.normals * np.repeat(areas, mesh.face_sizes, axis=0)).sum(axis=1) > 0.0).mean() > 0.999
        # The divergence theorem: positive where the faces look out of the volume.
        first = mesh.points[mesh.corner_points][np.cumsum(mesh.face_sizes) - mesh.face_sizes]
        assert (areas * first).sum() > 0.0


@pytest.mark.parametrize("name", ["shaderball", "sphere"])
def test_it_is_watertight(assets, name):
    for mesh in assets[name].meshes:
        a = mesh.corner_points.astype(np.int64)
        b, count = a[next_corners(mesh.face_sizes)], len(mesh.points)
        forth, back = np.sort(a * count + b), np.sort(b * count + a)
        np.testing.assert_array_equal(forth, back)
        assert (np.diff(forth) > 0).all()


def test_a_triangle_at_a_pole_has_the_u_of_its_middle_there():
    (mesh,) = make_sphere(8, 4).meshes
    u, v = mesh.uvs["st"][np.repeat(mesh.face_sizes == 3, mesh.face_sizes)].reshape(-1, 3, 2).transpose(2, 0, 1)
    at_pole = (v == 0.0) | (v == 1.0)
    assert at_pole.sum() == 2 * 8
    np.testing.assert_allclose(u[at_pole], np.where(at_pole, 0.0, u).sum(axis=1) / 2.0, atol=1e-7)


def test_the_plane_is_a_card_that_faces_the_camera(assets):
    asset = assets["plane"]
    assert (asset.center, asset.radius) == ((0.0, 0.0, 0.0), pytest.approx(np.sqrt(2.0)))
    assert asset.slots == (Slot("/plane"),)
    (mesh,) = asset.meshes
    # Facing -y, seen from there: x to the right, z up.
    np.testing.assert_array_equal(face_areas(mesh), [[0.0, -4.0, 0.0]])
    positions, (u, v) = mesh.points[mesh.corner_points], mesh.uvs["st"].T
    np.testing.assert_array_equal(positions, np.stack([2 * u - 1, 0 * u, 2 * v - 1], axis=-1))
    assert {(0.0, 0.0), (1.0, 1.0)} < set(zip(u.tolist(), v.tolist(), strict=True))
    np.testing.assert_array_equal(mesh.normals, np.tile([0.0, -1.0, 0.0], (4, 1)))
    np.testing.assert_array_equal(mesh.tangents, np.tile([1.0, 0.0, 0.0], (4, 1)))


def test_the_sphere_is_exact(assets):
    asset = assets["sphere"]
    assert len(asset.meshes[0].face_sizes) == 512 * 256
    assert (asset.center, asset.radius) == ((0.0, 0.0, 0.0), pytest.approx(1.0, abs=1e-7))
    assert asset.slots == (Slot("/sphere"),)
    (mesh,) = make_sphere(32, 16).meshes
    positions = mesh.points[mesh.corner_points]
    np.testing.assert_allclose(np.linalg.norm(mesh.points, axis=1), 1.0, atol=2e-7)
    quads = np.repeat(mesh.face_sizes == 4, mesh.face_sizes)
    np.testing.assert_allclose(mesh.normals[quads], positions[quads], atol=2e-7)
    u, v = mesh.uvs["st"].T
    latitude, longitude = np.pi * (v - 0.5), 2.0 * np.pi * u
    along, around = ([np.cos(longitude), np.sin(longitude)], [-np.sin(longitude), np.cos(longitude), 0 * longitude])
    expected = np.stack([*(np.cos(latitude) * along), np.sin(latitude)], axis=-1)
    np.testing.assert_allclose(positions, expected, atol=1e-6)  # u in float32, times 2 pi
    around = np.stack(around, axis=-1)
    np.testing.assert_allclose(mesh.tangents, around, atol=1e-6)


def test_the_shaderball_stands_on_the_floor_and_has_its_parts(assets):
    asset = assets["shaderball"]
    assert asset.slots == (Slot("/shaderball/body"), Slot("/shaderball/base"))
    assert min(points[:, 2].min() for points in world_points(asset)) == 0.0
    assert 100_000 < sum((mesh.face_sizes - 2).sum() for mesh in asset.meshes) < 250_000
    ball = asset.meshes[0].points
    distance = np.linalg.norm(ball, axis=1)
    assert distance.max() == pytest.approx(1.04, abs=1e-3)  # the rim
    groove = np.abs(np.degrees(np.arctan2(ball[:, 2], np.hypot(*ball[:, :2].T))) - 12.0) < 1.0
    np.testing.assert_allclose(distance[groove & (distance > 0.9)], 0.95, atol=1e-3)
    assert ball[np.hypot(*ball[:, :2].T) == 0.0, 2].max() == pytest.approx(0.80)  # the core's top


def test_the_shaderball_has_rounded_edges(assets):
    for mesh in assets["shaderball"].meshes:
        cosine = (mesh.normals * facets(mesh)).sum(axis=1)
        # A right angle in eight steps: normals of neighbouring facets differ by about 11 degrees.
        assert np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))).max() < 12.0


@pytest.mark.parametrize("name", BUILTINS)
def test_what_is_revolved_and_nothing_else_is_turned_onto_itself(assets, name):
    asset = assets[name]
    points = np.vstack(world_points(asset)) - asset.center
    turned = points @ np.array([[np.cos(1.0), np.sin(1.0), 0.0], [-np.sin(1.0), np.cos(1.0), 0.0], [0.0, 0.0, 1.0]])
    distance, _ = cKDTree(points).query(turned[::7])
    # Half a segment of 512 is 0.0062, the distance to a point's neighbour.
    assert (distance.max() < 0.007 * asset.radius) == asset.revolved


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"builtin": "shaderbal"}, "did you mean 'shaderball'"),
        ({"builtin": "sphere", "prim": "/World"}, "has no prims"),
        ({}, "either a USD file or a built-in"),
        ({"usd": "a.usd", "builtin": "sphere"}, "either a USD file or a built-in"),
    ],
)
def test_wrong_requests_are_errors(arguments, message):
    with pytest.raises(AssetError, match=message):
        load_asset(**arguments)
