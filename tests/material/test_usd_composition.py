"""Looks put together by USD's own composition: what is read is what composes."""

from __future__ import annotations

from pathlib import Path

import pytest

from lookdev.material import Layer
from lookdev.material.usd import expand_variants, read_look

PRESET = """#usda 1.0
(
    defaultPrim = "Rubber"
)
def Shader "Rubber"
{
    uniform token info:id = "LookdevDisney"
    color3f inputs:baseColor = (0.1, 0.1, 0.1)
    float inputs:roughness = 0.8
    float inputs:sheen = 0.5
    token outputs:layer
}
"""

LIBRARY = """#usda 1.0
class "Worn"
{
    float inputs:amount = 0.75
    over "Base"
    {
        float inputs:sheen = 0.25
    }
}
"""

LOOK = """#usda 1.0
(
    defaultPrim = "Tyre"
    subLayers = [@./library.usda@]
)
def Material "Tyre" (
    prepend inherits = </Worn>
    prepend variantSets = ["colour", "wear"]
    variants = {
        string colour = "black"
        string wear = "new"
    }
)
{
    token outputs:lookdev:surface.connect = </Tyre/Layers.outputs:surface>
    def Shader "Layers"
    {
        uniform token info:id = "LookdevLayers"
        token inputs:base.connect = </Tyre/Base.outputs:layer>
        token inputs:layer1.connect = </Tyre/Dust.outputs:layer>
        float inputs:layer1Mask.connect = </Tyre.inputs:amount>
        token outputs:surface
    }
    def Shader "Base" (
        references = @./rubber.usda@
    )
    {
        float inputs:roughness = 0.6
    }
    def Shader "Dust" (
        references = @./rubber.usda@</Rubber>
    )
    {
        color3f inputs:baseColor = (0.4, 0.3, 0.2)
    }
    variantSet "colour" = {
        "black" {
        }
        "red" {
            over "Base"
            {
                color3f inputs:baseColor = (0.5, 0.02, 0.02)
            }
        }
    }
    variantSet "wear" = {
        "new" {
            over "Layers"
            {
                bool inputs:layer1Enabled = 0
            }
        }
        "worn" {
        }
    }
}
"""

SHOT = """#usda 1.0
(
    defaultPrim = "Tyre"
    subLayers = [@./look.usda@]
)
over "Tyre"
{
    float inputs:amount = 0.125
}
"""


@pytest.fixture
def look(tmp_path: Path) -> Path:
    for name, text in (("rubber", PRESET), ("library", LIBRARY), ("look", LOOK), ("shot", SHOT)):
        (tmp_path / f"{name}.usda").write_text(text)
    return tmp_path / "look.usda"


def test_references_overrides_and_inherits(look: Path) -> None:
    (base,) = read_look(look).layers
    wanted = {"baseColor": (0.1, 0.1, 0.1), "roughness": 0.6, "sheen": 0.25}
    assert base == Layer("Base", "disney", {name: pytest.approx(value) for name, value in wanted.items()})


def test_variants_of_two_sets(look: Path) -> None:
    base, dust = read_look(look, variants={"colour": "red", "wear": "worn"}).layers
    assert base.inputs["baseColor"] == pytest.approx((0.5, 0.02, 0.02))
    assert dust.inputs["baseColor"] == pytest.approx((0.4, 0.3, 0.2))
    assert dust.mask == 0.75


def test_a_stronger_layer_overrides(look: Path) -> None:
    _, dust = read_look(look.with_name("shot.usda"), variants={"wear": "worn"}).layers
    assert dust.mask == 0.125


def test_every_variant(look: Path) -> None:
    assert expand_variants(look, None, {"colour": "*", "wear": "*"}) == tuple(
        {"colour": colour, "wear": wear} for colour in ("black", "red") for wear in ("new", "worn")
    )
    assert expand_variants(look, None, {"wear": "worn", "colour": "*"})[1] == {"wear": "worn", "colour": "red"}
