"""Limit positions and normals against closed forms, and against themselves."""

from dataclasses import replace

import numpy as np
import pytest
from asset_arrays import check_mesh
from cages import CAGES, CUBE, CUBE_FACES, bend, cage, cage_corners, lattice, limits, triangles_of
from scipy.interpolate import BSpline

from lookdev.asset.subdivision import refine

EPS = float(np.finfo(np.float32).eps)


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def rows(*arrays):
    return np.column_stack([np.asarray(array, np.float64).reshape(len(array), -1) for array in arrays])


def test_extraordinary_points_of_a_bent_cube_have_halsteads_normals():
    mesh = cage(bend(CUBE), CUBE_FACES)
    _, children = cage_corners(mesh, refine, 3)
    normals = refine(mesh, 3).normals[children]
    points = mesh.points.astype(np.float64)
    around = {corner: (face, i) for face in range(6) for i, corner in enumerate(range(4 * face, 4 * face + 4))}
    # Appendix A of Halstead et al.: A = 1 + cos t + cos(t/2) sqrt(2 (9 + cos t)) with t = 2 pi / 3.
    angle = 2.0 * np.pi / 3.0
    scale = 1.0 + np.cos(angle) + np.cos(angle / 2.0) * np.sqrt(2.0 * (9.0 + np.cos(angle)))
    for corner, (face, i) in around.items():
        ring = []
        here, at = face, i
        for _ in range(3):
            members = CUBE_FACES[here]
            ring.append((members[(at + 1) % 4], members[(at + 2) % 4]))
            back = members[at - 1]
            here = next(f for f in range(6) if f != here and {members[at], back} <= set(CUBE_FACES[f]))
            at = CUBE_FACES[here].index(members[at])
        edges, faces = points[[e for e, _ in ring]], points[[f for _, f in ring]]
        k = np.arange(3)[:, None]
        tangents = [
            (scale * np.cos(angle * k + shift) * edges).sum(axis=0)
            + ((np.cos(angle * k + shift) + np.cos(angle * (k + 1) + shift)) * faces).sum(axis=0)
            for shift in (0.0, -angle)
        ]
        np.testing.assert_allclose(normals[corner], unit(np.cross(*tangents)), atol=4.0 * EPS)


def grid_cage(heights, triangles=False):
    """Return a grid with these heights, with its parameters u and v as UVs that are refined as points are."""
    points, faces = lattice(*np.array(heights.shape) - 1)
    faces = triangles_of(faces) if triangles else faces
    if triangles:
        # Equilateral triangles.
        points = points @ np.array([[1.0, 0.0, 0.0], [-0.5, np.sqrt(0.75), 0.0], [0.0, 0.0, 1.0]])
    points[:, 2] = heights.ravel()
    uv = points[np.concatenate(faces), :2]
    return cage(points, faces, "loop" if triangles else "catmullClark", uv, interpolation={"st": "vertex"})


def test_a_regular_grid_is_the_bicubic_b_spline_with_its_normals():
    heights = np.random.default_rng(5).normal(size=(9, 8))
    refined = refine(grid_cage(heights), 3)
    u, v = refined.uvs["st"].astype(np.float64).T
    inside = (u > 1.0) & (u < 7.0) & (v > 1.0) & (v < 6.0)
    basis = [BSpline(np.arange(-2, n + 2), np.eye(n), 3) for n in heights.shape]
    value = [np.einsum("ki,ij,kj->k", basis[0](u, du), heights, basis[1](v, dv)) for du, dv in ((0, 0), (1, 0), (0, 1))]
    spline = np.stack([u, v, value[0]], axis=-1)
    normals = unit(np.stack([-value[1], -value[2], np.ones_like(u)], axis=-1))
    assert inside.sum() > 1000
    np.testing.assert_allclose(refined.points[refined.corner_points][inside], spline[inside], atol=16.0 * EPS)
    np.testing.assert_allclose(refined.normals[inside], normals[inside], atol=32.0 * EPS)


def test_a_grid_of_triangles_is_the_box_spline_with_its_normals():
    # The quartic box spline reproduces cubics. With the mask (1/2, 6 times 1/12) of unit edges, x^3 becomes x^3 + 3x/4,
    # x^2 becomes x^2 + 1/4 and y^2 likewise, x y stays.
    points = grid_cage(np.zeros((9, 9)), triangles=True).points.astype(np.float64)
    x, y = points[:, 0], points[:, 1]
    heights = 0.02 * x**3 - 0.1 * x**2 + 0.07 * x * y + 0.05 * y**2 - 0.3 * y
    refined = refine(grid_cage(heights.reshape(9, 9), triangles=True), 3)
    x, y = refined.uvs["st"].astype(np.float64).T
    row = y / np.sqrt(0.75)
    inside = (np.abs(row - 4.0) < 2.5) & (np.abs(x + 0.5 * row - 4.0) < 2.5)
    height = 0.02 * (x**3 + 0.75 * x) - 0.1 * (x**2 + 0.25) + 0.07 * x * y + 0.05 * (y**2 + 0.25) - 0.3 * y
    slope = 0.02 * (3.0 * x**2 + 0.75) - 0.2 * x + 0.07 * y, 0.07 * x + 0.1 * y - 0.3
    normals = unit(np.stack([-slope[0], -slope[1], np.ones_like(x)], axis=-1))
    assert inside.sum() > 1000
    surface = np.stack([x, y, height], axis=-1)
    # Heights to 20: float32 of the cage, and of the result.
    np.testing.assert_allclose(refined.points[refined.corner_points][inside], surface[inside], atol=40.0 * EPS)
    np.testing.assert_allclose(refined.normals[inside], normals[inside], atol=32.0 * EPS)


@pytest.mark.parametrize("level", [1, 2])
@pytest.mark.parametrize("name", CAGES)
def test_limits_are_the_same_at_the_next_level(name, level):
    mesh = CAGES[name]
    (coarse, normals), (fine, later) = limits(mesh, level), limits(mesh, level + 1)
    every = np.arange(len(coarse))
    every = 3 * (every + every // 3) if mesh.subdivision.scheme == "loop" else 4 * every
    np.testing.assert_allclose(coarse, fine[every], atol=1e-14)
    np.testing.assert_allclose(normals, later[every], atol=2.0 * EPS)
    # Few points have no tangent plane.
    assert (normals == 0.0).all(axis=1).mean() < 0.3


@pytest.mark.parametrize("scheme", ["catmullClark", "loop"])
@pytest.mark.parametrize("faces", [3, 4, 5, 7])
def test_a_dart_has_the_limit_and_the_normal_of_the_level_after_next(scheme, faces):
    mesh = fan(faces, scheme, {(0, 1): 10.0})
    (corners, children), (_, later) = cage_corners(mesh, refine, 1), cage_corners(mesh, refine, 3)
    dart = mesh.corner_points[corners] == 0
    coarse, fine = refine(mesh, 1), refine(mesh, 3)
    a, b = coarse.points[coarse.corner_points[children]], fine.points[fine.corner_points[later]]
    np.testing.assert_allclose(a[dart], b[dart], atol=4.0 * EPS)
    np.testing.assert_allclose(coarse.normals[children][dart], fine.normals[later][dart], atol=16.0 * EPS)
    smooth = refine(fan(faces, scheme, {}), 1)
    assert np.abs(smooth.points[smooth.corner_points[children]][dart] - a[dart]).max() > 1e-3


def fan(faces, scheme, creases):
    """Return faces around point 0, and a ring around these."""
    angle = 2.0 * np.pi * np.arange(2 * faces) / (2 * faces)
    rings = [np.stack([r * np.cos(angle), r * np.sin(angle), 0.0 * angle], axis=-1) for r in (1.0, 2.0)]
    points = bend(np.concatenate([[[0.0, 0.0, 0.0]], *rings]), 0.2)
    n = 2 * faces
    inner = [[0, 1 + 2 * i, 2 + 2 * i, 1 + (2 * i + 2) % n] for i in range(faces)]
    outer = [[1 + i, 1 + n + i, 1 + n + (i + 1) % n, 1 + (i + 1) % n] for i in range(n)]
    both = inner + outer
    return cage(points, triangles_of(both) if scheme == "loop" else both, scheme, creases=creases)


def test_normals_are_split_along_an_infinitely_sharp_crease_alone():
    refined = refine(CAGES["sharp ring"], 3)
    corners = rows(refined.corner_points, refined.normals.round(5))
    _, count = np.unique(np.unique(corners, axis=0)[:, 0], return_counts=True)
    # Four edges of the cage, each of 8 edges at level 3.
    assert (count == 2).sum() == 4 * 8
    assert set(count) == {1, 2}


@pytest.mark.parametrize("name", ["cube", "junctions", "loop, soft", "any faces", "bilinear"])
def test_refinement_commutes_with_affine_maps(name):
    mesh = CAGES[name]
    linear, offset = np.array([[1.2, 0.3, -0.1], [0.2, 0.8, 0.4], [-0.3, 0.1, 1.5]]), np.array([3.0, -2.0, 1.0])
    moved = refine(replace(mesh, points=(mesh.points @ linear.T + offset).astype(np.float32)), 2)
    straight = refine(mesh, 2)
    np.testing.assert_allclose(moved.points, straight.points @ linear.T + offset, atol=16.0 * EPS)
    plane = limits(mesh, 2)[1].any(axis=1)
    normals = unit(straight.normals @ np.linalg.inv(linear))
    np.testing.assert_allclose(moved.normals[plane], normals[plane], atol=64.0 * EPS)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e5])
def test_normals_do_not_depend_on_the_unit_of_length(scale):
    mesh = CAGES["junctions"]
    scaled = refine(replace(mesh, points=mesh.points * np.float32(scale)), 2)
    np.testing.assert_allclose(scaled.normals, refine(mesh, 2).normals, atol=64.0 * EPS)


@pytest.mark.parametrize("name", ["cube", "sharp ring", "junctions", "loop, soft"])
def test_a_closed_cage_stays_closed(name):
    refined = refine(CAGES[name], 3)
    corners = refined.corner_points.reshape(-1, int(refined.face_sizes[0]))
    edges = np.stack([corners, np.roll(corners, -1, axis=1)], axis=-1).reshape(-1, 2)
    assert len(np.unique(edges, axis=0)) == len(edges)
    np.testing.assert_array_equal(np.unique(edges, axis=0), np.unique(edges[:, ::-1], axis=0))
    # Euler's formula for a sphere.
    assert len(refined.points) - len(edges) // 2 + len(corners) == 2


def test_bilinear_faces_have_the_normals_of_their_patches():
    refined = refine(cage([[0, 0, 0], [2, 0, 0], [2, 2, 1], [0, 2, 0]], [[0, 1, 2, 3]], "bilinear"), 3)
    x, y, z = refined.points[refined.corner_points].astype(np.float64).T
    np.testing.assert_allclose(z, 0.25 * x * y, atol=2.0 * EPS)
    normals = unit(np.stack([-0.25 * y, -0.25 * x, np.ones_like(x)], axis=-1))
    np.testing.assert_allclose(refined.normals, normals, atol=4.0 * EPS)


@pytest.mark.parametrize("name", ["cube", "any faces", "open", "loop"])
def test_level_0_is_the_cage_with_mean_normals(name):
    mesh = CAGES[name]
    refined = refine(mesh, 0)
    assert refined.subdivision is None
    np.testing.assert_array_equal(refined.points, mesh.points)
    np.testing.assert_array_equal(refined.corner_points, mesh.corner_points)
    starts = np.cumsum(mesh.face_sizes) - mesh.face_sizes
    sums = np.zeros((len(mesh.points), 3))
    for start, size in zip(starts, mesh.face_sizes, strict=True):
        members = mesh.corner_points[start : start + size]
        p = mesh.points[members].astype(np.float64)
        sums[members] += np.cross(p - p[0], np.roll(p, -1, axis=0) - p[0]).sum(axis=0)
    np.testing.assert_allclose(refined.normals, unit(sums)[mesh.corner_points], atol=4.0 * EPS)


@pytest.mark.parametrize("name", CAGES)
@pytest.mark.parametrize("collapse", ["point", "line", "pair"])
def test_degenerate_cages_have_finite_points_and_unit_normals(name, collapse):
    mesh = CAGES[name]
    points = mesh.points.copy()
    if collapse == "pair":
        points[1] = points[0]
    else:
        points[:, 1 if collapse == "line" else 0 :] = 1.0
    for level in range(3):
        check_mesh(refine(replace(mesh, points=points), level))
