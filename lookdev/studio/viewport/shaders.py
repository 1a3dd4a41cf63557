"""The shaders of the viewport: hand-written GLSL around the generated functions of a look and of the lights."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from functools import cache
from importlib.resources import files

from lookdev.asset import Asset
from lookdev.codegen.glsl.functions import PRELUDE
from lookdev.codegen.glsl.look import TEXTURE_FUNCTIONS, LookFunctions
from lookdev.codegen.glsl.rig import RigFunctions
from lookdev.studio.viewport.geometry import WIDTH, CornerTexels
from lookdev.studio.viewport.hierarchy import FIRST_BITS

_HEAD = """#version 300 es
precision highp float;
precision highp int;
precision highp sampler2D;
precision highp isampler2D;
precision highp usampler2D;
"""

BSDF_SAMPLES, LIGHT_SAMPLES = 1, 1
"""Directions that a pixel samples in a frame: by the BSDF, and by the lights.

A look that transmits samples the lights once for each side of the surface.
"""


@dataclass(frozen=True)
class LookShaders:
    """The fragment shaders of a look: `visible` finds the surface that a pixel sees, and `relight` computes its light.

    Looks with equal shaders share a WebGL program.
    """

    visible: str
    relight: str


@cache
def _sections(name: str) -> Mapping[str, str]:
    """Return the sections of a GLSL file, by name; a line ``//@ section NAME`` begins each."""
    text = (files("lookdev") / "shaders" / name).read_text(encoding="utf-8")
    parts = re.split(r"^//@ section (\w+)\n", text, flags=re.MULTILINE)
    return dict(zip(parts[1::2], parts[2::2], strict=True))


@cache
def _sobol() -> str:
    """Return the GLSL functions of Sobol points; the file is OSL, which differs from GLSL by one qualifier only."""
    text = (files("lookdev") / "shaders" / "sobol.h").read_text(encoding="utf-8")
    return re.sub(r"\boutput\b", "out", text)


def vertex_shader() -> str:
    """Return the vertex shader of visible triangles."""
    visible = _sections("visible.glsl")
    return _HEAD + visible["camera"] + visible["vertex"]


def background_shader(rig: RigFunctions) -> str:
    """Return the fragment shader of the background, in which the camera sees lights."""
    camera, behind = _sections("visible.glsl")["camera"], _sections("display.glsl")["behind"]
    defines = "#define TRANSMITS 0\n#define LIT 1\n#define SHADOWS 0\n"
    return "".join([_HEAD, defines, camera, PRELUDE, rig.text, behind])


def display_shader(view: str) -> str:
    """Return the fragment shader that converts light to code values of the display.

    `view` is the text of a GLSL function ``view``, which OpenColorIO generates for the conversion.
    """
    return "".join([_HEAD, "precision highp sampler3D;\n", view, _sections("display.glsl")["develop"]])


class Shadows(IntEnum):
    """The shadows of a look, as the macro `SHADOWS` of its shaders selects them."""

    NONE = 0
    TRACED = 1
    BEHIND = 2
    """The asset occludes all light from behind the surface, and no other light."""

    @classmethod
    def of(cls, asset: Asset, look: LookFunctions, rig: RigFunctions) -> Shadows:
        """Return the shadows of a look on an asset under a rig.

        A convex asset occludes no light from the front of its surface. If it is a sheet, it occludes no light at all.
        """
        if not asset.convex:
            return cls.TRACED
        if asset.sheet or not (look.program.transmits or look.program.see_through):
            return cls.NONE
        # In a rig that is not plain, whether light is occluded depends on the distance or the group of the occluder.
        return cls.BEHIND if rig.plain else cls.TRACED


def look_shaders(
    look: LookFunctions, rig: RigFunctions, corners: CornerTexels, shadows: Shadows, convex: bool
) -> LookShaders:
    """Return the fragment shaders of a look under a rig; `convex` states whether the asset is convex.

    The sections of the shaders' files are joined with generated functions. Macros have the constants of the look, the
    rig and the texture of `corners`.
    """
    visible, relight = _sections("visible.glsl"), _sections("relight.glsl")
    shadow = (files("lookdev") / "shaders" / "shadow.glsl").read_text(encoding="utf-8")
    constants = {
        "TRANSMITS": int(look.program.transmits),
        "SEE_THROUGH": int(look.program.see_through),
        "DRAWN": BSDF_SAMPLES,  # directions that the BSDF samples
        "LIT": LIGHT_SAMPLES * (1 + look.program.transmits),  # directions that the lights sample
        "DIRECTIONS": f"(DRAWN + LIT + {look.program.deltas})",  # all directions, also of delta lobes
        "SHADOWS": int(shadows),
        "TRACED": (1 + look.program.transmits) * (shadows == Shadows.TRACED),  # sides with a shadow ray
        "CONVEX": int(convex),
        "OCCLUDERS": corners.hierarchy_start,
        "OCCLUDER_NODES": corners.hierarchy_nodes,
        "FIRST_BITS": f"{FIRST_BITS}u",
        "STRIDE": corners.stride,
        "CORNERS_WIDTH": WIDTH,
        "CORNERS_SHIFT": WIDTH.bit_length() - 1,
    }
    defines = "".join(f"#define {name} {value}\n" for name, value in constants.items())
    attribute_reads = "\n".join(
        f"    {'mesh_tangent' if name == 'shading_tangent' else name} = {corners.attribute_expression(binding)};"
        for name, binding in ((binding.parameter, binding) for binding in look.program.attributes)
    )
    surface = relight["surface"].replace("//@ attributes", attribute_reads)
    deltas = "".join(
        f"        if (k == DRAWN + LIT + {k}) look_delta{k}(wi, here.value);\n" for k in range(look.program.deltas)
    )
    if deltas:
        deltas += "        if (k >= DRAWN + LIT) {\n            here.w = surface_world(wi);\n"
        deltas += "            here.diffuse = vec3(0.0);\n        }\n"
    parts = [_HEAD, defines, visible["camera"], PRELUDE, _sobol(), TEXTURE_FUNCTIONS, look.text]
    visible_shader = f"{_HEAD}#define SEE_THROUGH 0\n{visible['fragment']}"
    if look.program.see_through:
        declared, _, main = visible["fragment"].partition("void main()")
        visible_shader = "".join([*parts, declared, surface, relight["absent"], "void main()", main])
    main = relight["main"].replace("//@ deltas\n", deltas)
    return LookShaders(visible_shader, "".join([*parts, rig.text, surface, shadow, main]))
