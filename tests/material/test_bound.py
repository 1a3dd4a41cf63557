"""Materials of other models as looks: terminals, inputs, textures, and the list of losses."""

import zipfile
from pathlib import Path
from typing import Any

import pytest
from look_files import PREVIEW, ST, asset, bound, disney, fault_texts, faults_of, materialx, preview, shader, write_gray
from pxr import UsdUtils

from lookdev.brdf import MODELS
from lookdev.errors import LookError, StageError
from lookdev.material import Displacement, Layer, Primvar, Texture
from lookdev.material.translate import TRANSLATIONS
from lookdev.material.usd import read_look
from lookdev.material.usd.bound import GREY_LAYER, BoundLook, read_any_look, read_bound_looks
from lookdev.stage import Composition, compose

pytestmark = pytest.mark.both_pythons

FILE = "asset file = @./rgb.png@\n"
CONNECTED = FILE + "float2 st <- St.result\n"
COLOR, ROUGH, NORMAL = "color3f diffuseColor <- Tex.{}", "float roughness <- Tex.{}", "normal3f normal <- Tex.rgb"
OWN = "token outputs:lookdev:surface.connect = </M/Base.outputs:layer>\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder with two images."""
    write_gray(tmp_path / "rgb.png", 3)
    write_gray(tmp_path / "rgb16.png", 3, "uint16")
    return tmp_path


def texture(more: str = "", body: str = CONNECTED) -> str:
    return shader("Tex", "UsdUVTexture", body + more) + ST


def inputs_of(result: BoundLook) -> dict[str, object]:
    (layer,) = result.look.layers
    return dict(layer.inputs)


def any_faults(file: Path, **options: object) -> list[tuple[str, str]]:
    return [fault[:2] for fault in faults_of(file, read_any_look, **options)]


RAW = 'token sourceColorSpace = "raw"; '
OPENGL = "float4 scale = (2, 2, 2, 1); float4 bias = (-1, -1, -1, 0); "
DIRECTX = "float4 scale = (2, -2, 2, 1); float4 bias = (-1, 1, -1, 0); "
CONSTANTS = """color3f diffuseColor = (0.25, 0.5, 0.75); float roughness = 0.25; int useSpecularWorkflow = 1
    token opacityMode = "presence"; normal3f normal = (0, 0, 1)"""
VALUES = {"diffuseColor": (0.25, 0.5, 0.75), "roughness": 0.25, "useSpecularWorkflow": "1", "opacityMode": "presence"}
SETTINGS = """token wrapS = "mirror"; token wrapT = "clamp"; float4 scale = (1, 2, 3, 4)
    float4 bias = (0.5, 0.25, 0.125, 0); float4 fallback = (1, 0, 0, 1)"""
THREE_CHANNELS = "is a float, connected to 3 channels"
SET = {"channel": "rgb", "colorspace": "raw", "wrap_s": "mirror", "wrap_t": "clamp", "st": "st"}
SET |= {"scale": (1.0, 2.0, 3.0, 4.0), "bias": (0.5, 0.25, 0.125, 0.0)}
TRANSFORM = "token in <- St.result; float2 scale = (2, 3); float rotation = 90; float2 translation = (0.5, 0.25)"
TRANSFORMED = shader("Tex", "UsdUVTexture", FILE + "float2 st <- T.result") + shader("T", "UsdTransform2d", TRANSFORM)
TURNED = pytest.approx((0.0, -3.0, 0.5, 2.0, 0.0, 0.25), abs=1e-12)
CONSTANT, UNCONNECTED = "float2 st = (0.25, 0.75)\n", "texture coordinates are not connected"
MAP1 = shader("St", "UsdPrimvarReader_float2", 'token varname = "map1"')


def image(file: str, space: str = "", setting: str = "") -> str:
    """Return a texture with the colour space of its file as metadata."""
    metadata = f'(\ncolorSpace = "{space}"\n)' if space else ""
    return texture(setting, f"asset file = @./{file}@ {metadata}\nfloat2 st <- St.result\n")


# Inputs of the surface, nodes, the resulting inputs (of textures: some attributes), and the faults.
CARRIED: list[tuple[str, str, dict[str, Any], list[tuple[str, str]]]] = [
    (CONSTANTS, "", VALUES | {"normal": (0.0, 0.0, 1.0)}, []),
    (COLOR.format("rgb"), texture(RAW + SETTINGS), {"diffuseColor": SET}, []),
    *((ROUGH.format(output), texture(), {"roughness": {"channel": output}}, []) for output in "rgba"),
    (ROUGH.format("rgb"), texture(), {"roughness": {"channel": "r"}}, [("S.roughness", THREE_CHANNELS)]),
    (COLOR.format("g"), texture(), {"diffuseColor": {"channel": "g"}}, []),
    *(
        (COLOR.format("rgb"), image(*given), {"diffuseColor": {"colorspace": expected}}, [])
        for *given, expected in (
            ("rgb.png", "sRGB"),
            ("rgb16.png", "raw"),
            ("rgb.png", "", RAW, "raw"),
            ("rgb.png", "lin_rec709_scene", "raw"),
            ("rgb16.png", "srgb_texture", "sRGB"),
            ("rgb16.png", "acescg", "lin_ap1_scene"),
            ("rgb16.png", "acescg", 'token sourceColorSpace = "sRGB"', "sRGB"),
        )
    ),
    *(
        (
            f"{link} <- P.result",
            shader("P", f"UsdPrimvarReader_{kind}", f"{varname}; {usd_type} fallback = {given}"),
            {link.split()[1]: Primvar("w", value)},
            [],
        )
        for kind, usd_type, link, given, value in (
            ("float", "float", "float roughness", 0.5, 0.5),
            ("int", "int", "float roughness", 1, 1.0),
            ("float3", "float3", "color3f diffuseColor", (0.25, 0.5, 1.0), (0.25, 0.5, 1.0)),
            ("vector", "vector3f", "color3f diffuseColor", (0.25, 0.5, 1.0), (0.25, 0.5, 1.0)),
        )
        for varname in ('string varname = "w"', 'token varname = "w"', "string varname <- .name")
    ),
    (ROUGH.format("r"), TRANSFORMED + MAP1, {"roughness": {"st": "map1", "transform": TURNED}}, []),
    # The specification's default of UsdUVTexture's st is the constant (0, 0), not a UV set.
    (ROUGH.format("r"), texture(body=FILE), {"roughness": {"transform": (0.0,) * 6}}, [("Tex.st", UNCONNECTED)]),
    (ROUGH.format("r"), texture(body=FILE + CONSTANT), {"roughness": {"transform": (0, 0, 0.25, 0, 0, 0.75)}}, []),
    *((NORMAL, texture(RAW + scale), {"normal": {"channel": "rgb"}}, []) for scale in (OPENGL, DIRECTX)),
    *(
        (NORMAL, texture(settings), {"normal": {"channel": "rgb"}}, [("S.normal", message)])
        for settings, message in (
            (OPENGL, "rgb.png is decoded as sRGB, but a normal map is data"),
            (RAW, "rgb.png holds 0 to 1, so no normal has a negative component"),
        )
    ),
]


@pytest.mark.parametrize(("links", "nodes", "expected", "losses"), CARRIED)
def test_inputs_are_carried(folder: Path, links: str, nodes: str, expected: dict, losses: list, capfd) -> None:
    result = bound(folder, preview(links, nodes) + 'token name = "w"\n')
    (layer,) = result.look.layers
    assert (layer.name, layer.model, result.look.name) == ("S", "preview_surface", "M")
    assert result.look.source.endswith("asset.usda</M>")
    assert set(layer.inputs) == set(expected)
    for name, value in expected.items():
        source = layer.inputs[name]
        if isinstance(value, dict):
            assert source.file in (folder / "rgb.png", folder / "rgb16.png")
            source = {key: getattr(source, key) for key in value}
        assert source == value
    assert fault_texts(result) == losses
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("identifier", [translation.identifier for translation in TRANSLATIONS.values()])
def test_every_translation_is_read_by_its_identifiers(folder: Path, identifier: str) -> None:
    result = bound(folder, preview("", identifier=identifier))
    assert TRANSLATIONS[result.look.layers[0].model].identifier == identifier
    assert not result.losses


def test_a_material_of_lookdev_is_read_as_any_look(folder: Path) -> None:
    body = OWN + disney(body="float roughness = 0") + preview("")
    rough = (Layer("Base", "disney", {"roughness": 0.0}),)
    assert bound(folder, body).look.layers == rough
    result = read_any_look(file := asset(folder, body))
    assert result.look == read_look(file)
    assert result.look.layers == rough
    assert (result.losses, result.titles) == ((), ("Disney",))
    with pytest.raises(LookError, match="unknown input"):
        bound(folder, body.replace("roughness", "rouhgness"))


def test_materialx_comes_before_the_universal_terminal(folder: Path) -> None:
    other = "token outputs:mtlx:surface.connect = </M/X.outputs:out>\n"
    body = preview("", terminal=PREVIEW + other) + shader("X", "ND_UsdPreviewSurface_surfaceshader")
    assert bound(folder, body).look.layers[0].name == "X"
    result = bound(folder, body.replace("ND_UsdPreviewSurface_surfaceshader", "ND_lama_surface"))
    assert result.look.layers[0].name == "S"
    ((where, message),) = fault_texts(result)
    assert where == "/M.outputs:mtlx:surface"
    assert "ND_lama_surface is not supported" in message
    ignored = "token outputs:mdl:surface.connect = </M/S.outputs:surface>\n"
    assert not bound(folder, preview("", terminal=PREVIEW + ignored)).losses


CYCLE = 'def NodeGraph "G"\n{\ntoken outputs:o.connect = </M/G.outputs:o>\n}\n'


def mix_material(inputs: str, more: str = "", identifier: str = "ND_mix_surfaceshader") -> str:
    terminal = "token outputs:mtlx:surface.connect = </M/Mix.outputs:out>\n"
    surface = "ND_UsdPreviewSurface_surfaceshader"
    mix = shader("Mix", identifier, "token fg <- A.out\ntoken bg <- B.out\n" + inputs)
    return terminal + mix + shader("A", surface) + shader("B", surface) + more


@pytest.mark.parametrize(
    ("body", "path", "where", "message"),
    [
        ("", "/M", "/M", "has no surface shader"),
        (preview("", identifier="PxrSurface"), "/M", "/M.outputs:surface", "of PxrSurface is not supported"),
        (PREVIEW, "/M", "/M.outputs:surface", "is neither an output of a shader"),
        (PREVIEW + 'def Shader "S"\n{\n}\n', "/M", "/M.outputs:surface", "of no info:id is not supported"),
        (PREVIEW.replace("/S", "/G").replace("surface>", "o>") + CYCLE, "/M", "/M/G.outputs:o", "run in a cycle"),
        (
            mix_material("").replace("</M/A.outputs:out>", "</M/Mix.outputs:out>"),
            "/M",
            "/M.outputs:mtlx:surface",
            "in a row",
        ),
        (preview(""), "/None", "/None", "is not a material"),
        (preview(""), "/M/S", "/M/S", "is not a material"),
    ],
)
def test_what_cannot_be_read_is_grey(folder: Path, body: str, path: str, where: str, message: str) -> None:
    result = bound(folder, body, path=path)
    assert result.look.layers == (GREY_LAYER,)
    assert any(fault_path == where and message in text for fault_path, text in fault_texts(result)), fault_texts(result)


def test_grey_says_what_can_be_read(folder: Path) -> None:
    result = bound(folder, preview("", identifier="PxrSurface"))
    assert result.titles == ("neutral grey",)
    titles = result.losses[0].what.partition("; ")[2].removesuffix(" are").split(", ")
    assert titles == sorted(set(titles), key=titles.index)
    assert "Standard Surface" in titles


def test_node_graphs_and_interface_inputs_are_followed(folder: Path) -> None:
    body = """token outputs:surface.connect = </M/G.outputs:out>
    float rough = 0.75
    float unset
    def NodeGraph "G"
    {
        float rough <- .rough
        token outputs:out.connect = </M/G/S.outputs:surface>
"""
    inputs = "float inputs:roughness.connect = </M/G.inputs:rough>\nfloat metallic <- .unset\nfloat unknown <- .unset"
    result = bound(folder, body + shader("S", "UsdPreviewSurface", inputs) + "}")
    assert inputs_of(result) == {"roughness": 0.75}
    assert not result.losses


def test_a_primvar_has_one_type_and_one_fallback(folder: Path) -> None:
    nodes = "".join(
        shader(name, f"UsdPrimvarReader_{kind}", f'string varname = "w"\n{kind} fallback = {fallback}')
        for name, kind, fallback in (("A", "float", 0.25), ("B", "float", 0.5), ("C", "float3", (1, 1, 1)))
    )
    links = "float clearcoat <- A.result\nfloat roughness <- B.result\ncolor3f diffuseColor <- C.result"
    result = bound(folder, preview(links, nodes))
    assert inputs_of(result) == {"clearcoat": Primvar("w", 0.25), "roughness": Primvar("w", 0.25)}
    assert sorted(where for where, _ in fault_texts(result)) == ["/M/B", "/M/C", "S.diffuseColor"]


@pytest.mark.parametrize(
    ("name", "message"),
    [("none.png", "no such image file"), ("bad.png", "cannot be read"), ("bad.<UDIM>.png", "cannot be read")],
)
def test_a_missing_or_damaged_image_is_an_error_or_its_fallback(folder: Path, name: str, message: str) -> None:
    for file in ("bad.png", "bad.1001.png"):
        (folder / file).write_text("no image")
    body = CONNECTED.replace("rgb.png", name)
    bad = preview(ROUGH.format("g"), texture(body=body))
    with pytest.raises(LookError, match=rf"/M/Tex\.inputs:file: .*{message}"):
        bound(folder, bad)
    result = bound(folder, bad, missing="warn")
    assert not inputs_of(result)
    assert [where for where, _ in fault_texts(result)] == ["S.roughness", "Tex.file"]
    result = bound(folder, preview(ROUGH.format("g"), texture("float4 fallback = (0, 0.5, 0, 1)", body)))
    assert inputs_of(result) == {"roughness": 0.5}
    assert [where for where, _ in fault_texts(result)] == ["Tex.file"]
    assert [where for where, _ in any_faults(asset(folder, bad))] == ["Tex.file"]


@pytest.mark.parametrize(
    ("name", "hint"),
    [("rougness", "did you mean 'roughness'?"), ("specular", ""), ("diffuse_color", "did you mean 'diffuseColor'?")],
)
def test_an_unknown_input_is_not_carried_and_a_near_one_is_named(folder: Path, name: str, hint: str) -> None:
    result = bound(folder, preview(f"float {name} = 0.5"))
    assert fault_texts(result) == [(f"S.{name}", "is not carried: UsdPreviewSurface is read without it")]
    assert result.losses[0].hint == hint


@pytest.mark.parametrize(
    ("inputs", "message", "value"),
    [
        ("float roughness = 2", "2 is outside [0, 1]", 1.0),
        ("float roughness = nan", "nan is not finite", None),
        ("float roughness = inf", "inf is not finite", None),
        ("string roughness = 'x'", "is not carried: holds a value of type string", None),
        ("float[] roughness = [1]", "holds a value of type float[], which is not read", None),
        ("color3f roughness = (0.5, 0, 0)", THREE_CHANNELS, 0.5),
        ("double roughness = 0.5", None, 0.5),
        ("half roughness = 0.5", None, 0.5),
        ("float roughness.timeSamples = { 1: 0.25, 2: 0.5 }", "is animated", 0.25),
        ("float roughness <- None.r", "is connected to </M/None.outputs:r>", None),
        ("float inputs:roughness.connect = [</M/A.outputs:r>, </M/B.outputs:r>]", "has 2 connections", None),
        ("float inputs:roughness.connect = </M/S.inputs:roughness>", "connected to </M/S.inputs:roughness>", None),
        ("int useSpecularWorkflow = 7", "is not carried: '7' is not one of 0, 1", None),
        ("normal3f normal = (0, 0, 0)", "is the zero vector, which has no direction", None),
    ],
)
def test_a_wrong_value_is_listed_and_not_taken(folder: Path, inputs: str, message: str | None, value: object) -> None:
    result = bound(folder, preview(inputs))
    name = inputs.split()[1].removeprefix("inputs:").partition(".")[0]
    assert inputs_of(result).get(name) == value
    if message is None:
        assert not result.losses
    else:
        assert any(where == f"S.{name}" and message in text for where, text in fault_texts(result)), fault_texts(result)


def test_what_translations_lose_is_listed(folder: Path) -> None:
    result = bound(folder, preview("color3f emissiveColor = (1, 1, 1)"))
    names = [name for name, _ in TRANSLATIONS["preview_surface"].losses({"emissiveColor": (1.0, 1.0, 1.0)})]
    assert [where for where, _ in fault_texts(result)] == [f"S.{name}" for name in names]


DISPLACED = PREVIEW + "token outputs:displacement.connect = </M/S.outputs:displacement>\n"


def displaced_material(inputs: str, identifier: str = "ND_displacement_float") -> str:
    terminal = PREVIEW + "token outputs:mtlx:displacement.connect = </M/D.outputs:out>\n"
    return preview("", shader("D", identifier, inputs), terminal=terminal)


def test_displacement(folder: Path) -> None:
    for body, expected in (
        (preview("float displacement = 0.5", terminal=DISPLACED), Displacement(0.5)),
        (preview("float displacement = 0", terminal=DISPLACED), None),
        (displaced_material("float displacement = 0.5\nfloat scale = 3"), Displacement(1.5)),
    ):
        assert bound(folder, body).look.displacement == expected
    image = bound(folder, preview("float displacement <- Tex.r", texture(), terminal=DISPLACED)).look
    assert isinstance(image.displacement.height, Texture)


VECTORS = displaced_material("float3 displacement = (0, 0, 1)", "ND_displacement_vector3")
MATERIALX_TERMINAL = "/M.outputs:mtlx:displacement"


@pytest.mark.parametrize(
    ("body", "where", "message"),
    [
        (preview("float displacement = 0.5"), "S.displacement", ""),  # no terminal is connected to it
        (VECTORS, MATERIALX_TERMINAL, "displaces by vectors"),
        (displaced_material("", "PxrDisplace"), MATERIALX_TERMINAL, "PxrDisplace is not supported"),
        (displaced_material("float displacement <- None.r"), MATERIALX_TERMINAL, "is not carried"),
    ],
)
def test_displacement_that_cannot_be_read_is_noted(folder: Path, body: str, where: str, message: str) -> None:
    result = bound(folder, body)
    assert result.look.displacement is None
    assert any(fault_path == where and message in text for fault_path, text in fault_texts(result))


def test_volumes_are_noted(folder: Path) -> None:
    body = preview("", terminal=PREVIEW + "token outputs:volume.connect = </M/S.outputs:surface>\n")
    assert fault_texts(bound(folder, body)) == [("/M.outputs:volume", "volumes are not supported")]


def test_a_mix_of_surfaces_is_a_layer_over_another(folder: Path) -> None:
    constant = bound(folder, mix_material("float mix = 0.25")).look
    assert [(layer.name, layer.mask, layer.mode) for layer in constant.layers] == [
        ("B", 1.0, "over"),
        ("A", 0.25, "over"),
    ]
    assert isinstance(bound(folder, mix_material("float mix <- Tex.r", texture())).look.layers[1].mask, Texture)
    inner = mix_material("float mix = 0.25").replace('"Mix"', '"Inner"').replace("/Mix.", "/Outer.")
    outer = shader("Outer", "ND_mix_surfaceshader", "token fg <- Inner.out\ntoken bg <- A.out\nfloat mix = 0.75")
    layers = bound(folder, inner + outer).look.layers
    assert [(layer.name, layer.mask) for layer in layers] == [("B", 1.0), ("A", 0.25), ("A", 0.25)]


def test_disney_principled_is_a_layer_of_disneys_model(folder: Path) -> None:
    result = bound(folder, preview("float metallic = 1", identifier="ND_disney_principled"))
    assert result.look.layers[0].model == "disney"
    assert inputs_of(result) == {"metallic": 1.0, "baseColor": (0.16, 0.16, 0.16)}
    assert set(inputs_of(result)) <= set(MODELS["disney"].parameters)


def test_bumps_and_normals_of_materialx(folder: Path) -> None:
    image = shader("Tex", "ND_image_float", "asset file = @./rgb.png@")
    node = shader("B", "ND_bump_vector3", "float height <- Tex.out\nfloat scale = 8")
    result = bound(folder, materialx("float3 normal <- B.out\n", node, image))
    bump = inputs_of(result)["normal"]
    assert (bump.scale, bump.height.channel) == (0.5, "r")
    assert not result.losses


def test_colours_are_converted_to_linear_rec709(folder: Path) -> None:
    color = 'color3f {} = {} (\ncolorSpace = "{}"\n)'.replace("color3f ", "color3f inputs:")
    result = bound(folder, preview(color.format("diffuseColor", "(0.5, 0.5, 0.5)", "srgb_texture")))
    assert inputs_of(result)["diffuseColor"] == pytest.approx((0.2140411,) * 3, abs=1e-6)
    result = bound(folder, preview(color.format("emissiveColor", "(1, 0, 0)", "acescg")))
    # Negative channels are clipped.
    assert inputs_of(result)["emissiveColor"] == pytest.approx((1.705051, 0.0, 0.0), abs=1e-5)
    odd = bound(folder, preview(color.format("diffuseColor", "(0.5, 0.5, 0.5)", "my_space")))
    assert fault_texts(odd) == [("S.diffuseColor", "the colour space 'my_space' is unknown")]


def test_several_materials_are_read_once_each(folder: Path) -> None:
    looks = read_bound_looks(compose(Composition(asset(folder, preview("float roughness = 2")))), ["/M", "/M"])
    assert list(looks) == ["/M"]
    assert len(looks["/M"].losses) == 1


MATERIAL = """<surfacematerial name="{}" type="material">
    <input name="surfaceshader" type="surfaceshader" nodename="S"/>
  </surfacematerial>"""
DOCUMENT = """<materialx version="1.38">
  <standard_surface name="S" type="surfaceshader">
    <input name="metalness" type="float" value="1"/>
    <input name="subsurface" type="float" value="0.5"/>
  </standard_surface>{}</materialx>"""


def test_a_document_is_a_look(folder: Path) -> None:
    file = folder / "gold.mtlx"
    file.write_text(DOCUMENT.format(MATERIAL.format("Gold")))
    result = read_any_look(file, name="gold")
    assert result.look.layers == (Layer("S", "standard_surface", {"metalness": 1.0, "subsurface": 0.5}),)
    assert (result.look.name, result.look.source) == ("gold", f"{file}</MaterialX/Materials/Gold>")
    assert result.titles == ("Standard Surface as Disney",)
    assert [where for where, _ in fault_texts(result)] == ["/MaterialX/Materials/Gold/S.inputs:subsurface"]
    file.write_text(DOCUMENT.format(MATERIAL.format("Gold") + MATERIAL.format("Tin")))
    assert read_any_look(file, "/MaterialX/Materials/Tin").look.name == "Tin"
    assert any_faults(file) == [("", "holds 2 materials and none is the default prim")]


def test_a_package_is_a_look_with_its_images(folder: Path) -> None:
    source, package = asset(folder, preview(COLOR.format("rgb"), texture())), folder / "m.usdz"
    assert UsdUtils.CreateNewUsdzPackage(str(source), str(package))
    assert zipfile.is_zipfile(package)
    assert inputs_of(read_any_look(package))["diffuseColor"].file.is_file()


def test_variants_are_those_of_the_material(tmp_path: Path) -> None:
    rough = '"{}" {{\nover "S" {{\nfloat inputs:roughness = {}\n}}\n}}\n'
    sets = 'variantSet "wear" = {\n' + rough.format("new", 0.25) + rough.format("worn", 0.75) + "}\n"
    file = asset(tmp_path, preview("") + sets)
    file.write_text(file.read_text().replace('"M"', '"M" ( prepend variantSets = "wear" )'))
    assert inputs_of(read_any_look(file, variants={"wear": "worn"})) == {"roughness": 0.75}
    assert any_faults(file, variants={"wear": "old"}) == [("/M", "variant set 'wear' has no variant 'old'")]


@pytest.mark.parametrize(
    "body",
    [
        "token outputs:lookdev:surface\n" + disney() + preview(""),  # no preview of itself
        OWN.replace("surface", "surfce") + disney() + preview(""),
        disney(),
        PREVIEW.replace("surface", "displacement") + shader("S", "UsdPreviewSurface"),
    ],
)
def test_a_look_that_is_not_connected_is_an_error(tmp_path: Path, body: str) -> None:
    assert any_faults(asset(tmp_path, body)) == [("/M.outputs:lookdev:surface", "is not connected")]


def test_a_surface_that_cannot_be_read_is_an_error(tmp_path: Path) -> None:
    first, second = any_faults(asset(tmp_path, preview("", identifier="ND_lama_surface")))
    assert first == ("/M", "has no surface shader that can be read")
    assert second[0] == "/M.outputs:surface"
    assert "ND_lama_surface" in second[1]


def test_a_broken_reference_of_the_material_is_an_error(tmp_path: Path) -> None:
    file = asset(tmp_path, preview(""))
    file.write_text(file.read_text().replace('"M"', '"M" ( references = @./gone.usda@ )'))
    ((where, message),) = any_faults(file)
    assert where == "/M"
    assert "gone.usda" in message


SURFACE = '<UsdPreviewSurface name="S" type="surfaceshader">{}</UsdPreviewSurface>'
GOLD = """<surfacematerial name="Gold" type="material">
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
LOOKS = '#usda 1.0\ndef Scope "Looks" (\n prepend references = @./x.mtlx@</MaterialX/Materials>\n)\n{{\n{}\n}}\n'


def write_reference(folder: Path, *parts: str, over: str = "") -> Path:
    (folder / "x.mtlx").write_text(f'<materialx version="1.38" colorspace="lin_rec709">{"".join(parts)}</materialx>')
    (folder / "asset.usda").write_text(LOOKS.format(over))
    return folder / "asset.usda"


def gold(file: Path) -> BoundLook:
    return read_bound_looks(compose(Composition(file)), ["/Looks/Gold"])["/Looks/Gold"]


def test_a_material_of_a_document(folder: Path) -> None:
    inputs = """<input name="roughness" type="float" value="0.25"/>
      <input name="diffuseColor" type="color3" nodegraph="G" output="o"/>
      <input name="metallic" type="float" nodename="top"/>"""
    top = '<constant name="top" type="float"><input name="value" type="float" value="1"/></constant>'
    result = gold(write_reference(folder, GRAPH, top, SURFACE.format(inputs), GOLD.format("")))
    (layer,) = result.look.layers
    assert (result.look.name, layer.model) == ("Gold", "materialx_preview_surface")
    assert (layer.inputs["roughness"], layer.inputs["metallic"]) == (0.25, 1.0)
    images = [source for source in layer.inputs["diffuseColor"].inputs.values() if isinstance(source, Texture)]
    assert {(image.colorspace, image.channel) for image in images} == {("sRGB", "rgb"), ("raw", "g")}
    assert not result.losses


def test_the_asset_overrides_an_input(folder: Path) -> None:
    over = ' over "Gold"\n {\n  float inputs:roughness = 0.75\n  float inputs:clearcoat = 1\n }'
    shader = SURFACE.format('<input name="roughness" type="float" value="0.25"/>')
    (layer,) = gold(write_reference(folder, shader, GOLD.format(""), over=over)).look.layers
    assert (layer.inputs["roughness"], layer.inputs["clearcoat"]) == (0.75, 1.0)


def test_displacement_of_a_document(folder: Path) -> None:
    node = """<displacement name="D" type="displacementshader">
      <input name="displacement" type="float" value="0.5"/><input name="scale" type="float" value="2"/>
    </displacement>"""
    link = '<input name="displacementshader" type="displacementshader" nodename="D"/>'
    result = gold(write_reference(folder, node, SURFACE.format(""), GOLD.format(link)))
    assert result.look.displacement == Displacement(1.0)


def test_what_the_document_loses_is_listed_with_its_place_in_it(folder: Path) -> None:
    (fault,) = gold(write_reference(folder, '<look name="L"/>', SURFACE.format(""), GOLD.format(""))).losses
    assert (fault.file, fault.where, fault.what) == (str(folder / "x.mtlx"), "L", "<look> is not read")


ROUGH_OF = '<input name="roughness" type="float" {}/>'
INWARD = '<add name="a" type="float"><input name="in1" type="float" nodename="a"/></add>'
OF_H = ROUGH_OF.format('nodegraph="H" output="o"')


@pytest.mark.parametrize(
    ("inputs", "nodes", "message"),
    [
        (ROUGH_OF.format('nodename="none"'), "", "which is neither an output of a shader"),
        (OF_H, "", "which is neither an output of a shader"),
        (ROUGH_OF.format('nodename="a"'), INWARD, "its connections run in a cycle"),
        (OF_H, '<nodegraph name="H"><output name="o" type="float" output="o"/></nodegraph>', "is connected to"),
        (ROUGH_OF.format('nodename="n"'), '<noise3d name="n" type="float"/>', "ND_noise3d_float is not supported"),
    ],
)
def test_what_is_broken_in_a_document_is_listed(folder: Path, inputs: str, nodes: str, message: str) -> None:
    result = gold(write_reference(folder, nodes, SURFACE.format(inputs), GOLD.format("")))
    assert "roughness" not in inputs_of(result)
    assert any(message in text for _, text in fault_texts(result)), fault_texts(result)


def test_a_missing_image_of_a_document_names_the_prim(folder: Path) -> None:
    inputs = '<input name="diffuseColor" type="color3" nodegraph="G" output="o"/>'
    file = write_reference(folder, GRAPH.replace("rgb.png", "none.png"), SURFACE.format(inputs), GOLD.format(""))
    with pytest.raises(LookError) as caught:
        gold(file)
    assert {fault.where for fault in caught.value.faults} >= {"/Looks/Gold/G/i.inputs:file"}


def test_a_malformed_document_is_an_error_of_the_stage(folder: Path) -> None:
    file = write_reference(folder, SURFACE.format('<input name="roughness" type="float" value="x"/>'), GOLD.format(""))
    with pytest.raises(StageError) as caught:
        gold(file)
    ((fault),) = caught.value.faults
    assert (fault.file, fault.where) == (str(folder / "x.mtlx"), "S/roughness")
