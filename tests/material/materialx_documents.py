"""MaterialX documents of a material M, made of a disney_principled S, and imports of them."""

from __future__ import annotations

from pathlib import Path

import MaterialX as mx
import pytest
from look_files import write_gray

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


def imported(folder: Path, *inputs: str, **parts: str) -> Imported:
    """Import a document as `document` writes it."""
    return import_materialx(document(folder, *inputs, **parts))


def document(
    folder: Path, *inputs: str, nodes: str = "", material: str = MATERIAL, attributes: str = 'version="1.39"'
) -> Path:
    """Write a document whose shader has the given inputs, beside two images."""
    for name, channels in (("gray.png", 1), ("rgb.png", 3)):
        write_gray(folder / name, channels)
    file = folder / "m.mtlx"
    file.write_text(f"<materialx {attributes}>\n{nodes}\n{shader(*inputs)}\n{material}\n</materialx>\n")
    return file


def as_look(imported: Imported) -> Layer:
    """Write what was imported, read it as a look and return its one layer."""
    usda = imported.file.with_suffix(".usda")
    write_usda(imported, usda, replace=True)
    (layer,) = read_look(usda).layers
    return layer


def unmapped(imported: Imported) -> list[tuple[str, str, str]]:
    assert all(fault.file == str(imported.file) for fault in imported.unmapped)
    return [(fault.where, fault.what, fault.hint) for fault in imported.unmapped]


def faults_of(file: Path) -> list[tuple[str, str, str]]:
    with pytest.raises(LookError) as caught:
        import_materialx(file)
    assert all(fault.file == str(file) for fault in caught.value.faults)
    return [(fault.where, fault.what, fault.hint) for fault in caught.value.faults]
