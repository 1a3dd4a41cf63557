"""The hierarchy for shadow rays: a traversal in NumPy against a test of all triangles."""

import numpy as np
import pytest

from lookdev.arrays import Floats
from lookdev.asset import load_asset
from lookdev.studio.viewport.geometry import pack_corners
from lookdev.studio.viewport.hierarchy import FIRST_BITS, Hierarchy


def walk(hierarchy: Hierarchy, start: Floats, w: Floats) -> tuple[list[int], int]:
    """Return the numbers of the triangles in all leaves whose boxes a ray hits, and the number of box tests."""
    texels, numbers, node, tested = hierarchy.texels, [], 0, 0
    *low, cell = texels[0]
    origin, step = (start - low) / cell, cell / w
    while node < hierarchy.nodes:
        texel, tested = texels[1 + node], tested + 1
        cells = texel[:3].view(np.uint32) - np.uint32(FIRST_BITS)
        ends = np.stack([cells & 0x7FFF, cells >> 15]).astype(np.float64)
        crossings = np.sort((ends - origin) * step, axis=0)
        met = max(crossings[0].max(), 0.0) <= crossings[1].min()
        leaf = texel[3] < 0.0
        node = node + 1 if met or leaf else int(texel[3])
        texel_of_triangle = 1 + hierarchy.nodes - 3 * int(1.0 + texel[3])
        while met and leaf:
            numbers.append(int(texels[texel_of_triangle, 3]))
            leaf, texel_of_triangle = texels[texel_of_triangle + 2, 3] == 0.0, texel_of_triangle + 3
    return numbers, tested


def triangles_on_ray(corners: Floats, start: Floats, w: Floats) -> set[int]:
    """Return the numbers of the triangles (t, 3, 3) that a ray hits, without hits near an edge."""
    edge1, edge2, off = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], start - corners[:, 0]
    p, q = np.cross(w, edge2), np.cross(off, edge1)
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = 1.0 / (edge1 * p).sum(axis=-1)
        w1, w2, distance = (off * p).sum(axis=-1) * scale, (q @ w) * scale, (edge2 * q).sum(axis=-1) * scale
    return set(np.flatnonzero((w1 > 1e-6) & (w2 > 1e-6) & (w1 + w2 < 1.0 - 1e-6) & (distance > 0.0)).tolist())


def soup(count: int) -> Floats:
    rng = np.random.default_rng(count)
    return rng.uniform(-1.0, 1.0, (count, 1, 3)) + rng.normal(0.0, 0.2, (count, 3, 3)) + (5.0, 0.0, -3.0)


SHAPES = {
    "one": soup(1),
    "two": soup(2),
    "soup": soup(400),
    "flat": soup(200) * (1.0, 1.0, 0.0),
    "coincident": np.repeat(soup(1), 100, axis=0),
    "scales": np.concatenate([soup(100), 1e-3 * soup(100) + (5.0, 0.0, -3.0)]),
}


@pytest.mark.parametrize("shape", SHAPES)
def test_a_walk_meets_what_a_ray_meets(shape: str) -> None:
    corners = SHAPES[shape].astype(np.float32)
    slots = np.arange(len(corners), dtype=np.float32) % 3
    hierarchy = Hierarchy.of(corners, slots)
    triangles = hierarchy.texels[1 + hierarchy.nodes :].reshape(-1, 3, 4)
    order = triangles[:, 0, 3].astype(int)
    assert sorted(order) == list(range(len(corners)))
    np.testing.assert_array_equal(triangles[:, 0, :3], corners[order, 0])
    np.testing.assert_array_equal(triangles[:, 1:, :3], corners[order, 1:] - corners[order, :1])
    np.testing.assert_array_equal(triangles[:, 1, 3], slots[order])
    rng, met = np.random.default_rng(3), 0
    middle, wide = corners.reshape(-1, 3).mean(axis=0), np.ptp(corners.reshape(-1, 3), axis=0).max()
    for _ in range(150):
        start = middle + wide * rng.normal(0.0, 0.5, 3)
        w = corners[rng.integers(len(corners))].mean(axis=0) - start + 0.02 * wide * rng.normal(0.0, 1.0, 3)
        w = w / np.linalg.norm(w)
        expected = triangles_on_ray(corners.astype(np.float64), start, w)
        numbers, _ = walk(hierarchy, start, w)
        assert expected <= set(numbers)
        assert len(numbers) == len(set(numbers))
        met += len(expected)
    assert met > 0


def test_few_boxes_are_tested() -> None:
    """Rays start on a surface of 15744 triangles, and pass close to others."""
    asset = load_asset(builtin="suzanne")
    hierarchy, rng = pack_corners(asset, tuple(range(len(asset.slots))), (), occluding=True), np.random.default_rng(4)
    triangles = hierarchy.texels[: hierarchy.hierarchy_start].reshape(-1, 3, hierarchy.stride, 4)
    places, normals = triangles[:, :, 0, :3].astype(np.float64), triangles[:, :, 1, :3].astype(np.float64)
    hierarchy = Hierarchy(hierarchy.texels[hierarchy.hierarchy_start :], hierarchy.hierarchy_nodes)
    counts = []
    for number in rng.integers(0, len(places), 200):
        normal, w = normals[number].mean(axis=0), rng.normal(size=3)
        w *= np.sign(w @ normal) / np.linalg.norm(w)
        numbers, tested = walk(hierarchy, places[number].mean(axis=0) + 1e-6 * normal, w)
        counts.append((tested, len(numbers)))
    assert (np.mean(counts, axis=0) < (90.0, 15.0)).all(), np.mean(counts, axis=0)
