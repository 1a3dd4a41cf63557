"""Add nodes that keep a surface from being shadowed by surfaces that coincide with it.

A ray leaves a surface at a small height above it, the lift (`lookdev.scene.shading.LIFT`). The lift is proportional to
the largest coordinate of the shading point and of its triangle's corners, but nodes cannot read the corners. Nodes use
the distance of the point from the origin, plus its distance to the camera, in place of this coordinate.

Backend ``nodes-exact`` lifts the points where its rays start. In backend ``nodes``, a surface is transparent to rays
that start below the lift.
"""

from __future__ import annotations

from lookdev.codegen.nodes.builder import TreeBuilder
from lookdev.codegen.source import GroupSocket, NodeLink, NodeTree
from lookdev.scene.shading import LIFT

GROUP = "Lookdev Coincident"
"""The name of the group `coincident_tree`."""


def add_lift(builder: TreeBuilder) -> NodeLink:
    """Add the nodes that compute the lift at the shading point, in metres, and return their output."""
    position = NodeLink(builder.add("NewGeometry"), "Position")
    distance = NodeLink(builder.add("VectorMath", {"operation": "LENGTH"}, {"Vector": position}), "Value")
    size = _add_math(builder, "ADD", distance, NodeLink(builder.add("CameraData"), "View Distance"))
    return _add_math(builder, "MULTIPLY", size, LIFT)


def _add_math(builder: TreeBuilder, operation: str, *operands: NodeLink | float) -> NodeLink:
    """Add a Math node, and return its output."""
    inputs = dict(zip(("Value", "Value_001"), operands, strict=False))
    return NodeLink(builder.add("Math", {"operation": operation}, inputs), "Value")


def coincident_tree(*, see_through: bool) -> NodeTree:
    """Return the group that makes a surface transparent to rays that start near it; other rays meet the input shader.

    A ray starts near the surface if its start is less than the lift above the surface's facet. Cycles starts its rays
    on a surface itself, so they would end on coincident surfaces.

    To other shadow rays, a surface that is not `see_through` is black. Cycles then does not evaluate the shader of the
    surface's look for them, which would take a fifth of a frame's time.
    """
    builder = TreeBuilder(GROUP)
    shader = NodeLink(builder.add("NodeGroupInput"), "Shader")
    path = builder.add("LightPath")
    if not see_through:
        black = builder.add("BsdfTransparent", inputs={"Color": (0.0, 0.0, 0.0)})
        blocked = {"Fac": NodeLink(path, "Is Shadow Ray"), "Shader": shader, "Shader_001": NodeLink(black, "BSDF")}
        shader = NodeLink(builder.add("MixShader", inputs=blocked), "Shader")
    geometry = builder.add("NewGeometry")
    vectors = {"Vector": NodeLink(geometry, "Incoming"), "Vector_001": NodeLink(geometry, "True Normal")}
    cosine = NodeLink(builder.add("VectorMath", {"operation": "DOT_PRODUCT"}, vectors), "Value")
    height = _add_math(builder, "ABSOLUTE", _add_math(builder, "MULTIPLY", NodeLink(path, "Ray Length"), cosine))
    is_near = _add_math(builder, "LESS_THAN", height, add_lift(builder))
    transparent = NodeLink(builder.add("BsdfTransparent"), "BSDF")
    inputs = {"Fac": is_near, "Shader": shader, "Shader_001": transparent}
    builder.add("NodeGroupOutput", inputs={"Shader": NodeLink(builder.add("MixShader", inputs=inputs), "Shader")})
    socket = GroupSocket("Shader", "shader")
    return builder.tree([socket], [socket])
