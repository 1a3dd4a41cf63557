"""MaterialX documents: what is carried over arrives in the look, and all else is reported."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from materialx_documents import IMAGE, INPUTS, MATERIAL, as_look, document, imported, setting, unmapped
from pxr import Sdf, Usd

from lookdev.brdf import MODELS
from lookdev.errors import OutputError
from lookdev.material.look import Primvar, Texture
from lookdev.material.materialx import import_materialx, write_usda
from lookdev.material.usd import read_look
from lookdev.material.validate.examine import examine

NUMBERS = {"float": "0.25", "color3": "0.25, 0.5, 0.75"}


@pytest.mark.parametrize("name", INPUTS)
def test_every_input_of_the_node_is_carried_over_or_reported(tmp_path: Path, name: str) -> None:
    value = NUMBERS[INPUTS[name]]
    found = imported(tmp_path, setting(name, f'value="{value}"'))
    if name in MODELS["disney"].parameters:
        numbers = tuple(float(each) for each in value.split(","))
        assert as_look(found).inputs[name] == (numbers if len(numbers) == 3 else numbers[0])
        assert not found.unmapped
    else:
        ((where, what, hint),) = unmapped(found)
        assert (where, what) == (f"S/{name}", f"'{value}' is not carried over")
        assert hint


def test_defaults_are_those_of_materialx(tmp_path: Path) -> None:
    layer = as_look(import_materialx(document(tmp_path)))
    assert layer.model == "disney"
    assert layer.inputs == {"baseColor": pytest.approx((0.16, 0.16, 0.16))}


def test_what_is_out_of_range_is_clipped_and_reported(tmp_path: Path) -> None:
    found = imported(tmp_path, setting("metallic", 'value="1.5"'), setting("baseColor", 'value="2, -1, 0.5"'))
    assert as_look(found).inputs == {"metallic": 1.0, "baseColor": (1.0, 0.0, 0.5)}
    assert unmapped(found) == [
        ("S/baseColor", "2, -1, 0.5 is outside [0, 1]", "1, 0, 0.5 is taken"),
        ("S/metallic", "1.5 is outside [0, 1]", "1 is taken"),
    ]


def test_a_constant_comes_through_graphs_interfaces_and_nodes(tmp_path: Path) -> None:
    graph = """<nodegraph name="G"><input name="r" type="float" value="0.25"/>
      <constant name="c" type="float"><input name="value" type="float" interfacename="r"/></constant>
      <constant name="d" type="float"><input name="value" type="float" nodename="c"/></constant>
      <output name="o" type="float" nodename="d"/></nodegraph>"""
    found = imported(tmp_path, setting("roughness", 'nodegraph="G" output="o"'), nodes=graph)
    assert as_look(found).inputs["roughness"] == 0.25
    assert not found.unmapped


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
    constant = imported(tmp_path, setting("baseColor", 'value="0.5, 0.5, 0.5"'), attributes=attributes)
    assert as_look(constant).inputs["baseColor"] == pytest.approx((decoded,) * 3)
    rough = '<image name="rough" type="float"><input name="file" type="filename" value="gray.png"/></image>'
    links = setting("baseColor", 'nodename="image"'), setting("roughness", 'nodename="rough"')
    found = imported(tmp_path, *links, nodes=IMAGE.format("") + rough, attributes=attributes)
    color, roughness = (as_look(found).inputs[name] for name in ("baseColor", "roughness"))
    assert isinstance(color, Texture)
    assert isinstance(roughness, Texture)
    assert (color.colorspace, roughness.colorspace) == (colorspace, "raw")
    lost = [(f"the colour space '{space}' is not carried over", hint)] if hint else []
    assert [each[1:] for each in unmapped(constant)] == [each[1:] for each in unmapped(found)] == lost


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
    found = imported(tmp_path, setting("metallic", f'nodename="{link}"'), nodes=nodes)
    texture = as_look(found).inputs["metallic"]
    assert isinstance(texture, Texture)
    assert (texture.channel, texture.file.name) == (channel, "rgb.png")
    assert not found.unmapped


def test_wrap_modes_uv_sets_and_a_shared_image(tmp_path: Path) -> None:
    inside = """<input name="texcoord" type="vector2" nodename="uv"/>
      <input name="uaddressmode" type="string" value="mirror"/>
      <input name="vaddressmode" type="string" value="constant"/>"""
    uv = '<texcoord name="uv" type="vector2"><input name="index" type="integer" value="1"/></texcoord>'
    links = [setting(name, 'nodename="image" channels="g"') for name in ("metallic", "roughness")]
    found = imported(tmp_path, *links, nodes=IMAGE.format(inside) + uv)
    layer = as_look(found)
    texture = layer.inputs["metallic"]
    assert isinstance(texture, Texture)
    assert texture == layer.inputs["roughness"]
    assert (texture.st, texture.wrap_s, texture.wrap_t) == ("st1", "mirror", "black")
    assert found.file.with_suffix(".usda").read_text().count("UsdUVTexture") == 1


def placed(st: np.ndarray, p: dict[str, np.ndarray], degrees: float, order: int) -> np.ndarray:
    """NG_place2d_vector2 of the MaterialX library, with mx_rotate_vector2, written out node by node."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))

    def rotate2d(v: np.ndarray) -> np.ndarray:
        return np.stack([c * v[:, 0] + s * v[:, 1], -s * v[:, 0] + c * v[:, 1]], axis=-1)

    if order == 0:
        return rotate2d((st - p["pivot"]) / p["scale"]) - p["offset"] + p["pivot"]
    return rotate2d(st - p["pivot"] - p["offset"]) / p["scale"] + p["pivot"]


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
    found = imported(tmp_path, setting("baseColor", 'nodename="image"'), nodes=nodes)
    assert not found.unmapped
    texture = as_look(found).inputs["baseColor"]
    assert isinstance(texture, Texture)
    st = rng.uniform(-1.0, 1.0, (8, 2))
    matrix = np.reshape(texture.transform, (2, 3))
    expected = placed(st, sizes, 37.0, order) * sizes["uvtiling"] - sizes["uvoffset"]
    # USD holds scales and translations, up to 11 here, in float32.
    np.testing.assert_allclose(st @ matrix[:, :2].T + matrix[:, 2], expected, atol=1e-5)


def test_radians_are_turned_into_degrees(tmp_path: Path) -> None:
    nodes = IMAGE.format('<input name="texcoord" type="vector2" nodename="place"/>') + (
        '<texcoord name="uv" type="vector2"/><place2d name="place" type="vector2">'
        '<input name="texcoord" type="vector2" nodename="uv"/>'
        '<input name="rotate" type="float" value="1.5707963267948966" unit="radian" unittype="angle"/></place2d>'
    )
    texture = as_look(imported(tmp_path, setting("baseColor", 'nodename="image"'), nodes=nodes)).inputs["baseColor"]
    assert isinstance(texture, Texture)
    assert texture.transform == pytest.approx((0.0, 1.0, 0.0, -1.0, 0.0, 0.0))


def test_primvars(tmp_path: Path) -> None:
    nodes = """<geompropvalue name="wear" type="float"><input name="geomprop" type="string" value="wear"/>
        <input name="default" type="float" value="0.25"/></geompropvalue>
      <geompropvalue name="Cd" type="color3"><input name="geomprop" type="string" value="displayColor"/>
      </geompropvalue>"""
    links = setting("roughness", 'nodename="wear"'), setting("baseColor", 'nodename="Cd"')
    found = imported(tmp_path, *links, nodes=nodes)
    layer = as_look(found)
    assert layer.inputs == {"roughness": Primvar("wear", 0.25), "baseColor": Primvar("displayColor", (0.0, 0.0, 0.0))}
    assert not found.unmapped


def test_what_does_not_map_is_reported(tmp_path: Path) -> None:
    nodes = (
        IMAGE.format(
            '<input name="texcoord" type="vector2" nodename="warp"/><input name="default" type="color3" value="1,0,0"/>'
            '<input name="filtertype" type="string" value="cubic"/>'
        )
        + """<noise2d name="warp" type="vector2"/><noise3d name="n" type="float"/>
      <multiply name="m" type="float"><input name="in1" type="float" nodename="n"/></multiply>
      <fractal3d name="unused" type="float"/><look name="L"/>
      <standard_surface name="Other" type="surfaceshader"/>
      <surfacematerial name="Plain" type="material"><input name="surfaceshader" type="surfaceshader" nodename="Other"/>
      </surfacematerial>
      <xi:include href="other.mtlx"/>"""
    )
    inputs = (
        setting("baseColor", 'nodename="image"'),
        setting("sheen", 'nodename="m"'),
        setting("specTrans", 'nodename="n"'),
        setting("flatness", 'value="0.3"', "float"),
    )
    file = document(
        tmp_path, *inputs, nodes=nodes, attributes='version="1.39" xmlns:xi="http://www.w3.org/2001/XInclude"'
    )
    found = import_materialx(file)
    assert set(as_look(found).inputs) == {"baseColor"}
    known = f"known: {', '.join(INPUTS)}"
    assert sorted(unmapped(found)) == sorted(
        [
            (
                f"line {file.read_text().split('<xi:')[0].count(chr(10)) + 1}, column 7",
                "includes 'other.mtlx'",
                "includes are not followed",
            ),
            ("S/flatness", "'0.3' is not carried over", f"unknown input; {known}"),
            ("image/default", "'1,0,0' is not carried over", ""),
            ("image/filtertype", "'cubic' is not carried over", "images are looked up linearly"),
            ("image/texcoord", "the connection to <noise2d> 'warp' is not carried over", "the UV set st is taken"),
            ("S/sheen", "the connection to <multiply> 'm' is not carried over", "0.0 is taken"),
            (
                "S/specTrans",
                "the connection to <noise3d> 'n' is not carried over",
                "a LookdevDisney layer lets no light through",
            ),
            (
                "Plain",
                "has the surface shader <standard_surface>",
                "only disney_principled is imported; "
                "the document itself, as 'material' of a look in a job, is read whatever its model",
            ),
            ("Other", "<standard_surface> is not carried over", ""),
            ("warp", "<noise2d> is not carried over", ""),
            ("m", "<multiply> is not carried over", ""),
            ("n", "<noise3d> is not carried over", ""),
            ("unused", "<fractal3d> is not carried over", "no imported material uses it"),
            ("L", "<look> is not carried over", "no imported material uses it"),
        ]
    )


@pytest.mark.parametrize(
    "nodes", [IMAGE.format("").replace("rgb.png", ""), IMAGE.format("").replace("rgb", "&lt;UVTILE>")]
)
def test_an_image_without_a_usable_path_is_reported(tmp_path: Path, nodes: str) -> None:
    found = imported(tmp_path, setting("baseColor", 'nodename="image"'), nodes=nodes)
    assert as_look(found).inputs["baseColor"] == pytest.approx((0.16, 0.16, 0.16))
    assert [where for where, _, _ in unmapped(found)] == ["image/file", "S/baseColor", "image"]


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
    mtlx = document(tmp_path, setting("baseColor", 'nodename="image"'), nodes=nodes, attributes=attributes)
    write_usda(import_materialx(mtlx), tmp_path / "looks" / "m.usda")
    layer = Sdf.Layer.FindOrOpen(str(tmp_path / "looks" / "m.usda"))
    assert layer.GetAttributeAtPath("/M/image.inputs:file").default.path == expected


def test_a_placement_of_nothing_and_swapped_channels_are_reported(tmp_path: Path) -> None:
    nodes = IMAGE.format('<input name="texcoord" type="vector2" nodename="p"/>') + '<place2d name="p" type="vector2"/>'
    placed = imported(tmp_path, setting("baseColor", 'nodename="image"'), nodes=nodes)
    assert unmapped(placed) == [("p", "places one point, as it has no texcoord", "the UV set st is taken")]
    swapped = imported(tmp_path, setting("baseColor", 'nodename="image" channels="bgr"'), nodes=nodes)
    assert unmapped(swapped)[0][0] == "S/baseColor"
    assert as_look(swapped).inputs["baseColor"] == pytest.approx((0.16, 0.16, 0.16))


def test_a_byte_order_mark_is_no_fault(tmp_path: Path) -> None:
    file = document(tmp_path, setting("sheen", 'value="0.25"'))
    file.write_text(file.read_text(), encoding="utf-8-sig")
    assert as_look(import_materialx(file)).inputs["sheen"] == 0.25


def test_materials_of_one_document_are_looks_of_one_file(tmp_path: Path) -> None:
    second = MATERIAL.replace('"M"', '"Alt gold/1"')
    found = imported(tmp_path, setting("metallic", 'value="1"'), material=MATERIAL + second)
    write_usda(found, tmp_path / "m.usda")
    for prim in ("/M", "/Alt_gold_1"):
        (layer,) = read_look(tmp_path / "m.usda", prim).layers
        assert layer.inputs["metallic"] == 1.0
    stage = Usd.Stage.Open(str(tmp_path / "m.usda"))
    data = stage.GetPrimAtPath("/Alt_gold_1").GetCustomDataByKey("lookdev:materialx")
    assert data == {"file": "m.mtlx", "material": "Alt gold/1"}
    assert {finding.severity for finding in examine(tmp_path / "m.usda").findings} == {"note"}


def test_a_look_is_written_as_its_suffix_says(tmp_path: Path) -> None:
    found = imported(tmp_path, setting("metallic", 'value="1"'))
    for suffix, start in ((".usda", b"#usda"), (".usdc", b"PXR-USDC")):
        file = tmp_path / f"look{suffix}"
        write_usda(found, file)
        assert file.read_bytes().startswith(start)
        assert examine(file).findings == ()
    with pytest.raises(OutputError, match=r"look\.txt: is no name of a look; it would end with \.usda"):
        write_usda(found, tmp_path / "look.txt")
