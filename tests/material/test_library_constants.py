"""Copies of looks with other constants: what is set, where, and what stays."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from pxr import Usd

from lookdev.errors import LookError
from lookdev.material.change import constant_of, with_constants
from lookdev.material.library.constants import check_writable, write_changed
from lookdev.material.usd import read_look

MATERIALS = Path(__file__).parents[2] / "materials"

SHARED = """#usda 1.0
(
    defaultPrim = "Paint"
)
def Material "Paint" (
    variants = { string wear = "old" }
    prepend variantSets = "wear"
)
{
    float inputs:rough = 0.4 ( doc = "Of both." )
    float inputs:shine = 0.8 ( doc = "Of the coat alone." )
    token outputs:lookdev:surface.connect = </Paint/Layers.outputs:surface>
    def Shader "Layers"
    {
        uniform token info:id = "LookdevLayers"
        token inputs:base.connect = </Paint/Base.outputs:layer>
        token inputs:layer1.connect = </Paint/Coat.outputs:layer>
        float inputs:layer1Mask.connect = </Paint/Fade.outputs:result>
        token outputs:surface
    }
    def Shader "Base"
    {
        uniform token info:id = "LookdevDisney"
        float inputs:roughness.connect = </Paint.inputs:rough>
        token outputs:layer
    }
    def Shader "Coat"
    {
        uniform token info:id = "LookdevDisney"
        float inputs:roughness.connect = </Paint.inputs:rough>
        float inputs:clearcoatGloss.connect = </Paint.inputs:shine>
        token outputs:layer
    }
    def Shader "Fade"
    {
        uniform token info:id = "LookdevExpression"
        string inputs:expression = "amount * view"
        float inputs:amount = 0.5
        float outputs:result
    }
    variantSet "wear" = {
        "old" {
            over "Base"
            {
                color3f inputs:baseColor = (0.2, 0.1, 0.1)
            }
        }
        "new" {
            over "Base"
            {
                color3f inputs:baseColor = (0.9, 0.1, 0.1)
            }
        }
    }
}
"""
NAMES = {
    "Coat.clearcoatGloss": (0.3,),
    "Base.roughness": (0.7,),
    "Coat.mask.amount": (0.25,),
    "Base.baseColor": (0.5, 0.6, 0.7),
    "Coat.metallic": (0.9,),
}


def test_constants_are_set_where_they_are(tmp_path: Path) -> None:
    file = tmp_path / "paint.usda"
    file.write_text(SHARED)
    before = read_look(file)
    for names in ([n for n in NAMES if n != "Base.roughness"], list(NAMES)):
        out = tmp_path / f"found{len(names)}.usda"
        changed = [replace(constant_of(before, name), value=NAMES[name]) for name in names]
        write_changed(file, out, changed)
        found = read_look(out)
        for each in changed:
            assert constant_of(found, each.name).value == pytest.approx(each.value)
        assert len(found.layers) == len(before.layers)
        stage = Usd.Stage.Open(str(out))
        # An interface keeps a constant that is its own; one that two layers share is left to the other.
        shared = "Base.roughness" in names
        assert stage.GetPrimAtPath("/Paint").GetAttribute("inputs:rough").Get() == pytest.approx(0.4)
        if not shared:
            assert stage.GetPrimAtPath("/Paint").GetAttribute("inputs:shine").Get() == pytest.approx(0.3)
            assert stage.GetPrimAtPath("/Paint/Coat").GetAttribute("inputs:clearcoatGloss").HasAuthoredConnections()
        assert constant_of(found, "Coat.roughness").value == pytest.approx((0.4,))
        # Only the variant that is shown changes.
        new = read_look(out, None, {"wear": "new"})
        assert constant_of(new, "Base.baseColor").value == pytest.approx((0.9, 0.1, 0.1))
    assert read_look(file) == before


def test_relative_paths_stay_right_in_another_folder(tmp_path: Path) -> None:
    file = MATERIALS / "robot_paint.usda"
    look = read_look(file)
    wanted = replace(constant_of(look, "Paint.roughness"), value=(0.5,))
    write_changed(file, tmp_path / "found.usdc", [wanted])
    assert read_look(tmp_path / "found.usdc").layers == with_constants(look, [wanted]).layers


def test_what_is_no_look_of_layers_is_refused(tmp_path: Path) -> None:
    file, out = tmp_path / "plain.usda", tmp_path / "out.usda"
    file.write_text('#usda 1.0\n(\n    defaultPrim = "M"\n)\ndef Material "M"\n{\n}\n')
    with pytest.raises(LookError, match="is not connected to layers"):
        check_writable(file)
    file.write_text(SHARED)
    look = read_look(file)
    with pytest.raises(LookError, match=r"found\.txt: is not a file to write a look in"):
        write_changed(file, tmp_path / "found.txt", [constant_of(look, "Base.metallic")])
    with pytest.raises(LookError, match=r"out\.usda: .*out of range"):
        write_changed(file, out, [replace(constant_of(look, "Base.metallic"), value=(3.0,))])
    assert not out.exists()
