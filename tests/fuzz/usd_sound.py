"""Sound USD assets, small, with the places where each can be made wrong.

A `Spot` is an attribute or relationship and its role: `usd_mutations.ROLES` says what can be wrong with one of that
role, and what must then be said.
"""

# ruff: noqa: E501
from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass, field

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
    """A property of a prim. `named` is what a message must name where that is not the prim's path."""

    prim: str
    name: str
    role: str
    named: str = ""


@dataclass(frozen=True)
class Sound:
    """A sound asset: the text of its layer, the files beside it, how it is read, and its spots."""

    text: str
    spots: tuple[Spot, ...]
    files: dict[str, str | bytes] = field(default_factory=dict)
    time: float | None = None
    camera: str | None = None
    collection: str | None = None
    variants: tuple[tuple[str, str], ...] = ()
    layer: str | None = None
    packs: bool = True
    """Whether it may be packed in an archive, or referenced: it has no files beside it."""


def _spots(prim: str, **roles: str) -> tuple[Spot, ...]:
    return tuple(Spot(prim, name.replace("__", ":"), role) for name, role in roles.items())


def _stage(body: str, more: str = "") -> str:
    return (
        f'#usda 1.0\n(\n    defaultPrim = "Root"\n    metersPerUnit = 0.5\n    upAxis = "Y"\n{more})\n\n'
        f'def Xform "Root"\n{{\n{body}\n}}\n'
    )


SOUND: dict[str, Sound] = {}

SOUND["mesh"] = Sound(
    _stage(f"""
    def Mesh "Body" (prepend apiSchemas = ["MaterialBindingAPI"])
    {{{_SQUARE}
        uniform token subdivisionScheme = "none"
        uniform token orientation = "rightHanded"
        normal3f[] normals = [(0, 0, 1), (0, 0, 1), (0, 0.5, 1), (0, 0, 1), (0, 0, 1), (0, 0, 1), (0.5, 0, 1), (0, 0, 1)] (interpolation = "faceVarying")
        texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = "faceVarying")
        int[] primvars:st:indices = [0, 1, 2, 3, 0, 1, 2, 3]
        float[] primvars:wear = [0, 0.25, 0.5, 0.75, 1, 1] (interpolation = "vertex")
        color3f[] primvars:displayColor = [(1, 0, 0), (0, 0.5, 0)] (interpolation = "uniform")
        float primvars:rust = 0.5 (interpolation = "constant")
        float3[] extent = [(0, 0, 0), (2, 1, 0.5)]
        uniform bool doubleSided = 1
        int[] holeIndices = []
        uniform token subsetFamily:materialBind:familyType = "nonOverlapping"
        def GeomSubset "Left" (prepend apiSchemas = ["MaterialBindingAPI"])
        {{
            uniform token elementType = "face"
            uniform token familyName = "materialBind"
            int[] indices = [0]
        }}
    }}
    def Mesh "Second"
    {{{CUBE}
        uniform token subdivisionScheme = "none"
        token visibility = "inherited"
        uniform token purpose = "render"
    }}"""),
    (
        *_spots(
            "/Root/Body",
            points="points",
            faceVertexCounts="counts",
            faceVertexIndices="indices",
            subdivisionScheme="token",
            orientation="token",
            normals="normals",
            primvars__st="uv",
            primvars__st__indices="uv_indices",
            primvars__wear="primvar",
            primvars__displayColor="color",
            primvars__rust="constant",
            extent="unread",
            doubleSided="unread",
            holeIndices="holes",
        ),
        *_spots("/Root/Body/Left", indices="subset", elementType="token"),
        *_spots("/Root/Second", points="bare", visibility="visibility", purpose="purpose"),
    ),
)

SOUND["cage"] = Sound(
    _stage(f"""
    def Mesh "Body"
    {{{CUBE}
        uniform token subdivisionScheme = "catmullClark"
        uniform token interpolateBoundary = "edgeAndCorner"
        uniform token faceVaryingLinearInterpolation = "cornersPlus1"
        uniform token triangleSubdivisionRule = "catmullClark"
        int[] creaseIndices = [0, 1, 2, 4, 5, 6]
        int[] creaseLengths = [3, 3]
        float[] creaseSharpnesses = [2, 10]
        int[] cornerIndices = [6, 7]
        float[] cornerSharpnesses = [10, 1.5]
        int[] holeIndices = [5]
        normal3f[] normals = [(0, 0, 1)] (interpolation = "constant")
        texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1), (0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = "vertex")
    }}
    def Mesh "Loop"
    {{
        point3f[] points = [(0, 0, 4), (1, 0, 4), (0, 1, 4), (0, 0, 5)]
        int[] faceVertexCounts = [3, 3, 3, 3]
        int[] faceVertexIndices = [0, 2, 1, 0, 1, 3, 1, 2, 3, 2, 0, 3]
        uniform token subdivisionScheme = "loop"
    }}"""),
    (
        *_spots(
            "/Root/Body",
            points="points",
            faceVertexCounts="counts",
            faceVertexIndices="indices",
            subdivisionScheme="token",
            interpolateBoundary="token",
            faceVaryingLinearInterpolation="token",
            triangleSubdivisionRule="token",
            creaseIndices="indices",
            creaseLengths="counts",
            creaseSharpnesses="sharpness",
            cornerIndices="indices",
            cornerSharpnesses="sharpness",
            holeIndices="holes",
            normals="unread",
            primvars__st="uv",
        ),
        *_spots("/Root/Loop", points="bare", faceVertexCounts="counts", faceVertexIndices="indices"),
    ),
)

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
    _axis = '\n        uniform token axis = "X"' if _kind not in ("Sphere", "Cube") else ""
    SOUND[_kind] = Sound(
        _stage(
            f'    def {_kind} "Body"\n    {{{_axis}\n'
            + "\n".join(f"        double {name} = {1.5 + i}" for i, name in enumerate(_names))
            + f'\n        color3f[] primvars:displayColor = [(1, 0, 0)]\n    }}\n    def Mesh "Second"\n    {{{CUBE}    }}'
        ),
        (
            *(
                Spot("/Root/Body", name, "size" if name.endswith(("size", "radius", "width", "length")) else "part")
                for name in _names
            ),
            *(_spots("/Root/Body", axis="token") if _axis else ()),
        ),
    )

SOUND["curves"] = Sound(
    _stage("""
    def BasisCurves "Hair"
    {
        point3f[] points = [(0, 0, 0), (0, 1, 0), (1, 1, 0), (1, 2, 0), (3, 0, 0), (3, 1, 0), (4, 1, 1), (4, 2, 0)]
        int[] curveVertexCounts = [4, 4]
        float[] widths = [0.25, 0.125, 0.25, 0.25, 0.5, 0.25, 0.25, 0.25] (interpolation = "vertex")
        uniform token type = "cubic"
        uniform token basis = "bezier"
        uniform token wrap = "nonperiodic"
        float[] primvars:wear = [0.5, 1, 0.5, 1, 0.5, 1, 0.5, 1] (interpolation = "vertex")
    }
    def BasisCurves "Grass"
    {
        point3f[] points = [(0, 0, 3), (0, 1, 3), (1, 1, 3)]
        int[] curveVertexCounts = [3]
        normal3f[] normals = [(0, 0, 1)] (interpolation = "constant")
        float[] widths = [0.5] (interpolation = "constant")
        uniform token type = "linear"
    }
    def NurbsCurves "Wire"
    {
        point3f[] points = [(0, 0, 5), (0, 1, 5), (1, 1, 5), (1, 2, 5)]
        int[] curveVertexCounts = [4]
        int[] order = [4]
        double[] knots = [0, 0, 0, 0, 1, 1, 1, 1]
        double2[] ranges = [(0, 1)]
        double[] pointWeights = [1, 2, 1, 1]
        float[] widths = [0.5] (interpolation = "constant")
    }"""),
    (
        *_spots(
            "/Root/Hair",
            points="points",
            curveVertexCounts="counts",
            widths="widths",
            type="token",
            basis="token",
            wrap="token",
            primvars__wear="primvar",
        ),
        *_spots("/Root/Grass", points="points", normals="normals", widths="width"),
        *_spots(
            "/Root/Wire",
            points="points",
            curveVertexCounts="counts",
            order="counts",
            knots="knots",
            ranges="ranges",
            pointWeights="weights",
        ),
    ),
)

SOUND["points"] = Sound(
    _stage("""
    def Points "Dust"
    {
        point3f[] points = [(0, 0, 0), (0, 1, 0), (1, 1, 0)]
        float[] widths = [0.25, 0.5, 0.25] (interpolation = "vertex")
        int64[] ids = [0, 1, 2]
    }
    def Points "Spray"
    {
        point3f[] points = [(0, 0, 0), (0, 1, 0)]
        vector3f[] velocities = [(0, 0, 1), (0, 0, 1)]
    }"""),
    (
        *_spots("/Root/Dust", points="points", widths="widths", ids="ignored"),
        *_spots("/Root/Spray", velocities="velocities"),
    ),
)

SOUND["instancer"] = Sound(
    _stage(f"""
    def PointInstancer "Trees"
    {{
        int[] protoIndices = [0, 1, 0]
        point3f[] positions = [(0, 0, 0), (4, 0, 0), (8, 0, 0)]
        quath[] orientations = [(1, 0, 0, 0), (1, 0, 0, 0), (0, 1, 0, 0)]
        float3[] scales = [(1, 1, 1), (2, 2, 2), (1, 1, 1)]
        int64[] ids = [5, 6, 7]
        int64[] invisibleIds = [7]
        rel prototypes = [</Root/Trees/Box>, </Root/Trees/Ball>]
        def Mesh "Box"
        {{{CUBE}        }}
        def Sphere "Ball"
        {{
            double radius = 0.5
        }}
    }}"""),
    (
        *_spots(
            "/Root/Trees",
            protoIndices="indices",
            positions="points",
            orientations="quaternions",
            scales="scales",
            ids="ids",
            invisibleIds="invisible",
            prototypes="targets",
        ),
        *_spots("/Root/Trees/Box", points="bare"),
    ),
)

SOUND["instances"] = Sound(
    _stage(f"""
    color3f[] primvars:displayColor = [(0.5, 0.5, 1)] (interpolation = "constant")
    class "Proto"
    {{
        def Mesh "Box"
        {{{CUBE}        }}
    }}
    def Xform "A" (instanceable = true; inherits = </Root/Proto>)
    {{
        double3 xformOp:translate = (0, 4, 0)
        double3 xformOp:rotateXYZ = (0, 90, 0)
        float3 xformOp:scale = (1, 2, 1)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ", "xformOp:scale"]
    }}
    def Xform "B" (instanceable = true; inherits = </Root/Proto>)
    {{
        matrix4d xformOp:transform = ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (8, 0, 0, 1))
        uniform token[] xformOpOrder = ["xformOp:transform"]
        token visibility = "inherited"
        uniform token purpose = "default"
        float primvars:rust = 0.5 (interpolation = "constant")
    }}"""),
    (
        *_spots("/Root", primvars__displayColor="inherited"),
        *_spots(
            "/Root/A",
            xformOp__translate="placement",
            xformOp__rotateXYZ="turn",
            xformOp__scale="scale",
            xformOpOrder="order",
        ),
        *_spots(
            "/Root/B",
            xformOp__transform="placement",
            xformOpOrder="order",
            visibility="visibility",
            purpose="purpose",
            primvars__rust="inherited",
        ),
    ),
)

_TWO = f"[{_IDENTITY}, ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 2, 0, 1))]"
SOUND["skel"] = Sound(
    _stage(f"""
    def SkelRoot "Puppet"
    {{
        def Mesh "Skin" (prepend apiSchemas = ["SkelBindingAPI"])
        {{
            uniform token subdivisionScheme = "none"{_SQUARE}
            int[] primvars:skel:jointIndices = [0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1] (interpolation = "vertex"; elementSize = 2)
            float[] primvars:skel:jointWeights = [1, 0, 0.5, 0.5, 1, 0, 0, 1, 0.5, 0.5, 0, 1] (interpolation = "vertex"; elementSize = 2)
            token primvars:skel:skinningMethod = "classicLinear"
            matrix4d primvars:skel:geomBindTransform = {_IDENTITY}
            uniform token[] skel:joints = ["Hip", "Hip/Knee"]
            rel skel:skeleton = </Root/Puppet/Bones>
            uniform token[] skel:blendShapes = ["Smile", "Frown"]
            rel skel:blendShapeTargets = [</Root/Puppet/Skin/Smile>, </Root/Puppet/Skin/Frown>]
            def BlendShape "Smile"
            {{
                uniform vector3f[] offsets = [(0, 0, 1), (0, 0.5, 0)]
                uniform vector3f[] normalOffsets = [(0, 0, 0), (0, 0, 0)]
                uniform int[] pointIndices = [1, 2]
                uniform vector3f[] inbetweens:half = [(0, 0, 0.25), (0, 0.5, 0)] (weight = 0.5)
            }}
            def BlendShape "Frown"
            {{
                uniform vector3f[] offsets = [(0, 0, 1), (0, 0, 1), (0, 0, 1), (0, 0, 1), (0, 0, 1), (0, 0, 1)]
            }}
        }}
        def Skeleton "Bones" (prepend apiSchemas = ["SkelBindingAPI"])
        {{
            uniform token[] joints = ["Hip", "Hip/Knee"]
            uniform matrix4d[] bindTransforms = {_TWO}
            uniform matrix4d[] restTransforms = {_TWO}
            rel skel:animationSource = </Root/Puppet/Walk>
        }}
        def SkelAnimation "Walk"
        {{
            uniform token[] joints = ["Hip", "Hip/Knee"]
            float3[] translations = [(0, 0, 1), (0, 2, 0)]
            quatf[] rotations = [(1, 0, 0, 0), (0, 1, 0, 0)]
            half3[] scales = [(1, 1, 1), (1, 1, 1)]
            uniform token[] blendShapes = ["Smile", "Frown"]
            float[] blendShapeWeights = [0.75, 0.5]
        }}
    }}"""),
    (
        *_spots(
            "/Root/Puppet/Skin",
            points="points",
            primvars__skel__jointIndices="joint_indices",
            primvars__skel__jointWeights="joint_weights",
            primvars__skel__skinningMethod="token",
            primvars__skel__geomBindTransform="matrix",
            skel__joints="own_joints",
            skel__skeleton="target",
            skel__blendShapes="names",
            skel__blendShapeTargets="targets",
        ),
        *_spots(
            "/Root/Puppet/Skin/Smile",
            offsets="offsets",
            normalOffsets="offsets",
            pointIndices="fixed_indices",
            inbetweens__half="offsets",
        ),
        *_spots("/Root/Puppet/Bones", joints="joints", bindTransforms="matrices", restTransforms="matrices"),
        *_spots("/Root/Puppet/Bones", skel__animationSource="lenient"),
        *_spots(
            "/Root/Puppet/Walk",
            joints="animated",
            translations="components",
            rotations="components",
            scales="components",
            blendShapes="names",
            blendShapeWeights="morphs",
        ),
    ),
)


def _png() -> bytes:
    """Return a PNG of 4 x 4 pixels that differ."""
    rows = b"".join(
        b"\0" + bytes((37 * (4 * y + x) + 80 * c) % 256 for x in range(4) for c in range(3)) for y in range(4)
    )
    chunks = ((b"IHDR", struct.pack(">IIBBBBB", 4, 4, 8, 2, 0, 0, 0)), (b"IDAT", zlib.compress(rows)), (b"IEND", b""))
    packed = (struct.pack(">I", len(d)) + k + d + struct.pack(">I", zlib.crc32(k + d)) for k, d in chunks)
    return b"\x89PNG\r\n\x1a\n" + b"".join(packed)


PIXELS = _png()
SOUND["materials"] = Sound(
    _stage(f"""
    def Mesh "Body" (
        prepend apiSchemas = ["MaterialBindingAPI", "CollectionAPI:paint"]
    )
    {{
        uniform token subdivisionScheme = "none"{_SQUARE}
        texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1), (0, 1), (1, 1)] (interpolation = "vertex")
        rel material:binding = </Root/Looks/Preview>
        rel collection:paint:includes = </Root/Body>
        uniform token collection:paint:expansionRule = "expandPrims"
    }}
    def Mesh "Second" (prepend apiSchemas = ["MaterialBindingAPI"])
    {{{CUBE}
        rel material:binding = </Root/Looks/Standard>
    }}
    def Scope "Looks"
    {{
        def Material "Preview"
        {{
            token outputs:surface.connect = </Root/Looks/Preview/Surface.outputs:surface>
            def Shader "Surface"
            {{
                uniform token info:id = "UsdPreviewSurface"
                color3f inputs:diffuseColor.connect = </Root/Looks/Preview/Image.outputs:rgb>
                float inputs:roughness = 0.25
                float inputs:metallic = 0.5
                token outputs:surface
            }}
            def Shader "Image"
            {{
                uniform token info:id = "UsdUVTexture"
                asset inputs:file = @color.png@
                token inputs:wrapS = "repeat"
                token inputs:sourceColorSpace = "sRGB"
                float4 inputs:scale = (1, 0.5, 1, 1)
                float2 inputs:st.connect = </Root/Looks/Preview/Turn.outputs:result>
                float3 outputs:rgb
            }}
            def Shader "Turn"
            {{
                uniform token info:id = "UsdTransform2d"
                float2 inputs:in.connect = </Root/Looks/Preview/Reader.outputs:result>
                float inputs:rotation = 90
                float2 outputs:result
            }}
            def Shader "Reader"
            {{
                uniform token info:id = "UsdPrimvarReader_float2"
                string inputs:varname = "st"
                float2 outputs:result
            }}
        }}
        def Material "Standard"
        {{
            token outputs:mtlx:surface.connect = </Root/Looks/Standard/Surface.outputs:out>
            def Shader "Surface"
            {{
                uniform token info:id = "ND_standard_surface_surfaceshader"
                float inputs:base = 1
                color3f inputs:base_color.connect = </Root/Looks/Standard/Mul.outputs:out>
                float inputs:specular_roughness = 0.5
                token outputs:out
            }}
            def Shader "Mul"
            {{
                uniform token info:id = "ND_multiply_color3"
                color3f inputs:in1 = (0.5, 0.25, 1)
                color3f inputs:in2 = (0.5, 1, 1)
                color3f outputs:out
            }}
        }}
    }}"""),
    (
        Spot("/Root/Body", "material:binding", "binding"),
        Spot("/Root/Second", "material:binding", "binding"),
        Spot("/Root/Body", "collection:paint:includes", "members"),
        Spot("/Root/Body", "collection:paint:expansionRule", "expansion"),
        Spot("/Root/Looks/Preview", "outputs:surface", "terminal"),
        Spot("/Root/Looks/Preview/Surface", "info:id", "shader"),
        Spot("/Root/Looks/Preview/Surface", "inputs:diffuseColor", "connection"),
        Spot("/Root/Looks/Preview/Surface", "inputs:roughness", "input"),
        Spot("/Root/Looks/Preview/Surface", "inputs:metallic", "input"),
        Spot("/Root/Looks/Preview/Image", "info:id", "shader"),
        Spot("/Root/Looks/Preview/Image", "inputs:wrapS", "input"),
        Spot("/Root/Looks/Preview/Image", "inputs:sourceColorSpace", "input"),
        Spot("/Root/Looks/Preview/Image", "inputs:scale", "input"),
        Spot("/Root/Looks/Preview/Image", "inputs:st", "connection"),
        Spot("/Root/Looks/Preview/Image", "inputs:file", "image"),
        Spot("/Root/Looks/Preview/Turn", "inputs:rotation", "input"),
        Spot("/Root/Looks/Preview/Turn", "inputs:in", "connection"),
        Spot("/Root/Looks/Preview/Reader", "inputs:varname", "varname"),
        Spot("/Root/Looks/Standard", "outputs:mtlx:surface", "terminal"),
        Spot("/Root/Looks/Standard/Surface", "inputs:specular_roughness", "input"),
        Spot("/Root/Looks/Standard/Surface", "inputs:base_color", "connection"),
        Spot("/Root/Looks/Standard/Mul", "info:id", "shader"),
        Spot("/Root/Looks/Standard/Mul", "inputs:in1", "input"),
    ),
    files={"color.png": PIXELS},
    collection="/Root/Body.collection:paint",
    packs=False,
)

SOUND["camera"] = Sound(
    _stage(f"""
    def Mesh "Body"
    {{{CUBE}    }}
    def Camera "Shot"
    {{
        float focalLength = 50
        float horizontalAperture = 36
        float verticalAperture = 24
        float horizontalApertureOffset = 1
        float verticalApertureOffset = 0
        float fStop = 4
        float focusDistance = 10
        float2 clippingRange = (0.5, 1000)
        token projection = "perspective"
        double3 xformOp:translate = (0, 0, 16)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }}"""),
    (
        *_spots(
            "/Root/Shot",
            focalLength="lens",
            horizontalAperture="lens",
            verticalAperture="lens",
            horizontalApertureOffset="number",
            verticalApertureOffset="number",
            fStop="number",
            focusDistance="number",
            clippingRange="clipping",
            projection="token",
            xformOp__translate="placement",
        ),
    ),
    camera="/Root/Shot",
)

SOUND["samples"] = Sound(
    _stage(
        f"""
    def Mesh "Body"
    {{
        uniform token subdivisionScheme = "none"
        point3f[] points.timeSamples = {{
            1: [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)],
            5: [(0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)],
        }}
        int[] faceVertexCounts.timeSamples = {{ 1: [4], 5: [4] }}
        int[] faceVertexIndices.timeSamples = {{ 1: [0, 1, 2, 3], 5: [0, 1, 2, 3] }}
        float[] primvars:wear.timeSamples = {{ 1: [0.5], 5: [1] }}
        token visibility.timeSamples = {{ 1: "inherited", 5: "inherited" }}
        double3 xformOp:translate.timeSamples = {{ 1: (0, 0, 0), 5: (0, 4, 0) }}
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }}
    def Mesh "Second"
    {{{CUBE}    }}""",
        "    startTimeCode = 1\n    endTimeCode = 5\n",
    ),
    _spots(
        "/Root/Body",
        points="sampled",
        faceVertexCounts="sampled",
        faceVertexIndices="sampled",
        primvars__wear="sampled",
    ),
    time=3.0,
)
