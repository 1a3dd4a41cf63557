"""A view of OpenColorIO as a shader for WebGL 2, so that the page shows what the pictures show."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np

from lookdev.output.color import DisplayView


def view_shader(view: DisplayView) -> dict[str, Any]:
    """Return the GLSL of a function ``vec4 view(vec4)`` from linear Rec.709 to display values, and its textures.

    A texture has the name of its sampler, its size, its components a texel, whether it is interpolated, and its texels
    as base64 of little-endian float32. Tables of one dimension are rows of a picture, as WebGL has no others.
    """
    import PyOpenColorIO as ocio

    shader = ocio.GpuShaderDesc.CreateShaderDesc()
    shader.setLanguage(ocio.GPU_LANGUAGE_GLSL_ES_3_0)
    shader.setFunctionName("view")
    shader.setAllowTexture1D(False)
    view.transform.getDefaultGPUProcessor().extractGpuShaderInfo(shader)
    textures = [
        _texture(each, (each.width, each.height, 1), 1 if each.channel == each.TEXTURE_RED_CHANNEL else 3)
        for each in shader.getTextures()
    ]
    textures += [_texture(each, (each.edgeLen,) * 3, 3) for each in shader.get3DTextures()]
    return {"name": str(view), "glsl": shader.getShaderText(), "textures": textures}


def _texture(texture: Any, size: tuple[int, int, int], components: int) -> dict[str, Any]:
    import PyOpenColorIO as ocio

    return {
        "sampler": texture.samplerName,
        "size": size,
        "components": components,
        "smooth": texture.interpolation != ocio.INTERP_NEAREST,
        "texels": base64.b64encode(np.asarray(texture.getValues(), "<f4").tobytes()).decode("ascii"),
    }
