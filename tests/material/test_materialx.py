"""Import of MaterialX documents: inputs arrive in the look, or the import reports them, in little time.

Documents have a material M with a disney_principled S.
"""

import time
from pathlib import Path

import MaterialX as mx
import numpy as np
import pytest
from look_files import faults_of, rotate_clockwise, write_gray
from pxr import Sdf, Usd, UsdShade

from lookdev.brdf import MODELS
from lookdev.errors import OutputError
from lookdev.material import Layer, Primvar, Texture
from lookdev.material.materialx import ImportedDocument, import_materialx, write_usda
from lookdev.material.usd import read_look
from lookdev.material.validate.examine import examine_file

pytestmark = pytest.mark.both_pythons

MATERIAL = """<surfacematerial name="M" type="material">
  <input name="surfaceshader" type="surfaceshader" nodename="S"/>
</surfacematerial>"""
IMAGE = '<image name="image" type="color3"><input name="file" type="filename" value="rgb.png"/>{}</image>'


def library() -> dict[str, str]:
    """Return the type of every input of the node, as the MaterialX library has it."""
    document = mx.createDocument()
    mx.readFromXmlFile(document, mx.getDefaultDataSearchPath().find("libraries/bxdf/disney_principled.mtlx"))
    return {port.getName(): port.getType() for port in document.getNodeDef("ND_disney_principled").getInputs()}


INPUTS = library()


def setting(name: str, rest: str, kind: str = "") -> str:
    return f'<input name="{name}" type="{kind or INPUTS[name]}" {rest}/>'


def document(folder: Path, *inputs: str, nodes="", material=MATERIAL, attributes='version="1.39"') -> Path:
    """Write a document whose shader has the given inputs, beside two images."""
    write_gray(folder / "gray.png")
    write_gray(folder / "rgb.png", 3)
    file = folder / "m.mtlx"
    shader = f'<disney_principled name="S" type="surfaceshader">{"".join(inputs)}</disney_principled>'
    file.write_text(f"<materialx {attributes}>\n{nodes}\n{shader}\n{material}\n</materialx>\n")
    return file


def as_look(import_layer: ImportedDocument) -> Layer:
    """Write an imported document, read it as a look and return its only layer; check the types of connections."""
    usda = import_layer.file.with_suffix(".usda")
    write_usda(import_layer, usda, replace=True)
    stage = Usd.Stage.Open(str(usda))
    for prim in stage.Traverse():
        for target in UsdShade.ConnectableAPI(prim).GetInputs():
            for source in target.GetValueProducingAttributes():
                assert source.GetTypeName().type == target.GetTypeName().type
    (layer,) = read_look(usda).layers
    return layer


def unmapped_faults(import_layer: ImportedDocument) -> list[tuple[str, str, str]]:
    assert all(fault.file == str(import_layer.file) for fault in import_layer.losses)
    return [(fault.where, fault.what, fault.hint) for fault in import_layer.losses]


def import_layer(folder: Path, *inputs: str, **parts: str) -> ImportedDocument:
    """Import a document as `document` writes it."""
    return import_materialx(document(folder, *inputs, **parts))


def texture_of(import_layer: ImportedDocument, name: str) -> Texture:
    return as_look(import_layer).inputs[name]


TO_IMAGE = setting("baseColor", 'nodename="image"')
OTHER_MODELS = "only disney_principled is imported; the document itself, as 'material' of a look in a job, "
OTHER_MODELS += "is read whatever its model"
NUMBERS = {"float": "0.25", "color3": "0.25, 0.5, 0.75"}


@pytest.mark.parametrize("name", INPUTS)
def test_every_input_of_the_node_is_carried_over_or_reported(tmp_path: Path, name: str) -> None:
    value = NUMBERS[INPUTS[name]]
    result = import_layer(tmp_path, setting(name, f'value="{value}"'))
    if name in MODELS["disney"].parameters:
        numbers = tuple(float(number) for number in value.split(","))
        assert as_look(result).inputs[name] == (numbers if len(numbers) == 3 else numbers[0])
        assert not result.losses
    else:
        ((where, message, hint),) = unmapped_faults(result)
        assert (where, message) == (f"S/{name}", f"'{value}' is not carried over")
        assert hint


def test_defaults_are_those_of_materialx(tmp_path: Path) -> None:
    layer = as_look(import_materialx(document(tmp_path)))
    assert layer.model == "disney"
    assert layer.inputs == {"baseColor": pytest.approx((0.16, 0.16, 0.16))}


def test_what_is_out_of_range_is_clipped_and_reported(tmp_path: Path) -> None:
    result = import_layer(tmp_path, setting("metallic", 'value="1.5"'), setting("baseColor", 'value="2, -1, 0.5"'))
    assert as_look(result).inputs == {"metallic": 1.0, "baseColor": (1.0, 0.0, 0.5)}
    assert unmapped_faults(result) == [
        ("S/baseColor", "2, -1, 0.5 is outside [0, 1]", "1, 0, 0.5 is taken"),
        ("S/metallic", "1.5 is outside [0, 1]", "1 is taken"),
    ]


def test_a_constant_comes_through_graphs_interfaces_and_nodes(tmp_path: Path) -> None:
    graph = """<nodegraph name="G"><input name="r" type="float" value="0.25"/>
      <constant name="c" type="float"><input name="value" type="float" interfacename="r"/></constant>
      <constant name="d" type="float"><input name="value" type="float" nodename="c"/></constant>
      <output name="o" type="float" nodename="d"/></nodegraph>"""
    result = import_layer(tmp_path, setting("roughness", 'nodegraph="G" output="o"'), nodes=graph)
    assert as_look(result).inputs["roughness"] == 0.25
    assert not result.losses


@pytest.mark.parametrize(
    ("space", "decoded", "colorspace", "hint"),
    [
        ("srgb_texture", 0.2140411, "sRGB", ""),
        ("lin_rec709", 0.5, "raw", ""),
        ("lin_ap1", 0.5, "raw", "linear Rec.709 is taken"),
        ("g22_rec709", 0.2140411, "sRGB", "sRGB is taken"),
    ],
)
def test_colour_spaces(tmp_path: Path, space: str, decoded: float, colorspace: str, hint: str) -> None:
    attributes = f'version="1.39" colorspace="{space}"'
    constant = import_layer(tmp_path, setting("baseColor", 'value="0.5, 0.5, 0.5"'), attributes=attributes)
    assert as_look(constant).inputs["baseColor"] == pytest.approx((decoded,) * 3)
    rough = '<image name="rough" type="float"><input name="file" type="filename" value="gray.png"/></image>'
    links = TO_IMAGE, setting("roughness", 'nodename="rough"')
    result = import_layer(tmp_path, *links, nodes=IMAGE.format("") + rough, attributes=attributes)
    assert [texture_of(result, name).colorspace for name in ("baseColor", "roughness")] == [colorspace, "raw"]
    fault_texts = [(f"the colour space '{space}' is not carried over", hint)] if hint else []
    assert (
        [fault[1:] for fault in unmapped_faults(constant)]
        == [fault[1:] for fault in unmapped_faults(result)]
        == fault_texts
    )


@pytest.mark.parametrize(
    ("node", "link", "channel"),
    [
        ('<extract name="e" type="float">{}<input name="index" type="integer" value="2"/></extract>', "e", "b"),
        ('<extract name="e" type="float">{}</extract>', "e", "r"),
        ('<swizzle name="e" type="float">{}<input name="channels" type="string" value="g"/></swizzle>', "e", "g"),
        ('<separate3 name="e" type="multioutput">{}</separate3>', 'e" output="outg', "g"),
        ("", 'image" channels="b', "b"),
    ],
)
def test_a_float_takes_a_channel(tmp_path: Path, node: str, link: str, channel: str) -> None:
    nodes = IMAGE.format("") + node.format('<input name="in" type="color3" nodename="image"/>')
    result = import_layer(tmp_path, setting("metallic", f'nodename="{link}"'), nodes=nodes)
    texture = texture_of(result, "metallic")
    assert (texture.channel, texture.file.name) == (channel, "rgb.png")
    assert not result.losses


def test_wrap_modes_uv_sets_and_a_shared_image(tmp_path: Path) -> None:
    inside = """<input name="texcoord" type="vector2" nodename="uv"/>
      <input name="uaddressmode" type="string" value="mirror"/>
      <input name="vaddressmode" type="string" value="constant"/>"""
    uv = '<texcoord name="uv" type="vector2"><input name="index" type="integer" value="1"/></texcoord>'
    links = [setting(name, 'nodename="image" channels="g"') for name in ("metallic", "roughness")]
    result = import_layer(tmp_path, *links, nodes=IMAGE.format(inside) + uv)
    layer = as_look(result)
    texture = layer.inputs["metallic"]
    assert texture == layer.inputs["roughness"]
    assert (texture.st, texture.wrap_s, texture.wrap_t) == ("st1", "mirror", "black")
    assert result.file.with_suffix(".usda").read_text().count("UsdUVTexture") == 1


def place_coordinates(st: np.ndarray, p: dict[str, np.ndarray], degrees: float, order: int) -> np.ndarray:
    """NG_place2d_vector2 of the MaterialX library, written out node by node."""
    if order == 0:
        return rotate_clockwise((st - p["pivot"]) / p["scale"], degrees) - p["offset"] + p["pivot"]
    return rotate_clockwise(st - p["pivot"] - p["offset"], degrees) / p["scale"] + p["pivot"]


@pytest.mark.parametrize("order", [0, 1])
def test_placement_is_that_of_the_library(tmp_path: Path, order: int) -> None:
    rng = np.random.default_rng(order)
    sizes = {name: rng.uniform(0.2, 2.0, 2) for name in ("pivot", "scale", "offset", "uvtiling", "uvoffset")}
    inputs = {name: f'<input name="{name}" type="vector2" value="{x}, {y}"/>' for name, (x, y) in sizes.items()}
    nodes = f"""<texcoord name="uv" type="vector2"/>
      <place2d name="place" type="vector2"><input name="texcoord" type="vector2" nodename="uv"/>
        {inputs["pivot"]}{inputs["scale"]}{inputs["offset"]}<input name="rotate" type="float" value="37"/>
        <input name="operationorder" type="integer" value="{order}"/></place2d>
      <tiledimage name="image" type="color3"><input name="file" type="filename" value="rgb.png"/>
        <input name="texcoord" type="vector2" nodename="place"/>{inputs["uvtiling"]}{inputs["uvoffset"]}</tiledimage>"""
    result = import_layer(tmp_path, TO_IMAGE, nodes=nodes)
    assert not result.losses
    texture = texture_of(result, "baseColor")
    st = rng.uniform(-1.0, 1.0, (8, 2))
    matrix = np.reshape(texture.transform, (2, 3))
    expected = place_coordinates(st, sizes, 37.0, order) * sizes["uvtiling"] - sizes["uvoffset"]
    # USD holds scales and translations, up to 11 here, in float32.
    np.testing.assert_allclose(st @ matrix[:, :2].T + matrix[:, 2], expected, atol=1e-5)


def test_radians_are_turned_into_degrees(tmp_path: Path) -> None:
    nodes = IMAGE.format('<input name="texcoord" type="vector2" nodename="place"/>') + (
        '<texcoord name="uv" type="vector2"/><place2d name="place" type="vector2">'
        '<input name="texcoord" type="vector2" nodename="uv"/>'
        '<input name="rotate" type="float" value="1.5707963267948966" unit="radian" unittype="angle"/></place2d>'
    )
    texture = texture_of(import_layer(tmp_path, TO_IMAGE, nodes=nodes), "baseColor")
    assert texture.transform == pytest.approx((0.0, 1.0, 0.0, -1.0, 0.0, 0.0))


def test_primvars(tmp_path: Path) -> None:
    nodes = """<geompropvalue name="wear" type="float"><input name="geomprop" type="string" value="wear"/>
        <input name="default" type="float" value="0.25"/></geompropvalue>
      <geompropvalue name="Cd" type="color3"><input name="geomprop" type="string" value="displayColor"/>
      </geompropvalue>"""
    links = setting("roughness", 'nodename="wear"'), setting("baseColor", 'nodename="Cd"')
    result = import_layer(tmp_path, *links, nodes=nodes)
    layer = as_look(result)
    assert layer.inputs == {"roughness": Primvar("wear", 0.25), "baseColor": Primvar("displayColor", (0.0, 0.0, 0.0))}
    assert not result.losses


def test_what_does_not_map_is_reported(tmp_path: Path) -> None:
    inside = """<input name="texcoord" type="vector2" nodename="warp"/>
      <input name="default" type="color3" value="1,0,0"/><input name="filtertype" type="string" value="cubic"/>"""
    nodes = f"""{IMAGE.format(inside)}<noise2d name="warp" type="vector2"/><noise3d name="n" type="float"/>
      <multiply name="m" type="float"><input name="in1" type="float" nodename="n"/></multiply>
      <fractal3d name="unused" type="float"/><look name="L"/>
      <standard_surface name="Other" type="surfaceshader"/>
      <surfacematerial name="Plain" type="material"><input name="surfaceshader" type="surfaceshader" nodename="Other"/>
      </surfacematerial>
      <xi:include href="other.mtlx"/>"""
    inputs = TO_IMAGE, setting("sheen", 'nodename="m"'), setting("specTrans", 'nodename="n"')
    attributes = 'version="1.39" xmlns:xi="http://www.w3.org/2001/XInclude"'
    file = document(tmp_path, *inputs, setting("flatness", 'value="0.3"', "float"), nodes=nodes, attributes=attributes)
    result = import_materialx(file)
    assert set(as_look(result).inputs) == {"baseColor"}
    line = file.read_text().split("<xi:")[0].count("\n") + 1
    connection, unused = "the connection to {} is not carried over", "no imported material uses it"
    fault_texts = "a LookdevDisney layer lets no light through"
    assert sorted(unmapped_faults(result)) == sorted(
        [
            (f"line {line}, column 7", "includes 'other.mtlx'", "includes are not followed"),
            ("S/flatness", "'0.3' is not carried over", f"unknown input; known: {', '.join(INPUTS)}"),
            ("image/default", "'1,0,0' is not carried over", ""),
            ("image/filtertype", "'cubic' is not carried over", "images are looked up linearly"),
            ("image/texcoord", connection.format("<noise2d> 'warp'"), "the UV set st is taken"),
            ("S/sheen", connection.format("<multiply> 'm'"), "0.0 is taken"),
            ("S/specTrans", connection.format("<noise3d> 'n'"), fault_texts),
            ("Plain", "has the surface shader <standard_surface>", OTHER_MODELS),
            ("Other", "<standard_surface> is not carried over", ""),
            ("warp", "<noise2d> is not carried over", ""),
            ("m", "<multiply> is not carried over", ""),
            ("n", "<noise3d> is not carried over", ""),
            ("unused", "<fractal3d> is not carried over", unused),
            ("L", "<look> is not carried over", unused),
        ]
    )


@pytest.mark.parametrize("file", ["", "&lt;UVTILE>.png"])
def test_an_image_without_a_usable_path_is_reported(tmp_path: Path, file: str) -> None:
    result = import_layer(tmp_path, TO_IMAGE, nodes=IMAGE.format("").replace("rgb.png", file))
    assert as_look(result).inputs["baseColor"] == pytest.approx((0.16, 0.16, 0.16))
    assert [where for where, _, _ in unmapped_faults(result)] == ["image/file", "S/baseColor", "image"]


@pytest.mark.parametrize(
    ("prefix", "file", "expected"),
    [
        ("", "rgb.png", "../rgb.png"),
        ("sub/", "..\\pictures\\a@b &lt;UDIM>.png", "../pictures/a@b <UDIM>.png"),
        ("looks/", "own/@@@.png", "./own/@@@.png"),
        ("/pictures/", "rgb.png", "/pictures/rgb.png"),
    ],
)
def test_image_paths_become_relative_to_what_is_written(tmp_path: Path, prefix: str, file: str, expected: str) -> None:
    nodes, attributes = IMAGE.format("").replace("rgb.png", file), f'version="1.39" fileprefix="{prefix}"'
    mtlx = document(tmp_path, TO_IMAGE, nodes=nodes, attributes=attributes)
    write_usda(import_materialx(mtlx), tmp_path / "looks" / "m.usda")
    layer = Sdf.Layer.FindOrOpen(str(tmp_path / "looks" / "m.usda"))
    assert layer.GetAttributeAtPath("/M/image.inputs:file").default.path == expected


def test_a_placement_of_nothing_and_swapped_channels_are_reported(tmp_path: Path) -> None:
    nodes = IMAGE.format('<input name="texcoord" type="vector2" nodename="p"/>') + '<place2d name="p" type="vector2"/>'
    place_coordinates = import_layer(tmp_path, TO_IMAGE, nodes=nodes)
    assert unmapped_faults(place_coordinates) == [
        ("p", "places one point, as it has no texcoord", "the UV set st is taken")
    ]
    swapped = import_layer(tmp_path, setting("baseColor", 'nodename="image" channels="bgr"'), nodes=nodes)
    assert unmapped_faults(swapped)[0][0] == "S/baseColor"
    assert as_look(swapped).inputs["baseColor"] == pytest.approx((0.16, 0.16, 0.16))


def test_a_byte_order_mark_is_no_fault(tmp_path: Path) -> None:
    file = document(tmp_path, setting("sheen", 'value="0.25"'))
    file.write_text(file.read_text(), encoding="utf-8-sig")
    assert as_look(import_materialx(file)).inputs["sheen"] == 0.25


def test_materials_of_one_document_are_looks_of_one_file(tmp_path: Path) -> None:
    second = MATERIAL.replace('"M"', '"Alt gold/1"')
    write_usda(
        import_layer(tmp_path, setting("metallic", 'value="1"'), material=MATERIAL + second), tmp_path / "m.usda"
    )
    for prim in ("/M", "/Alt_gold_1"):
        (layer,) = read_look(tmp_path / "m.usda", prim).layers
        assert layer.inputs["metallic"] == 1.0
    stage = Usd.Stage.Open(str(tmp_path / "m.usda"))
    data = stage.GetPrimAtPath("/Alt_gold_1").GetCustomDataByKey("lookdev:materialx")
    assert data == {"file": "m.mtlx", "material": "Alt gold/1"}
    assert {finding.severity for finding in examine_file(tmp_path / "m.usda").findings} == {"note"}


def test_a_look_is_written_as_its_suffix_says(tmp_path: Path) -> None:
    result = import_layer(tmp_path, setting("metallic", 'value="1"'))
    for suffix, start in ((".usda", b"#usda"), (".usdc", b"PXR-USDC")):
        file = tmp_path / f"look{suffix}"
        write_usda(result, file)
        assert file.read_bytes().startswith(start)
        assert examine_file(file).findings == ()
    with pytest.raises(OutputError, match=r"look\.txt: is not the name of a look; it would end with \.usda"):
        write_usda(result, tmp_path / "look.txt")


def faults(file: Path) -> list[tuple[str, str, str]]:
    return faults_of(file, import_materialx)


def loop(*names: str) -> str:
    """Nodes of which each is connected to the next, and the last to the first."""
    node = '<invert name="{}" type="float"><input name="in" type="float" nodename="{}"/></invert>'
    return "".join(map(node.format, names, (*names[1:], names[0])))


TO_A = setting("sheen", 'nodename="a"')
TO_G = setting("sheen", 'nodegraph="G" output="o"')
INWARD = '<nodegraph name="G"><output name="o" type="float" output="o"/></nodegraph>'
TILE = IMAGE.format('<input name="uaddressmode" type="string" value="tile"/>')
PLACED = IMAGE.format('<input name="texcoord" type="vector2" nodename="p"/>')
PLACED += '<place2d name="p" type="vector2"><input name="{}" type="{}" value="{}"/></place2d>'


@pytest.mark.parametrize(
    ("inputs", "nodes", "where", "message"),
    [
        (setting("sheen", 'value="much"'), "", "S/sheen", "'much' is not a value"),
        (setting("sheen", 'value="nan"'), "", "S/sheen", "'nan' is not a value"),
        (setting("sheen", 'value="1e30"'), "", "S/sheen", "'1e30' is not a value"),
        (setting("baseColor", 'value="1, 0"'), "", "S/baseColor", "'1, 0' is not a value"),
        (setting("sheen", 'value="1"', "color3"), "", "S/sheen", "has type 'color3'"),
        (setting("sheen", 'nodename="none"'), "", "S/sheen", "is connected to 'none', which is not there"),
        (setting("sheen", 'nodename="M"'), "", "M", "its connections run in a cycle"),
        (TO_G, "", "S/sheen", "is connected to 'G.o', which is not there"),
        (setting("sheen", 'interfacename="i"'), "", "S/sheen", "is connected to 'i', which is not there"),
        (TO_A, loop("a"), "a", "its connections run in a cycle"),
        (TO_A, loop("a", "b", "c"), "a", "its connections run in a cycle"),
        (TO_G, INWARD, "S/sheen", "its connections run in a cycle"),
        (TO_IMAGE, TILE, "image/uaddressmode", "unknown value 'tile'"),
        (TO_IMAGE, PLACED.format("scale", "vector2", "0, 1"), "p", "has a scale of 0"),
        (TO_IMAGE, PLACED.format("operationorder", "integer", "2"), "p/operationorder", "unknown value '2'"),
    ],
)
def test_a_broken_document_is_an_error(tmp_path: Path, inputs: str, nodes: str, where: str, message: str) -> None:
    assert (where, message) in [fault[:2] for fault in faults(document(tmp_path, inputs, nodes=nodes))]


def test_all_faults_are_reported_at_once(tmp_path: Path) -> None:
    file = document(tmp_path, setting("sheen", 'value="x"'), setting("metallic", 'value="y"'))
    assert [where for where, _, _ in faults(file)] == ["S/metallic", "S/sheen"]


def test_other_shading_models_are_named(tmp_path: Path) -> None:
    other = '<standard_surface name="O" type="surfaceshader"/>'
    empty = '<surfacematerial name="E" type="material"/>'
    file = document(tmp_path, nodes=other, material=MATERIAL.replace('nodename="S"', 'nodename="O"') + empty)
    assert faults(file) == [
        ("M", "has the surface shader <standard_surface>", OTHER_MODELS),
        ("E", "has no surface shader", OTHER_MODELS),
    ]
    ((where, message, hint),) = faults(document(tmp_path, material=""))
    assert (where, message) == ("", "holds no surfacematerial")
    assert "disney_principled" in hint


LAUGHS = "".join(f'<!ENTITY a{i + 1} "{f"&a{i};" * 10}">' for i in range(9))
HEAD = b"<materialx version='1.39'>"
TWICE = HEAD + b"<a name='n'/>\n<b name='n'/></materialx>"
LAUGHS = f'<!DOCTYPE x [<!ENTITY a0 "ha">{LAUGHS}]><materialx version="1.39" doc="&a9;"/>'


@pytest.mark.parametrize(
    ("text", "where", "message"),
    [
        (b"", "line 1, column 1", "is not XML: no element found"),
        (b"#usda 1.0", "line 1, column 1", "is not XML: syntax error"),
        (b"<materialx version='1.39'>\n <image", "line 2, column 2", "is not XML: unclosed token"),
        (b"<materialx version='1.39' doc='\xff'/>", "line 1, column 32", "not UTF-8 text"),
        (b"<html/>", "line 1, column 1", "the document is <html>, not <materialx>"),
        (b"<materialx/>", "line 1, column 1", "MaterialX version ''"),
        (b"<materialx version='1.37'/>", "line 1, column 1", "MaterialX version '1.37'"),
        (b"<materialx version='9.1'/>", "line 1, column 1", "MaterialX version '9.1'"),
        (b"<materialx version='one'/>", "line 1, column 1", "MaterialX version 'one'"),
        (TWICE, "line 2, column 1", "a second element here is named 'n'"),
        (LAUGHS.encode(), "line 1, column 13", "has a document type definition"),
        (HEAD + b"<a>" * 300_000, "line 1, column 120", "more than 32 elements inside each other"),
    ],
)
def test_what_is_no_materialx_is_refused(tmp_path: Path, text: bytes, where: str, message: str) -> None:
    file = tmp_path / "m.mtlx"
    file.write_bytes(text)
    assert [fault[:2] for fault in faults(file)] == [(where, message)]


def test_missing_files_and_folders(tmp_path: Path) -> None:
    missing = "cannot be read: No such file or directory"
    for file, message in ((tmp_path / "none.mtlx", missing), (tmp_path, "is a folder")):
        assert [fault[:2] for fault in faults(file)] == [("", message)]


@pytest.mark.parametrize(("version", "closed"), [("1.38", False), ("1.39", True)])
def test_a_megabyte_of_nodes_ends_soon(tmp_path: Path, version: str, closed: bool) -> None:
    names = [f"n{i}" for i in range(14_000)]
    nodes = loop(*names) if closed else loop(*names).replace(' nodename="n0"', ' value="0"')
    file = document(tmp_path, setting("sheen", 'nodename="n0"'), nodes=nodes, attributes=f'version="{version}"')
    assert file.stat().st_size > 1_000_000
    before = time.process_time()
    if closed:
        assert "its connections run in a cycle" in faults(file)[0][1]
    else:
        assert len(import_materialx(file).losses) == len(names) + 1
    # It takes less than a second on an idle machine. Upgrading such a file took 150 s.
    assert time.process_time() - before < 5.0
