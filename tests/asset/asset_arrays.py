"""Invariants of an asset, and arrays that follow from its arrays."""

import numpy as np
from numpy.typing import ArrayLike

from lookdev.arrays import Floats
from lookdev.asset import Asset, Mesh
from lookdev.asset.normals import area_vectors
from lookdev.asset.shape import Attribute, PolygonShape
from lookdev.asset.tangents import tangents_of


def affine(offset: ArrayLike, linear: ArrayLike = 1.0) -> Floats:
    """Return the matrix (4, 4) of a linear part, (3, 3) or a factor, and an offset (3,)."""
    matrix = np.eye(4)
    matrix[:3, :3] = linear if np.ndim(linear) else np.multiply(linear, np.eye(3))
    matrix[:3, 3] = offset
    return matrix


def corners(surface: Mesh | PolygonShape) -> Floats:
    """Return the points at the corners, (m, 3)."""
    numbers = surface.corner_points if isinstance(surface, Mesh) else surface.face_points
    return surface.points[numbers].astype(np.float64)


def face_areas(surface: Mesh | PolygonShape) -> Floats:
    """Return each face's area times its unit normal, (f, 3)."""
    return area_vectors(corners(surface), surface.face_sizes)


def area(surface: Mesh | PolygonShape) -> float:
    return float(np.linalg.norm(face_areas(surface), axis=1).sum())


def volume(surface: Mesh | PolygonShape) -> float:
    """Return the volume inside, positive where faces wind counter-clockwise seen from outside."""
    first = np.cumsum(surface.face_sizes) - surface.face_sizes
    return float((face_areas(surface) * corners(surface)[first]).sum() / 3.0)


def facets(surface: Mesh | PolygonShape) -> Floats:
    """Return the unit normal of each corner's face, (m, 3)."""
    areas = face_areas(surface)
    return np.repeat(areas / np.linalg.norm(areas, axis=1, keepdims=True), surface.face_sizes, axis=0)


def at_corners(shape: PolygonShape, attribute: Attribute) -> Floats:
    """Return the values of an attribute by point or corner, at the corners."""
    return attribute.values if attribute.interpolation == "faceVarying" else attribute.values[shape.face_points]


def corner_st(shape: PolygonShape) -> Floats:
    (st,) = (attribute for attribute in shape.attributes if attribute.name == "st")
    assert st.is_uv
    return at_corners(shape, st)


def world_points(asset: Asset) -> list[Floats]:
    """Return the points of each instance in the world, (n, 3)."""
    return [
        asset.meshes[instance.mesh].points.astype(np.float64) @ instance.matrix[:3, :3].T + instance.matrix[:3, 3]
        for instance in asset.instances
    ]


def check_mesh(mesh: Mesh) -> None:
    """Assert the invariants that `lookdev.asset.mesh` states of a mesh alone."""
    corners = int(mesh.face_sizes.sum())
    (tangents,) = tangents_of([mesh])
    for array in (mesh.points, mesh.normals, tangents, *mesh.uvs.values(), *mesh.primvars.values()):
        assert array.dtype == np.float32
        assert np.isfinite(array).all()
    for array in (mesh.corner_points, mesh.face_sizes, mesh.face_slots):
        assert array.dtype == np.int32
    assert mesh.face_sizes.min() >= 3
    assert mesh.corner_points.shape == (corners,)
    assert 0 <= mesh.corner_points.min() <= mesh.corner_points.max() < len(mesh.points)
    assert mesh.face_slots.shape == mesh.face_sizes.shape
    assert mesh.normals.shape == tangents.shape == (corners, 3)
    assert all(uv.shape == (corners, 2) for uv in mesh.uvs.values())
    assert mesh.default_uv in ("", *mesh.uvs)
    if (rules := mesh.subdivision) is not None:
        assert rules.crease_edges.shape == (*rules.crease_sharpness.shape, 2)
        assert rules.corner_points.shape == rules.corner_sharpness.shape
        for numbers, count in ((rules.crease_edges, len(mesh.points)), (rules.holes, len(mesh.face_sizes))):
            assert numbers.dtype == np.int32
            assert ((numbers >= 0) & (numbers < count)).all()
        assert rules.interpolation.keys() == mesh.uvs.keys() | mesh.primvars.keys()
    # Three products of float32 unit components: a few rounding errors of 6e-8.
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1.0, atol=5e-7)
    np.testing.assert_allclose(np.linalg.norm(tangents, axis=1), 1.0, atol=5e-7)
    np.testing.assert_allclose((mesh.normals * tangents).sum(axis=1), 0.0, atol=5e-7)


def check_asset(asset: Asset) -> None:
    """Assert the invariants that `lookdev.asset.mesh` states."""
    for mesh in asset.meshes:
        check_mesh(mesh)
        assert 0 <= mesh.face_slots.min() <= mesh.face_slots.max() < len(asset.slots)
    for instance, placed in zip(asset.instances, world_points(asset), strict=True):
        points = placed[asset.meshes[instance.mesh].corner_points]
        # In float64 from float32 points: the sum of squares rounds in the last digits.
        assert np.linalg.norm(points - asset.center, axis=1).max() <= asset.radius * (1.0 + 1e-12)
    assert len(asset.digest) == 64
