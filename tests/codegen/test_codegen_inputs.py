"""What a look reads: images that do not matter are never opened."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from layers import surface

from lookdev.codegen.source import AttributeBinding, ShaderSource
from lookdev.material import Bump, Formula, Input, Layer, Texture
from lookdev.material.expression import parse


class Images:
    """Textures that record when they are opened."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.opened: list[str] = []

    def texture(self, name: str, channel: Any = "r") -> Texture:
        (self.folder / name).write_bytes(name.encode())
        return Texture(self.folder / name, channel, "raw")

    def resolve(self, source: Texture | Bump) -> Path:
        assert isinstance(source, Texture)
        self.opened.append(source.file.name)
        return source.file

    def surface(self, *layers: Layer) -> ShaderSource:
        return surface(*layers, resolve=self.resolve, bounces=0)


@pytest.fixture
def images(tmp_path: Path) -> Images:
    return Images(tmp_path)


def formula(text: str, **inputs: Any) -> Formula:
    return Formula(parse(text), inputs, dict.fromkeys(inputs, "float"))


@pytest.mark.parametrize("model", ["disney", "pixar"])
def test_of_eight_layers_only_those_that_show_are_read(images: Images, model: str) -> None:
    color = {"disney": "baseColor", "pixar": "surfaceColor"}[model]

    def layer(number: int, mask: Any) -> Layer:
        inputs: dict[str, Input] = {color: images.texture(f"{number}.exr", "rgb")}
        return Layer(f"layer{number}", model, inputs, mask)

    dirt = images.texture("dirt.exr")
    gone = formula("dirt * off", dirt=images.texture("unread.exr"), off=0.0)
    masks = [1.0, dirt, 1.0, 0.0, 0.5, gone, formula("clamp(x, 0, 1)", x=0.0), dirt]
    stack = [layer(number, mask) for number, mask in enumerate(masks)]
    whole = images.surface(*stack)
    # Layer 2 covers 0 and 1; the masks of 3, 5 and 6 fold to 0.
    assert sorted(images.opened) == ["2.exr", "4.exr", "7.exr", "dirt.exr"]
    reduced = images.surface(replace(stack[2], mask=1.0), stack[4], stack[7])
    assert whole.osl == reduced.osl
    assert [binding.file for binding in whole.textures] == [binding.file for binding in reduced.textures]


def test_a_set_of_tiles_is_a_look_up_of_the_tile(images: Images) -> None:
    for tile in ("1001", "1012"):
        images.texture(f"wear.{tile}.exr")
    rough = Texture(images.folder / "wear.<UDIM>.exr", "r", "raw")
    source = images.surface(Layer("layer", "disney", {"roughness": rough}))
    assert sorted(images.opened) == ["wear.1001.exr", "wear.1012.exr"]
    assert [binding.parameter for binding in source.textures] == ["texture0_1001_file", "texture0_1012_file"]


@pytest.mark.parametrize("kind", ["uv", "float"])
def test_names_in_blender_are_short_plain_and_different(kind):
    names = ["st", *("a" * length for length in (40, 41, 56, 67, 300_000)), "a" * 40 + "é", "ä", "ö", "a:b", "a.b"]
    names += ["a_b", "1", "\x1b", "position", "lookdev_normal", "material_index", ".corner_vert"]
    stored = [AttributeBinding("x", name, kind).mesh_name for name in names]
    assert len(set(stored)) == len(names)
    assert all(re.fullmatch(r"(primvars:)?[A-Za-z0-9_]+", name) and len(name) < 56 for name in stored)
    assert stored[0].removeprefix("primvars:") == "st"
    assert not {"position", "lookdev_normal", "material_index"} & set(stored)


def test_a_primvar_and_a_uv_set_of_one_name_differ_in_blender():
    assert AttributeBinding("x", "st", "uv").mesh_name != AttributeBinding("y", "st", "float").mesh_name
