"""Looks of a material /M made from text, their images, and their faults."""

from __future__ import annotations

from pathlib import Path

import OpenImageIO as oiio
import pytest

from lookdev.errors import LookError
from lookdev.material.usd import read_look

SHADER = 'def Shader "{name}" {{\n uniform token info:id = "{id}"\n {body}\n}}\n'


def shader(name: str, shader_id: str, body: str = "") -> str:
    return SHADER.format(name=name, id=shader_id, body=body)


def disney(name: str = "Base", body: str = "") -> str:
    return shader(name, "LookdevDisney", body)


def pixar(name: str = "Base", body: str = "") -> str:
    return shader(name, "LookdevPixar", body)


ST = shader("St", "UsdPrimvarReader_float2", 'string inputs:varname = "st"')


def texture(more: str = "", file: str = "@./gray.png@", name: str = "Tex") -> str:
    """Return a texture, and its reader of coordinates unless `more` connects another."""
    st = "" if "inputs:st" in more else "float2 inputs:st.connect = </M/St.outputs:result>\n"
    return shader(name, "UsdUVTexture", f"asset inputs:file = {file}\n{st}{more}") + ST


def rough(source: str) -> str:
    """Return a Disney layer whose roughness is connected to an output inside the material."""
    return disney(body=f"float inputs:roughness.connect = </M/{source}>")


BASE = "token inputs:base.connect = </M/Base.outputs:layer>\n"
LAYER1 = "token inputs:layer1.connect = </M/Coat.outputs:layer>\n"


def look(body: str, terminal: str = "</M/Base.outputs:layer>", material: str = "", before: str = "") -> str:
    """Return the text of a file with the material, whose surface is connected to `terminal` unless that is empty."""
    surface = f"token outputs:lookdev:surface.connect = {terminal}" if terminal else ""
    return f'#usda 1.0\n(\n defaultPrim = "M"\n)\n{before}\ndef Material "M" {material}\n{{\n{surface}\n{body}\n}}\n'


def write_gray(file: Path, channels: int = 1, kind: str = "uint8", size: int = 2) -> None:
    """Write an image whose channels are all 0.5."""
    image = oiio.ImageBuf(oiio.ImageSpec(size, size, channels, kind))
    oiio.ImageBufAlgo.fill(image, (0.5,) * channels)
    assert image.write(str(file)), image.geterror()


def stack(inputs: str, *shaders: str) -> str:
    return shader("Layers", "LookdevLayers", inputs) + "".join(shaders)


STACK = "</M/Layers.outputs:surface>"


def faults_of(file: Path, **options: object) -> list[tuple[str, str, str]]:
    with pytest.raises(LookError) as caught:
        read_look(file, **options)
    assert all(fault.file == str(file) for fault in caught.value.faults)
    return [(fault.where, fault.what, fault.hint) for fault in caught.value.faults]
