"""Outlines have the hull of all faces, whatever the meshes, and the turning axis is the middle of the footprint."""

import math
from collections.abc import Callable, Iterable

import numpy as np
import pytest
from asset_arrays import affine

from lookdev.asset import Asset, load_asset
from lookdev.asset.bounds import bounding_sphere, turning_axis
from lookdev.asset.mesh import Instance, Mesh, Slot
from lookdev.asset.silhouette import hull_points

DIRECTIONS = np.random.default_rng(0).normal(size=(3, 200))
RNG = np.random.default_rng


def faces_of(points) -> Mesh:
    """Return a mesh whose faces are triangles of consecutive points."""
    points = np.asarray(points, np.float32)
    count = len(points) // 3
    corners = np.arange(3 * count, dtype=np.int32)
    none = np.zeros((3 * count, 3), np.float32)
    return Mesh("mesh", points, corners, np.full(count, 3, np.int32), np.zeros(count, np.int32), none, none, {})


def asset_of(mesh: Mesh, matrices: Iterable[np.ndarray]) -> Asset:
    instances = tuple(Instance(0, matrix) for matrix in matrices)
    return Asset("asset", (mesh,), instances, (Slot("/a"),), (0.0, 0.0, 0.0), 1.0)


def scatter(count, points_of, spread) -> Callable[[], Asset]:
    """Return a function that makes instances of alternating meshes, rotated, scaled and placed at random."""

    def make() -> Asset:
        rng = RNG(0)
        meshes = tuple(faces_of(points) for points in points_of(rng))
        positions = rng.normal(size=(count, 3)) * spread
        rotations = (np.linalg.qr(rng.normal(size=(3, 3)))[0] * rng.uniform(0.5, 2.0) for _ in positions)
        matrices = [affine(offset, linear) for offset, linear in zip(positions, rotations, strict=True)]
        instances = tuple(Instance(number % len(meshes), matrix) for number, matrix in enumerate(matrices))
        return Asset("asset", meshes, instances, (Slot("/a"),), (0.0, 0.0, 0.0), 1.0)

    return make


def flat(turn: float, *shape: int) -> Callable[[], Asset]:
    """Return a function that makes instances in a row, which rises, of a flat mesh or of a line."""
    linear = [[math.cos(turn), -math.sin(turn), 0.0], [math.sin(turn), math.cos(turn), 0.0], [0.0, 0.0, 1.0]]
    matrices = [affine((i, 3 * i, i**2), linear) for i in range(20)]
    return lambda: asset_of(faces_of(RNG(1).normal(size=(3000, 3)) * shape), matrices)


def tiles() -> Asset:
    """Return a floor of waves, whose tops are in one tilted plane."""
    u, v = np.meshgrid(*[np.linspace(-0.5, 0.5, 33)] * 2)
    sheet = faces_of(np.stack([u, v, 0.05 * np.sin(20.0 * u) * np.cos(17.0 * v)], axis=-1).reshape(-1, 3))
    tilt = np.linalg.qr(RNG(0).normal(size=(3, 3)))[0]
    return asset_of(sheet, (affine(tilt @ [x, y, 0.0], tilt) for x, y in np.ndindex(15, 15)))


def row(points, *places) -> Callable[[], Asset]:
    return lambda: asset_of(faces_of(points), (affine(offset) for offset in places))


def ball(rng, count):
    points = rng.normal(size=(count, 3))
    return points / np.linalg.norm(points, axis=1)[:, None]


# An asset, and the part of its points that its outline has at most.
ASSETS: dict[str, tuple[Callable[[], Asset], float]] = {
    "one mesh": (scatter(1, lambda rng: [rng.normal(size=(300, 3))], 1.0), 1.0),
    "a few": (scatter(5, lambda rng: rng.normal(size=(5, 90, 3)), 3.0), 1.0),
    "instances": (scatter(200, lambda rng: [rng.normal(size=(900, 3))], 10.0), 0.02),
    "flat instances": (scatter(20, lambda rng: [rng.normal(size=(60, 3)) * [1, 1, 0]], 10.0), 1.0),
    "instances on a line": (scatter(20, lambda rng: [rng.normal(size=(60, 3)) * [1, 0, 0]], [10.0, 0.0, 0.0]), 1.0),
    "large flat instances": (scatter(20, lambda rng: [rng.normal(size=(3000, 3)) * [1, 1, 0]], 10.0), 1.0),
    "large instances in a plane": (scatter(60, lambda rng: [ball(rng, 3000)], [50.0, 50.0, 0.0]), 0.2),
    "large and small": (scatter(40, lambda r: [ball(r, 3000), ball(r, 60), r.normal(size=(9, 3))], 9.0), 1.0),
    "large instances in one place": (scatter(15, lambda rng: [ball(rng, 3000)], 0.0), 1.0),
    "flat meshes": (flat(0.0, 1, 1, 0), 100 / 3000),
    "flat meshes, turned": (flat(0.7, 1, 1, 0), 100 / 3000),
    "upright meshes": (flat(0.0, 0, 1, 1), 100 / 3000),
    "upright meshes, turned": (flat(0.7, 0, 1, 1), 100 / 3000),
    "lines": (flat(0.0, 1, 0, 0), 2 / 3000),
    "lines, turned": (flat(0.7, 1, 0, 0), 2 / 3000),
    "tops in one plane": (tiles, 0.01),
    "a flat whole": (row(RNG(0).normal(size=(3000, 3)) * [1, 1, 0], *((x, x * x, 0) for x in range(30))), 1.0),
    "far away": (row(np.eye(3), *((1e6, x, -1e6) for x in range(30))), 1.0),
    "all in a plane": (row(np.eye(3) * [1, 1, 0], *((x, 0, 0) for x in range(9))), 1.0),
}


def support(asset: Asset) -> np.ndarray:
    """Return the greatest coordinate of the asset along each direction."""
    reach = [
        (asset.meshes[instance.mesh].points @ (instance.matrix[:3, :3].T @ DIRECTIONS)).max(axis=0)
        + instance.matrix[:3, 3] @ DIRECTIONS
        for instance in asset.instances
    ]
    return np.max(reach, axis=0)


@pytest.mark.parametrize("name", ASSETS)
def test_the_outline_has_the_hull_of_all_points_and_few_others(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    make, part = ASSETS[name]
    asset = make()
    expected, count = support(asset), sum(len(asset.meshes[instance.mesh].points) for instance in asset.instances)
    for many in (1 << 18, 0):  # of fewer points, and always, a finer polytope decides
        monkeypatch.setattr("lookdev.asset.silhouette._MANY_POINTS", many)
        points = hull_points(asset.meshes, asset.instances)
        # Both place the same points, in another order of sums.
        np.testing.assert_allclose((points @ DIRECTIONS).max(axis=0), expected, rtol=1e-12, atol=1e-9)
        assert len(points) <= part * count


def test_points_of_no_face_do_not_count() -> None:
    asset = asset_of(faces_of([[0, 0, 0], [1, 0, 0], [0, 1, 0], [50, 50, 50]]), [np.eye(4)])
    assert hull_points(asset.meshes, asset.instances).max() == 1.0
    assert bounding_sphere(asset.meshes, asset.instances)[1] == pytest.approx(math.sqrt(0.5))


@pytest.mark.parametrize(
    ("footprint", "axis"),
    [
        ([(0, 0), (4, 0), (2, 1)], (2.0, 0.0)),  # obtuse: two points decide
        ([(0, 0), (4, 0), (0, 4), (1, 1)], (2.0, 2.0)),
        ([(3, 0), (-3, 0), (0, 3), (0, -3), (1, 1)], (0.0, 0.0)),
        ([(1, 1), (5, 4)], (3.0, 2.5)),  # an upright card
        ([(7, 8)], (7.0, 8.0)),  # a vertical line
        ([(1e5, 1e5), (1e5 + 1, 1e5)], (1e5 + 0.5, 1e5)),
    ],
)
def test_the_axis_is_the_middle_of_the_smallest_circle(footprint, axis) -> None:
    points = np.array([(x, y, z) for x, y in footprint for z in (-9.0, 5.0)])
    assert turning_axis(points) == pytest.approx(axis, abs=1e-6)


def test_a_revolved_asset_turns_about_its_centre() -> None:
    asset = load_asset(builtin="sphere")
    assert math.dist(turning_axis(hull_points(asset.meshes, asset.instances)), asset.center[:2]) <= 1e-6 * asset.radius
