"""A bounding volume hierarchy of triangles, as texels that a shader traverses without a stack.

- Meister, D. and Bittner, J. 2018. Parallel Locally-Ordered Clustering for Bounding Volume Hierarchy Construction.
  IEEE Transactions on Visualization and Computer Graphics 24(3). (PLOC; here its steps are array operations.)
- Goldsmith, J. and Salmon, J. 1987. Automatic Creation of Object Hierarchies for Ray Tracing. IEEE Computer Graphics
  and Applications 7(5). (The cost of a traversal, from surface areas.)
- Smits, B. 1998. Efficiency Issues for Ray Tracing. Journal of Graphics Tools 3(2). (Nodes in the order of a
  traversal, each with the node that follows if its box is missed.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lookdev.arrays import Floats32, Ints

MAX_TRIANGLE_TEXELS = 5
"""Largest number of texels for a triangle: three for itself, and two nodes."""

FIRST_BITS = 0x00800000
"""The bits of the smallest normal float32."""

_NEIGHBOURS = 8  # clusters on each side along the curve among which the nearest neighbour is searched
# Of boxes of equal size, few are mutual nearest neighbours. If a step would join fewer than one in 32 clusters, it
# joins neighbours along the curve instead.
_MAX_CLUSTERS_PER_JOIN = 32
_MAX_LEAF_TRIANGLES = 4  # largest number of triangles in a leaf
_TRIANGLE_COST = 1.2  # cost of a triangle test, relative to that of a box test
_CELLS = 1 << 10  # of the Morton curve along each axis
_BINS = 1 << 15  # cells of the grid along the longest axis


@dataclass(frozen=True)
class _Tree:
    """A binary tree: its nodes are `leaves` triangles, then inner nodes, each of which joins two earlier nodes.

    Boxes `low` and `high` are (3, n); `children` are those of the inner nodes, (2, n - leaves). Step `k` of the
    construction made the nodes from ``steps[k]`` to ``steps[k + 1] - 1``. The last node is the root.
    """

    low: Floats32
    high: Floats32
    children: Ints
    steps: list[int]

    @property
    def leaves(self) -> int:
        return self.steps[0]


@dataclass(frozen=True, eq=False)
class Hierarchy:
    """The hierarchy of triangles as `texels` (n, 4): a grid, `nodes` nodes, and triangles of three texels each.

    Grid: its lowest corner, and the size of its cells.

    Node: x, y and z have the first and the last cell of its box along an axis, 15 bits each; `FIRST_BITS` is added, so
    that the bits are those of normal floats. The next texel is the next node of the traversal, for an inner node its
    first child; if a ray misses the box of an inner node, w is the next node. For a leaf, w is -1 minus the index of
    its first triangle. The traversal ends behind the last node.

    Triangle: a corner and the triangle's number; an edge and its slot; the other edge, and 1 for the last triangle of
    a leaf. float32 has all these numbers exactly, up to 2^24.
    """

    texels: Floats32
    nodes: int

    @classmethod
    def of(cls, corners: Floats32, slots: Floats32) -> Hierarchy:
        """Return the hierarchy of one or more triangles (t, 3, 3), whose slots are (t,)."""
        tree = _cluster_boxes(corners)
        order, indices, sizes, first = _lay_out_nodes(tree)
        traversal_nodes = np.argsort(indices, kind="stable")[np.count_nonzero(indices < 0) :]
        nodes, size = len(traversal_nodes), sizes[traversal_nodes]
        texels = np.zeros((1 + nodes + 3 * len(corners), 4), np.float32)
        start = tree.low[:, -1]
        cell = max(float((tree.high[:, -1] - start).max()) / (_BINS - 2), float(np.finfo(np.float32).tiny))
        texels[0] = (*start, cell)
        # The margin, a hundredth of a cell, is larger than the rounding of a ray to float32.
        low, high = (
            (corner[:, traversal_nodes].T.astype(np.float64) - start) / np.float32(cell)
            for corner in (tree.low, tree.high)
        )
        low, high = np.floor(np.maximum(low - 0.01, 0.0)), np.ceil(high + 0.01)
        bits = low.astype(np.uint32) | (high.astype(np.uint32) << np.uint32(_BINS.bit_length() - 1))
        texels[1 : 1 + nodes, :3] = (bits + np.uint32(FIRST_BITS)).view(np.float32)
        texels[1 : 1 + nodes, 3] = np.where(size == 1, -1 - first[traversal_nodes], np.arange(nodes) + size)
        triangles = texels[1 + nodes :].reshape(-1, 3, 4)
        ordered = corners[order]
        triangles[:, 0, :3] = ordered[:, 0]
        triangles[:, 1:, :3] = ordered[:, 1:] - ordered[:, :1]
        triangles[:, 0, 3], triangles[:, 1, 3] = order, slots[order]
        starts = first[traversal_nodes[size == 1]]
        triangles[np.append(starts[1:], len(corners)) - 1, 2, 3] = 1.0
        return cls(texels, nodes)


def _cluster_boxes(corners: Floats32) -> _Tree:
    """Build the tree of triangles (t, 3, 3): each step joins mutual nearest neighbours, by joint area."""
    count = len(corners)
    low, high = np.empty((2, 3, 2 * count - 1), np.float32)
    low[:, :count], high[:, :count] = corners.min(axis=1).T, corners.max(axis=1).T
    children, steps = np.empty((2, count - 1), np.int64), [count]
    nodes = np.argsort(_morton_numbers(low[:, :count] + high[:, :count]), kind="stable")
    while (remaining := len(nodes)) > 1:
        lowest, highest, indices = low[:, nodes], high[:, nodes], np.arange(remaining)
        nearest, neighbour = np.full(remaining, np.inf, np.float32), np.zeros(remaining, np.int64)
        for step in range(1, min(_NEIGHBOURS, remaining - 1) + 1):
            a, b = slice(None, -step), slice(step, None)
            joint_area = _half_area(np.minimum(lowest[:, a], lowest[:, b]), np.maximum(highest[:, a], highest[:, b]))
            for side, opposite in ((a, b), (b, a)):
                nearer = joint_area < nearest[side]
                np.copyto(nearest[side], joint_area, where=nearer)
                np.copyto(neighbour[side], indices[opposite], where=nearer)
        joined = np.flatnonzero((neighbour[neighbour] == indices) & (indices < neighbour))
        if _MAX_CLUSTERS_PER_JOIN * len(joined) < remaining:
            joined = np.arange(0, remaining - 1, 2)
            neighbour[joined] = joined + 1
        pair = np.stack([nodes[joined], nodes[neighbour[joined]]])
        new_nodes = steps[-1] + np.arange(len(joined))
        children[:, new_nodes - count] = pair
        low[:, new_nodes], high[:, new_nodes] = low[:, pair].min(axis=1), high[:, pair].max(axis=1)
        nodes[joined] = new_nodes
        nodes = np.delete(nodes, neighbour[joined])
        steps.append(steps[-1] + len(joined))
    return _Tree(low, high, children, steps)


def _lay_out_nodes(tree: _Tree) -> tuple[Ints, Ints, Ints, Ints]:
    """Return the triangles in the order of leaves, and for each node its index, its size and its first triangle.

    The index is the position in the traversal, -1 within leaves. The size is the number of nodes in the subtree, with
    the node. A node becomes a leaf if testing its triangles costs less than testing its boxes.
    """
    area, leaves = _half_area(tree.low, tree.high).astype(np.float64), tree.leaves
    cost, counts, sizes = _TRIANGLE_COST * area, np.ones(len(area), np.int64), np.ones(len(area), np.int64)
    for begin, end in zip(tree.steps, tree.steps[1:], strict=False):
        # If a ray hits a box, both children are tested, the larger one first: rays hit it more often.
        pair = tree.children[:, begin - leaves : end - leaves]
        pair[:] = np.where(area[pair[0]] < area[pair[1]], pair[::-1], pair)
        counts[begin:end] = counts[pair].sum(axis=0)
        inner_cost = 2.0 * area[begin:end] + cost[pair].sum(axis=0)
        leaf_cost = _TRIANGLE_COST * counts[begin:end] * area[begin:end]
        is_leaf = (counts[begin:end] <= _MAX_LEAF_TRIANGLES) & (leaf_cost <= inner_cost)
        cost[begin:end] = np.where(is_leaf, leaf_cost, inner_cost)
        sizes[begin:end] = np.where(is_leaf, 1, 1 + sizes[pair].sum(axis=0))
    indices, first = np.full(len(area), -1), np.zeros(len(area), np.int64)
    indices[-1] = 0
    for begin, end in zip(tree.steps[-2::-1], tree.steps[:0:-1], strict=True):
        first_child, second_child = tree.children[:, begin - leaves : end - leaves]
        first[first_child] = first[begin:end]
        first[second_child] = first[begin:end] + counts[first_child]
        is_inner = (sizes[begin:end] > 1) & (indices[begin:end] >= 0)
        indices[first_child[is_inner]] = indices[begin:end][is_inner] + 1
        indices[second_child[is_inner]] = indices[begin:end][is_inner] + 1 + sizes[first_child[is_inner]]
    order = np.empty(leaves, np.int64)
    order[first[:leaves]] = np.arange(leaves)
    return order, indices, sizes, first


def _half_area(low: Floats32, high: Floats32) -> Floats32:
    """Return half the area (n,) of boxes (3, n)."""
    x, y, z = high - low
    return np.asarray(x * y + y * z + z * x)


def _morton_numbers(positions: Floats32) -> Ints:
    """Return the numbers (n,) of positions (3, n) along the Morton curve."""
    low = positions.min(axis=1, keepdims=True)
    extent = max(float((positions - low).max()), np.finfo(np.float32).tiny)
    number = np.zeros(positions.shape[1], np.int64)
    for axis, row in enumerate((positions - low) / extent):
        x = (row * (_CELLS - 1)).astype(np.int64)
        for shift, mask in ((16, 0x30000FF), (8, 0x300F00F), (4, 0x30C30C3), (2, 0x9249249)):
            x = (x | x << shift) & mask
        number |= x << axis
    return number
