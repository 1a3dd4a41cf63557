"""Write the shading frame (`lookdev.scene.shading`) as a group of nodes, for the trees of all looks."""

from __future__ import annotations

import numpy as np

from lookdev.brdf import Real
from lookdev.brdf.vectors import cross, dot, normalize
from lookdev.codegen.nodes.builder import TreeBuilder
from lookdev.codegen.nodes.group import bind_symbols
from lookdev.codegen.source import TANGENT, GroupSocket, NodeLink, NodeTree, SocketValue
from lookdev.codegen.trace.graph import Graph
from lookdev.codegen.trace.symbolic import SymbolicArray, elements_of
from lookdev.scene.shading import shading_frame

GROUP = "Lookdev Frame"
"""The name of the group."""

# The group's outputs, and their tooltips in Blender.
_OUTPUTS = {
    "Normal": "The shading normal on the viewer's side, bent where it would face away from the viewer",
    "Tangent": "Along the first UV set's u, where the look depends on its direction",
    "Bitangent": "Completes the frame",
    "Viewer": "The direction to the viewer in the frame",
}


def add_frame(builder: TreeBuilder) -> dict[str, NodeLink]:
    """Add a node of the group `frame_tree` to a tree, and return its outputs ``tangent``, ``bitangent`` and ``normal``.

    These outputs are unit vectors in world space. The symbols ``wo_x wo_y wo_z`` are bound to the group's output
    ``"Viewer"``.
    """
    node = builder.add("Group", group=GROUP)
    builder.bind(("wo_x", "wo_y", "wo_z"), NodeLink(node, "Viewer"))
    return {name: NodeLink(node, name.capitalize()) for name in ("tangent", "bitangent", "normal")}


def reads_frame_tangent(tree: NodeTree) -> bool:
    """Return whether nodes of a tree read the frame's tangent or bitangent, or the viewer's components along these."""
    frames = {node.name for node in tree.nodes if node.group == GROUP}
    links = [(node, link) for node in tree.nodes for link in node.inputs.values() if isinstance(link, NodeLink)]
    # The nodes that separate the components of the direction to the viewer.
    viewers = {node.name for node, link in links if link.node in frames and node.kind == "SeparateXYZ"}
    return any(
        (link.node in frames and link.socket != "Normal" and node.name not in viewers)
        or (link.node in viewers and link.socket != "Z")
        for node, link in links
    )


def frame_tree(*, reads_tangent: bool, bends_normals: bool) -> NodeTree:
    """Return the group that computes the shading frame.

    With `reads_tangent`, the group reads the mesh's tangent, for a look that depends on the tangent's direction. With
    `bends_normals`, it mirrors the bitangent of a mirrored instance, for a look with bumps or normal maps.
    """
    graph, builder = Graph(), TreeBuilder(GROUP)

    def to_world(kind: str, value: NodeLink | SocketValue) -> NodeLink:
        properties = {"vector_type": kind, "convert_from": "OBJECT", "convert_to": "WORLD"}
        return NodeLink(builder.add("VectorTransform", properties, {"Vector": value}), "Vector")

    def mesh_attribute(name: str) -> NodeLink:
        return NodeLink(builder.add("Attribute", {"attribute_type": "GEOMETRY", "attribute_name": name}), "Vector")

    def symbols(name: str, link: NodeLink) -> SymbolicArray:
        return bind_symbols(graph, builder, name, link, vector=True)

    geometry = builder.add("NewGeometry")
    hand: Real = 1.0
    if bends_normals:
        axes = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
        x, y, z = (symbols(name, to_world("VECTOR", axis)) for name, axis in axes.items())
        hand = np.where(dot(cross(x, y), z) < 0.0, -1.0, 1.0)
    viewer = symbols("viewer", NodeLink(geometry, "Incoming"))
    frame = shading_frame(
        normalize(symbols("normal", to_world("NORMAL", mesh_attribute("lookdev_normal")))),
        symbols("tangent", to_world("VECTOR", mesh_attribute(TANGENT))) if reads_tangent else None,
        symbols("facet", NodeLink(geometry, "True Normal")),
        viewer,
        hand,
    )
    values = [elements_of(vector) for vector in (frame.normal, frame.tangent, frame.bitangent, frame.to_local(viewer))]
    builder.plan_vectors(values)
    builder.add("NodeGroupOutput", inputs=dict(zip(_OUTPUTS, map(builder.vector, values), strict=True)))
    return builder.tree(outputs=[GroupSocket(name, "vector", help=help) for name, help in _OUTPUTS.items()])
