from __future__ import annotations

import numpy as np
import pytest
from shapes import Plane, Sphere

from lookdev.asset import load_asset
from lookdev.asset.tangents import tangents_of

SHAPES = {"plane": Plane(), "sphere": Sphere()}


@pytest.fixture
def rng():
    return np.random.default_rng(11)


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


@pytest.mark.parametrize("name", SHAPES)
def test_it_has_the_frames_of_the_asset_of_its_name(name):
    (mesh,) = load_asset(builtin=name).meshes
    # Corners of quads: where three meet, at a pole, a corner has the u of its triangle's middle.
    corners = np.flatnonzero(np.repeat(mesh.face_sizes == 4, mesh.face_sizes))[::97]
    points = mesh.points[mesh.corner_points[corners]].astype(np.float64)
    normals = mesh.normals[corners].astype(np.float64)
    frames, _ = SHAPES[name].frame(points, normals)
    # float32 in the mesh; beside a pole its rounding turns the tangent the more.
    np.testing.assert_allclose(frames[:, 2], normals, atol=2e-7)
    np.testing.assert_allclose(frames[:, 0], tangents_of([mesh])[0][corners], atol=2e-5)
    np.testing.assert_allclose(np.cross(frames[:, 0], frames[:, 1]), frames[:, 2], atol=1e-12)
    behind, _ = SHAPES[name].frame(points, -normals)
    # Not to the bit: NumPy adds up in an order that depends on where an array lies in memory.
    np.testing.assert_allclose(behind, -frames, atol=1e-14)


def test_hits_of_a_sphere_satisfy_its_equation(rng):
    sphere = Sphere((1.0, -2.0, 0.5), 0.7)
    origin = np.array([4.0, 3.0, 2.0])
    ray = unit(np.array(sphere.center) - origin + rng.uniform(-1.0, 1.0, (500, 3)))
    hit, point = sphere.hit(origin, ray)
    assert 100 < hit.sum() < 400
    out = (point - sphere.center)[hit]
    np.testing.assert_allclose(np.linalg.norm(out, axis=1), 0.7, rtol=1e-12)
    assert (np.einsum("ni,ni->n", out, ray[hit]) < 0.0).all()  # the nearer side
    nearest = np.linalg.norm(np.cross(np.array(sphere.center) - origin, ray), axis=1)
    np.testing.assert_array_equal(hit, nearest < 0.7)
    assert not sphere.hit(origin, -ray)[0].any()


def test_a_ray_through_a_sphere_meets_the_far_wall_and_one_that_leaves_meets_nothing(rng):
    sphere = Sphere((1.0, -2.0, 0.5), 0.7)
    normal, direction = unit(rng.normal(size=(2, 500, 3)))
    point = sphere.center + 0.7 * normal
    inward = np.einsum("ni,ni->n", normal, direction) < 0.0
    blocked, far = sphere.onward(point, direction)
    np.testing.assert_array_equal(blocked, inward)
    along = far[inward] - point[inward]
    np.testing.assert_allclose(np.linalg.norm(far[inward] - sphere.center, axis=1), 0.7, rtol=1e-12)
    np.testing.assert_allclose(unit(along), direction[inward], atol=1e-9)
    assert sphere.onward(far[inward], -direction[inward])[0].all()
    assert not sphere.onward(far[inward], direction[inward])[0].any()


def test_a_card_is_hit_inside_its_border_from_either_side(rng):
    target = np.stack([rng.uniform(-1.5, 1.5, 500), np.zeros(500), rng.uniform(-1.5, 1.5, 500)], axis=-1)
    inside = np.abs(target).max(axis=1) < 1.0
    for origin in (np.array([0.3, -4.0, 1.0]), np.array([0.3, 4.0, 1.0])):
        ray = unit(target - origin)
        hit, point = Plane().hit(origin, ray)
        np.testing.assert_array_equal(hit, inside)
        np.testing.assert_allclose(point[hit], target[hit], atol=1e-12)
        assert not Plane().hit(origin, -ray)[0].any()
        assert not Plane().hit(origin, ray * [1.0, 0.0, 1.0])[0].any()
        assert not Plane().onward(point[hit], ray[hit])[0].any()
