"""The level of each cage by its size in the frame."""

from dataclasses import replace

import numpy as np
import pytest
from cages import CAGES, bend, cage, lattice

from lookdev.asset import Asset, Instance, Slot
from lookdev.asset.subdivision import orbit_pixel_size, refine, refinement_levels
from lookdev.asset.subdivision.detail import DISPLACED_EDGE, SURFACE_TOLERANCE
from lookdev.asset.subdivision.topology import connect, split_corners, split_faces


def asset_of(meshes, matrices=None):
    matrices = [np.eye(4)] * len(meshes) if matrices is None else matrices
    instances = tuple(Instance(min(i, len(meshes) - 1), matrix) for i, matrix in enumerate(matrices))
    return Asset("thing", tuple(meshes), instances, (Slot("/cage"),), (0.0, 0.0, 0.0), 2.0)


def pixels_of(size):
    return lambda centers, radii: np.full(len(radii), size)


def levels(meshes, size, **options):
    return refinement_levels(asset_of(meshes), pixels_of(size), **options).levels


def facet_distances(mesh, level):
    """Return how far the limit surface is from the facets of a level, along its normal, at corners two levels finer."""
    coarse, fine = refine(mesh, level), refine(mesh, level + 2)
    triangles = mesh.subdivision.scheme == "loop"
    facets, _ = connect(coarse.corner_points.astype(np.intp), coarse.face_sizes.astype(np.intp), len(coarse.points))
    positions = coarse.points[coarse.corner_points].astype(np.float64)
    for _ in range(2):
        positions, facets = split_corners(facets, positions, triangles), split_faces(facets, triangles)
    away = fine.points[fine.corner_points] - positions
    return np.abs((away * fine.normals).sum(axis=1))


@pytest.mark.parametrize("size", [0.2, 0.05])
@pytest.mark.parametrize("name", ["cube", "open", "sharp ring", "junctions", "loop", "any faces"])
def test_facets_are_within_a_tenth_of_a_pixel_of_the_limit_surface(name, size):
    (level,) = levels([CAGES[name]], size)
    assert 1 <= level <= 5
    # Distances are measured at the middles of edges and faces, and fall by four only in the limit; the worst hundredth
    # of the edges may be one level short.
    distances = facet_distances(CAGES[name], level)
    assert np.quantile(distances, 0.97) < 1.1 * SURFACE_TOLERANCE * size
    assert distances.max() < 4.4 * SURFACE_TOLERANCE * size


def test_one_level_less_would_be_too_far_from_the_limit_surface():
    (level,) = levels([CAGES["cube"]], 0.02)
    assert facet_distances(CAGES["cube"], level - 1).max() > SURFACE_TOLERANCE * 0.02


@pytest.mark.parametrize("scheme", ["catmullClark", "bilinear"])
def test_a_flat_cage_is_not_refined(scheme):
    points, faces = lattice(1, 1)
    assert levels([cage(points, faces, scheme)], 1e-5) == (0,)


def test_a_flat_cage_is_refined_for_uvs_that_are_not_linear():
    points, faces = lattice(2, 1)
    # Two charts, whose corners are cut by the rule `none` at the seam between them.
    uv = points[np.concatenate(faces)][:, :2] + np.repeat([0.0, 3.0], 4)[:, None]
    assert levels([cage(points, faces, uv=uv)], 1e-3) == (0,)
    (level,) = levels([cage(points, faces, uv=uv, face_varying="none")], 1e-3)
    assert level >= 3


def test_the_level_follows_the_size_of_a_pixel():
    mesh = CAGES["cube"]
    result = [levels([mesh], size)[0] for size in (1e3, 1.0, 0.1, 0.01, 0.001, 1e-6, 0.0)]
    assert result == sorted(result)
    assert result[0] == 0
    assert result[-1] == 6
    assert levels([mesh], 1e-6, max_level=3) == (3,)


def test_an_instance_counts_by_its_own_scale():
    mesh = CAGES["cube"]
    large, small = np.diag([10.0, 10.0, 10.0, 1.0]), np.diag([0.1, 0.1, 0.1, 1.0])
    at = pixels_of(0.01)
    assert refinement_levels(asset_of([mesh], [large]), at).levels == levels([mesh], 0.001)
    assert refinement_levels(asset_of([mesh], [small]), at).levels == levels([mesh], 0.1)
    assert refinement_levels(asset_of([mesh], [small, large]), at).levels == levels([mesh], 0.001)
    assert refinement_levels(asset_of([mesh], []), at).levels == (0,)
    # Without volume it is as if it were not there.
    assert refinement_levels(asset_of([mesh], [np.zeros((4, 4))]), at).levels == (0,)


def test_a_mesh_that_is_no_cage_stays_at_level_0():
    plain = replace(CAGES["cube"], subdivision=None)
    assert levels([plain, CAGES["cube"], plain], 0.01) == (0, *levels([CAGES["cube"]], 0.01), 0)


@pytest.mark.parametrize("size", [0.02, 0.001])
def test_the_edges_of_a_displaced_mesh_are_two_pixels_long(size):
    points, faces = lattice(1, 1)
    (level,) = levels([cage(points, faces, "bilinear")], size, displaced=[0])
    assert 1.0 / 2**level <= DISPLACED_EDGE * size < 2.0 / 2**level


def test_no_asset_has_more_corners_than_it_may_and_a_note_says_so():
    meshes = [replace(CAGES["cube"], name=f"/{i}") for i in range(5)]
    meshes.append(replace(cage(*(lambda p, f: (bend(p), f))(*lattice(8, 8))), name="/large"))
    free = refinement_levels(asset_of(meshes), pixels_of(0.001))
    assert free.notes == ()
    result = refinement_levels(asset_of(meshes), pixels_of(0.001), max_corners=100_000)
    total = sum(len(mesh.corner_points) * 4**level for mesh, level in zip(meshes, result.levels, strict=True))
    assert 25_000 < total <= 100_000
    (note,) = result.notes
    assert "refined less than the size in the frame requires" in note
    assert f"{result.levels[-1]} times instead of {free.levels[-1]}" in note
    assert "/large" in note


def test_a_cage_too_large_to_measure_is_not_refined():
    result = refinement_levels(asset_of([CAGES["cube"]]), pixels_of(0.01), max_corners=90)
    assert result.levels == (0,)
    assert "0 times instead of 1" in result.notes[0]


def test_an_orbits_pixel_is_that_of_the_nearest_place_of_the_camera():
    pixel = orbit_pixel_size((0.0, -10.0, 2.0), (0.0, 0.0), 0.001)
    centers = np.array([[0.0, 0.0, 2.0], [6.0, 8.0, 2.0], [0.0, 4.0, 2.0], [0.0, 0.0, 0.0]])
    radii = np.array([1.0, 1.0, 0.0, 0.0])
    expected = 0.001 * np.array([9.0, 0.0, 6.0, np.hypot(10.0, 2.0)])
    np.testing.assert_allclose(pixel(centers, radii), expected, rtol=1e-12)
    still = orbit_pixel_size((3.0, 4.0, 0.0), (3.0, 4.0), 0.5)
    np.testing.assert_allclose(still(np.zeros((1, 3)), np.zeros(1)), [2.5], rtol=1e-12)
