"""Looks as native nodes, written by hand."""

from lookdev.codegen.source import GroupSocket, NodeLink, NodeSource, NodeTree, ShaderNode

_OUTPUT = ShaderNode("Output", "OutputMaterial", {"target": "CYCLES"}, {"Surface": NodeLink("Surface", "BSDF")})


def diffuse(color: tuple[float, float, float]) -> NodeSource:
    """Return a Diffuse BSDF with the shading normals of the asset, in a group whose colour is a socket."""
    group = NodeTree(
        "Lookdev Diffuse",
        (
            ShaderNode("In", "NodeGroupInput"),
            ShaderNode("Normal", "Attribute", {"attribute_type": "GEOMETRY", "attribute_name": "lookdev_normal"}),
            ShaderNode(
                "World",
                "VectorTransform",
                {"vector_type": "NORMAL", "convert_from": "OBJECT", "convert_to": "WORLD"},
                {"Vector": NodeLink("Normal", "Vector")},
            ),
            ShaderNode(
                "BSDF",
                "BsdfDiffuse",
                inputs={"Color": NodeLink("In", "baseColor"), "Normal": NodeLink("World", "Vector"), "Roughness": 0.0},
            ),
            ShaderNode("Out", "NodeGroupOutput", inputs={"BSDF": NodeLink("BSDF", "BSDF")}),
        ),
        (GroupSocket("baseColor", "color", (0.8, 0.8, 0.8), help="The colour."),),
        (GroupSocket("BSDF", "shader"),),
    )
    surface = ShaderNode("Surface", "Group", inputs={"baseColor": color}, group=group.name)
    return NodeSource("diffuse", (group, NodeTree("diffuse", (surface, _OUTPUT))), (), f"diffuse {color}", False)


def portal(color: tuple[float, float, float]) -> NodeSource:
    """Return a surface that sends all light straight on through itself, tinted, as a portal does."""
    nodes = (
        ShaderNode("Geometry", "NewGeometry"),
        ShaderNode(
            "Onward", "VectorMath", {"operation": "SCALE"}, {"Vector": NodeLink("Geometry", "Incoming"), "Scale": -1.0}
        ),
        ShaderNode("Surface", "BsdfRayPortal", inputs={"Color": color, "Direction": NodeLink("Onward", "Vector")}),
        _OUTPUT,
    )
    return NodeSource("portal", (NodeTree("portal", nodes),), (), f"portal {color}", True)


def crowded(vectors: int) -> NodeSource:
    """Return a Diffuse BSDF that needs a number of vectors at once: first for their sum, then each again."""
    nodes = [ShaderNode("Geometry", "NewGeometry")]

    def add(name: str, operation: str, a: NodeLink, b: NodeLink | tuple[float, float, float]) -> NodeLink:
        nodes.append(ShaderNode(name, "VectorMath", {"operation": operation}, {"Vector": a, "Vector_001": b}))
        return NodeLink(name, "Vector")

    position = NodeLink("Geometry", "Position")
    products = [add(f"Value {number}", "MULTIPLY", position, (1.0 + number,) * 3) for number in range(vectors)]
    total = products[0]
    for number, vector in enumerate(products[1:]):
        total = add(f"Sum {number}", "ADD", total, vector)
    for number, vector in enumerate(products):
        total = add(f"Largest {number}", "MAXIMUM", total, vector)
    surface = ShaderNode("Surface", "BsdfDiffuse", inputs={"Color": total})
    return NodeSource("crowded", (NodeTree("crowded", (*nodes, surface, _OUTPUT)),), (), f"crowded {vectors}", False)
