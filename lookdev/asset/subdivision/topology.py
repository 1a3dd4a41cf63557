"""Half-edges of a control cage and of each level of its refinement.

A half-edge runs from a corner of a face to the face's next corner, and has the number of that corner. Its twin is the
half-edge of the neighbouring face; where an edge has no face, or more than one, on its other side, there is none.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lookdev.asset.normals import face_starts, next_corners

Doubles = NDArray[np.float64]
Index = NDArray[np.intp]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Level:
    """Faces, half-edges and sharpness of one level.

    sizes (f,) corners of each face; points (m,) and edges (m,) of each half-edge: where it starts, what it lies on;
    twins (m,), -1 where there is none; ends (e, 2) points of each edge; edge_sharpness (e,), point_sharpness (n,):
    0 smooth, infinite at boundaries and where the surface is not manifold.
    """

    sizes: Index
    points: Index
    edges: Index
    twins: Index
    ends: Index
    edge_sharpness: Doubles
    point_sharpness: Doubles

    @cached_property
    def next(self) -> Index:
        """The half-edge (m,) that follows each one around its face."""
        return next_corners(self.sizes)

    @cached_property
    def previous(self) -> Index:
        """The half-edge (m,) before each one around its face."""
        previous = np.empty_like(self.next)
        previous[self.next] = np.arange(len(previous))
        return previous

    @cached_property
    def faces(self) -> Index:
        """The face (m,) of each half-edge."""
        return np.repeat(np.arange(len(self.sizes)), self.sizes)

    @cached_property
    def boundary(self) -> Flags:
        """Whether each edge (e,) has one face."""
        return np.asarray(np.bincount(self.edges, minlength=len(self.ends)) == 1)

    def sharp_edges(self, above: float) -> Index:
        """Return how many edges sharper than `above` meet at each point (n,)."""
        return np.bincount(self.ends[self.edge_sharpness > above].ravel(), minlength=len(self.point_sharpness))

    def part(self, faces: Flags) -> tuple[Level, Index, Index]:
        """Return the marked faces (f,) alone, and which corners and points of the whole are theirs.

        Edges at which they are cut off are infinitely sharp.
        """
        corners = np.flatnonzero(faces[self.faces])
        old_points, points = np.unique(self.points[corners], return_inverse=True)
        old_edges, edges = np.unique(self.edges[corners], return_inverse=True)
        inside = np.full(len(self.points) + 1, -1)
        inside[corners] = np.arange(len(corners))
        twins = inside[self.twins[corners]]
        sharpness = self.edge_sharpness[old_edges]
        sharpness[edges[twins < 0]] = np.inf
        renumbered = np.searchsorted(old_points, self.ends[old_edges])
        level = Level(self.sizes[faces], points, edges, twins, renumbered, sharpness, self.point_sharpness[old_points])
        return level, corners, old_points


@dataclass(frozen=True, eq=False)
class Joints:
    """How the faces of a cage hang together: the twisted edges (e,), and around how many fans (n,) each point's lie.

    A manifold point has one fan, an edge between more than two faces, twice in one, or between two of opposite winding
    is not manifold.
    """

    twisted: Flags
    fans: Index

    def manifold(self, ends: Index) -> Flags:
        """Return which points (n,) have one fan and no twisted edge."""
        manifold = self.fans <= 1
        manifold[ends[self.twisted]] = False
        return manifold


def connect(points: Index, sizes: Index, count: int) -> tuple[Level, Joints]:
    """Return the half-edges of faces given by their points (m,) < `count` and sizes (f,), smooth up to topology.

    Boundary edges and edges that are not manifold are infinitely sharp; no point is sharp.
    """
    following = next_corners(sizes)
    low, high = np.minimum(points, points[following]), np.maximum(points, points[following])
    _, first, edges = np.unique(low * count + high, return_index=True, return_inverse=True)
    uses = np.bincount(edges)
    order = np.argsort(edges, kind="stable")
    start = np.cumsum(uses) - uses
    double = np.flatnonzero(uses == 2)
    a, b = order[start[double]], order[start[double] + 1]
    faces = np.repeat(np.arange(len(sizes)), sizes)
    # Two faces of one winding run through their edge in opposite directions; an edge of no length has no direction.
    proper = (points[a] != points[b]) & (faces[a] != faces[b])
    twins = np.full(len(points), -1)
    twins[a[proper]], twins[b[proper]] = b[proper], a[proper]
    twisted = uses != 1
    twisted[double[proper]] = False
    twisted |= low[first] == high[first]
    level = Level(
        sizes=sizes,
        points=points,
        edges=edges,
        twins=twins,
        ends=np.stack([points[first], points[following[first]]], axis=-1),
        edge_sharpness=np.where(twisted | (uses == 1), np.inf, 0.0),
        point_sharpness=np.zeros(count),
    )
    return level, Joints(twisted, _fans(level))


def _fans(level: Level) -> Index:
    """Return the number of fans (n,) around each point: sets of faces joined by twins at the point."""
    # Half the time that a program takes to start, for few files.
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    count = len(level.points)
    beside = level.twins[level.previous]
    joined = np.flatnonzero(beside >= 0)
    graph = coo_array((np.ones(len(joined), np.int8), (joined, beside[joined])), shape=(count, count))
    fans, member = connected_components(graph, directed=False)
    of_point = np.empty(fans, np.intp)
    of_point[member] = level.points
    return np.bincount(of_point, minlength=len(level.point_sharpness))


def split(level: Level, triangles: bool) -> Level:
    """Return the next level: each face becomes quads, one at a corner, or each triangle four triangles.

    Points are those of the points, of the edges and, unless `triangles`, of the faces, in this order. The child at
    corner c starts with half-edge `first_child` of c, at the point of c; of triangles, the fourth is in the middle.
    Sharpness falls by one ("uniform" creasing, DeRose et al. 1998, section 3).
    """
    edge_count, count = len(level.ends), len(level.point_sharpness)
    corners = np.arange(len(level.points))
    child = first_child(corners, triangles)
    of_edge = count + np.arange(edge_count)
    # The half of each edge on the side of its half-edge's start, and of its end.
    reversed_ = level.ends[level.edges, 0] != level.points
    out, back = 2 * level.edges + reversed_, (2 * level.edges + ~reversed_)[level.previous]
    inner = 2 * edge_count + corners
    before = level.previous
    across = level.twins[before]
    # The twins of a child's half-edges along the parent's edges.
    beyond = np.where(level.twins < 0, -1, child[level.next[level.twins]] + (2 if triangles else 3))
    behind = np.where(across < 0, -1, child[across])
    ahead = of_edge[level.edges]
    edge_ends = np.stack([level.ends, np.broadcast_to(of_edge[:, None], level.ends.shape)], axis=-1).reshape(-1, 2)
    if triangles:
        middle = child[3 * (corners // 3)] + 9 + corners % 3
        points = _interleave([level.points, ahead, ahead[before]], ahead)
        edges = _interleave([out, inner, back], inner[level.next])
        twins = _interleave([beyond, middle[before], behind], child[level.next] + 1)
        inner_ends = np.stack([ahead, ahead[before]], axis=-1)
        sizes, new_points = np.full(len(points) // 3, 3), edge_count
    else:
        center = count + edge_count + level.faces
        points = np.stack([level.points, ahead, center, ahead[before]], axis=-1).ravel()
        edges = np.stack([out, inner, inner[before], back], axis=-1).ravel()
        twins = np.stack([beyond, child[level.next] + 2, child[before] + 1, behind], axis=-1).ravel()
        inner_ends = np.stack([ahead, center], axis=-1)
        sizes, new_points = np.full(len(corners), 4), edge_count + len(level.sizes)
    halves = np.repeat(softened(level.edge_sharpness), 2)
    return Level(
        sizes=sizes,
        points=points,
        edges=edges,
        twins=twins,
        ends=np.concatenate([edge_ends, inner_ends]),
        edge_sharpness=np.concatenate([halves, np.zeros(len(corners))]),
        point_sharpness=np.concatenate([softened(level.point_sharpness), np.zeros(new_points)]),
    )


def first_child(corners: Index, triangles: bool) -> Index:
    """Return the first half-edge of the child at each corner (k,)."""
    return 3 * (corners + corners // 3) if triangles else 4 * corners


def parent_faces(level: Level, triangles: bool) -> Index:
    """Return the face of `level` that each face of the next one comes from."""
    return np.repeat(np.arange(len(level.sizes)), 4) if triangles else level.faces


def split_corners(level: Level, values: NDArray[Any], triangles: bool) -> NDArray[Any]:
    """Return values (m', k) at the corners of the next level, bilinear over each face, from those (m, k) at corners."""
    before = level.previous
    middles = 0.5 * (values + values[level.next])
    if triangles:
        return _interleave([values, middles, middles[before]], middles)
    means = np.add.reduceat(values, face_starts(level.sizes), axis=0) / level.sizes[:, None]
    stacked = np.stack([values, middles, means[level.faces], middles[before]], axis=1)
    return np.asarray(stacked.reshape(-1, *values.shape[1:]))


def softened(sharpness: Doubles) -> Doubles:
    """Return the sharpness at the next level."""
    return np.maximum(sharpness - 1.0, 0.0)


def _interleave(outer: list[NDArray[Any]], middle: NDArray[Any]) -> NDArray[Any]:
    """Return what three triangles at the corners of each triangle have, then what the one in the middle has."""
    three = np.stack(outer, axis=1).reshape(-1, 9, *middle.shape[1:])
    four = np.concatenate([three, middle.reshape(-1, 3, *middle.shape[1:])], axis=1)
    return np.asarray(four.reshape(-1, *middle.shape[1:]))
