"""Displaced geometry against closed forms."""

from dataclasses import replace

import numpy as np
import pytest

from lookdev.asset import Asset, Instance, Mesh, Slot
from lookdev.asset.builtin import make_sphere
from lookdev.asset.normals import area_vectors, flat_normals
from lookdev.asset.store import make_asset
from lookdev.errors import AssetError
from lookdev.material import Coordinates, Displacement, Formula, Layer, Look, Primvar, ViewCosine
from lookdev.material.expression import parse
from lookdev.scene.displace import as_cage, displace

RINGS = 256


def look(displacement: Displacement | None) -> Look:
    return Look("look", (Layer("Base", "disney"),), displacement=displacement)


def displaced(asset: Asset, displacement: Displacement | None) -> Asset:
    return displace(asset, {slot.path: look(displacement) for slot in asset.slots})


def with_primvar(asset: Asset, heights: np.ndarray, *, matrix: np.ndarray | None = None) -> Asset:
    (mesh,) = asset.meshes
    corners = heights.astype(np.float32)[mesh.corner_points]
    placed = [Instance(0, np.eye(4) if matrix is None else matrix)]
    return make_asset(asset.name, [replace(mesh, primvars={"h": corners})], placed, asset.slots)


@pytest.fixture(scope="module")
def sphere() -> Asset:
    return make_sphere(64, RINGS)


def box() -> Asset:
    """A cube of side 2 with hard edges: six faces over eight points."""
    points = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float32)
    faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    corners = np.array(faces, np.int32).ravel()
    sizes = np.full(6, 4, np.int32)
    normals = flat_normals(area_vectors(points[corners].astype(np.float64), sizes), sizes).astype(np.float32)
    mesh = Mesh("/box", points, corners, sizes, np.zeros(6, np.int32), normals, np.roll(normals, 1, axis=1), {})
    return make_asset("box", [mesh], [Instance(0, np.eye(4))], [Slot("/box")])


def test_without_displacement_the_asset_is_the_same(sphere: Asset) -> None:
    assert displaced(sphere, None) is sphere


def test_a_constant_height_makes_a_larger_sphere(sphere: Asset) -> None:
    result = displaced(sphere, Displacement(0.75, scale=0.4, midlevel=0.5))
    (mesh,) = result.meshes
    np.testing.assert_allclose(np.linalg.norm(mesh.points, axis=1), 1.1, rtol=2e-7)
    np.testing.assert_allclose(mesh.normals, sphere.meshes[0].normals, atol=2e-4)
    assert result.radius == pytest.approx(1.1, rel=1e-6)
    assert result.digest != sphere.digest


def test_object_units_are_those_of_the_file(sphere: Asset) -> None:
    result = displaced(replace(sphere, unit=0.01), Displacement(1.0, scale=10.0))
    np.testing.assert_allclose(np.linalg.norm(result.meshes[0].points, axis=1), 1.1, rtol=2e-7)
    assert result.unit == 0.01


def test_normals_are_those_of_the_displaced_surface(sphere: Asset) -> None:
    # r = 1 + a sin(k z): the gradient of r(z / |p|) - |p| is normal to the surface.
    a, k = 0.05, 7.0
    unit = sphere.meshes[0].points.astype(np.float64)
    (mesh,) = displaced(with_primvar(sphere, a * np.sin(k * unit[:, 2])), Displacement(Primvar("h", 0.0))).meshes
    z = unit[:, 2:]
    slope = a * k * np.cos(k * z)
    expected = unit - slope / (1.0 + a * np.sin(k * z)) * (np.array([0.0, 0.0, 1.0]) - z * unit)
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    # For rings pi / 256 apart, central differences have an error of (k pi / 256)^2 / 6 of the slope, less at the poles.
    assert np.abs(mesh.normals - expected[mesh.corner_points]).max() < 2.0 * a * k * (k * np.pi / RINGS) ** 2


@pytest.mark.parametrize("scales", [(2.0, 2.0, 2.0), (1.0, 2.0, 0.5), (-1.0, 2.0, 1.0)])
def test_world_units_are_metres_along_the_normal_in_the_world(sphere: Asset, scales: tuple[float, ...]) -> None:
    matrix = np.diag([*scales, 1.0])
    matrix[:3, 3] = 3.0, -1.0, 2.0
    before = with_primvar(sphere, np.full(len(sphere.meshes[0].points), 0.1), matrix=matrix)
    after = displaced(before, Displacement(Primvar("h", 0.0), units="world"))
    move = (after.meshes[0].points.astype(np.float64) - before.meshes[0].points) * scales
    normals = before.meshes[0].points / np.array(scales)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    np.testing.assert_allclose(move, 0.1 * normals, atol=2e-6)


def test_instances_of_one_shape_share_a_mesh() -> None:
    asset = box()
    far, twice = np.eye(4), np.diag([2.0, 2.0, 2.0, 1.0])
    far[0, 3] = 10.0
    instances = [Instance(0, matrix, f"/box{i}") for i, matrix in enumerate((np.eye(4), twice, far))]
    asset = make_asset("boxes", asset.meshes, instances, asset.slots)
    assert len(displaced(asset, Displacement(0.1)).meshes) == 1
    result = displaced(asset, Displacement(0.1, units="world"))
    places = [(instance.mesh, instance.path) for instance in result.instances]
    assert places == [(0, "/box0"), (0, "/box2"), (1, "/box1")]


def test_hard_edges_stay_closed_and_hard() -> None:
    (mesh,) = displaced(box(), Displacement(0.3)).meshes
    # A corner of the cube moves by the mean of three offsets of length 0.3.
    np.testing.assert_allclose(np.abs(mesh.points), 1.1, rtol=1e-6)
    np.testing.assert_allclose(mesh.normals, box().meshes[0].normals, atol=1e-6)


def test_only_parts_whose_look_displaces_move(sphere: Asset) -> None:
    (mesh,) = sphere.meshes
    slots = np.zeros_like(mesh.face_slots)
    slots[len(slots) // 2 :] = 1
    asset = make_asset("two", [replace(mesh, face_slots=slots)], [Instance(0, np.eye(4))], [Slot("/a"), Slot("/b")])
    moved = displace(asset, {"/a": look(None), "/b": look(Displacement(0.1))}).meshes[0]
    a, b = (mesh.corner_points[np.repeat(slots, mesh.face_sizes) == slot] for slot in (0, 1))
    radii = np.linalg.norm(moved.points, axis=1)
    np.testing.assert_allclose(radii[np.setdiff1d(a, b)], 1.0, rtol=1e-6)
    np.testing.assert_allclose(radii[np.setdiff1d(b, a)], 1.1, rtol=1e-6)


def test_an_expression_of_coordinates_displaces(sphere: Asset) -> None:
    formula = Formula(parse("0.1 * st[1]"), {"st": Coordinates("st")}, {"st": "color"})
    (mesh,) = displaced(sphere, Displacement(formula)).meshes
    radii = np.linalg.norm(mesh.points, axis=1)[mesh.corner_points]
    np.testing.assert_allclose(radii, 1.0 + 0.1 * mesh.uvs["st"][:, 1], rtol=1e-6)


MAP1 = Formula(parse("st[0]"), {"st": Coordinates("map1")}, {"st": "color"})
FACING = Formula(parse("view"), {"view": ViewCosine()}, {"view": "float"})


@pytest.mark.parametrize(
    ("displacement", "message"),
    [
        (Displacement(MAP1), "reads the UV set 'map1'; it has: st"),
        (Displacement(FACING), "a displacement depends on the view"),
        (Displacement(10.0, scale=1e308), "'look' is not finite"),
        (Displacement(Primvar("h", (0.0, 0.0, 0.0))), "primvar 'h' has 1 numbers; the displacement reads 3"),
    ],
)
def test_faults_are_named(sphere: Asset, displacement: Displacement, message: str) -> None:
    asset = with_primvar(sphere, np.ones(len(sphere.meshes[0].points)))
    with pytest.raises(AssetError, match=f"/sphere.*{message}|{message}.*/sphere"):
        displaced(asset, displacement)


def test_a_refined_polygon_mesh_is_displaced_along_its_own_normals() -> None:
    asset = box()
    up = np.broadcast_to(np.array([0, 0, 1], np.float32), (24, 3))
    # Refinement computes the normals of the faces; a primvar keeps the original ones.
    refined = replace(as_cage(replace(asset.meshes[0], normals=up)), normals=asset.meshes[0].normals, subdivision=None)
    (mesh,) = displaced(replace(asset, meshes=(refined,)), Displacement(0.25)).meshes
    np.testing.assert_allclose(mesh.points - asset.meshes[0].points, np.broadcast_to([0.0, 0.0, 0.25], (8, 3)))
    assert not mesh.primvars
