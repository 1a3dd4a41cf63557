"""Materials of any model that a job names: what is read as a look of `lookdev`, and what by the bound reader."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest
from look_files import PREVIEW, asset, disney, lost, preview, shader, write_gray
from pxr import UsdUtils

from lookdev.errors import LookError
from lookdev.material.look import Layer
from lookdev.material.usd import read_look
from lookdev.material.usd.bound import read_any_look

GOLD = """<materialx version="1.38">
  <standard_surface name="S" type="surfaceshader">
    <input name="metalness" type="float" value="1"/>
    <input name="subsurface" type="float" value="0.5"/>
  </standard_surface>
  <surfacematerial name="Gold" type="material">
    <input name="surfaceshader" type="surfaceshader" nodename="S"/>
  </surfacematerial>{more}
</materialx>"""
TIN = """<surfacematerial name="Tin" type="material">
    <input name="surfaceshader" type="surfaceshader" nodename="S"/>
  </surfacematerial>"""
OWN = "token outputs:lookdev:surface.connect = </M/Base.outputs:layer>\n"


def document(folder: Path, more: str = "") -> Path:
    file = folder / "gold.mtlx"
    file.write_text(GOLD.format(more=more))
    return file


def faults(file: Path, **options: str) -> list[tuple[str, str]]:
    with pytest.raises(LookError) as caught:
        read_any_look(file, **options)
    assert all(fault.file == str(file) for fault in caught.value.faults)
    return [(fault.where, fault.what) for fault in caught.value.faults]


def test_a_document_is_a_look(tmp_path: Path) -> None:
    found = read_any_look(file := document(tmp_path), name="gold")
    assert found.look.layers == (Layer("S", "standard_surface", {"metalness": 1.0, "subsurface": 0.5}),)
    assert (found.look.name, found.look.source) == ("gold", f"{file}</MaterialX/Materials/Gold>")
    assert found.titles == ("Standard Surface as Disney",)
    assert [where for where, _ in lost(found)] == ["/MaterialX/Materials/Gold/S.inputs:subsurface"]


def test_one_of_several_materials_is_named(tmp_path: Path) -> None:
    file = document(tmp_path, TIN)
    assert read_any_look(file, "/MaterialX/Materials/Tin").look.name == "Tin"
    ((_, what),) = faults(file)
    assert what == "holds 2 materials and none is the default prim"


def test_a_package_is_a_look_with_its_images(tmp_path: Path) -> None:
    write_gray(tmp_path / "rgb.png", 3)
    tex = shader("Tex", "UsdUVTexture", "asset file = @./rgb.png@")
    source = asset(tmp_path, preview("color3f diffuseColor <- Tex.rgb", tex))
    package = tmp_path / "m.usdz"
    assert UsdUtils.CreateNewUsdzPackage(str(source), str(package))
    assert zipfile.is_zipfile(package)
    (layer,) = read_any_look(package).look.layers
    assert layer.inputs["diffuseColor"].file.is_file()


def test_variants_are_those_of_the_material(tmp_path: Path) -> None:
    rough = '"{}" {{\nover "S" {{\nfloat roughness = {}\n}}\n}}\n'
    sets = 'variantSet "wear" = {\n' + rough.format("new", 0.25) + rough.format("worn", 0.75) + "}\n"
    file = asset(tmp_path, preview("") + sets)
    file.write_text(file.read_text().replace('"M"', '"M" ( prepend variantSets = "wear" )'))
    assert read_any_look(file, variants={"wear": "worn"}).look.layers[0].inputs == {"roughness": 0.75}
    ((_, what),) = faults(file, variants={"wear": "old"})
    assert what == "variant set 'wear' has no variant 'old'"


def test_a_look_of_lookdev_stays_one(tmp_path: Path) -> None:
    file = asset(tmp_path, OWN + disney(body="float roughness = 0") + preview(""))
    found = read_any_look(file)
    assert found.look == read_look(file)
    assert found.lost == ()
    assert found.titles == ("Disney",)


@pytest.mark.parametrize("terminal", ["token outputs:lookdev:surface\n", OWN.replace("surface", "surfce")])
def test_a_look_of_lookdev_that_is_not_connected_is_no_preview_of_itself(tmp_path: Path, terminal: str) -> None:
    assert faults(asset(tmp_path, terminal + disney() + preview(""))) == [
        ("/M.outputs:lookdev:surface", "is not connected")
    ]


def test_a_material_without_a_surface_is_an_error(tmp_path: Path) -> None:
    assert faults(asset(tmp_path, disney())) == [("/M.outputs:lookdev:surface", "is not connected")]


def test_a_surface_that_cannot_be_read_is_an_error(tmp_path: Path) -> None:
    first, second = faults(asset(tmp_path, preview("", identifier="ND_lama_surface")))
    assert first == ("/M", "has no surface shader that can be read")
    assert second[0] == "/M.outputs:surface"
    assert "ND_lama_surface" in second[1]


def test_missing_images_are_errors(tmp_path: Path) -> None:
    tex = shader("Tex", "UsdUVTexture", "asset file = @./gone.png@")
    connected = "color3f diffuseColor <- Tex.rgb"
    ((where, what),) = faults(asset(tmp_path, preview(connected, tex)))
    assert where == "/M/Tex.inputs:file"
    assert "no such image file" in what


def test_a_broken_reference_of_the_material_is_an_error(tmp_path: Path) -> None:
    file = asset(tmp_path, preview(""))
    file.write_text(file.read_text().replace('"M"', '"M" ( references = @./gone.usda@ )'))
    ((where, what),) = faults(file)
    assert where == "/M"
    assert "gone.usda" in what


def test_only_a_surface_makes_it_foreign(tmp_path: Path) -> None:
    moved = PREVIEW.replace("surface", "displacement")
    assert faults(asset(tmp_path, moved + shader("S", "UsdPreviewSurface"))) == [
        ("/M.outputs:lookdev:surface", "is not connected")
    ]
