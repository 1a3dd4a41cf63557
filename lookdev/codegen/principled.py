"""Translate a look of Disney's model into Blender's Principled BSDF, which the benchmark compares with it.

The two models differ, so their pictures are similar, not equal. Sampling one is as hard as sampling the other.
"""

from __future__ import annotations

import math

import numpy as np

from lookdev.brdf import complete_parameters
from lookdev.brdf.vectors import Parameters
from lookdev.codegen.source import PrincipledSource
from lookdev.errors import CodegenError
from lookdev.material import Look, Varying

# Parameters of Disney's model that have a counterpart in the Principled BSDF.
_SUPPORTED = ("baseColor", "metallic", "roughness", "anisotropic", "clearcoat", "clearcoatGloss")


def generate_principled(look: Look) -> PrincipledSource:
    """Return the Principled BSDF that is most similar to a look of one Disney layer with constant inputs.

    Disney's clearcoat is a quarter as strong as Blender's coat. The clearcoat's alpha is 0.1 at a gloss of 0 and 0.001
    at a gloss of 1 (Burley 2012, section 5.6). Blender's coat roughness is the square root of alpha.

    Raises
    ------
    CodegenError
        The look has other layers, or an input that the Principled BSDF does not have.
    """
    prefix = f"{look.name}: the Principled BSDF takes"
    if [layer.model for layer in look.layers] != ["disney"]:
        raise CodegenError(f"{prefix} one Disney layer, not {len(look.layers)} layers of any model")
    inputs = look.layers[0].inputs
    for name, value in inputs.items():
        if isinstance(value, Varying):
            raise CodegenError(f"{prefix} constants, and {name} varies over the surface")
    values: Parameters = complete_parameters("disney", inputs)
    defaults = complete_parameters("disney", {})
    for name in values:
        if name not in _SUPPORTED and not np.array_equal(values[name], defaults[name]):
            raise CodegenError(f"{prefix} no {name} but its default")
    red, green, blue = map(float, values["baseColor"])
    sockets: dict[str, float | tuple[float, ...]] = {
        "Base Color": (red, green, blue),
        "Metallic": float(values["metallic"]),
        "Roughness": float(values["roughness"]),
    }
    if values["anisotropic"] > 0.0:
        sockets["Anisotropic"] = float(values["anisotropic"])
    if values["clearcoat"] > 0.0:
        sockets["Coat Weight"] = 0.25 * float(values["clearcoat"])
        sockets["Coat Roughness"] = math.sqrt(0.1 - 0.099 * float(values["clearcoatGloss"]))
    return PrincipledSource(look.name, sockets)
