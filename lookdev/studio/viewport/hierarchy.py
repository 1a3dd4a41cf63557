"""A bounding volume hierarchy of triangles, as texels that a shader walks without a stack.

- Meister, D. and Bittner, J. 2018. Parallel Locally-Ordered Clustering for Bounding Volume Hierarchy Construction.
  IEEE Transactions on Visualization and Computer Graphics 24(3). (PLOC; each of its steps is one over arrays.)
- Goldsmith, J. and Salmon, J. 1987. Automatic Creation of Object Hierarchies for Ray Tracing. IEEE Computer Graphics
  and Applications 7(5). (What a walk costs, by areas.)
- Smits, B. 1998. Efficiency Issues for Ray Tracing. Journal of Graphics Tools 3(2). (Nodes in the order of a walk, each
  with the one that follows where it is missed.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]
Ints = NDArray[np.int64]

MOST_TEXELS_EACH = 5
"""Texels of a triangle: its own three, and at most two nodes."""

FIRST_BITS = 0x00800000
"""The bits of the least normal float32."""

_NEIGHBOURS = 8  # along the curve, on each side, among which a cluster looks for its nearest
_LEAST = 32  # one of so many clusters joins another in each step: where boxes are alike, few are each other's nearest
_MOST = 4  # triangles of a leaf
_TRIANGLE = 1.2  # what meeting a triangle costs, by what meeting a box does
_CELLS = 1 << 10  # of the curve along each axis
_BINS = 1 << 15  # cells of the grid along the longest axis


@dataclass(frozen=True)
class _Tree:
    """Nodes: `leaves` triangles, then inner nodes, which step by step join two nodes of steps before.

    Boxes are (3, n), `children` those of the inner nodes (2, n - leaves); step `k` made nodes ``steps[k]`` to before
    ``steps[k + 1]``. The last node is the root.
    """

    low: Floats
    high: Floats
    children: Ints
    steps: list[int]

    @property
    def leaves(self) -> int:
        return self.steps[0]


@dataclass(frozen=True, eq=False)
class Hierarchy:
    """The hierarchy of triangles as `texels` (n, 4): a grid, `nodes` nodes, and triangles, three texels each.

    The grid is its lowest corner and its cells' size. A node's x, y and z have the first and the last cell of its box
    along an axis, 15 bits each, as bits of a float from `FIRST_BITS` on, so that all are normal numbers; its w is the
    node that follows where the box is missed, and of a leaf, which the next one follows, -1 less its first triangle's
    place. Else its first child is the next node. The walk ends at the place behind the last node. A triangle is a
    corner and the triangle's number, an edge and its slot, the other edge and 1 for the last one of a leaf. float32 has
    all numbers exactly, up to 2^24.
    """

    texels: Floats
    nodes: int

    @classmethod
    def of(cls, corners: Floats, slots: Floats) -> Hierarchy:
        """Return the hierarchy of triangles (t, 3, 3) of slots (t,), at least one."""
        tree = _clustered(corners)
        order, places, sizes, first = _laid_out(tree)
        kept = np.argsort(places, kind="stable")[np.count_nonzero(places < 0) :]
        nodes, size = len(kept), sizes[kept]
        texels = np.zeros((1 + nodes + 3 * len(corners), 4), np.float32)
        start = tree.low[:, -1]
        cell = max(float((tree.high[:, -1] - start).max()) / (_BINS - 2), float(np.finfo(np.float32).tiny))
        texels[0] = (*start, cell)
        # A hundredth of a cell more than the rounding of a ray to float32.
        low, high = ((each[:, kept].T.astype(np.float64) - start) / np.float32(cell) for each in (tree.low, tree.high))
        low, high = np.floor(np.maximum(low - 0.01, 0.0)), np.ceil(high + 0.01)
        bits = low.astype(np.uint32) | (high.astype(np.uint32) << np.uint32(_BINS.bit_length() - 1))
        texels[1 : 1 + nodes, :3] = (bits + np.uint32(FIRST_BITS)).view(np.float32)
        texels[1 : 1 + nodes, 3] = np.where(size == 1, -1 - first[kept], np.arange(nodes) + size)
        triangles = texels[1 + nodes :].reshape(-1, 3, 4)
        placed = corners[order]
        triangles[:, 0, :3] = placed[:, 0]
        triangles[:, 1:, :3] = placed[:, 1:] - placed[:, :1]
        triangles[:, 0, 3], triangles[:, 1, 3] = order, slots[order]
        starts = first[kept[size == 1]]
        triangles[np.append(starts[1:], len(corners)) - 1, 2, 3] = 1.0
        return cls(texels, nodes)


def _clustered(corners: Floats) -> _Tree:
    """Join boxes of triangles (t, 3, 3): in each step those that are each other's nearest, by the area about both."""
    count = len(corners)
    low, high = np.empty((2, 3, 2 * count - 1), np.float32)
    low[:, :count], high[:, :count] = corners.min(axis=1).T, corners.max(axis=1).T
    children, steps = np.empty((2, count - 1), np.int64), [count]
    nodes = np.argsort(_curve(low[:, :count] + high[:, :count]), kind="stable")
    while (left := len(nodes)) > 1:
        lowest, highest, places = low[:, nodes], high[:, nodes], np.arange(left)
        nearest, mate = np.full(left, np.inf, np.float32), np.zeros(left, np.int64)
        for step in range(1, min(_NEIGHBOURS, left - 1) + 1):
            a, b = slice(None, -step), slice(step, None)
            about = _area(np.minimum(lowest[:, a], lowest[:, b]), np.maximum(highest[:, a], highest[:, b]))
            for one, other in ((a, b), (b, a)):
                nearer = about < nearest[one]
                np.copyto(nearest[one], about, where=nearer)
                np.copyto(mate[one], places[other], where=nearer)
        joined = np.flatnonzero((mate[mate] == places) & (places < mate))
        if _LEAST * len(joined) < left:
            joined = np.arange(0, left - 1, 2)
            mate[joined] = joined + 1
        pair = np.stack([nodes[joined], nodes[mate[joined]]])
        made = steps[-1] + np.arange(len(joined))
        children[:, made - count] = pair
        low[:, made], high[:, made] = low[:, pair].min(axis=1), high[:, pair].max(axis=1)
        nodes[joined] = made
        nodes = np.delete(nodes, mate[joined])
        steps.append(steps[-1] + len(joined))
    return _Tree(low, high, children, steps)


def _laid_out(tree: _Tree) -> tuple[Ints, Ints, Ints, Ints]:
    """Return the triangles in order; and of each node its place in the walk, -1 within leaves, how many nodes it has
    with those below, and its first triangle's place. A leaf is a node whose triangles cost less than its boxes.
    """
    area, leaves = _area(tree.low, tree.high).astype(np.float64), tree.leaves
    cost, counts, sizes = _TRIANGLE * area, np.ones(len(area), np.int64), np.ones(len(area), np.int64)
    for begin, end in zip(tree.steps, tree.steps[1:], strict=False):
        # Where a box is met, both children's are tested: that of the larger one first, which is met more often.
        pair = tree.children[:, begin - leaves : end - leaves]
        pair[:] = np.where(area[pair[0]] < area[pair[1]], pair[::-1], pair)
        counts[begin:end] = counts[pair].sum(axis=0)
        apart, together = (
            2.0 * area[begin:end] + cost[pair].sum(axis=0),
            _TRIANGLE * counts[begin:end] * area[begin:end],
        )
        ends = (counts[begin:end] <= _MOST) & (together <= apart)
        cost[begin:end] = np.where(ends, together, apart)
        sizes[begin:end] = np.where(ends, 1, 1 + sizes[pair].sum(axis=0))
    places, first = np.full(len(area), -1), np.zeros(len(area), np.int64)
    places[-1] = 0
    for begin, end in zip(tree.steps[-2::-1], tree.steps[:0:-1], strict=True):
        one, other = tree.children[:, begin - leaves : end - leaves]
        first[one] = first[begin:end]
        first[other] = first[begin:end] + counts[one]
        inner = (sizes[begin:end] > 1) & (places[begin:end] >= 0)
        places[one[inner]] = places[begin:end][inner] + 1
        places[other[inner]] = places[begin:end][inner] + 1 + sizes[one[inner]]
    order = np.empty(leaves, np.int64)
    order[first[:leaves]] = np.arange(leaves)
    return order, places, sizes, first


def _area(low: Floats, high: Floats) -> Floats:
    """Return half the area (n,) of boxes (3, n)."""
    x, y, z = high - low
    return np.asarray(x * y + y * z + z * x)


def _curve(places: Floats) -> Ints:
    """Return numbers (n,) of places (3, n) along Morton's curve."""
    low = places.min(axis=1, keepdims=True)
    wide = max(float((places - low).max()), np.finfo(np.float32).tiny)
    number = np.zeros(places.shape[1], np.int64)
    for axis, row in enumerate((places - low) / wide):
        x = (row * (_CELLS - 1)).astype(np.int64)
        for by, mask in ((16, 0x30000FF), (8, 0x300F00F), (4, 0x30C30C3), (2, 0x9249249)):
            x = (x | x << by) & mask
        number |= x << axis
    return number
