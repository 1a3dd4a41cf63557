"""A bounding volume hierarchy of triangles, as texels that the viewport's shadow rays traverse without a stack.

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
"""The bits of the smallest normal float32, which are added to the integers of a node (see `Hierarchy`)."""

_NEIGHBOURS = 8  # clusters on each side along the Morton curve among which the nearest neighbour is searched
# Of boxes of equal size, few are mutual nearest neighbours. If a step would join fewer than one in 32 clusters, it
# joins neighbours along the curve instead.
_MAX_CLUSTERS_PER_JOIN = 32
_MAX_LEAF_TRIANGLES = 4  # largest number of triangles in a leaf
_TRIANGLE_COST = 1.2  # cost of a triangle test, relative to the cost of a box test
_MORTON_CELLS = 1 << 10  # cells of the Morton curve along each axis
_GRID_CELLS = 1 << 15  # cells of the grid of boxes along the longest axis


@dataclass(frozen=True)
class _Tree:
    """A binary tree of n nodes: first a leaf for each triangle, then the inner nodes; the last node is the root.

    The box of a node has the corners `low` and `high` (3, n). An inner node joins two earlier nodes, its `children` (2,
    n - leaves). Step k of the construction made the nodes from ``steps[k]`` to ``steps[k + 1] - 1``.
    """

    low: Floats32
    high: Floats32
    children: Ints
    steps: list[int]

    @property
    def leaves(self) -> int:
        """The number of triangles."""
        return self.steps[0]


@dataclass(frozen=True, eq=False)
class Hierarchy:
    """The hierarchy of triangles as `texels` (n, 4): a grid, `nodes` nodes, and three texels for each triangle.

    The first texel is the grid on which boxes are stored: the lowest corner of the root's box, and the size of a cell.

    A node is a texel. Each of its x, y and z is the extent of the node's box along an axis: the number of the box's
    first cell in the lower 15 bits, and of its last cell in the next 15. `FIRST_BITS` is added to them, so that they
    are the bits of a normal float. A traversal begins at the root, which is node 0. It goes from a node to the next
    texel, which is the first child of an inner node. If a ray misses the box of an inner node, the traversal goes to
    the node of number w instead. For a leaf, w is -1 minus the index of the first of its triangles. The traversal ends
    after the last node.

    The first texel of a triangle has a corner and, as w, the triangle's number. The second has an edge from this
    corner, and the number of the triangle's slot. The third has the other edge from this corner, and 1 if the triangle
    is the last of its leaf, else 0. float32 represents all these whole numbers exactly, up to 2^24.
    """

    texels: Floats32
    nodes: int

    @classmethod
    def of(cls, corners: Floats32, slots: Floats32) -> Hierarchy:
        """Return the hierarchy of t > 0 triangles, from the positions `corners` (t, 3, 3) and numbers `slots` (t,)."""
        tree = _cluster_boxes(corners)
        order, indices, sizes, first = _lay_out_nodes(tree)
        # The nodes in the order of the traversal, which skips nodes within leaves; these have index -1.
        traversal_nodes = np.argsort(indices, kind="stable")[np.count_nonzero(indices < 0) :]
        nodes, size = len(traversal_nodes), sizes[traversal_nodes]
        texels = np.zeros((1 + nodes + 3 * len(corners), 4), np.float32)
        start = tree.low[:, -1]
        # The box of the root has two cells fewer than the grid: the rounding below, and its margin, enlarge boxes.
        cell = max(float((tree.high[:, -1] - start).max()) / (_GRID_CELLS - 2), float(np.finfo(np.float32).tiny))
        texels[0] = (*start, cell)
        low, high = (
            (corner[:, traversal_nodes].T.astype(np.float64) - start) / np.float32(cell)
            for corner in (tree.low, tree.high)
        )
        # The margin of 0.01 cells is larger than the rounding of a ray to float32.
        low, high = np.floor(np.maximum(low - 0.01, 0.0)), np.ceil(high + 0.01)
        bits = low.astype(np.uint32) | (high.astype(np.uint32) << np.uint32(_GRID_CELLS.bit_length() - 1))
        texels[1 : 1 + nodes, :3] = (bits + np.uint32(FIRST_BITS)).view(np.float32)
        texels[1 : 1 + nodes, 3] = np.where(size == 1, -1 - first[traversal_nodes], np.arange(nodes) + size)
        triangles = texels[1 + nodes :].reshape(-1, 3, 4)
        ordered = corners[order]
        triangles[:, 0, :3] = ordered[:, 0]
        triangles[:, 1:, :3] = ordered[:, 1:] - ordered[:, :1]
        triangles[:, 0, 3], triangles[:, 1, 3] = order, slots[order]
        # The last triangle of a leaf precedes the first triangle of the next leaf.
        starts = first[traversal_nodes[size == 1]]
        triangles[np.append(starts[1:], len(corners)) - 1, 2, 3] = 1.0
        return cls(texels, nodes)


def _cluster_boxes(corners: Floats32) -> _Tree:
    """Build the tree of triangles with `corners` (t, 3, 3).

    The tree begins with a cluster for each triangle. Each step joins the pairs of clusters that are mutual nearest
    neighbours: the distance of two clusters is the area of the box around both.
    """
    count = len(corners)
    low, high = np.empty((2, 3, 2 * count - 1), np.float32)
    low[:, :count], high[:, :count] = corners.min(axis=1).T, corners.max(axis=1).T
    children, steps = np.empty((2, count - 1), np.int64), [count]
    # The nodes that are clusters at present, in the order of the Morton curve.
    nodes = np.argsort(_morton_numbers(low[:, :count] + high[:, :count]), kind="stable")
    while (remaining := len(nodes)) > 1:
        lowest, highest, indices = low[:, nodes], high[:, nodes], np.arange(remaining)
        # Find the nearest neighbour of each cluster among the clusters near it on the curve: distance and position.
        nearest, neighbour = np.full(remaining, np.inf, np.float32), np.zeros(remaining, np.int64)
        for step in range(1, min(_NEIGHBOURS, remaining - 1) + 1):
            a, b = slice(None, -step), slice(step, None)
            joint_area = _half_area(np.minimum(lowest[:, a], lowest[:, b]), np.maximum(highest[:, a], highest[:, b]))
            for side, opposite in ((a, b), (b, a)):
                nearer = joint_area < nearest[side]
                np.copyto(nearest[side], joint_area, where=nearer)
                np.copyto(neighbour[side], indices[opposite], where=nearer)
        # The positions of clusters that are joined with their neighbour; the neighbour comes later on the curve.
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
    """Return the order of triangles (t,), and the index, the size and the first triangle (n,) of each node of a tree.

    The index is the position of the node in the traversal, -1 within leaves. The size is the number of nodes in its
    subtree, itself included. The first triangle is an index in the order of triangles. A node becomes a leaf if testing
    its triangles costs less than testing the boxes below it.
    """
    area, leaves = _half_area(tree.low, tree.high).astype(np.float64), tree.leaves
    # From the leaves to the root: the cost of a subtree, and its numbers of triangles and of nodes.
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
    # From the root to the leaves: the index of a node in the traversal, and its first triangle.
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
    """Return half the surface areas (n,) of boxes with corners `low` and `high` (3, n)."""
    x, y, z = high - low
    return np.asarray(x * y + y * z + z * x)


def _morton_numbers(positions: Floats32) -> Ints:
    """Return the numbers (n,) of positions (3, n) along the Morton curve, which interleave the bits of coordinates."""
    low = positions.min(axis=1, keepdims=True)
    extent = max(float((positions - low).max()), np.finfo(np.float32).tiny)
    number = np.zeros(positions.shape[1], np.int64)
    for axis, row in enumerate((positions - low) / extent):
        x = (row * (_MORTON_CELLS - 1)).astype(np.int64)
        # Spread the 10 bits of x, so that two zeros follow each.
        for shift, mask in ((16, 0x30000FF), (8, 0x300F00F), (4, 0x30C30C3), (2, 0x9249249)):
            x = (x | x << shift) & mask
        number |= x << axis
    return number
