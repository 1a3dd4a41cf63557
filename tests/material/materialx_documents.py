"""MaterialX documents of a material M, made of a disney_principled S, and what an import says of them."""

from __future__ import annotations

from pathlib import Path

import MaterialX as mx
import numpy as np
import OpenImageIO as oiio
import pytest

from lookdev.errors import LookError
from lookdev.material.look import Layer
from lookdev.material.materialx import Imported, import_materialx, write_usda
from lookdev.material.usd import read_look

MATERIAL = """<surfacematerial name="M" type="material">
  <input name="surfaceshader" type="surfaceshader" nodename="S"/>
</surfacematerial>"""
IMAGE = '<image name="image" type="color3"><input name="file" type="filename" value="rgb.png"/>{}</image>'


def library() -> dict[str, str]:
    """Return the type of every input of the node, as the MaterialX library has it."""
    document = mx.createDocument()
    mx.readFromXmlFile(document, mx.getDefaultDataSearchPath().find("libraries/bxdf/disney_principled.mtlx"))
    return {each.getName(): each.getType() for each in document.getNodeDef("ND_disney_principled").getInputs()}


INPUTS = library()


def setting(name: str, rest: str, kind: str = "") -> str:
    return f'<input name="{name}" type="{kind or INPUTS[name]}" {rest}/>'


def shader(*inputs: str) -> str:
    return f'<disney_principled name="S" type="surfaceshader">{"".join(inputs)}</disney_principled>'


def document(
    folder: Path, *inputs: str, nodes: str = "", material: str = MATERIAL, attributes: str = 'version="1.39"'
) -> Path:
    """Write a document whose shader has the given inputs, beside two images."""
    for name, channels in (("gray.png", 1), ("rgb.png", 3)):
        output = oiio.ImageOutput.create(str(folder / name))
        assert output.open(str(folder / name), oiio.ImageSpec(2, 2, channels, oiio.UINT8))
        assert output.write_image(np.full((2, 2, channels), 0.5, np.float32))
        assert output.close()
    file = folder / "m.mtlx"
    file.write_text(f"<materialx {attributes}>\n{nodes}\n{shader(*inputs)}\n{material}\n</materialx>\n")
    return file


def as_look(imported: Imported) -> Layer:
    """Write what was imported, read it as a look and return its one layer."""
    usda = imported.file.with_suffix(".usda")
    write_usda(imported, usda, replace=True)
    (layer,) = read_look(usda).layers
    return layer


def told(imported: Imported) -> list[tuple[str, str, str]]:
    assert all(fault.file == str(imported.file) for fault in imported.unmapped)
    return [(fault.where, fault.what, fault.hint) for fault in imported.unmapped]


def faults_of(file: Path) -> list[tuple[str, str, str]]:
    with pytest.raises(LookError) as caught:
        import_materialx(file)
    assert all(fault.file == str(file) for fault in caught.value.faults)
    return [(fault.where, fault.what, fault.hint) for fault in caught.value.faults]
