"""`lookdev.scene.shading.LIFT` as nodes: surfaces that coincide with a surface do not shadow it.

The coordinates of a triangle's corners determine how far a position is rounded, but nodes cannot read them. The corners
are assumed to be at most as far from the origin as the position, plus its distance to the viewer.
"""

from __future__ import annotations

from lookdev.codegen.nodes.builder import TreeBuilder
from lookdev.codegen.source import GroupSocket, NodeLink, NodeTree
from lookdev.scene.shading import LIFT

GROUP = "Lookdev Coincident"


def add_lift(builder: TreeBuilder) -> NodeLink:
    """Add the nodes that compute the lift, in metres: rays that leave a surface pass others up to this height."""
    position = NodeLink(builder.add("NewGeometry"), "Position")
    distance = NodeLink(builder.add("VectorMath", {"operation": "LENGTH"}, {"Vector": position}), "Value")
    size = _add_math(builder, "ADD", distance, NodeLink(builder.add("CameraData"), "View Distance"))
    return _add_math(builder, "MULTIPLY", size, LIFT)


def _add_math(builder: TreeBuilder, operation: str, *operands: NodeLink | float) -> NodeLink:
    inputs = dict(zip(("Value", "Value_001"), operands, strict=False))
    return NodeLink(builder.add("Math", {"operation": operation}, inputs), "Value")


def coincident_tree(*, see_through: bool) -> NodeTree:
    """Return the group that makes a surface transparent to rays that start no higher above its facet than the lift.

    Cycles starts its rays on the surface itself, so they would end on coincident surfaces. For shadow rays that start
    higher, a surface that is not `see_through` is black: Cycles then skips the shader of its look, which takes a fifth
    of a frame's time.
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
