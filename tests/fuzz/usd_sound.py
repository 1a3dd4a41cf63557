"""Sound USD assets, small, with the places where each can be made wrong.

A comment at the end of a line names the role of its property, or those of other properties of the prim:
`usd_mutations.ROLES` says what can be wrong with one of that role, and what must then be said.
"""

# ruff: noqa: E501
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from image_files import png
from pxr import Sdf

CUBE = """
        point3f[] points = [(-1, -1, -1), (1, -1, -1), (1, 1, -1), (-1, 1, -1), (-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1)]
        int[] faceVertexCounts = [4, 4, 4, 4, 4, 4]
        int[] faceVertexIndices = [0, 3, 2, 1, 4, 5, 6, 7, 0, 1, 5, 4, 1, 2, 6, 5, 2, 3, 7, 6, 3, 0, 4, 7]
"""
_SQUARE = """
        point3f[] points = [(0, 0, 0), (1, 0, 0), (2, 0, 0), (0, 1, 0.5), (1, 1, 0.25), (2, 1, 0.5)]
        int[] faceVertexCounts = [4, 4]
        int[] faceVertexIndices = [0, 1, 4, 3, 1, 2, 5, 4]
"""
_IDENTITY = "((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1))"


@dataclass(frozen=True)
class Spot:
    """A property of a prim, and its role."""

    prim: str
    name: str
    role: str


@dataclass(frozen=True)
class Sound:
    """A sound asset: the text of its layer, its spots, the files beside it, and how it is read."""

    text: str
    spots: tuple[Spot, ...]
    files: dict[str, str | bytes] = field(default_factory=dict)
    time: float | None = None
    camera: str | None = None
    collection: str | None = None
    packs: bool = True
    """Whether it may be packed in an archive, or referenced: it has no files beside it."""


def _sound(body: str, more: str = "", **options: Any) -> Sound:
    text = (
        f'#usda 1.0\n(\n    defaultPrim = "Root"\n    metersPerUnit = 0.5\n    upAxis = "Y"\n{more})\n\n'
        f'def Xform "Root"\n{{\n{body}\n}}\n'
    )
    return Sound(re.sub("  # .*", "", text), tuple(_spots(text)), **options)


def sound_layer(sound: Sound) -> Sdf.Layer:
    """Return the layer of a sound asset, in memory."""
    layer = Sdf.Layer.CreateAnonymous(".usda")
    layer.ImportFromString(sound.text)
    return layer


def _spots(text: str) -> Iterator[Spot]:
    """Yield the spots that comments name."""
    path, name = [""], ""
    for line in text.splitlines():
        code, _, roles = line.partition("  # ")
        if prim := re.match(r' *(?:def|class) .*?"(\w+)"', code):
            name = prim[1]
        if code.endswith("{"):
            path.append(name)
        elif code.strip() == "}":
            path.pop()
        for word in roles.split():
            of, _, role = word.rpartition("=")
            own = code.partition(" = ")[0].split()[-1].removesuffix(".connect").removesuffix(".timeSamples")
            yield Spot("/".join(path), of or own, role)


SOUND: dict[str, Sound] = {}

SOUND["mesh"] = _sound(f"""
    def Mesh "Body" (prepend apiSchemas = ["MaterialBindingAPI"]) {{  # points=points faceVertexCounts=counts faceVertexIndices=indices{_SQUARE}
        uniform token subdivisionScheme = "none"  # token
        uniform token orientation = "rightHanded"  # token
        normal3f[] normals = [(0, 0, 1), (0, 0, 1), (0, 0.5, 1), (0, 0, 1), (0, 0, 1), (0, 0, 1), (0.5, 0, 1), (0, 0, 1)] (interpolation = "faceVarying")  # normals
        texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = "faceVarying")  # uv
        int[] primvars:st:indices = [0, 1, 2, 3, 0, 1, 2, 3]  # uv_indices
        float[] primvars:wear = [0, 0.25, 0.5, 0.75, 1, 1] (interpolation = "vertex")  # primvar
        color3f[] primvars:displayColor = [(1, 0, 0), (0, 0.5, 0)] (interpolation = "uniform")  # color
        float primvars:rust = 0.5 (interpolation = "constant")  # constant
        float3[] extent = [(0, 0, 0), (2, 1, 0.5)]  # unread
        uniform bool doubleSided = 1  # unread
        int[] holeIndices = []  # holes
        uniform token subsetFamily:materialBind:familyType = "nonOverlapping"
        def GeomSubset "Left" (prepend apiSchemas = ["MaterialBindingAPI"]) {{
            uniform token elementType = "face"  # token
            uniform token familyName = "materialBind"
            int[] indices = [0]  # subset
        }}
    }}
    def Mesh "Second" {{  # points=bare{CUBE}
        uniform token subdivisionScheme = "none"
        token visibility = "inherited"  # visibility
        uniform token purpose = "render"  # purpose
    }}""")

SOUND["cage"] = _sound(f"""
    def Mesh "Body" {{  # points=points faceVertexCounts=counts faceVertexIndices=indices{CUBE}
        uniform token subdivisionScheme = "catmullClark"  # token
        uniform token interpolateBoundary = "edgeAndCorner"  # token
        uniform token faceVaryingLinearInterpolation = "cornersPlus1"  # token
        uniform token triangleSubdivisionRule = "catmullClark"  # token
        int[] creaseIndices = [0, 1, 2, 4, 5, 6]  # indices
        int[] creaseLengths = [3, 3]  # counts
        float[] creaseSharpnesses = [2, 10]  # sharpness
        int[] cornerIndices = [6, 7]  # indices
        float[] cornerSharpnesses = [10, 1.5]  # sharpness
        int[] holeIndices = [5]  # holes
        normal3f[] normals = [(0, 0, 1)] (interpolation = "constant")  # unread
        texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1), (0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = "vertex")  # uv
    }}
    def Mesh "Loop" {{
        point3f[] points = [(0, 0, 4), (1, 0, 4), (0, 1, 4), (0, 0, 5)]  # bare
        int[] faceVertexCounts = [3, 3, 3, 3]  # counts
        int[] faceVertexIndices = [0, 2, 1, 0, 1, 3, 1, 2, 3, 2, 0, 3]  # indices
        uniform token subdivisionScheme = "loop"
    }}""")

_SIZES = {
    "Sphere": ("radius",),
    "Cube": ("size",),
    "Cylinder": ("radius", "height"),
    "Cone": ("radius", "height"),
    "Capsule": ("radius", "height"),
    "Plane": ("width", "length"),
    "Cylinder_1": ("radiusBottom", "radiusTop", "height"),
    "Capsule_1": ("radiusBottom", "radiusTop", "height"),
}
for _kind, _names in _SIZES.items():
    _axis = '\n        uniform token axis = "X"  # token' if _kind not in ("Sphere", "Cube") else ""
    _lengths = "".join(
        f"        double {name} = {1.5 + i}  # {'part' if name.endswith(('Top', 'Bottom', 'height')) else 'size'}\n"
        for i, name in enumerate(_names)
    )
    SOUND[_kind] = _sound(f"""
    def {_kind} "Body" {{{_axis}
{_lengths}        color3f[] primvars:displayColor = [(1, 0, 0)]
    }}
    def Mesh "Second" {{{CUBE}    }}""")

SOUND["curves"] = _sound("""
    def BasisCurves "Hair" {
        point3f[] points = [(0, 0, 0), (0, 1, 0), (1, 1, 0), (1, 2, 0), (3, 0, 0), (3, 1, 0), (4, 1, 1), (4, 2, 0)]  # points
        int[] curveVertexCounts = [4, 4]  # counts
        float[] widths = [0.25, 0.125, 0.25, 0.25, 0.5, 0.25, 0.25, 0.25] (interpolation = "vertex")  # widths
        uniform token type = "cubic"  # token
        uniform token basis = "bezier"  # token
        uniform token wrap = "nonperiodic"  # token
        float[] primvars:wear = [0.5, 1, 0.5, 1, 0.5, 1, 0.5, 1] (interpolation = "vertex")  # primvar
    }
    def BasisCurves "Grass" {
        point3f[] points = [(0, 0, 3), (0, 1, 3), (1, 1, 3)]  # points
        int[] curveVertexCounts = [3]
        normal3f[] normals = [(0, 0, 1)] (interpolation = "constant")  # normals
        float[] widths = [0.5] (interpolation = "constant")  # width
        uniform token type = "linear"
    }
    def NurbsCurves "Wire" {
        point3f[] points = [(0, 0, 5), (0, 1, 5), (1, 1, 5), (1, 2, 5)]  # points
        int[] curveVertexCounts = [4]  # counts
        int[] order = [4]  # counts
        double[] knots = [0, 0, 0, 0, 1, 1, 1, 1]  # knots
        double2[] ranges = [(0, 1)]  # ranges
        double[] pointWeights = [1, 2, 1, 1]  # weights
        float[] widths = [0.5] (interpolation = "constant")
    }""")

SOUND["points"] = _sound("""
    def Points "Dust" {
        point3f[] points = [(0, 0, 0), (0, 1, 0), (1, 1, 0)]  # points
        float[] widths = [0.25, 0.5, 0.25] (interpolation = "vertex")  # widths
        int64[] ids = [0, 1, 2]  # ignored
    }
    def Points "Spray" {
        point3f[] points = [(0, 0, 0), (0, 1, 0)]
        vector3f[] velocities = [(0, 0, 1), (0, 0, 1)]  # velocities
    }""")

SOUND["instancer"] = _sound(f"""
    def PointInstancer "Trees" {{
        int[] protoIndices = [0, 1, 0]  # indices
        point3f[] positions = [(0, 0, 0), (4, 0, 0), (8, 0, 0)]  # points
        quath[] orientations = [(1, 0, 0, 0), (1, 0, 0, 0), (0, 1, 0, 0)]  # quaternions
        float3[] scales = [(1, 1, 1), (2, 2, 2), (1, 1, 1)]  # scales
        int64[] ids = [5, 6, 7]  # ids
        int64[] invisibleIds = [7]  # invisible
        rel prototypes = [</Root/Trees/Box>, </Root/Trees/Ball>]  # targets
        def Mesh "Box" {{  # points=bare{CUBE}        }}
        def Sphere "Ball" {{
            double radius = 0.5
        }}
    }}""")

SOUND["instances"] = _sound(f"""
    color3f[] primvars:displayColor = [(0.5, 0.5, 1)] (interpolation = "constant")  # inherited
    class "Proto" {{
        def Mesh "Box" {{{CUBE}        }}
    }}
    def Xform "A" (instanceable = true; inherits = </Root/Proto>) {{
        double3 xformOp:translate = (0, 4, 0)  # placement
        double3 xformOp:rotateXYZ = (0, 90, 0)  # turn
        float3 xformOp:scale = (1, 2, 1)  # scale
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ", "xformOp:scale"]  # order
    }}
    def Xform "B" (instanceable = true; inherits = </Root/Proto>) {{
        matrix4d xformOp:transform = ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (8, 0, 0, 1))  # placement
        uniform token[] xformOpOrder = ["xformOp:transform"]  # order
        token visibility = "inherited"  # visibility
        uniform token purpose = "default"  # purpose
        float primvars:rust = 0.5 (interpolation = "constant")  # inherited
    }}""")

_TWO = f"[{_IDENTITY}, ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 2, 0, 1))]"
SOUND["skel"] = _sound(f"""
    def SkelRoot "Puppet" {{
        def Mesh "Skin" (prepend apiSchemas = ["SkelBindingAPI"]) {{  # points=points
            uniform token subdivisionScheme = "none"{_SQUARE}
            int[] primvars:skel:jointIndices = [0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1] (interpolation = "vertex"; elementSize = 2)  # joint_indices
            float[] primvars:skel:jointWeights = [1, 0, 0.5, 0.5, 1, 0, 0, 1, 0.5, 0.5, 0, 1] (interpolation = "vertex"; elementSize = 2)  # joint_weights
            token primvars:skel:skinningMethod = "classicLinear"  # token
            matrix4d primvars:skel:geomBindTransform = {_IDENTITY}  # matrix
            uniform token[] skel:joints = ["Hip", "Hip/Knee"]  # own_joints
            rel skel:skeleton = </Root/Puppet/Bones>  # target
            uniform token[] skel:blendShapes = ["Smile", "Frown"]  # names
            rel skel:blendShapeTargets = [</Root/Puppet/Skin/Smile>, </Root/Puppet/Skin/Frown>]  # targets
            def BlendShape "Smile" {{
                uniform vector3f[] offsets = [(0, 0, 1), (0, 0.5, 0)]  # offsets
                uniform vector3f[] normalOffsets = [(0, 0, 0), (0, 0, 0)]  # offsets
                uniform int[] pointIndices = [1, 2]  # fixed_indices
                uniform vector3f[] inbetweens:half = [(0, 0, 0.25), (0, 0.5, 0)] (weight = 0.5)  # offsets
            }}
            def BlendShape "Frown" {{
                uniform vector3f[] offsets = [(0, 0, 1), (0, 0, 1), (0, 0, 1), (0, 0, 1), (0, 0, 1), (0, 0, 1)]
            }}
        }}
        def Skeleton "Bones" (prepend apiSchemas = ["SkelBindingAPI"]) {{
            uniform token[] joints = ["Hip", "Hip/Knee"]  # joints
            uniform matrix4d[] bindTransforms = {_TWO}  # matrices
            uniform matrix4d[] restTransforms = {_TWO}  # matrices
            rel skel:animationSource = </Root/Puppet/Walk>  # lenient
        }}
        def SkelAnimation "Walk" {{
            uniform token[] joints = ["Hip", "Hip/Knee"]  # animated
            float3[] translations = [(0, 0, 1), (0, 2, 0)]  # components
            quatf[] rotations = [(1, 0, 0, 0), (0, 1, 0, 0)]  # components
            half3[] scales = [(1, 1, 1), (1, 1, 1)]  # components
            uniform token[] blendShapes = ["Smile", "Frown"]  # names
            float[] blendShapeWeights = [0.75, 0.5]  # morphs
        }}
    }}""")

PIXELS = png(
    4,
    4,
    b"".join(b"\0" + bytes((37 * (4 * y + x) + 80 * c) % 256 for x in range(4) for c in range(3)) for y in range(4)),
)
"""An image of pixels that differ."""
SOUND["materials"] = _sound(
    f"""
    def Mesh "Body" (
        prepend apiSchemas = ["MaterialBindingAPI", "CollectionAPI:paint"]
    ) {{
        uniform token subdivisionScheme = "none"{_SQUARE}
        texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1), (0, 1), (1, 1)] (interpolation = "vertex")
        rel material:binding = </Root/Looks/Preview>  # binding
        rel collection:paint:includes = </Root/Body>  # members
        uniform token collection:paint:expansionRule = "expandPrims"  # expansion
    }}
    def Mesh "Second" (prepend apiSchemas = ["MaterialBindingAPI"]) {{{CUBE}
        rel material:binding = </Root/Looks/Standard>  # binding
    }}
    def Scope "Looks" {{
        def Material "Preview" {{
            token outputs:surface.connect = </Root/Looks/Preview/Surface.outputs:surface>  # terminal
            def Shader "Surface" {{
                uniform token info:id = "UsdPreviewSurface"  # shader
                color3f inputs:diffuseColor.connect = </Root/Looks/Preview/Image.outputs:rgb>  # connection
                float inputs:roughness = 0.25  # input
                float inputs:metallic = 0.5  # input
                token outputs:surface
            }}
            def Shader "Image" {{
                uniform token info:id = "UsdUVTexture"  # shader
                asset inputs:file = @color.png@  # image
                token inputs:wrapS = "repeat"  # input
                token inputs:sourceColorSpace = "sRGB"  # input
                float4 inputs:scale = (1, 0.5, 1, 1)  # input
                float2 inputs:st.connect = </Root/Looks/Preview/Turn.outputs:result>  # connection
                float3 outputs:rgb
            }}
            def Shader "Turn" {{
                uniform token info:id = "UsdTransform2d"
                float2 inputs:in.connect = </Root/Looks/Preview/Reader.outputs:result>  # connection
                float inputs:rotation = 90  # input
                float2 outputs:result
            }}
            def Shader "Reader" {{
                uniform token info:id = "UsdPrimvarReader_float2"
                string inputs:varname = "st"  # varname
                float2 outputs:result
            }}
        }}
        def Material "Standard" {{
            token outputs:mtlx:surface.connect = </Root/Looks/Standard/Surface.outputs:out>  # terminal
            def Shader "Surface" {{
                uniform token info:id = "ND_standard_surface_surfaceshader"
                float inputs:base = 1
                color3f inputs:base_color.connect = </Root/Looks/Standard/Mul.outputs:out>  # connection
                float inputs:specular_roughness = 0.5  # input
                token outputs:out
            }}
            def Shader "Mul" {{
                uniform token info:id = "ND_multiply_color3"  # shader
                color3f inputs:in1 = (0.5, 0.25, 1)  # input
                color3f inputs:in2 = (0.5, 1, 1)
                color3f outputs:out
            }}
        }}
    }}""",
    files={"color.png": PIXELS},
    collection="/Root/Body.collection:paint",
    packs=False,
)

SOUND["camera"] = _sound(
    f"""
    def Mesh "Body" {{{CUBE}    }}
    def Camera "Shot" {{
        float focalLength = 50  # lens
        float horizontalAperture = 36  # lens
        float verticalAperture = 24  # lens
        float horizontalApertureOffset = 1  # number
        float verticalApertureOffset = 0  # number
        float fStop = 4  # number
        float focusDistance = 10  # number
        float2 clippingRange = (0.5, 1000)  # clipping
        token projection = "perspective"  # token
        double3 xformOp:translate = (0, 0, 16)  # placement
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }}""",
    camera="/Root/Shot",
)

SOUND["samples"] = _sound(
    f"""
    def Mesh "Body" {{
        uniform token subdivisionScheme = "none"
        point3f[] points.timeSamples = {{ 1: [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], 5: [(0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)] }}  # sampled
        int[] faceVertexCounts.timeSamples = {{ 1: [4], 5: [4] }}  # sampled
        int[] faceVertexIndices.timeSamples = {{ 1: [0, 1, 2, 3], 5: [0, 1, 2, 3] }}  # sampled
        float[] primvars:wear.timeSamples = {{ 1: [0.5], 5: [1] }}  # sampled
        token visibility.timeSamples = {{ 1: "inherited", 5: "inherited" }}
        double3 xformOp:translate.timeSamples = {{ 1: (0, 0, 0), 5: (0, 4, 0) }}
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }}
    def Mesh "Second" {{{CUBE}    }}""",
    "    startTimeCode = 1\n    endTimeCode = 5\n",
    time=3.0,
)
