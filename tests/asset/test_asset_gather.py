"""Small meshes joined: the same surface in fewer meshes."""

from dataclasses import replace

import numpy as np
import pytest
from asset_arrays import affine

from lookdev.asset import Asset, Instance, Mesh, Slot
from lookdev.asset.bounds import center_asset
from lookdev.asset.builtin import make_sphere
from lookdev.asset.gather import join_small_meshes, move_stretch_to_meshes
from lookdev.asset.store import make_asset
from lookdev.asset.tangents import tangents_of

BALL = make_sphere(8, 4).meshes[0]
WEAR = {"wear": BALL.uvs["st"][:, 0].copy(), "tint": BALL.normals.copy()}


def many(count: int = 80, mesh: Mesh = BALL, spread: float = 10.0) -> Asset:
    """Return balls, each a mesh with a slot of its own, turned, sheared and placed at random."""
    rng = np.random.default_rng(3)
    instances = []
    for number in range(count):
        linear = np.eye(3) + 0.3 * rng.normal(size=(3, 3))
        linear[:, 0] *= np.sign(np.linalg.det(linear))
        instances.append(Instance(number, affine(spread * rng.normal(size=3), linear)))
    slots = np.arange(count, dtype=np.int32)
    meshes = [replace(mesh, name=f"/{slot}", face_slots=np.full_like(mesh.face_slots, slot)) for slot in slots]
    return center_asset(make_asset("many", meshes, instances, [Slot(f"/{slot}") for slot in slots]))


def surface(asset: Asset) -> dict[int, np.ndarray]:
    """Return, by slot number, the world-space values of its corners (m, ...), with unit normals and tangents."""
    rows_by_slot = {}
    for instance in asset.instances:
        mesh, linear = asset.meshes[instance.mesh], instance.matrix[:3, :3]
        positions = mesh.points[mesh.corner_points] @ linear.T + instance.matrix[:3, 3]
        normals, tangents = mesh.normals @ np.linalg.inv(linear), tangents_of([mesh])[0] @ linear.T
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
        attributes = [values.reshape(len(positions), -1) for values in (*mesh.uvs.values(), *mesh.primvars.values())]
        sizes = np.repeat(mesh.face_sizes, mesh.face_sizes)[:, None]
        rows = np.concatenate([positions, normals, tangents, *attributes, sizes], axis=1)
        slots = np.repeat(mesh.face_slots, mesh.face_sizes)
        rows_by_slot |= {slot: rows[slots == slot] for slot in np.unique(slots)}
    return rows_by_slot


def assert_same_surface(asset: Asset, other: Asset) -> None:
    expected, other_rows = surface(asset), surface(other)
    assert expected.keys() == other_rows.keys()
    for slot, rows in expected.items():
        # A few roundings to float32, of positions as far away as the radius.
        np.testing.assert_allclose(other_rows[slot], rows, rtol=0.0, atol=4e-7 * max(1.0, asset.radius))


def test_unstretched_instances_are_rotations_and_show_the_same_surface() -> None:
    asset = many(6)
    meshes = (replace(asset.meshes[0], tangents=tangents_of(asset.meshes[:1])[0]), *asset.meshes[1:])
    matrices = [instance.matrix.copy() for instance in asset.instances]
    matrices[1][:3, 0] *= -1.0
    matrices[2][:3, :3] = 2.0 * np.linalg.qr(matrices[2][:3, :3])[0]
    instances = [Instance(number, matrix) for number, matrix in enumerate(matrices)]
    asset = replace(asset, meshes=meshes, instances=(*instances, replace(instances[0], mesh=1)))
    rigid = move_stretch_to_meshes(asset, {0, 1, 2})
    assert_same_surface(asset, rigid)
    for before, after in zip(asset.instances, rigid.instances, strict=True):
        linear = after.matrix[:3, :3]
        if before.mesh in (0, 1):
            np.testing.assert_allclose(linear @ linear.T, np.eye(3), atol=1e-12)
            assert np.sign(np.linalg.det(linear)) == np.sign(np.linalg.det(before.matrix[:3, :3]))
        else:
            assert after.mesh == before.mesh
            assert after.matrix is before.matrix


def test_meshes_with_tangents_are_joined_apart_from_those_without() -> None:
    asset = many()
    meshes = tuple(replace(mesh, tangents=None) if i % 2 else mesh for i, mesh in enumerate(asset.meshes))
    joined = join_small_meshes(replace(asset, meshes=meshes))
    assert len(joined.meshes) == 2
    with_tangents = next(mesh for mesh in joined.meshes if mesh.tangents is not None)
    assert set(with_tangents.face_slots) == set(range(0, len(meshes), 2))


def test_many_small_meshes_are_one() -> None:
    asset = many(mesh=replace(BALL, primvars=WEAR))
    joined = join_small_meshes(asset)
    assert len(joined.meshes) == len(joined.instances) == 1
    assert joined.meshes[0].corner_points.dtype == np.int32
    assert joined.meshes[0].name == "/0 and 79 others"
    assert joined.slots == asset.slots
    assert_same_surface(asset, joined)


def test_a_few_meshes_stay_as_they_are() -> None:
    asset = many(20)
    assert join_small_meshes(asset) is asset


def test_meshes_of_other_attributes_are_joined_by_themselves() -> None:
    asset = many()
    meshes = [replace(mesh, primvars=WEAR) if i % 3 == 0 else mesh for i, mesh in enumerate(asset.meshes)]
    asset = replace(asset, meshes=tuple(meshes))
    joined = join_small_meshes(asset)
    assert {tuple(mesh.primvars) for mesh in joined.meshes} == {(), tuple(WEAR)}
    assert_same_surface(asset, joined)


def scale_first(asset: Asset, *scales: float) -> Asset:
    first, *others = asset.instances
    return replace(asset, instances=(replace(first, matrix=first.matrix @ np.diag([*scales, 1.0])), *others))


def repeat_first(asset: Asset) -> Asset:
    first = asset.instances[0]
    moved = affine(first.matrix[:3, 3] + 1.0, first.matrix[:3, :3])
    return replace(asset, instances=(*asset.instances, replace(first, matrix=moved)))


def refine_first(asset: Asset) -> Asset:
    return replace(asset, meshes=(replace(make_sphere(64, 32).meshes[0], name="/0"), *asset.meshes[1:]))


CHANGES = {
    "reflected": lambda asset: scale_first(asset, -1.0, 1.0, 1.0),
    "fine": lambda asset: scale_first(asset, 1e-5, 1e-5, 1e-5),
    "twice": repeat_first,
    "large": refine_first,
}


@pytest.mark.parametrize("name", CHANGES)
def test_a_mesh_stays_apart_that_joining_would_change_or_copy(name) -> None:
    asset = CHANGES[name](many())
    joined = join_small_meshes(asset)
    assert len(joined.meshes) == 2
    assert joined.meshes[1] is asset.meshes[0]
    assert len(joined.instances) == 2 + (name == "twice")
    assert_same_surface(asset, joined)


def test_a_joined_mesh_has_a_limited_size(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lookdev.asset.gather._JOINED_CORNERS", 10 * len(BALL.corner_points))
    asset = many()
    joined = join_small_meshes(asset)
    assert len(joined.meshes) == 8
    assert_same_surface(asset, joined)
