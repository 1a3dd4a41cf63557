"""Looks of materials in MaterialX documents, at the paths where an asset refers to them."""

from __future__ import annotations

from pathlib import Path

import pytest
from look_files import lost, write_gray

from lookdev.errors import LookError, StageError
from lookdev.material.look import Displacement, Formula, Texture
from lookdev.material.usd.bound import BoundLook, read_bound
from lookdev.stage import Composition, compose

SURFACE = '<UsdPreviewSurface name="S" type="surfaceshader">{}</UsdPreviewSurface>'
MATERIAL = """<surfacematerial name="Gold" type="material">
  <input name="surfaceshader" type="surfaceshader" nodename="S"/>{}</surfacematerial>"""
GRAPH = """<nodegraph name="G">
  <input name="tint" type="color3" value="1, 0.5, 0.25"/>
  <image name="i" type="color3">
    <input name="file" type="filename" value="rgb.png" colorspace="srgb_texture"/></image>
  <image name="m" type="color3"><input name="file" type="filename" value="rgb.png"/></image>
  <mix name="x" type="color3"><input name="fg" type="color3" nodename="i"/>
    <input name="bg" type="color3" interfacename="tint"/>
    <input name="mix" type="float" nodename="m" channels="g"/></mix>
  <output name="o" type="color3" nodename="x"/></nodegraph>"""
ASSET = '#usda 1.0\ndef Scope "Looks" (\n prepend references = @./x.mtlx@</MaterialX/Materials>\n)\n{{\n{}\n}}\n'


def write(folder: Path, *parts: str, over: str = "") -> Path:
    write_gray(folder / "rgb.png", 3)
    (folder / "x.mtlx").write_text(f'<materialx version="1.38" colorspace="lin_rec709">{"".join(parts)}</materialx>')
    (folder / "asset.usda").write_text(ASSET.format(over))
    return folder / "asset.usda"


def gold(file: Path) -> BoundLook:
    return read_bound(compose(Composition(file)), ["/Looks/Gold"])["/Looks/Gold"]


def test_a_material_of_a_document(tmp_path: Path) -> None:
    inputs = """<input name="roughness" type="float" value="0.25"/>
      <input name="diffuseColor" type="color3" nodegraph="G" output="o"/>
      <input name="metallic" type="float" nodename="top"/>"""
    top = '<constant name="top" type="float"><input name="value" type="float" value="1"/></constant>'
    found = gold(write(tmp_path, GRAPH, top, SURFACE.format(inputs), MATERIAL.format("")))
    (layer,) = found.look.layers
    assert (found.look.name, layer.model) == ("Gold", "materialx_preview_surface")
    assert (layer.inputs["roughness"], layer.inputs["metallic"]) == (0.25, 1.0)
    color = layer.inputs["diffuseColor"]
    assert isinstance(color, Formula)
    assert {(each.colorspace, each.channel) for each in color.inputs.values() if isinstance(each, Texture)} == {
        ("sRGB", "rgb"),
        ("raw", "g"),
    }
    assert not found.lost


def test_the_asset_overrides_an_input(tmp_path: Path) -> None:
    over = ' over "Gold"\n {\n  float inputs:roughness = 0.75\n  float inputs:clearcoat = 1\n }'
    shader = SURFACE.format('<input name="roughness" type="float" value="0.25"/>')
    (layer,) = gold(write(tmp_path, shader, MATERIAL.format(""), over=over)).look.layers
    assert (layer.inputs["roughness"], layer.inputs["clearcoat"]) == (0.75, 1.0)


def test_displacement(tmp_path: Path) -> None:
    node = """<displacement name="D" type="displacementshader">
      <input name="displacement" type="float" value="0.5"/><input name="scale" type="float" value="2"/>
    </displacement>"""
    link = '<input name="displacementshader" type="displacementshader" nodename="D"/>'
    found = gold(write(tmp_path, node, SURFACE.format(""), MATERIAL.format(link)))
    assert found.look.displacement == Displacement(1.0)


def test_what_the_document_loses_is_listed_with_its_place_in_it(tmp_path: Path) -> None:
    found = gold(write(tmp_path, '<look name="L"/>', SURFACE.format(""), MATERIAL.format("")))
    assert [(fault.file, fault.where, fault.what) for fault in found.lost] == [
        (str(tmp_path / "x.mtlx"), "L", "<look> is not read")
    ]


@pytest.mark.parametrize(
    ("inputs", "nodes", "what"),
    [
        ('<input name="roughness" type="float" nodename="none"/>', "", "which is no output of a shader"),
        ('<input name="roughness" type="float" nodegraph="H" output="o"/>', "", "which is no output of a shader"),
        (
            '<input name="roughness" type="float" nodename="a"/>',
            '<add name="a" type="float"><input name="in1" type="float" nodename="a"/></add>',
            "its connections run in a cycle",
        ),
        (
            '<input name="roughness" type="float" nodegraph="H" output="o"/>',
            '<nodegraph name="H"><output name="o" type="float" output="o"/></nodegraph>',
            "is connected to",
        ),
        (
            '<input name="roughness" type="float" nodename="n"/>',
            '<noise3d name="n" type="float"/>',
            "a node of ND_noise3d_float is not supported",
        ),
    ],
)
def test_what_is_broken_is_listed(tmp_path: Path, inputs: str, nodes: str, what: str) -> None:
    found = gold(write(tmp_path, nodes, SURFACE.format(inputs), MATERIAL.format("")))
    assert "roughness" not in found.look.layers[0].inputs
    assert any(what in said for _, said in lost(found)), lost(found)


def test_a_missing_image_names_the_prim(tmp_path: Path) -> None:
    inputs = '<input name="diffuseColor" type="color3" nodegraph="G" output="o"/>'
    file = write(tmp_path, GRAPH.replace("rgb.png", "none.png"), SURFACE.format(inputs), MATERIAL.format(""))
    with pytest.raises(LookError) as caught:
        gold(file)
    assert {fault.where for fault in caught.value.faults} >= {"/Looks/Gold/G/i.inputs:file"}


def test_a_malformed_document_is_an_error_of_the_stage(tmp_path: Path) -> None:
    file = write(tmp_path, SURFACE.format('<input name="roughness" type="float" value="x"/>'), MATERIAL.format(""))
    with pytest.raises(StageError) as caught:
        gold(file)
    ((fault),) = caught.value.faults
    assert (fault.file, fault.where) == (str(tmp_path / "x.mtlx"), "S/roughness")
