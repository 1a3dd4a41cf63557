"""Helpers that write materials /M from text, of `lookdev` or of other models, with images, and read them.

Besides USD's own notation, texts have a short one: ``float roughness = 0.5`` is an input, ``float roughness <- Tex.r``
one that is connected to </M/Tex.outputs:r>, ``float roughness <- .rough`` one to the interface </M.inputs:rough>. A
semicolon ends a line.
"""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from lookdev.arrays import Floats
from lookdev.errors import LookError
from lookdev.material.usd import read_look
from lookdev.material.usd.bound import BoundLook, read_bound_looks
from lookdev.stage import Composition, compose

_TYPE = r"(?:bool|int|float|half|double|token|string|asset|color[34]f|normal3f|vector3f|float[234])(?:\[\])?"


def expand(body: str) -> str:
    """Return the text as USD has it."""
    body = body.replace("; ", "\n")
    if "<-" in body:
        body = re.sub(r"(?<!\S)(\S+) (\S+) <- ([\w/]+)\.(\w+)", r"\1 inputs:\2.connect = </M/\3.outputs:\4>", body)
        body = re.sub(r"(?<!\S)(\S+) (\S+) <- \.(\w+)", r"\1 inputs:\2.connect = </M.inputs:\3>", body)
    return re.sub(rf"(?m)^([ ]*{_TYPE} )(?=\w+(?: =|\.timeSamples|\s*$))", r"\1inputs:", body)


def shader(name: str, shader_id: str, body: str = "") -> str:
    return f'def Shader "{name}" {{\n uniform token info:id = "{shader_id}"\n {expand(body)}\n}}\n'


def disney(name: str = "Base", body: str = "") -> str:
    return shader(name, "LookdevDisney", body)


def pixar(name: str = "Base", body: str = "") -> str:
    return shader(name, "LookdevPixar", body)


ST = shader("St", "UsdPrimvarReader_float2", 'string varname = "st"')


def texture(more: str = "", file: str = "@./gray.png@", name: str = "Tex") -> str:
    """Return a texture, and its reader of coordinates unless `more` connects another."""
    st = "" if re.search(r"\bst( |$)", more) else "float2 st <- St.result\n"
    return shader(name, "UsdUVTexture", f"asset file = {file}\n{st}{more}") + ST


def rough(source: str) -> str:
    """Return a Disney layer whose roughness is connected to an output inside the material."""
    return disney(body=f"float roughness <- {source}")


def expression(text: str, inputs: str = "", name: str = "Expr", kind: str = "float") -> str:
    return shader(name, "LookdevExpression", f'string expression = "{text}"\n{inputs}\n{kind} outputs:result')


BASE = "token base <- Base.layer\n"
LAYER1 = "token layer1 <- Coat.layer\n"


def look(body: str, terminal: str = "</M/Base.outputs:layer>", material: str = "", before: str = "") -> str:
    """Return the text of a file with the material, whose surface is connected to `terminal` unless that is empty."""
    surface = f"token outputs:lookdev:surface.connect = {terminal}" if terminal else ""
    head = f'#usda 1.0\n(\n defaultPrim = "M"\n)\n{before}\ndef Material "M" {material}'
    return f"{head}\n{{\n{surface}\n{expand(body)}\n}}\n"


def write_gray(file: Path, channels: int = 1, kind: str = "uint8", size: int = 2) -> None:
    """Write an image whose channels are all 0.5."""
    image = oiio.ImageBuf(oiio.ImageSpec(size, size, channels, kind))
    oiio.ImageBufAlgo.fill(image, (0.5,) * channels)
    assert image.write(str(file)), image.geterror()


def stack(inputs: str, *shaders: str) -> str:
    return shader("Layers", "LookdevLayers", inputs) + "".join(shaders)


STACK = "</M/Layers.outputs:surface>"


def shorten_path(path: str) -> str:
    """Return ``Tex.st`` for the place /M/Tex.inputs:st."""
    return re.sub(r"^/M/(\w+)\.inputs:(\w+)$", r"\1.\2", path)


def faults_of(file: Path, read: Callable[..., object] = read_look, **options: object) -> list[tuple[str, str, str]]:
    """Return place, text and hint of each fault in the error that reading a file raises."""
    with pytest.raises(LookError) as caught:
        read(file, **options)
    assert all(fault.file == str(file) for fault in caught.value.faults)
    return [(shorten_path(fault.where), fault.what, fault.hint) for fault in caught.value.faults]


PREVIEW = "token outputs:surface.connect = </M/S.outputs:surface>\n"


def preview(inputs: str, *nodes: str, terminal: str = PREVIEW, identifier: str = "UsdPreviewSurface") -> str:
    """Return the body of a material of one surface shader of another model."""
    return terminal + shader("S", identifier, inputs) + "".join(nodes)


def materialx(inputs: str, *nodes: str) -> str:
    return preview(inputs, *nodes, identifier="ND_UsdPreviewSurface_surfaceshader")


def asset(folder: Path, body: str) -> Path:
    """Write an asset with the material."""
    file = folder / "asset.usda"
    file.write_text(f'#usda 1.0\ndef Material "M"\n{{\n{expand(body)}\n}}\n')
    return file


def bound(folder: Path, body: str, missing: str = "error", path: str = "/M") -> BoundLook:
    """Return the look of the material of an asset."""
    composed = compose(Composition(asset(folder, body), missing=missing))  # type: ignore[arg-type]
    return read_bound_looks(composed, [path])[path]


def fault_texts(result: BoundLook) -> list[tuple[str, str]]:
    return [(shorten_path(fault.where), fault.what) for fault in result.losses]


def rotate_clockwise(v: Floats, degrees: float) -> Floats:
    """mx_rotate_vector2 of the MaterialX library: clockwise."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.stack([c * v[:, 0] + s * v[:, 1], -s * v[:, 0] + c * v[:, 1]], axis=-1)


def write_preset(file: Path, inputs="", model="LookdevDisney", category="metal", doc="") -> None:
    """Write a preset whose prim has the capitalised name of the file."""
    prim, documentation = file.stem.capitalize(), f'doc = """{doc}"""' if doc else ""
    head = f'#usda 1.0\n(\n    defaultPrim = "{prim}"\n)\n\ndef Shader "{prim}" (\n    {documentation}\n'
    data = f'    customData = {{\n        string category = "{category}"\n    }}\n)\n'
    body = f'{{\n    uniform token info:id = "{model}"\n    {expand(inputs)}\n    token outputs:layer\n}}\n'
    file.write_text(head + data + body)
