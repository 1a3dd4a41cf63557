"""The shading frame as nodes, the same as that of `lookdev/shaders/surface.osl`."""

from __future__ import annotations

from dataclasses import dataclass

from lookdev.codegen.nodes.builder import TreeBuilder
from lookdev.codegen.source import GroupSocket, Link, NodeTree, SocketValue

GROUP = "Lookdev Frame"

# How far above the horizon of a bent normal the viewer stands at least.
_LEAN = 1e-4

_OUTPUTS = {
    "Normal": "The shading normal on the viewer's side, bent where it would face away from the viewer",
    "Tangent": "Along the first UV set's u",
    "Bitangent": "Completes the frame",
    "Viewer": "The direction to the viewer in the frame",
}


@dataclass(frozen=True)
class Frame:
    """Where the axes of the shading frame are found: unit vectors in world space."""

    normal: Link
    tangent: Link
    bitangent: Link


def add_frame(builder: TreeBuilder) -> Frame:
    """Show the group of `frame_tree` in a tree, and bind ``wo_x wo_y wo_z``."""
    node = builder.add("Group", group=GROUP)
    builder.bind(("wo_x", "wo_y", "wo_z"), Link(node, "Viewer"))
    return Frame(Link(node, "Normal"), Link(node, "Tangent"), Link(node, "Bitangent"))


def frame_tree(*, leaning: bool) -> NodeTree:
    """Return the group that computes the shading frame.

    Parameters
    ----------
    leaning
        Normals of the look lean (bumps, normal maps): then it matters that a reflected instance has its bitangent on
        the other side.
    """
    builder = TreeBuilder(GROUP)

    def vector(operation: str, *operands: Link | SocketValue, scale: Link | float | None = None) -> Link:
        sockets: dict[str, Link | SocketValue] = dict(zip(("Vector", "Vector_001"), operands, strict=False))
        if scale is not None:
            sockets["Scale"] = scale
        output = "Value" if operation == "DOT_PRODUCT" else "Vector"
        return Link(builder.add("VectorMath", {"operation": operation}, sockets), output)

    def math(operation: str, *operands: Link | float) -> Link:
        sockets = dict(zip(("Value", "Value_001", "Value_002"), operands, strict=False))
        return Link(builder.add("Math", {"operation": operation}, sockets), "Value")

    def to_world(kind: str, value: Link | SocketValue) -> Link:
        properties = {"vector_type": kind, "convert_from": "OBJECT", "convert_to": "WORLD"}
        return Link(builder.add("VectorTransform", properties, {"Vector": value}), "Vector")

    def of_mesh(name: str) -> Link:
        return Link(builder.add("Attribute", {"attribute_type": "GEOMETRY", "attribute_name": name}), "Vector")

    geometry = builder.add("NewGeometry")
    # Both are on the viewer's side.
    facet, viewer = Link(geometry, "True Normal"), Link(geometry, "Incoming")

    # From behind, the frame is turned about through the point.
    n = vector("NORMALIZE", to_world("NORMAL", of_mesh("lookdev_normal")))
    behind = math("LESS_THAN", vector("DOT_PRODUCT", n, facet), 0.0)
    side = math("MULTIPLY_ADD", behind, -2.0, 1.0)
    n = vector("SCALE", n, scale=side)
    # An interpolated normal can lean away from a viewer who sees the facet: it is bent until it does not.
    lean = math("MAXIMUM", math("SUBTRACT", _LEAN, vector("DOT_PRODUCT", n, viewer)), 0.0)
    n = vector("NORMALIZE", vector("ADD", n, vector("SCALE", viewer, scale=lean)))
    t = vector("SCALE", to_world("VECTOR", of_mesh("lookdev_tangent")), scale=side)
    t = vector("NORMALIZE", vector("SUBTRACT", t, vector("SCALE", n, scale=vector("DOT_PRODUCT", t, n))))
    if leaning:
        x, y, z = (to_world("VECTOR", axis) for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))
        reflected = math("LESS_THAN", vector("DOT_PRODUCT", vector("CROSS_PRODUCT", x, y), z), 0.0)
        side = math("MULTIPLY", side, math("MULTIPLY_ADD", reflected, -2.0, 1.0))
    b = vector("SCALE", vector("CROSS_PRODUCT", n, t), scale=side)

    local = dict(zip("XYZ", (vector("DOT_PRODUCT", viewer, axis) for axis in (t, b, n)), strict=True))
    wo = Link(builder.add("CombineXYZ", inputs=local), "Vector")
    builder.add("NodeGroupOutput", inputs=dict(zip(_OUTPUTS, (n, t, b, wo), strict=True)))
    return builder.tree(outputs=[GroupSocket(name, "vector", help=help) for name, help in _OUTPUTS.items()])
