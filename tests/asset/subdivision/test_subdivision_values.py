"""Values that vary over a cage, and what the faces of a cage hand on to their children."""

from dataclasses import replace

import numpy as np
import pytest
from cages import CAGES, bend, cage, chart, lattice, with_rules

from lookdev.asset.subdivision import refine
from lookdev.asset.tangents import tangents_of

EPS = float(np.finfo(np.float32).eps)


def with_primvar(mesh, values, interpolation):
    values = np.asarray(values, np.float32)
    return with_rules(replace(mesh, primvars={"value": values}), interpolation={"value": interpolation})


@pytest.mark.parametrize("level", [0, 1, 3])
@pytest.mark.parametrize("name", ["cube", "any faces", "loop, open", "bilinear"])
def test_faces_keep_their_slots_and_their_uniform_and_constant_values(name, level):
    mesh = CAGES[name]
    faces = np.arange(len(mesh.face_sizes))
    per_face = np.repeat(faces, mesh.face_sizes)
    values = {"own": per_face.astype(np.float32), "same": np.full((len(per_face), 3), 7.0, "f4")}
    marked = replace(mesh, primvars=values)
    refined = refine(with_rules(marked, interpolation={"own": "uniform", "same": "constant"}), level)
    slots = np.repeat(refined.face_slots, refined.face_sizes)
    np.testing.assert_array_equal(refined.primvars["own"], mesh.face_slots[slots])
    assert (refined.primvars["same"] == 7.0).all()
    assert refined.primvars["same"].shape == (len(refined.corner_points), 3)
    assert set(refined.face_slots) == set(mesh.face_slots)
    children = mesh.face_sizes if mesh.subdivision.scheme != "loop" else np.full(len(faces), 4)
    expected = children * 4 ** (level - 1) if level else np.ones(len(faces))
    np.testing.assert_array_equal(np.bincount(refined.face_slots), expected)


@pytest.mark.parametrize("name", ["cube", "junctions", "any faces", "loop, soft", "open, edgeOnly", "fins", "bilinear"])
def test_a_vertex_value_is_refined_as_positions_are(name):
    mesh = CAGES[name]
    refined = refine(with_primvar(mesh, mesh.points[mesh.corner_points], "vertex"), 2)
    np.testing.assert_allclose(refined.primvars["value"], refined.points[refined.corner_points], atol=2.0 * EPS)


@pytest.mark.parametrize("interpolation", ["varying", "vertex", "faceVarying"])
def test_a_value_that_is_bilinear_is_the_mean_at_the_middle_of_edges_and_faces(interpolation):
    # vertex and faceVarying with the rule `all` or the scheme `bilinear`, too.
    points, faces = lattice(2, 2)
    scheme = "bilinear" if interpolation == "vertex" else "catmullClark"
    rule = "all" if interpolation == "faceVarying" else "cornersPlus1"
    at_points = np.sin(3.0 * np.arange(9)).astype(np.float32)
    mesh = cage(bend(points), faces, scheme, face_varying=rule)
    refined = refine(with_primvar(mesh, at_points[mesh.corner_points], interpolation), 1).primvars["value"]
    a, b, c, d = (at_points[[face[i] for face in faces]] for i in range(4))
    first = refined.reshape(4, 4, 4)[:, 0].T
    np.testing.assert_allclose(first, [a, (a + b) / 2.0, (a + b + c + d) / 4.0, (a + d) / 2.0], atol=2.0 * EPS)


def test_face_varying_values_without_a_seam_are_those_of_points():
    mesh = CAGES["cube"]
    values = mesh.points[mesh.corner_points]
    vertex = refine(with_primvar(mesh, values, "vertex"), 2).primvars["value"]
    np.testing.assert_array_equal(refine(with_primvar(mesh, values, "faceVarying"), 2).primvars["value"], vertex)


def test_a_name_without_interpolation_is_face_varying():
    mesh = CAGES["seams, cornersPlus1"]
    explicit = with_rules(mesh, interpolation={"st": "faceVarying"})
    np.testing.assert_array_equal(refine(mesh, 2).uvs["st"], refine(explicit, 2).uvs["st"])


def test_uv_sets_are_refined_apart_and_keep_their_names_and_their_order():
    mesh = CAGES["seams, cornersOnly"]
    other = np.asarray(chart(mesh.points, lattice(4, 4)[1], [0] * 8 + [1] * 8), np.float32)
    both = refine(replace(mesh, uvs={"second": other, "st": mesh.uvs["st"]}), 2)
    assert list(both.uvs) == ["second", "st"]
    np.testing.assert_array_equal(both.uvs["st"], refine(mesh, 2).uvs["st"])
    np.testing.assert_array_equal(both.uvs["second"], refine(replace(mesh, uvs={"st": other}), 2).uvs["st"])


def test_tangents_follow_u():
    refined = refine(CAGES["seams, cornersPlus1"], 3)
    points, uv = refined.points[refined.corner_points].reshape(-1, 4, 3), refined.uvs["st"].reshape(-1, 4, 2)
    along = np.sum(uv[:, 1] - uv[:, 0], axis=0)
    assert np.isfinite(along).all()
    edges, steps = points[:, [1, 3]] - points[:, :1], uv[:, [1, 3]] - uv[:, :1]
    across = np.einsum("fji,fjk->fik", edges, np.linalg.inv(steps).transpose(0, 2, 1))[:, :, 0]
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    dots = (np.repeat(across, 4, axis=0) * tangents_of([refined])[0]).sum(axis=1)
    assert np.median(dots) > 0.999
