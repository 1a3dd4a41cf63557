"""Defines the half-edges of a control cage and of each level of its refinement, and splits faces.

A half-edge runs from a corner of a face to the face's next corner, and has the number of the corner where it starts.
Its twin is the half-edge of the neighbouring face along the same edge. A half-edge has no twin if its edge has no other
face, or more than one.

Level 0 is the cage, and each refinement makes the next level. In the code, `level` is the half-edges of a level.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np

from lookdev.arrays import Bools, Floats, Indices
from lookdev.asset.normals import next_corners, run_starts

_Array = TypeVar("_Array", Floats, Indices)


@dataclass(frozen=True, eq=False)
class HalfEdges:
    """The f faces, m half-edges, e edges and n points of one level of refinement.

    - sizes (f,): the number of corners of each face
    - points (m,): the point at which each half-edge starts
    - edges (m,): the edge of each half-edge
    - twins (m,): the twin of each half-edge, -1 if it has none
    - ends (e, 2): the two points of each edge
    - edge_sharpness (e,), point_sharpness (n,): 0 means smooth; the sharpness is infinite at boundaries and where the
      surface is not manifold
    """

    sizes: Indices
    points: Indices
    edges: Indices
    twins: Indices
    ends: Indices
    edge_sharpness: Floats
    point_sharpness: Floats

    @cached_property
    def next(self) -> Indices:
        """The next half-edge (m,) around the face."""
        return next_corners(self.sizes)

    @cached_property
    def previous(self) -> Indices:
        """The previous half-edge (m,) around the face."""
        previous = np.empty_like(self.next)
        previous[self.next] = np.arange(len(previous))
        return previous

    @cached_property
    def faces(self) -> Indices:
        """The face (m,) of each half-edge."""
        return np.repeat(np.arange(len(self.sizes)), self.sizes)

    @cached_property
    def boundary(self) -> Bools:
        """Whether each edge (e,) has exactly one face."""
        return np.asarray(np.bincount(self.edges, minlength=len(self.ends)) == 1)

    def sharp_edges(self, above: float) -> Indices:
        """Return the number of edges sharper than `above` at each point (n,)."""
        return np.bincount(self.ends[self.edge_sharpness > above].ravel(), minlength=len(self.point_sharpness))

    def extract(self, faces: Bools) -> tuple[HalfEdges, Indices, Indices]:
        """Return the half-edges of only the marked faces (f,), and the indices in `self` of their corners and points.

        Edges that are shared with faces that are not marked become infinitely sharp.
        """
        corners = np.flatnonzero(faces[self.faces])
        old_points, points = np.unique(self.points[corners], return_inverse=True)
        old_edges, edges = np.unique(self.edges[corners], return_inverse=True)
        # The new number of each half-edge, or -1; the last entry is for half-edges without a twin, whose twin is -1.
        inside = np.full(len(self.points) + 1, -1)
        inside[corners] = np.arange(len(corners))
        twins = inside[self.twins[corners]]
        sharpness = self.edge_sharpness[old_edges]
        sharpness[edges[twins < 0]] = np.inf
        renumbered = np.searchsorted(old_points, self.ends[old_edges])
        level = HalfEdges(
            self.sizes[faces], points, edges, twins, renumbered, sharpness, self.point_sharpness[old_points]
        )
        return level, corners, old_points


@dataclass(frozen=True, eq=False)
class Connectivity:
    """The edges of a cage that are not manifold, and the fans of faces around its points.

    - is_nonmanifold_edge (e,): whether an edge has more than two faces, occurs twice in one face, or joins two faces of
      opposite winding
    - fan_counts (n,): the number of fans around each point; a fan is a set of faces around a point that are connected
      by twins

    A manifold point has one fan, and all its edges are manifold.
    """

    is_nonmanifold_edge: Bools
    fan_counts: Indices


def connect(points: Indices, sizes: Indices, count: int) -> tuple[HalfEdges, Connectivity]:
    """Return the half-edges of faces, and their connectivity.

    `points` (m,) is the point at each corner, a number below `count`, and `sizes` (f,) is the number of corners of each
    face. Boundary edges and edges that are not manifold are infinitely sharp; all else is smooth.
    """
    following = next_corners(sizes)
    low, high = np.minimum(points, points[following]), np.maximum(points, points[following])
    _, first, edges = np.unique(low * count + high, return_index=True, return_inverse=True)
    use_counts = np.bincount(edges)
    order = np.argsort(edges, kind="stable")
    start = np.cumsum(use_counts) - use_counts
    shared_edges = np.flatnonzero(use_counts == 2)
    a, b = order[start[shared_edges]], order[start[shared_edges] + 1]
    faces = np.repeat(np.arange(len(sizes)), sizes)
    # Edges are found by their two points, regardless of direction. Two faces of equal winding traverse their edge in
    # opposite directions. An edge from a point to itself has no direction.
    is_paired = (points[a] != points[b]) & (faces[a] != faces[b])
    twins = np.full(len(points), -1)
    twins[a[is_paired]], twins[b[is_paired]] = b[is_paired], a[is_paired]
    is_nonmanifold = use_counts != 1
    is_nonmanifold[shared_edges[is_paired]] = False
    is_nonmanifold |= low[first] == high[first]
    level = HalfEdges(
        sizes=sizes,
        points=points,
        edges=edges,
        twins=twins,
        ends=np.stack([points[first], points[following[first]]], axis=-1),
        edge_sharpness=np.where(is_nonmanifold | (use_counts == 1), np.inf, 0.0),
        point_sharpness=np.zeros(count),
    )
    return level, Connectivity(is_nonmanifold, _fan_counts(level))


def _fan_counts(level: HalfEdges) -> Indices:
    """Return the number of fans (n,) around each point, from the connected components of half-edges."""
    # These imports take half of a program's start-up time, and few files need them.
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    count = len(level.points)
    neighbours = level.twins[level.previous]
    paired = np.flatnonzero(neighbours >= 0)
    graph = coo_array((np.ones(len(paired), np.int8), (paired, neighbours[paired])), shape=(count, count))
    fans, member = connected_components(graph, directed=False)
    fan_points = np.empty(fans, np.intp)
    fan_points[member] = level.points
    return np.bincount(fan_points, minlength=len(level.point_sharpness))


def split_faces(level: HalfEdges, triangles: bool) -> HalfEdges:
    """Return the next level: each face becomes quads, one for each corner, or with `triangles`, four triangles.

    The points of the next level are the points of this level, then a point for each edge and, unless `triangles`, a
    point for each face. A new face is called a child. The child at corner c starts at the point of c, with the
    half-edge that `first_child` returns for c. The fourth triangle is in the middle. Sharpness falls by one ("uniform"
    creasing, DeRose et al. 1998, section 3).
    """
    edge_count, count = len(level.ends), len(level.point_sharpness)
    corners = np.arange(len(level.points))
    child = first_child(corners, triangles)
    edge_points = count + np.arange(edge_count)
    # Edge i is split into the new edges 2 i and 2 i + 1, at its first and its second end. Two new edges meet at each
    # corner: the leading half is a half of the corner's own half-edge, and the trailing half is a half of the previous
    # half-edge.
    is_reversed = level.ends[level.edges, 0] != level.points
    leading_halves, trailing_halves = 2 * level.edges + is_reversed, (2 * level.edges + ~is_reversed)[level.previous]
    # Each half-edge has a new inner edge, from its edge's new point to the face's point or, for triangles, to the new
    # point of the previous edge.
    inner_edges = 2 * edge_count + corners
    before = level.previous
    previous_twins = level.twins[before]
    # The twins of a child's first and last half-edge, which lie on edges of the old face.
    leading_twins = np.where(level.twins < 0, -1, child[level.next[level.twins]] + (2 if triangles else 3))
    trailing_twins = np.where(previous_twins < 0, -1, child[previous_twins])
    next_edge_points = edge_points[level.edges]
    edge_ends = np.stack([level.ends, np.broadcast_to(edge_points[:, None], level.ends.shape)], axis=-1).reshape(-1, 2)
    if triangles:
        # For each corner, the half-edge of the middle triangle that starts at the new point of the corner's edge.
        middle = child[3 * (corners // 3)] + 9 + corners % 3
        points = _interleave([level.points, next_edge_points, next_edge_points[before]], next_edge_points)
        edges = _interleave([leading_halves, inner_edges, trailing_halves], inner_edges[level.next])
        twins = _interleave([leading_twins, middle[before], trailing_twins], child[level.next] + 1)
        inner_ends = np.stack([next_edge_points, next_edge_points[before]], axis=-1)
        sizes, new_points = np.full(len(points) // 3, 3), edge_count
    else:
        face_points = count + edge_count + level.faces
        points = np.stack([level.points, next_edge_points, face_points, next_edge_points[before]], axis=-1).ravel()
        edges = np.stack([leading_halves, inner_edges, inner_edges[before], trailing_halves], axis=-1).ravel()
        twins = np.stack([leading_twins, child[level.next] + 2, child[before] + 1, trailing_twins], axis=-1).ravel()
        inner_ends = np.stack([next_edge_points, face_points], axis=-1)
        sizes, new_points = np.full(len(corners), 4), edge_count + len(level.sizes)
    halves = np.repeat(next_sharpness(level.edge_sharpness), 2)
    return HalfEdges(
        sizes=sizes,
        points=points,
        edges=edges,
        twins=twins,
        ends=np.concatenate([edge_ends, inner_ends]),
        edge_sharpness=np.concatenate([halves, np.zeros(len(corners))]),
        point_sharpness=np.concatenate([next_sharpness(level.point_sharpness), np.zeros(new_points)]),
    )


def first_child(corners: Indices, triangles: bool) -> Indices:
    """Return the first half-edge (k,), at the next level, of the child at each of the corners (k,)."""
    return 3 * (corners + corners // 3) if triangles else 4 * corners


def parent_faces(level: HalfEdges, triangles: bool) -> Indices:
    """Return, for each face of the next level, the face of `level` from which it comes."""
    return np.repeat(np.arange(len(level.sizes)), 4) if triangles else level.faces


def split_corners(level: HalfEdges, values: Floats, triangles: bool) -> Floats:
    """Return values (m', k) at the corners of the next level, bilinear over each face, from (m, k) at corners."""
    before = level.previous
    middles = 0.5 * (values + values[level.next])
    if triangles:
        return _interleave([values, middles, middles[before]], middles)
    means = np.add.reduceat(values, run_starts(level.sizes), axis=0) / level.sizes[:, None]
    stacked = np.stack([values, middles, means[level.faces], middles[before]], axis=1)
    return np.asarray(stacked.reshape(-1, *values.shape[1:]))


def next_sharpness(sharpness: Floats) -> Floats:
    """Return the sharpness of edges or points at the next level: less by 1, but at least 0."""
    return np.maximum(sharpness - 1.0, 0.0)


def _interleave(outer: list[_Array], middle: _Array) -> _Array:
    """Return values at the corners of the next level's triangles, four for each old triangle.

    `outer` has three arrays: the values at the first, second and third corner of the child at each old corner, (m,) or
    (m, k). `middle` has the values at the corners of the middle triangles.
    """
    three = np.stack(outer, axis=1).reshape(-1, 9, *middle.shape[1:])
    four = np.concatenate([three, middle.reshape(-1, 3, *middle.shape[1:])], axis=1)
    return np.asarray(four.reshape(-1, *middle.shape[1:]))
