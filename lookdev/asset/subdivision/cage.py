"""Builds the half-edges of a control cage from its tags: creases, corners and holes.

A tag is the sharpness of an edge (crease) or of a point (corner), or it marks a face that is not part of the surface
(hole).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lookdev.arrays import Bools, Floats, Indices
from lookdev.asset.mesh import Interpolation, Mesh, Subdivision
from lookdev.asset.subdivision.topology import HalfEdges, connect
from lookdev.errors import AssetError

INFINITE_SHARPNESS = 10.0
"""The least sharpness that counts as infinite, as in OpenSubdiv and USD."""


@dataclass(frozen=True, eq=False)
class Cage:
    """The half-edges of a cage, with their sharpness.

    `is_manifold` (n,) marks its manifold points (`Connectivity`). `is_hidden` (f,) marks faces that are not part of the
    surface.
    """

    half_edges: HalfEdges
    is_manifold: Bools
    is_hidden: Bools


@dataclass(frozen=True, eq=False)
class Tags:
    """The tags of a cage, as in `lookdev.asset.mesh.Subdivision`, but infinite sharpness is infinity.

    - crease_edges (e, 2), crease_sharpness (e,): pairs of points, and the sharpness of the edge between them
    - corner_points (c,), corner_sharpness (c,): points, and their sharpness
    - holes (h,): faces
    """

    crease_edges: Indices
    crease_sharpness: Floats
    corner_points: Indices
    corner_sharpness: Floats
    holes: Indices


@dataclass(frozen=True, eq=False)
class ControlMesh:
    """A cage, or several cages joined to one, before its half-edges are known.

    - points (n, 3): positions
    - corners (m,): the point at each corner of the faces
    - sizes (f,): the number of corners of each face
    - tags: creases, corners and holes
    - values: for each UV set and primvar, its interpolation and its values (m, k) at the corners
    """

    points: Floats
    corners: Indices
    sizes: Indices
    tags: Tags
    values: list[tuple[Interpolation, Floats]]


def read_tags(mesh: Mesh) -> Tags:
    """Return the tags of a cage.

    Raises
    ------
    AssetError
        A tag refers to a point or face that does not exist, or has no sharpness; or the cage has no face, or has the
        scheme loop and a face that is not a triangle.
    """
    rules = mesh.subdivision
    assert rules is not None, "a mesh without subdivision has no tags"
    if len(mesh.face_sizes) == 0:
        raise AssetError(f"{mesh.name}: the cage of a subdivision surface has no face; it needs one")
    edges = np.asarray(rules.crease_edges, np.intp).reshape(-1, 2)
    corners, holes = np.asarray(rules.corner_points, np.intp), np.asarray(rules.holes, np.intp)
    if rules.scheme == "loop" and len(wrong := np.flatnonzero(mesh.face_sizes != 3)):
        raise AssetError(
            f"{mesh.name}: face {wrong[0]} has {mesh.face_sizes[wrong[0]]} corners; subdivision scheme 'loop' "
            "refines triangles only (catmullClark takes any face)"
        )
    for tag, indices, count, noun in (
        ("a crease", edges, len(mesh.points), "points"),
        ("a corner", corners, len(mesh.points), "points"),
        ("a hole", holes, len(mesh.face_sizes), "faces"),
    ):
        outside = indices[(indices < 0) | (indices >= count)]
        if len(outside):
            raise AssetError(f"{mesh.name}: {tag} has index {outside[0]}, but there are {count} {noun}")
    return Tags(
        edges,
        _sharpness(mesh, "crease", rules.crease_sharpness, len(edges)),
        corners,
        _sharpness(mesh, "corner", rules.corner_sharpness, len(corners)),
        holes,
    )


def _sharpness(mesh: Mesh, tag: str, values: object, count: int) -> Floats:
    """Return the sharpness (count,) of creases or corners: at least 0; `INFINITE_SHARPNESS` and more are infinity."""
    sharpness = np.asarray(values, np.float64)
    if sharpness.shape != (count,):
        raise AssetError(f"{mesh.name}: {count} {tag}s have {sharpness.size} values of sharpness; each needs one")
    if np.isnan(sharpness).any():
        raise AssetError(f"{mesh.name}: the sharpness of {tag} {int(np.isnan(sharpness).argmax())} is not a number")
    return np.where(sharpness >= INFINITE_SHARPNESS, np.inf, np.maximum(sharpness, 0.0))


def build_cage(control: ControlMesh, rules: Subdivision) -> Cage:
    """Return the half-edges of a cage, with the tags of `control` and the boundary rule of `rules`.

    The tags of `rules` are not used. Tags are applied in the order of OpenSubdiv (Far::TopologyRefinerFactory). A
    crease between points that share no edge has no effect. Boundaries become infinitely sharp, and so do edges and
    points that are not manifold. An exception is a point at which exactly two edges have three or more faces: it stays
    smooth along these edges. With the boundary rule `none`, a face is not part of the surface if one of its points is
    an end of a boundary edge that is not an infinitely sharp crease.
    """
    count, tags, boundary = len(control.points), control.tags, rules.interpolate_boundary
    level, connectivity = connect(control.corners, control.sizes, count)
    manifold = connectivity.fan_counts <= 1
    manifold[level.ends[connectivity.is_nonmanifold_edge]] = False
    crease_sharpness = np.zeros(len(level.ends))
    crease_edges = _find_edges(level, tags.crease_edges)
    crease_sharpness[crease_edges[crease_edges >= 0]] = tags.crease_sharpness[crease_edges >= 0]
    np.maximum(level.edge_sharpness, crease_sharpness, out=level.edge_sharpness)
    level.point_sharpness[tags.corner_points] = tags.corner_sharpness

    face_counts = np.bincount(control.corners, minlength=count)
    edge_counts = np.bincount(level.ends.ravel(), minlength=count)
    nonmanifold_edges = np.bincount(level.ends[connectivity.is_nonmanifold_edge].ravel(), minlength=count)
    boundary_edges = np.bincount(level.ends[level.boundary].ravel(), minlength=count)
    # At a fin, exactly two of a point's edges are not manifold: they have three or more faces. The point stays smooth.
    is_fin = (nonmanifold_edges == 2) & (boundary_edges == 0) & (face_counts > edge_counts)
    level.point_sharpness[~manifold & ~is_fin] = np.inf
    # A corner point of the boundary has one face and two edges.
    if boundary == "edgeAndCorner":
        level.point_sharpness[(face_counts == 1) & (edge_counts == 2)] = np.inf

    hidden = np.zeros(len(control.sizes), bool)
    if boundary == "none" and rules.scheme != "bilinear":
        has_uncreased_boundary = np.zeros(count, bool)
        has_uncreased_boundary[level.ends[level.boundary & np.isfinite(crease_sharpness)]] = True
        hidden[level.faces[has_uncreased_boundary[control.corners]]] = True
    hidden[tags.holes] = True
    return Cage(level, manifold, hidden)


def _find_edges(level: HalfEdges, pairs: Indices) -> Indices:
    """Return the edge (k,) between each pair of points (k, 2), or -1 if there is none."""
    count = len(level.point_sharpness)
    # An edge has the key low * count + high of its points' numbers.
    keys = np.sort(level.ends, axis=1) @ np.array([count, 1])
    pair_keys = np.sort(pairs, axis=1) @ np.array([count, 1])
    order = np.argsort(keys)
    position = np.minimum(np.searchsorted(keys, pair_keys, sorter=order), len(keys) - 1)
    return np.where(keys[order[position]] == pair_keys, order[position], -1)
