"""Arrange the nodes of a tree for Blender's editor, so that an artist can read it.

A node's column is the length, in links, of its longest path to the output. Within a column, nodes are near the nodes
that read them.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping

from lookdev.codegen.source import NodeLink, ShaderNode

# All in Blender's units: the distance between columns, the gap between the nodes of a column; and the heights of a
# node's header, of a socket or property, and of the three fields of a vector that is not linked.
_COLUMN = 220.0
_GAP = 30.0
_HEADER, _ROW, _VECTOR = 90.0, 24.0, 90.0


def lay_out_nodes(nodes: Mapping[str, ShaderNode]) -> dict[str, tuple[float, float]]:
    """Return the upper left corners (x, y) of nodes, by name, in Blender's units.

    Nodes do not overlap. A node is to the right of the nodes that it reads.
    """
    readers: dict[str, list[str]] = defaultdict(list)
    for name, node in nodes.items():
        for source in dict.fromkeys(link.node for link in node.inputs.values() if isinstance(link, NodeLink)):
            readers[source].append(name)
    # The number of each node's column, counted from the output to the left. Nodes are in the order in which they were
    # added, so readers follow the nodes that they read.
    columns: dict[str, int] = {}
    for name in reversed(list(nodes)):
        columns[name] = 1 + max((columns[reader] for reader in readers[name]), default=-1)
    # The group's inputs are leftmost.
    last = max(columns.values(), default=0)
    for name, node in nodes.items():
        if node.kind == "NodeGroupInput":
            columns[name] = last + 1
    by_column: dict[int, list[str]] = defaultdict(list)
    for name in nodes:
        by_column[columns[name]].append(name)
    # The heights of the centres of nodes. A node's target is the mean of the centres of its readers.
    middles: dict[str, float] = {}
    positions: dict[str, tuple[float, float]] = {}
    for column in sorted(by_column):
        targets = {
            name: sum(middles[reader] for reader in readers[name]) / len(readers[name]) if readers[name] else 0.0
            for name in by_column[column]
        }
        members = sorted(by_column[column], key=lambda name: -targets[name])
        heights = [_height(nodes[name]) for name in members]
        # The column is centred at the mean of its nodes' targets.
        top = (sum(heights) + _GAP * len(members)) / 2.0 + sum(targets.values()) / len(members)
        for name, height in zip(members, heights, strict=True):
            positions[name] = (-_COLUMN * column, round(top))
            middles[name] = top - height / 2.0
            top -= height + _GAP
    return positions


def _height(node: ShaderNode) -> float:
    """Return the approximate height of a node; an unlinked vector has a row for each component."""
    if node.kind == "TexImage":
        return 300.0
    rows = sum(_VECTOR if isinstance(value, tuple) else _ROW for value in node.inputs.values())
    return _HEADER + rows + _ROW * len(node.properties)
