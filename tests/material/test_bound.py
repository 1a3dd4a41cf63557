"""Materials that an asset binds, as looks: terminals, inputs, textures, and the list of what is not carried."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from look_files import PREVIEW, ST, asset, bound, disney, lost, materialx, preview, shader, write_gray

from lookdev.brdf import MODELS
from lookdev.errors import LookError
from lookdev.material.look import Bump, Displacement, Layer, Primvar, Texture
from lookdev.material.translate import TRANSLATIONS
from lookdev.material.usd.bound import GREY, read_bound
from lookdev.stage import Composition, compose

FILE = "asset file = @./rgb.png@\n"
CONNECTED = FILE + "float2 st <- St.result\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder with two images."""
    write_gray(tmp_path / "rgb.png", 3)
    write_gray(tmp_path / "rgb16.png", 3, "uint16")
    return tmp_path


def texture(more: str = "", body: str = CONNECTED) -> str:
    return shader("Tex", "UsdUVTexture", body + more) + ST


def layer_of(folder: Path, body: str, **options: str) -> Layer:
    (layer,) = bound(folder, body, **options).look.layers
    return layer


def test_constants_are_inputs_of_the_translation(folder: Path) -> None:
    inputs = """color3f diffuseColor = (0.1, 0.2, 0.3)
    float roughness = 0.25
    int useSpecularWorkflow = 1
    token opacityMode = "presence"
    normal3f normal = (0, 0, 1) """
    found = bound(folder, preview(inputs))
    (layer,) = found.look.layers
    assert (layer.name, layer.model) == ("S", "preview_surface")
    assert layer.inputs["diffuseColor"] == pytest.approx((0.1, 0.2, 0.3))
    assert (layer.inputs["roughness"], layer.inputs["useSpecularWorkflow"]) == (0.25, "1")
    assert (layer.inputs["opacityMode"], layer.inputs["normal"]) == ("presence", (0.0, 0.0, 1.0))
    assert found.look.name == "M"
    assert found.look.source.endswith("asset.usda</M>")
    assert not found.lost


@pytest.mark.parametrize("identifier", [name for each in TRANSLATIONS.values() for name in each.identifiers])
def test_every_translation_is_read_by_its_identifiers(folder: Path, identifier: str) -> None:
    found = bound(folder, preview("", identifier=identifier))
    assert TRANSLATIONS[found.look.layers[0].model].identifiers.count(identifier) == 1
    assert not found.lost


def test_a_material_of_lookdev_is_read_as_any_look(folder: Path) -> None:
    body = "token outputs:lookdev:surface.connect = </M/Base.outputs:layer>\n" + disney(body="float roughness = 0")
    assert layer_of(folder, body + preview("")) == Layer("Base", "disney", {"roughness": 0.0})
    with pytest.raises(LookError, match="unknown input"):
        bound(folder, body.replace("roughness", "rouhgness"))


def test_materialx_comes_before_the_universal_terminal(folder: Path) -> None:
    other = "token outputs:mtlx:surface.connect = </M/X.outputs:out>\n"
    body = preview("", terminal=PREVIEW + other) + shader("X", "ND_UsdPreviewSurface_surfaceshader")
    assert layer_of(folder, body).name == "X"
    found = bound(folder, body.replace("ND_UsdPreviewSurface_surfaceshader", "ND_lama_surface"))
    assert found.look.layers[0].name == "S"
    ((where, what),) = lost(found)
    assert where == "/M.outputs:mtlx:surface"
    assert "ND_lama_surface is not supported" in what
    ignored = "token outputs:mdl:surface.connect = </M/S.outputs:surface>\n"
    assert not bound(folder, preview("", terminal=PREVIEW + ignored)).lost


@pytest.mark.parametrize(
    ("body", "where", "what"),
    [
        ("", "/M", "has no surface shader"),
        (preview("", identifier="PxrSurface"), "/M.outputs:surface", "of PxrSurface is not supported"),
        (PREVIEW, "/M.outputs:surface", "is no output of a shader"),
        (PREVIEW + 'def Shader "S"\n{\n}\n', "/M.outputs:surface", "of no info:id is not supported"),
        (
            'token outputs:surface.connect = </M/G.outputs:o>\ndef NodeGraph "G"\n{\n'
            "token outputs:o.connect = </M/G.outputs:o>\n}\n",
            "/M/G.outputs:o",
            "its connections run in a cycle",
        ),
    ],
)
def test_what_has_no_readable_shader_is_grey(folder: Path, body: str, where: str, what: str) -> None:
    found = bound(folder, body)
    assert found.look.layers == (GREY,)
    assert any(place == where and what in said for place, said in lost(found)), lost(found)


@pytest.mark.parametrize("path", ["/None", "/M/S"])
def test_what_is_no_material_is_grey(folder: Path, path: str) -> None:
    found = bound(folder, preview(""), path=path)
    assert found.look.layers == (GREY,)
    assert lost(found) == [(path, "is no material")]


def test_node_graphs_and_interface_inputs_are_followed(folder: Path) -> None:
    body = """token outputs:surface.connect = </M/G.outputs:out>
    float rough = 0.75
    float unset
    def NodeGraph "G"
    {
        float rough <- .rough
        token outputs:out.connect = </M/G/S.outputs:surface>
""" + shader(
        "S",
        "UsdPreviewSurface",
        """float inputs:roughness.connect = </M/G.inputs:rough>
        float metallic <- .unset
        float unknown <- .unset""",
    )
    found = bound(folder, body + "}")
    assert found.look.layers[0].inputs == {"roughness": 0.75}
    assert not found.lost


def test_a_texture_with_all_its_settings(folder: Path) -> None:
    settings = """token sourceColorSpace = "raw"
    token wrapS = "mirror"
    token wrapT = "clamp"
    float4 scale = (1, 2, 3, 4)
    float4 bias = (0.5, 0.25, 0.125, 0)
    float4 fallback = (1, 0, 0, 1)"""
    link = "color3f diffuseColor <- Tex.rgb"
    found = bound(folder, preview(link, texture(settings)))
    expected = Texture(
        folder / "rgb.png", "rgb", "raw", "mirror", "clamp", scale=(1, 2, 3, 4), bias=(0.5, 0.25, 0.125, 0)
    )
    assert found.look.layers[0].inputs == {"diffuseColor": expected}
    assert not found.lost


@pytest.mark.parametrize(
    ("file", "metadata", "setting", "expected"),
    [
        ("rgb.png", "", "", "sRGB"),
        ("rgb16.png", "", "", "raw"),
        ("rgb.png", "", 'token sourceColorSpace = "raw"', "raw"),
        ("rgb.png", '(\ncolorSpace = "lin_rec709_scene"\n)', "", "raw"),
        ("rgb16.png", '(\ncolorSpace = "srgb_texture"\n)', "", "sRGB"),
        ("rgb16.png", '(\ncolorSpace = "acescg"\n)', "", "lin_ap1_scene"),
        ("rgb16.png", '(\ncolorSpace = "acescg"\n)', 'token sourceColorSpace = "sRGB"', "sRGB"),
    ],
)
def test_colour_spaces_of_images(folder: Path, file: str, metadata: str, setting: str, expected: str) -> None:
    body = f"asset file = @./{file}@ {metadata}\nfloat2 st <- St.result\n{setting}"
    link = "color3f diffuseColor <- Tex.rgb"
    found = layer_of(folder, preview(link, texture(body=body))).inputs["diffuseColor"]
    assert isinstance(found, Texture)
    assert found.colorspace == expected


@pytest.mark.parametrize("output", ["r", "g", "b", "a"])
def test_floats_are_channels(folder: Path, output: str) -> None:
    found = layer_of(folder, preview(f"float roughness <- Tex.{output}", texture()))
    assert isinstance(found.inputs["roughness"], Texture)
    assert found.inputs["roughness"].channel == output


def test_a_float_from_a_colour_is_its_first_channel_and_noted(folder: Path) -> None:
    found = bound(folder, preview("float roughness <- Tex.rgb", texture()))
    assert found.look.layers[0].inputs["roughness"].channel == "r"  # type: ignore[union-attr]
    assert lost(found) == [("/M/S.inputs:roughness", "is a float, connected to 3 channels")]


def test_a_colour_from_a_float_is_three_equal_channels(folder: Path) -> None:
    found = bound(folder, preview("color3f diffuseColor <- Tex.g", texture()))
    assert found.look.layers[0].inputs["diffuseColor"].channel == "g"  # type: ignore[union-attr]
    assert not found.lost


@pytest.mark.parametrize("varname", ['string varname = "w"', 'token varname = "w"', ""])
@pytest.mark.parametrize(
    ("reader", "link", "fallback"),
    [
        ("float", "float roughness", 0.5),
        ("int", "float roughness", 1.0),
        ("float3", "color3f diffuseColor", (0.25, 0.5, 1.0)),
        ("vector", "color3f diffuseColor", (0.25, 0.5, 1.0)),
    ],
)
def test_primvars(
    folder: Path, varname: str, reader: str, link: str, fallback: float | tuple[float, float, float]
) -> None:
    types = {"float": "float", "int": "int", "float3": "float3", "vector": "vector3f"}
    name = varname or "string varname <- .name"
    given = int(fallback) if reader == "int" else fallback
    node = shader("P", f"UsdPrimvarReader_{reader}", f"{name}\n{types[reader]} inputs:fallback = {given}")
    body = preview(f"{link} <- P.result", node) + 'token name = "w"\n'
    found = bound(folder, body)
    assert list(found.look.layers[0].inputs.values()) == [Primvar("w", fallback)]
    assert not found.lost


def test_a_primvar_has_one_type_and_one_fallback(folder: Path) -> None:
    nodes = "".join(
        shader(name, f"UsdPrimvarReader_{kind}", f'string varname = "w"\n{kind} fallback = {fallback}')
        for name, kind, fallback in (("A", "float", 0.25), ("B", "float", 0.5), ("C", "float3", (1, 1, 1)))
    )
    links = [
        f"{kind} {name} <- {node}.result\n"
        for kind, name, node in (
            ("float", "clearcoat", "A"),
            ("float", "roughness", "B"),
            ("color3f", "diffuseColor", "C"),
        )
    ]
    found = bound(folder, preview("".join(links), nodes))
    assert found.look.layers[0].inputs == {"clearcoat": Primvar("w", 0.25), "roughness": Primvar("w", 0.25)}
    assert sorted(where for where, _ in lost(found)) == ["/M/B", "/M/C", "/M/S.inputs:diffuseColor"]


def test_transforms_and_uv_sets(folder: Path) -> None:
    nodes = (
        shader("Tex", "UsdUVTexture", FILE + "float2 st <- T.result")
        + shader(
            "T",
            "UsdTransform2d",
            """token in <- St.result
            float2 scale = (2, 3)
            float rotation = 90
            float2 translation = (0.5, 0.25)""",
        )
        + shader("St", "UsdPrimvarReader_float2", 'token varname = "map1"')
    )
    found = bound(folder, preview("float roughness <- Tex.r", nodes))
    image = found.look.layers[0].inputs["roughness"]
    assert isinstance(image, Texture)
    assert image.st == "map1"
    np.testing.assert_allclose(image.transform, (0.0, -3.0, 0.5, 2.0, 0.0, 0.25), atol=1e-12)
    assert not found.lost


@pytest.mark.parametrize(("authored", "where"), [("", (0.0, 0.0)), ("float2 st = (0.25, 0.75)\n", (0.25, 0.75))])
def test_coordinates_that_are_not_connected_are_one_place(
    folder: Path, authored: str, where: tuple[float, float]
) -> None:
    """The specification's default of UsdUVTexture's st is the constant (0, 0), not a UV set."""
    found = bound(folder, preview("float roughness <- Tex.r", texture(body=FILE + authored)))
    image = found.look.layers[0].inputs["roughness"]
    assert isinstance(image, Texture)
    assert image.transform == (0.0, 0.0, where[0], 0.0, 0.0, where[1])
    assert lost(found) == ([] if authored else [("/M/Tex.inputs:st", "texture coordinates are not connected")])


NORMAL = "normal3f normal <- Tex.rgb"
RAW = 'token sourceColorSpace = "raw"\n'
OPENGL = RAW + "float4 scale = (2, 2, 2, 1)\nfloat4 bias = (-1, -1, -1, 0)"
DIRECTX = RAW + "float4 scale = (2, -2, 2, 1)\nfloat4 bias = (-1, 1, -1, 0)"


@pytest.mark.parametrize("settings", [OPENGL, DIRECTX])
def test_normal_maps_of_both_conventions(folder: Path, settings: str) -> None:
    found = bound(folder, preview(NORMAL, texture(settings)))
    assert isinstance(found.look.layers[0].inputs["normal"], Texture)
    assert not found.lost


@pytest.mark.parametrize(
    ("settings", "what"),
    [
        (OPENGL.replace(RAW, ""), "rgb.png is decoded as sRGB, but a normal map is data"),
        (RAW, "rgb.png holds 0 to 1, so no normal has a negative component"),
    ],
)
def test_doubtful_normal_maps_are_carried_and_noted(folder: Path, settings: str, what: str) -> None:
    found = bound(folder, preview(NORMAL, texture(settings)))
    assert isinstance(found.look.layers[0].inputs["normal"], Texture)
    assert lost(found) == [("/M/S.inputs:normal", what)]


MISSING = "asset file = @./none.png@\nfloat2 st <- St.result\n"


def test_missing_images_are_errors_that_name_file_and_prim(folder: Path) -> None:
    body = preview("float roughness <- Tex.r", texture(body=MISSING))
    with pytest.raises(LookError) as caught:
        bound(folder, body)
    ((fault),) = caught.value.faults
    assert (fault.where, fault.what) == ("/M/Tex.inputs:file", "no such image file: ./none.png")
    found = bound(folder, body, missing="warn")
    assert "roughness" not in found.look.layers[0].inputs
    assert ("/M/Tex.inputs:file", "no such image file: ./none.png") in lost(found)


def test_the_fallback_of_a_missing_image_is_taken_and_noted(folder: Path) -> None:
    fallback = "float4 fallback = (0.25, 0.5, 0.75, 1)"
    body = preview("float roughness <- Tex.g", texture(fallback, MISSING))
    found = bound(folder, body)
    assert found.look.layers[0].inputs["roughness"] == 0.5
    assert lost(found) == [("/M/Tex.inputs:file", "no such image file: ./none.png")]


@pytest.mark.parametrize("name", ["bad.png", "bad.<UDIM>.png"])
def test_an_image_that_is_none_is_as_a_missing_one(folder: Path, name: str) -> None:
    (folder / name.replace("<UDIM>", "1001")).write_text("no image")
    body = CONNECTED.replace("rgb.png", name)
    given = "float roughness <- Tex.g"
    with pytest.raises(LookError, match=r"Tex\.inputs:file: .* cannot be read as an image"):
        bound(folder, preview(given, texture(body=body)))
    found = bound(folder, preview(given, texture(body=body)), missing="warn")
    assert not found.look.layers[0].inputs
    assert [where for where, _ in lost(found)] == ["/M/S.inputs:roughness", "/M/Tex.inputs:file"]
    found = bound(folder, preview(given, texture("float4 fallback = (0, 0.5, 0, 1)", body)))
    assert found.look.layers[0].inputs == {"roughness": 0.5}
    assert [where for where, _ in lost(found)] == ["/M/Tex.inputs:file"]


@pytest.mark.parametrize(
    ("name", "hint"),
    [("rougness", "did you mean 'roughness'?"), ("specular", ""), ("diffuse_color", "did you mean 'diffuseColor'?")],
)
def test_an_unknown_input_is_not_carried_and_a_near_one_is_named(folder: Path, name: str, hint: str) -> None:
    (fault,) = bound(folder, preview(f"float {name} = 0.5")).lost
    assert (fault.where, fault.hint) == (f"/M/S.inputs:{name}", hint)
    assert "is not carried" in fault.what


def test_what_cannot_be_read_is_grey_and_says_what_can(folder: Path) -> None:
    found = bound(folder, preview("", identifier="PxrSurface"))
    assert found.look.layers == (GREY,)
    assert found.titles == ("neutral grey",)
    titles = found.lost[0].what.partition("; ")[2].removesuffix(" are").split(", ")
    assert titles == sorted(set(titles), key=titles.index)
    assert "Standard Surface" in titles


@pytest.mark.parametrize(
    ("inputs", "what", "value"),
    [
        ("float roughness = 2", "2 is outside [0, 1]", 1.0),
        ("float roughness = nan", "nan is not finite", None),
        ("float roughness = inf", "inf is not finite", None),
        ("string roughness = 'x'", "is not carried: holds a value of type string", None),
        ("float[] roughness = [1]", "holds a value of type float[], which is not read", None),
        ("color3f roughness = (0.5, 0, 0)", "is a float, connected to 3 channels", 0.5),
        ("double roughness = 0.5", None, 0.5),
        ("half roughness = 0.5", None, 0.5),
        ("float inputs:roughness.timeSamples = { 1: 0.25, 2: 0.5 }", "is animated", 0.25),
        ("float roughness <- None.r", "is connected to </M/None.outputs:r>", None),
        ("float inputs:roughness.connect = [</M/A.outputs:r>, </M/B.outputs:r>]", "has 2 connections", None),
        ("float inputs:roughness.connect = </M/S.inputs:roughness>", "is connected to </M/S.inputs:roughness>", None),
        ("float specular = 0.5", "is not carried: UsdPreviewSurface is read without it", None),
        ("int useSpecularWorkflow = 7", "is not carried: '7' is none of 0, 1", None),
        ("normal3f normal = (0, 0, 0)", "is the zero vector, which has no direction", None),
    ],
)
def test_what_is_wrong_is_listed_and_the_default_taken(
    folder: Path, inputs: str, what: str | None, value: float | None
) -> None:
    found = bound(folder, preview(inputs))
    name = inputs.split()[1].removeprefix("inputs:").partition(".")[0]
    assert found.look.layers[0].inputs.get(name) == value
    if what is None:
        assert not found.lost
    else:
        assert any(where == f"/M/S.inputs:{name}" and what in said for where, said in lost(found)), lost(found)


def test_what_translations_lose_is_listed(folder: Path) -> None:
    found = bound(folder, preview("color3f emissiveColor = (1, 1, 1)"))
    names = [name for name, _ in TRANSLATIONS["preview_surface"].losses({"emissiveColor": (1.0, 1.0, 1.0)})]
    assert [where for where, _ in lost(found)] == [f"/M/S.inputs:{name}" for name in names]


DISPLACED = PREVIEW + "token outputs:displacement.connect = </M/S.outputs:displacement>\n"


def test_displacement(folder: Path) -> None:
    constant = bound(folder, preview("float displacement = 0.5", terminal=DISPLACED)).look
    assert constant.displacement == Displacement(0.5)
    link = "float displacement <- Tex.r"
    image = bound(folder, preview(link, texture(), terminal=DISPLACED)).look
    assert image.displacement is not None
    assert isinstance(image.displacement.height, Texture)
    assert bound(folder, preview("float displacement = 0", terminal=DISPLACED)).look.displacement is None


def test_displacement_without_a_terminal_has_no_effect_and_is_noted(folder: Path) -> None:
    found = bound(folder, preview("float displacement = 0.5"))
    assert found.look.displacement is None
    assert [where for where, _ in lost(found)] == ["/M/S.inputs:displacement"]


def displaced(inputs: str, identifier: str = "ND_displacement_float") -> str:
    terminal = PREVIEW + "token outputs:mtlx:displacement.connect = </M/D.outputs:out>\n"
    return preview("", shader("D", identifier, inputs), terminal=terminal)


def test_displacement_of_materialx(folder: Path) -> None:
    inputs = "float displacement = 0.5\nfloat scale = 3"
    assert bound(folder, displaced(inputs)).look.displacement == Displacement(1.5)


@pytest.mark.parametrize(
    ("body", "what"),
    [
        (displaced("float3 displacement = (0, 0, 1)", "ND_displacement_vector3"), "displaces by vectors"),
        (displaced("", "PxrDisplace"), "PxrDisplace is not supported"),
        (displaced("float displacement <- None.r"), "is not carried"),
    ],
)
def test_displacement_that_cannot_be_read_is_noted(folder: Path, body: str, what: str) -> None:
    found = bound(folder, body)
    assert found.look.displacement is None
    assert any(where == "/M.outputs:mtlx:displacement" and what in said for where, said in lost(found))


def test_volumes_are_noted(folder: Path) -> None:
    body = preview("", terminal=PREVIEW + "token outputs:volume.connect = </M/S.outputs:surface>\n")
    assert lost(bound(folder, body)) == [("/M.outputs:volume", "volumes are not supported")]


def mixed(inputs: str, more: str = "", identifier: str = "ND_mix_surfaceshader") -> str:
    terminal = "token outputs:mtlx:surface.connect = </M/Mix.outputs:out>\n"
    links = "token fg <- A.out\ntoken bg <- B.out\n"
    surface = "ND_UsdPreviewSurface_surfaceshader"
    return terminal + shader("Mix", identifier, links + inputs) + shader("A", surface) + shader("B", surface) + more


def test_a_mix_of_surfaces_is_a_layer_over_another(folder: Path) -> None:
    constant = bound(folder, mixed("float mix = 0.25")).look
    assert [(each.name, each.mask, each.mode) for each in constant.layers] == [("B", 1.0, "over"), ("A", 0.25, "over")]
    textured = bound(folder, mixed("float mix <- Tex.r", texture())).look
    assert isinstance(textured.layers[1].mask, Texture)


def test_a_mix_of_a_mix_lies_beneath(folder: Path) -> None:
    outer = mixed("float mix = 0.25").replace('"Mix"', '"Inner"').replace("/Mix.", "/Outer.")
    links = "token fg <- Inner.out\ntoken bg <- A.out\n"
    body = outer + shader("Outer", "ND_mix_surfaceshader", links + "float mix = 0.75")
    layers = bound(folder, body).look.layers
    assert [(each.name, each.mask) for each in layers] == [("B", 1.0), ("A", 0.25), ("A", 0.25)]


def test_mixes_in_a_cycle_are_grey(folder: Path) -> None:
    body = mixed("").replace("</M/A.outputs:out>", "</M/Mix.outputs:out>")
    found = bound(folder, body)
    assert found.look.layers == (GREY,)
    assert found.lost


def test_disney_principled_is_a_layer_of_disneys_model(folder: Path) -> None:
    found = bound(folder, preview("float metallic = 1", identifier="ND_disney_principled"))
    assert found.look.layers[0].model == "disney"
    assert found.look.layers[0].inputs == {"metallic": 1.0, "baseColor": (0.16, 0.16, 0.16)}
    assert set(found.look.layers[0].inputs) <= set(MODELS["disney"].parameters)


def test_bumps_and_normals_of_materialx(folder: Path) -> None:
    link = "float3 normal <- B.out\n"
    image = shader("Tex", "ND_image_float", "asset file = @./rgb.png@")
    node = shader("B", "ND_bump_vector3", "float height <- Tex.out\nfloat scale = 8")
    found = bound(folder, materialx(link, node, image))
    bump = found.look.layers[0].inputs["normal"]
    assert isinstance(bump, Bump)
    assert (bump.scale, bump.height.channel) == (0.5, "r")
    assert not found.lost


def test_colours_are_converted_to_linear_rec709(folder: Path) -> None:
    body = preview('color3f diffuseColor = (0.5, 0.5, 0.5) (\ncolorSpace = "srgb_texture"\n)')
    assert layer_of(folder, body).inputs["diffuseColor"] == pytest.approx((0.2140411,) * 3, abs=1e-6)
    body = preview('color3f emissiveColor = (1, 0, 0) (\ncolorSpace = "acescg"\n)')
    emissive = layer_of(folder, body).inputs["emissiveColor"]
    assert emissive == pytest.approx((1.705051, 0.0, 0.0), abs=1e-5)  # negative channels are clipped
    odd = bound(folder, preview('color3f diffuseColor = (0.5, 0.5, 0.5) (\ncolorSpace = "my_space"\n)'))
    assert lost(odd) == [("/M/S.inputs:diffuseColor", "the colour space 'my_space' is unknown")]


def test_several_materials_are_read_once_each(folder: Path) -> None:
    file = asset(folder, preview("float roughness = 2"))
    looks = read_bound(compose(Composition(file)), ["/M", "/M"])
    assert list(looks) == ["/M"]
    assert len(looks["/M"].lost) == 1


def test_nothing_is_written_to_stderr(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    bound(folder, preview(NORMAL, texture(RAW)))
    assert capfd.readouterr().err == ""
