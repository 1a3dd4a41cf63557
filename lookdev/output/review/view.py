"""A view of OpenColorIO as a shader for WebGL 2, so that pages show the same colours as the pictures of a job."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np

from lookdev.output.color import DisplayView


def view_shader(view: DisplayView) -> dict[str, Any]:
    """Return the ``name`` of a view, the ``glsl`` of a function ``vec4 view(vec4)``, and the ``textures`` it reads.

    The function converts linear Rec.709 to code values of the display. A texture has the name of its sampler, its size,
    the number of components of a texel, whether it is interpolated, and its texels as base64 of little-endian float32.
    A one-dimensional table becomes a two-dimensional texture, because WebGL has no one-dimensional ones.
    """
    import PyOpenColorIO as ocio

    shader = ocio.GpuShaderDesc.CreateShaderDesc()
    shader.setLanguage(ocio.GPU_LANGUAGE_GLSL_ES_3_0)
    shader.setFunctionName("view")
    shader.setAllowTexture1D(False)
    view.transform.getDefaultGPUProcessor().extractGpuShaderInfo(shader)
    textures = [
        _texture_entry(table, (table.width, table.height, 1), 1 if table.channel == table.TEXTURE_RED_CHANNEL else 3)
        for table in shader.getTextures()
    ]
    textures += [_texture_entry(table, (table.edgeLen,) * 3, 3) for table in shader.get3DTextures()]
    return {"name": str(view), "glsl": shader.getShaderText(), "textures": textures}


def _texture_entry(texture: Any, size: tuple[int, int, int], components: int) -> dict[str, Any]:
    """Return the record of a texture that OpenColorIO's shader reads."""
    import PyOpenColorIO as ocio

    return {
        "sampler": texture.samplerName,
        "size": size,
        "components": components,
        "smooth": texture.interpolation != ocio.INTERP_NEAREST,
        "texels": base64.b64encode(np.asarray(texture.getValues(), "<f4").tobytes()).decode("ascii"),
    }
