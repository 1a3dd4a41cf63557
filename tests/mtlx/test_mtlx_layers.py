"""A MaterialX document as a USD layer: prims, values, connections, colour spaces, paths and units."""

from pathlib import Path
from typing import Any

import pytest
from pxr import Sdf, Usd, UsdShade

from lookdev.errors import LookError
from lookdev.mtlx import NOTES_KEY, document_layer, shade

pytestmark = pytest.mark.both_pythons

MATERIAL = """<surfacematerial name="M" type="material">
  <input name="surfaceshader" type="surfaceshader" nodename="S"/>{}
</surfacematerial>"""
SHADER = '<standard_surface name="S" type="surfaceshader">{}</standard_surface>'
M = "/MaterialX/Materials/M"


def write(folder: Path, *parts: str, attributes: str = 'version="1.38"', name: str = "x.mtlx") -> Path:
    file = folder / name
    file.write_text(f"<materialx {attributes}>{''.join(parts)}</materialx>")
    return file


def stage_of(file: Path) -> Usd.Stage:
    return Usd.Stage.Open(str(document_layer(str(file))))


def material(folder: Path, inputs: str, *nodes: str, **options: str) -> Usd.Stage:
    return stage_of(write(folder, *nodes, SHADER.format(inputs), MATERIAL.format(""), **options))


def value(stage: Usd.Stage, path: str) -> Any:
    """Return the value of an attribute of the material M, by its connections."""
    (source,) = UsdShade.Input(stage.GetAttributeAtPath(f"{M}{path}")).GetValueProducingAttributes()
    return source.Get()


def test_a_material_is_where_usd_has_it(tmp_path: Path) -> None:
    stage = material(tmp_path, '<input name="base" type="float" value="0.5"/>')
    prim = stage.GetPrimAtPath(M)
    assert prim.IsA(UsdShade.Material)
    shader, _, _ = UsdShade.Material(prim).ComputeSurfaceSource("mtlx")
    assert shader.GetShaderId() == "ND_standard_surface_surfaceshader"
    assert value(stage, "/S.inputs:base") == 0.5
    assert stage.GetDefaultPrim().GetPath() == "/MaterialX"


@pytest.mark.parametrize(("attributes", "suffix"), [('version="1.0.1"', ""), ('version="1.0.0"', "_100")])
def test_versions_of_a_node_are_told_apart(tmp_path: Path, attributes: str, suffix: str) -> None:
    shader = SHADER.format("").replace('name="S"', f'name="S" {attributes}')
    stage = stage_of(write(tmp_path, shader, MATERIAL.format("")))
    prim = UsdShade.Shader(stage.GetPrimAtPath(f"{M}/S"))
    assert prim.GetShaderId() == f"ND_standard_surface_surfaceshader{suffix}"


def test_another_layer_overrides_an_input_of_the_material(tmp_path: Path) -> None:
    stage = material(tmp_path, '<input name="base" type="float" value="0.5"/>')
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        for name, number in (("base", 0.25), ("sheen", 0.75)):
            stage.GetPrimAtPath(M).CreateAttribute(f"inputs:{name}", Sdf.ValueTypeNames.Float).Set(number)
    # Inputs that the document leaves unset are there too: those of the library's node definition.
    assert (value(stage, "/S.inputs:base"), value(stage, "/S.inputs:sheen")) == (0.25, 0.75)


VALUES = [
    ("float", "0.5", 0.5), ("integer", "3", 3), ("boolean", "true", True), ("string", "a, b", "a, b"),
    ("vector2", "1, 2", (1, 2)), ("vector2", "1 2", (1, 2)), ("color3", "1,2 , 3", (1, 2, 3)),
    ("vector3", "1,2,3", (1, 2, 3)), ("color4", "1,2,3,4", (1, 2, 3, 4)),
]  # fmt: skip
UNITS = {"foot": 0.3048, "inch": 0.0254, "centimeter": 0.01, "degree": 1.0, "radian": 57.29578}


def test_values_and_units_which_become_metres_and_degrees(tmp_path: Path) -> None:
    inputs = [f'type="{kind}" value="{text}"' for kind, text, _ in VALUES]
    inputs += [f'type="float" value="2" unit="{unit}"' for unit in UNITS]
    ports = "".join(f'<input name="in{i}" {attributes}/>' for i, attributes in enumerate(inputs))
    node = f'<thing name="n" type="float">{ports}</thing>'
    stage = material(tmp_path, '<input name="base" type="float" nodename="n"/>', node)
    expected = [number for *_, number in VALUES] + [pytest.approx(2.0 * factor) for factor in UNITS.values()]
    assert [value(stage, f"/n.inputs:in{i}") for i in range(len(inputs))] == expected


def test_graphs_interfaces_and_channels(tmp_path: Path) -> None:
    graph = """<nodegraph name="G"><input name="amount" type="float" value="0.25"/>
      <constant name="c" type="color3"><input name="value" type="color3" value="1, 2, 3"/></constant>
      <multiply name="m" type="float"><input name="in1" type="float" interfacename="amount"/>
        <input name="in2" type="float" nodename="c" channels="g"/></multiply>
      <output name="o" type="float" nodename="m"/></nodegraph>"""
    stage = material(tmp_path, '<input name="base" type="float" nodegraph="G" output="o"/>', graph)
    assert stage.GetPrimAtPath(f"{M}/G").IsA(UsdShade.NodeGraph)
    assert value(stage, "/G/m.inputs:in1") == 0.25
    (target,) = stage.GetAttributeAtPath(f"{M}/G/m.inputs:in2").GetConnections()
    swizzle = UsdShade.Shader(stage.GetPrimAtPath(target.GetPrimPath()))
    assert (swizzle.GetShaderId(), swizzle.GetInput("channels").Get()) == ("ND_swizzle_float", "g")


def test_only_what_a_material_reads_is_in_it(tmp_path: Path) -> None:
    stage = material(tmp_path, "", '<constant name="unused" type="float"/>')
    assert [prim.GetName() for prim in stage.GetPrimAtPath(M).GetChildren()] == ["S"]


def test_colour_spaces_are_those_that_hold_for_each_value(tmp_path: Path) -> None:
    inputs = """<input name="base_color" type="color3" value="1, 1, 1"/><input name="base" type="float" value="1"/>
      <input name="coat_color" type="color3" value="1, 1, 1" colorspace="srgb_texture"/>"""
    stage = material(tmp_path, inputs, attributes='version="1.38" colorspace="acescg"')
    attributes = [stage.GetAttributeAtPath(f"{M}.inputs:{name}") for name in ("base_color", "coat_color", "base")]
    spaces = [attribute.GetColorSpace() if attribute.HasColorSpace() else "" for attribute in attributes]
    assert spaces == ["acescg", "srgb_texture", ""]


def textured(folder: Path, name: str, attributes: str) -> Usd.Stage:
    node = f'<image name="i" type="color3"><input name="file" type="filename" value="{name}"/></image>'
    link = '<input name="base_color" type="color3" nodename="i"/>'
    return material(folder, link, node, attributes=f'version="1.38" {attributes}')


def image(stage: Usd.Stage) -> str:
    return str(stage.GetAttributeAtPath(f"{M}/i.inputs:file").Get().path)


@pytest.mark.parametrize(
    ("attributes", "name", "expected"),
    [
        ("", "a.png", "a.png"),
        ("", "./sub/../a.png", "a.png"),
        ("", "..\\\\pictures\\\\a.png", "../pictures/a.png"),
        ('fileprefix="tex/"', "a.&lt;UDIM>.png", "tex/a.<UDIM>.png"),
        ("", "/pictures/a.png", "/pictures/a.png"),
    ],
)
def test_images_are_relative_to_the_document(tmp_path: Path, attributes: str, name: str, expected: str) -> None:
    name = name.replace("\\\\", "\\")
    path = image(textured(tmp_path, name, attributes))
    assert Path(path) == Path(str(tmp_path / expected).replace("x/../", "")).resolve()


def test_a_prefix_that_is_in_the_path_already_is_left_out_and_noted(tmp_path: Path) -> None:
    (tmp_path / "tex").mkdir()
    (tmp_path / "tex" / "a.png").touch()
    stage = textured(tmp_path, "tex/a.png", 'fileprefix="tex/"')
    assert image(stage) == str(tmp_path / "tex/a.png")
    assert "there is no tex/tex/a.png" in stage.GetRootLayer().customLayerData[NOTES_KEY]


def test_names_become_identifiers(tmp_path: Path) -> None:
    text = MATERIAL.format("").replace('"M"', '"ns:Alt gold/1"')
    stage = stage_of(write(tmp_path, SHADER.format(""), text, MATERIAL.format("").replace('"M"', '"ns__Alt_gold_1"')))
    names = [prim.GetName() for prim in stage.GetPrimAtPath("/MaterialX/Materials").GetChildren()]
    assert names == ["ns__Alt_gold_1", "ns__Alt_gold_1_2"]


def test_what_is_left_out_is_noted(tmp_path: Path) -> None:
    parts = '<look name="L"/><xi:include href="y.mtlx"/>'
    node = '<thing name="n" type="float"><input name="in" type="matrix33" value="1"/></thing>'
    attributes = 'version="1.38" xmlns:xi="http://www.w3.org/2001/XInclude"'
    stage = material(tmp_path, '<input name="base" type="float" nodename="n"/>', node, parts, attributes=attributes)
    lines = [line.split("\t") for line in stage.GetRootLayer().customLayerData[NOTES_KEY].splitlines()]
    assert [line[0] for line in lines] == [str(tmp_path / "x.mtlx")] * 3
    notes = ["includes 'y.mtlx'", "a value of type 'matrix33' is not read", "<look> is not read"]
    assert [line[2] for line in lines] == notes


def test_the_layer_is_made_once_for_a_content(tmp_path: Path) -> None:
    file = write(tmp_path, SHADER.format(""), MATERIAL.format(""))
    first = document_layer(str(file))
    assert document_layer(str(file)) == first
    write(tmp_path, SHADER.format('<input name="base" type="float" value="0"/>'), MATERIAL.format(""))
    assert document_layer(str(file)) != first


def test_malformed_values_are_errors_that_are_reported_together(tmp_path: Path) -> None:
    wrong = [
        ("base", "float", "much"), ("sheen", "float", "nan"), ("coat", "float", "1e30"),
        ("base_color", "color3", "1, 2"), ("thin_walled", "boolean", "2"),
    ]  # fmt: skip
    with pytest.raises(LookError) as caught:
        material(tmp_path, "".join(f'<input name="{n}" type="{kind}" value="{text}"/>' for n, kind, text in wrong))
    faults = {(fault.file, fault.where, fault.what) for fault in caught.value.faults}
    assert faults == {(str(tmp_path / "x.mtlx"), f"S/{name}", f"'{text}' is not a value") for name, _, text in wrong}


def test_a_document_of_many_materials_that_share_many_nodes_is_refused(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(shade, "_MAX_PRIMS", 1000)
    link = '<input name="{}" type="float" nodename="n{}"/>'
    chain = "".join(f'<add name="n{i}" type="float">{link.format("in1", i + 1)}</add>' for i in range(100))
    shader = SHADER.format(link.format("base", 0))

    def layer(count: int) -> Path:
        materials = "".join(MATERIAL.format("").replace('"M"', f'"M{i}"') for i in range(count))
        return document_layer(str(write(tmp_path, chain, shader, materials)))

    assert layer(9).exists()
    with pytest.raises(LookError, match="more than 1000 nodes, each counted for every material"):
        layer(10)


@pytest.mark.parametrize(
    ("category", "name"),
    [("open_pbr_surface", "base_weight"), ("gltf_pbr", "metallic"), ("UsdPreviewSurface", "diffuseColor")],
)
def test_a_material_has_the_inputs_of_its_shader_in_the_library(tmp_path: Path, category: str, name: str) -> None:
    stage = stage_of(write(tmp_path, SHADER.format("").replace("standard_surface", category), MATERIAL.format("")))
    assert stage.GetAttributeAtPath(f"{M}.inputs:{name}")
