"""Nodes of MaterialX in bound materials: their values at points, against the definitions of the standard library."""

import time
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
import pytest
from look_files import bound, fault_texts, materialx, rotate_clockwise, shader, write_gray

from lookdev.arrays import Floats
from lookdev.brdf import Parameter
from lookdev.material import Primvar, Texture
from lookdev.material.points import ImagePoints
from lookdev.material.textures import image_texels
from lookdev.material.usd.bound import BoundLook
from lookdev.material.usd.nodes import NODES
from lookdev.material.values import SourceValues

ST = np.array([[0.1, 0.2], [0.35, 0.8], [0.6, 0.45], [0.9, 0.95]])
COLOR = "color3f diffuseColor <- N.out\n"
ROUGH = "float roughness <- N.out\n"
# (s, t, 0) as a colour, beside which other inputs are constant.
UV = shader("Uv", "ND_texcoord_vector2") + shader("C", "ND_convert_vector2_vector3", "float2 in <- Uv.out")


class Points(ImagePoints):
    """Points of UV set st; another set has twice the coordinates."""

    def uv(self, name: str) -> Floats:
        return ST if name == "st" else 2.0 * ST

    def primvar(self, primvar: Primvar) -> Floats:
        return np.full(len(ST), 0.25) if isinstance(primvar.fallback, float) else np.full((len(ST), 3), 0.25)

    def handedness(self) -> Floats:
        return np.ones(len(ST))


def value(result: BoundLook, name: str, kind: str = "color") -> Floats:
    """Return the value of an input at the points, not clipped."""
    assert not result.losses, result.losses
    source = result.look.layers[0].inputs[name]
    parameter = Parameter(name, kind, 0.0, (-np.inf, np.inf))  # type: ignore[arg-type]
    return np.asarray(SourceValues(Points()).parameter_value(source, parameter)) + np.zeros(
        (len(ST), 3) if kind != "float" else len(ST)
    )


S, T = ST.T
C = np.stack([S, T, 0.0 * S], axis=-1)
GREY_LAYER = (C @ [0.2, 0.7, 0.1])[:, np.newaxis] + 0 * C
HALFWAY = np.clip((C - 0.2) / 0.5, 0, 1)
WEIGHTS = "color3f lumacoeffs = (0.2, 0.7, 0.1)"
NODES_OF_FLOATS = UV + shader("X", "ND_separate2_vector2", "float2 in <- Uv.out")
NODES_OF_FLOATS += shader("P", "ND_combine2_vector2", "float in1 <- X.outx\nfloat in2 = 0.5")

# Nodes of vectors and colours, whose first input is in, in1 or fg, connected to (s, t, 0): node, type, input, others.
OF_C = [
    ("add_vector3", "float3 in1", "float3 in2 = (1, 2, 3)", np.add(C, [1, 2, 3])),
    ("subtract_vector3", "float3 in2", "float3 in1 = (1, 2, 3)", [1, 2, 3] - C),
    ("multiply_vector3", "float3 in1", "float3 in2 <- C.out", C * C),
    ("multiply_vector3", "float3 in1", "", C),
    ("multiply_vector3FA", "float3 in1", "float in2 = 3", 3 * C),
    ("divide_vector3FA", "float3 in1", "float in2 = 4", C / 4),
    ("modulo_vector3FA", "float3 in1", "float in2 = 0.25", C % 0.25),
    ("power_vector3FA", "float3 in1", "float in2 = 2.5", C**2.5),
    ("min_vector3FA", "float3 in1", "float in2 = 0.4", np.minimum(C, 0.4)),
    ("max_vector3FA", "float3 in1", "float in2 = 0.4", np.maximum(C, 0.4)),
    ("invert_vector3", "float3 in", "", 1 - C),
    ("sin_vector3", "float3 in", "", np.sin(C)),
    ("sqrt_vector3", "float3 in", "", np.sqrt(C)),
    ("exp_vector3", "float3 in", "", np.exp(C)),
    ("clamp_vector3FA", "float3 in", "float low = 0.3", np.clip(C, 0.3, 1)),
    ("smoothstep_vector3FA", "float3 in", "float low = 0.2\nfloat high = 0.7", HALFWAY * HALFWAY * (3 - 2 * HALFWAY)),
    ("remap_vector3FA", "float3 in", "float inlow = 0.5\nfloat outlow = 2\nfloat outhigh = -1", 2 - (C - 0.5) * 6),
    ("range_vector3FA", "float3 in", "float gamma = 2\nfloat outhigh = 0.5\nbool doclamp = 1", 0.5 * np.sqrt(C)),
    ("contrast_vector3FA", "float3 in", "float amount = 3", (C - 0.5) * 3 + 0.5),
    ("mix_vector3", "float3 fg", "float3 bg = (1, 1, 1)\nfloat mix = 0.25", 0.75 + 0.25 * C),
    ("plus_color3", "color3f fg", "color3f bg = (1, 1, 1)", 1 + C),
    ("minus_color3", "color3f fg", "color3f bg = (1, 1, 1)", 1 - C),
    ("difference_color3", "color3f fg", "color3f bg = (.5, .5, .5)\nfloat mix = .5", 0.25 + 0.5 * np.abs(0.5 - C)),
    ("screen_color3", "color3f fg", "color3f bg = (0.5, 0.5, 0.5)", 1 - (1 - C) * 0.5),
    ("inside_color3", "color3f in", "float mask = 0.5", 0.5 * C),
    ("outside_color3", "color3f in", "float mask = 0.25", 0.75 * C),
    ("luminance_color3", "color3f in", WEIGHTS, GREY_LAYER),
    ("saturate_color3", "color3f in", "float amount = 0.5\n" + WEIGHTS, 0.5 * C + 0.5 * GREY_LAYER),
    ("normalize_vector3", "float3 in", "", C / np.linalg.norm(C, axis=-1, keepdims=True)),
    ("swizzle_vector3_color3", "float3 in", 'string channels = "yx1"', np.stack([T, S, 0 * S + 1], axis=-1)),
    ("dot_color3", "color3f in", "", C),
    ("switch_color3", "color3f in2", "float which = 1", C),
    ("extract_vector3", "float3 in", "int index = 1", T),
    ("dotproduct_vector3", "float3 in1", "float3 in2 = (0.5, 0.25, 9)", C @ [0.5, 0.25, 9]),
    ("magnitude_vector3", "float3 in", "", np.linalg.norm(C, axis=-1)),
]
OTHERS = [
    ("absval_vector3", "float3 in = (-1, 2, -3)", 0 * C + (1, 2, 3)),
    ("fract_vector3", "float3 in = (1.25, -0.25, 3)", 0 * C + [0.25, 0.75, 0]),
    ("constant_color3", "color3f value = (1, 0.5, 0.25)", 0 * C + [1, 0.5, 0.25]),
    ("ramplr_color3", "color3f valuer = (1, 2, 3)", np.outer(S, [1, 2, 3])),
    ("ramptb_color3", "color3f valuet = (1, 2, 3)", np.outer(T, [1, 2, 3])),
    ("splitlr_color3", "color3f valuer = (1, 2, 3)", np.outer(S >= 0.5, [1, 2, 3])),
    ("splittb_color3", "color3f valuet = (1, 2, 3)\nfloat center = 0.3", np.outer(T >= 0.3, [1, 2, 3])),
    ("ifgreater_float", "float value1 <- X.outx\nfloat value2 = 0.5\nfloat in1 = 1", np.where(S > 0.5, 1.0, 0.0)),
    ("ifgreatereq_float", "float value1 <- X.outx\nfloat value2 = 0.5\nfloat in2 = 1", np.where(S >= 0.5, 0.0, 1.0)),
    ("atan2_float", "float iny = 0.5\nfloat inx <- X.outx", np.arctan2(0.5, S)),
    ("geompropvalue_float", 'string geomprop = "wear"\nfloat default = 0.5', 0 * S + 0.25),
    ("add_float", "float in1 <- X.outy", T),
    ("magnitude_vector2", "float2 in <- P.out", np.hypot(S, 0.5)),
]
CASES = [(kind, f"{first} <- C.out\n{others}", expected) for kind, first, others, expected in OF_C] + OTHERS


@pytest.mark.parametrize(("kind", "inputs", "expected"), CASES, ids=[kind for kind, *_ in CASES])
def test_values(tmp_path: Path, kind: str, inputs: str, expected: Floats) -> None:
    nodes = shader("N", f"ND_{kind}", inputs) + NODES_OF_FLOATS
    if expected.ndim == 1:
        result = value(bound(tmp_path, materialx(ROUGH, nodes)), "roughness", "float")
    else:  # beyond 0 to 1 only emission may be, which has no effect otherwise
        emissive = bound(tmp_path, materialx(COLOR.replace("diffuseColor", "emissiveColor"), nodes))
        losses = tuple(fault for fault in emissive.losses if "emissiveColor" not in fault.where)
        result = value(BoundLook(emissive.look, losses), "emissiveColor")
    np.testing.assert_allclose(result, expected, rtol=1e-6, atol=1e-7)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder with an image of distinct texels in 16 bits, so that ``auto`` is raw."""
    image = oiio.ImageBuf(np.linspace(0.0, 1.0, 8 * 8 * 4, dtype=np.float32).reshape(8, 8, 4))
    assert image.write(str(tmp_path / "a.exr")), image.geterror()
    write_gray(tmp_path / "rgb.png", 3)
    return tmp_path


IMAGE = shader("I", "ND_image_color3", "asset file = @./a.exr@")


def sample_exr(folder: Path, st: Floats) -> Floats:
    return image_texels(Texture(folder / "a.exr", "rgb", "raw"), st)


def test_arithmetic_on_an_image_stays_a_texture(folder: Path) -> None:
    half = shader("A", "ND_multiply_color3FA", "color3f in1 <- I.out\nfloat in2 = 0.5")
    result = bound(folder, materialx(COLOR, IMAGE, half, shader("N", "ND_invert_color3", "color3f in <- A.out")))
    image = result.look.layers[0].inputs["diffuseColor"]
    assert (image.scale[:3], image.bias[:3]) == ((-0.5,) * 3, (1.0,) * 3)
    np.testing.assert_allclose(value(result, "diffuseColor"), 1 - 0.5 * sample_exr(folder, ST)[:, :3], atol=1e-6)


def test_two_images_make_an_expression_with_masks_kept(folder: Path) -> None:
    other = shader("J", "ND_image_float", "asset file = @./a.exr@\nfloat2 texcoord <- U.out")
    uv = shader("U", "ND_texcoord_vector2", "int index = 1")
    mix = "color3f fg <- I.out\ncolor3f bg = (1, 0, 0)\nfloat mix <- J.out"
    result = bound(folder, materialx(COLOR, IMAGE, other, uv, shader("N", "ND_mix_color3", mix)))
    assert sorted(result.look.layers[0].inputs["diffuseColor"].inputs) == ["I", "J"]
    mask = sample_exr(folder, 2.0 * ST)[:, :1]
    expected = mask * sample_exr(folder, ST)[:, :3] + (1 - mask) * [1, 0, 0]
    np.testing.assert_allclose(value(result, "diffuseColor"), expected, atol=1e-6)


@pytest.mark.parametrize("index", range(4))
def test_channels_of_four(folder: Path, index: int) -> None:
    split = shader("X", "ND_separate4_color4", "color4f in <- I.out")
    link = f"float roughness <- X.out{'rgba'[index]}"
    result = bound(folder, materialx(link, IMAGE.replace("color3", "color4"), split))
    np.testing.assert_allclose(value(result, "roughness", "float"), sample_exr(folder, ST)[:, index], atol=1e-6)


PLACE = "float2 pivot = (0.5, 0.25); float2 scale = (2, 0.5); float rotate = 30; float2 offset = (0.1, 0.2); "
PLACE += "float2 texcoord <- Uv.out; "
ORDER = PLACE + "int operationorder = 1"
TILED = "float2 uvtiling = (2, 3); float2 uvoffset = (0.25, 0.5); float2 realworldimagesize = (2, 2); "
TILED += "float2 realworldtilesize = (1, 4)"
GLTF = "color3f factor = (1, 0.5, 0.25); float2 scale = (2, 3); float2 offset = (0.25, 0.5); float rotate = 30"
# NG_gltf_image: place2d about (0, 1) by 1 / scale, -rotate and offset times (-1, 1).
FROM_GLTF = rotate_clockwise((ST - [0, 1]) * [2, 3], -30) - [-0.25, 0.5] + [0, 1]


def p(kind: str, inputs: str) -> str:
    return shader("P", f"ND_{kind}", inputs)


ADDED = shader("Q", "ND_add_vector2", "float2 in1 <- Uv.out; float2 in2 = (1, 0.5)")
PLACED = [
    (p("place2d_vector2", PLACE), rotate_clockwise((ST - [0.5, 0.25]) / [2, 0.5], 30) - [0.1, 0.2] + [0.5, 0.25]),
    (p("place2d_vector2", ORDER), rotate_clockwise(ST - [0.5, 0.25] - [0.1, 0.2], 30) / [2, 0.5] + [0.5, 0.25]),
    (p("rotate2d_vector2", "float2 in <- Uv.out; float amount = 30"), rotate_clockwise(ST, 30)),
    (p("multiply_vector2", "float2 in1 <- Q.out; float2 in2 = (2, 3)") + ADDED, np.add(ST, [1, 0.5]) * [2, 3]),
    (p("UsdTransform2d", "float2 in <- Uv.out; float2 scale = (2, 3)"), ST * [2, 3]),
    (p("geompropvalue_vector2", 'string geomprop = "map1"'), 2 * ST),
]
IMAGES = [
    *(("image_color3", "float2 texcoord <- P.out", nodes, st, 1.0) for nodes, st in PLACED),
    ("tiledimage_color3", TILED, "", (ST * [2, 3] - [0.25, 0.5]) / 2 * [1, 4], 1.0),
    ("gltf_image_color3_color3_1_0", GLTF, "", FROM_GLTF, np.array([1, 0.5, 0.25])),
]


@pytest.mark.parametrize(("kind", "inputs", "nodes", "st", "factor"), IMAGES)
def test_placement(folder: Path, kind: str, inputs: str, nodes: str, st: Floats, factor: Any) -> None:
    result = bound(folder, materialx(COLOR, shader("N", f"ND_{kind}", f"asset file = @./a.exr@\n{inputs}"), nodes, UV))
    np.testing.assert_allclose(value(result, "diffuseColor"), sample_exr(folder, st)[:, :3] * factor, atol=1e-6)


def test_uv_textures_of_materialx(folder: Path) -> None:
    body = 'asset file = @./rgb.png@ (\ncolorSpace = "srgb_texture"\n)\nstring wrapS = "periodic"'
    link = "color3f diffuseColor <- N.rgb\nfloat roughness <- N.a"
    result = bound(folder, materialx(link, shader("N", "ND_UsdUVTexture_23", body)))
    color, alpha = (result.look.layers[0].inputs[name] for name in ("diffuseColor", "roughness"))
    assert (color.colorspace, color.wrap_s, color.channel) == ("sRGB", "repeat", "rgb")
    assert alpha.channel == "a"
    assert not result.losses


@pytest.mark.parametrize(
    ("identifier", "space", "expected"),
    [
        ("ND_image_color3", "srgb_texture", "sRGB"),
        ("ND_image_color3", "acescg", "lin_ap1_scene"),
        ("ND_image_color3", "", "raw"),
        ("ND_image_vector3", "srgb_texture", "raw"),
    ],
)
def test_only_the_colour_of_colours_is_managed(folder: Path, identifier: str, space: str, expected: str) -> None:
    metadata = f'(\ncolorSpace = "{space}"\n)' if space else ""
    result = bound(folder, materialx(COLOR, shader("N", identifier, f"asset file = @./rgb.png@ {metadata}")))
    assert result.look.layers[0].inputs["diffuseColor"].colorspace == expected


NORMAL = "float3 normal <- N.out"


@pytest.mark.parametrize(("inputs", "scale"), [("", 1), ("float scale = 0.5", 0.5), ("float2 scale = (0.5, 0.5)", 0.5)])
def test_normal_maps(folder: Path, inputs: str, scale: float) -> None:
    node = shader("N", "ND_normalmap", "float3 in <- I.out\n" + inputs)
    result = bound(folder, materialx(NORMAL, node, IMAGE.replace("color3", "vector3")))
    assert isinstance(result.look.layers[0].inputs["normal"], Texture)
    expected = (2 * sample_exr(folder, ST)[:, :3] - 1) * [scale, scale, 1]
    np.testing.assert_allclose(value(result, "normal", "normal"), expected, atol=1e-6)


def test_a_height_to_a_normal_is_a_bump(folder: Path) -> None:
    nodes = (
        shader("N", "ND_normalmap", "float3 in <- H.out\nfloat scale = 0.5"),
        shader("H", "ND_heighttonormal_vector3", "float in <- A.out\nfloat scale = 4"),
        shader("A", "ND_multiply_float", "float in1 <- I.out\nfloat in2 = 3"),
    )
    height = IMAGE.replace("color3", "float")
    bump = bound(folder, materialx(NORMAL, *nodes, height)).look.layers[0].inputs["normal"]
    assert (bump.scale, bump.height.scale[0]) == (4 * 0.5 / 16, 3.0)


RGB = "asset file = @./rgb.png@\n"
SQUARED = shader("Squared", "ND_multiply_vector2", "float2 in1 <- Uv.out\nfloat2 in2 <- Uv.out") + UV


@pytest.mark.parametrize(
    ("kind", "inputs", "where", "message"),
    [
        ("ND_fractal3d_color3", "", "/M/N", "a node of ND_fractal3d_color3 is not supported"),
        ("", "", "/M/N", "a node of no info:id is not supported"),
        ("ND_image_color3", "", "N.file", "names no image file"),
        ("ND_image_color3", RGB + 'string filtertype = "cubic"', "N.filtertype", "is not carried"),
        ("ND_image_color3", RGB + 'string uaddressmode = "tile"', "N.uaddressmode", "unknown value 'tile'"),
        ("ND_image_color3", RGB + 'string layer = "left"', "N.layer", "ND_image_color3 is read without it"),
        ("ND_image_color3", RGB + "float2 texcoord <- Squared.out", "N.texcoord", "is computed"),
        ("ND_image_color3", 'string file = "rgb.png"', "/M/N", "inputs:file is not an asset"),
        ("ND_extract_color3", "color3f in = (1, 2, 3)\nint index = 3", "/M/N", "there is no channel 3 of 3"),
        ("ND_swizzle_color3_color3", 'string channels = "rq"', "/M/N", "'rq' are not channels"),
        ("ND_geompropvalue_color3", "", "/M/N", "names no primvar"),
        ("ND_geompropvalue_color4", 'string geomprop = "c"', "/M/N", "only primvars of one to three numbers"),
        ("ND_add_color3", "color3f in1 <- N.out", "N.in1", "its connections run in a cycle"),
        ("ND_add_color3", "color3f in1 <- None.out", "N.in1", "is connected to </M/None.outputs:out>"),
        ("ND_add_color3", "color3f in1 = (nan, 0, 0)", "N.in1", "is not finite"),
        ("ND_place2d_vector2", "float2 scale = (0, 1)", "/M/N", "has a scale of 0"),
        ("ND_noise2d_color3", "", "/M/N", "has another pattern here"),
    ],
)
def test_what_is_not_carried_is_listed_at_its_node(
    folder: Path, kind: str, inputs: str, where: str, message: str
) -> None:
    result = bound(folder, materialx(COLOR, shader("N", kind, inputs), SQUARED))
    assert any(fault_path == where and message in text for fault_path, text in fault_texts(result)), fault_texts(result)


@pytest.mark.parametrize(
    ("kind", "inputs", "message"),
    [
        ("ND_normalmap", 'string space = "object"', "in object space is not supported"),
        ("ND_bump_vector3", "float height <- P.out", "only one channel"),
    ],
)
def test_normals_that_cannot_be_read(folder: Path, kind: str, inputs: str, message: str) -> None:
    primvar = shader("P", "ND_geompropvalue_float", 'string geomprop = "h"')
    result = bound(folder, materialx(NORMAL, shader("N", kind, inputs), primvar))
    assert "normal" not in result.look.layers[0].inputs
    assert any(message in text for _, text in fault_texts(result)), fault_texts(result)


def chain(count: int, body: str) -> str:
    """Return nodes of which each reads the one before."""
    nodes = [shader("N0", "ND_geompropvalue_float", 'string geomprop = "wear"')]
    nodes += [shader(f"N{i}", "ND_multiply_float", body.format(f"N{i - 1}.out")) for i in range(1, count)]
    return "".join(nodes) + shader("N", "ND_dot_float", f"float in <- N{count - 1}.out")


@pytest.mark.parametrize(
    ("count", "body", "message"),
    [
        (2000, "float in1 <- {0}\nfloat in2 = 2", "more than 64 nodes are connected in a row"),
        (40, "float in1 <- {0}\nfloat in2 <- {0}", "makes an expression of more than"),
    ],
)
def test_huge_networks_are_refused_soon(tmp_path: Path, count: int, body: str, message: str) -> None:
    before = time.process_time()
    result = bound(tmp_path, materialx(ROUGH, chain(count, body)))
    assert "roughness" not in result.look.layers[0].inputs
    assert any(message in text for _, text in fault_texts(result)), fault_texts(result)
    assert time.process_time() - before < 5.0


def test_shared_nodes_are_read_once(tmp_path: Path) -> None:
    result = bound(tmp_path, materialx(ROUGH, chain(8, "float in1 <- {0}\nfloat in2 <- {0}")))
    np.testing.assert_allclose(value(result, "roughness", "float"), 0.25**128)


def test_coordinates_as_a_colour_are_noted(tmp_path: Path) -> None:
    result = bound(tmp_path, materialx(COLOR, shader("N", "ND_texcoord_vector2")))
    assert fault_texts(result) == [("S.diffuseColor", "has three channels, connected to 2")]
    np.testing.assert_allclose(value(BoundLook(result.look), "diffuseColor"), C)


@pytest.mark.parametrize("category", NODES)
def test_a_node_without_inputs_is_read_or_listed(folder: Path, category: str) -> None:
    for kind in ("", "_color3", "_float", "_vector2", "_vector3"):
        result = bound(folder, materialx(COLOR + ROUGH + NORMAL, shader("N", f"ND_{category}{kind}")))
        assert len(result.look.layers[0].inputs) + len(result.losses) >= 3
