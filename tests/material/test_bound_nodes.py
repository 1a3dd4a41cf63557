"""Nodes of MaterialX in bound materials: their values at points, against the definitions of the standard library."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from look_files import bound, lost, materialx, shader, write_gray
from numpy.typing import NDArray

from lookdev.brdf import Parameter
from lookdev.material.look import Bump, Formula, Primvar, Texture
from lookdev.material.points import ImagePoints
from lookdev.material.textures import image_texels
from lookdev.material.usd.bound import BoundLook
from lookdev.material.usd.nodes import NODES
from lookdev.material.values import Values

Floats = NDArray[np.float64]

ST = np.array([[0.1, 0.2], [0.35, 0.8], [0.6, 0.45], [0.9, 0.95]])
FROM_UV = "float2 {} <- Uv.out"
SQUARED = "float2 texcoord <- Squared.out"
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


def value(found: BoundLook, name: str, kind: str = "color") -> Floats:
    """Return the value of an input at the points, not clipped."""
    assert not found.lost, found.lost
    source = found.look.layers[0].inputs[name]
    parameter = Parameter(name, kind, 0.0, (-np.inf, np.inf))  # type: ignore[arg-type]
    return np.asarray(Values(Points()).of(source, parameter)) + np.zeros((len(ST), 3) if kind != "float" else len(ST))


def node(identifier: str, inputs: str) -> str:
    return shader("N", identifier, inputs) + UV


S, T = ST.T
C = np.stack([S, T, 0.0 * S], axis=-1)

NUMBERS: dict[str, tuple[str, str, Callable[[], Floats]]] = {
    "add": ("ND_add_vector3", "float3 in1 <- C.out\nfloat3 in2 = (1, 2, 3)", lambda: np.add(C, [1, 2, 3])),
    "subtract": ("ND_subtract_vector3", "float3 in1 = (1, 2, 3)\nfloat3 in2 <- C.out", lambda: [1, 2, 3] - C),
    "multiply by itself": ("ND_multiply_vector3", "float3 in1 <- C.out\nfloat3 in2 <- C.out", lambda: C * C),
    "multiply, default": ("ND_multiply_vector3", "float3 in1 <- C.out", lambda: C),
    "multiply by a float": ("ND_multiply_vector3FA", "float3 in1 <- C.out\nfloat in2 = 3", lambda: 3 * C),
    "divide": ("ND_divide_vector3FA", "float3 in1 <- C.out\nfloat in2 = 4", lambda: C / 4),
    "modulo": ("ND_modulo_vector3FA", "float3 in1 <- C.out\nfloat in2 = 0.25", lambda: C % 0.25),
    "power": ("ND_power_vector3FA", "float3 in1 <- C.out\nfloat in2 = 2.5", lambda: C**2.5),
    "min": ("ND_min_vector3FA", "float3 in1 <- C.out\nfloat in2 = 0.4", lambda: np.minimum(C, 0.4)),
    "max": ("ND_max_vector3FA", "float3 in1 <- C.out\nfloat in2 = 0.4", lambda: np.maximum(C, 0.4)),
    "invert": ("ND_invert_vector3", "float3 in <- C.out", lambda: 1 - C),
    "absval": ("ND_absval_vector3", "float3 in = (-1, 2, -3)", lambda: 0 * C + [1, 2, 3]),
    "fract": ("ND_fract_vector3", "float3 in = (1.25, -0.25, 3)", lambda: 0 * C + [0.25, 0.75, 0]),
    "sin": ("ND_sin_vector3", "float3 in <- C.out", lambda: np.sin(C)),
    "sqrt": ("ND_sqrt_vector3", "float3 in <- C.out", lambda: np.sqrt(C)),
    "exp": ("ND_exp_vector3", "float3 in <- C.out", lambda: np.exp(C)),
    "clamp": ("ND_clamp_vector3FA", "float3 in <- C.out\nfloat low = 0.3", lambda: np.clip(C, 0.3, 1)),
    "smoothstep": (
        "ND_smoothstep_vector3FA",
        "float3 in <- C.out\nfloat low = 0.2\nfloat high = 0.7",
        lambda: (lambda t: t * t * (3 - 2 * t))(np.clip((C - 0.2) / 0.5, 0, 1)),
    ),
    "remap": (
        "ND_remap_vector3FA",
        "float3 in <- C.out\nfloat inlow = 0.5\nfloat outlow = 2\nfloat outhigh = -1",
        lambda: 2 + (C - 0.5) * -3 / 0.5,
    ),
    "range": (
        "ND_range_vector3FA",
        "float3 in <- C.out\nfloat gamma = 2\nfloat outhigh = 0.5\nbool doclamp = 1",
        lambda: np.clip(0.5 * np.sqrt(C), 0, 0.5),
    ),
    "contrast": ("ND_contrast_vector3FA", "float3 in <- C.out\nfloat amount = 3", lambda: (C - 0.5) * 3 + 0.5),
    "mix": ("ND_mix_vector3", "float3 fg <- C.out\nfloat3 bg = (1, 1, 1)\nfloat mix = 0.25", lambda: 0.75 + 0.25 * C),
    "plus": ("ND_plus_color3", "color3f fg <- C.out\ncolor3f bg = (1, 1, 1)", lambda: 1 + C),
    "minus": ("ND_minus_color3", "color3f fg <- C.out\ncolor3f bg = (1, 1, 1)", lambda: 1 - C),
    "difference": (
        "ND_difference_color3",
        "color3f fg <- C.out\ncolor3f bg = (0.5, 0.5, 0.5)\nfloat mix = 0.5",
        lambda: 0.25 + 0.5 * np.abs(0.5 - C),
    ),
    "screen": ("ND_screen_color3", "color3f fg <- C.out\ncolor3f bg = (0.5, 0.5, 0.5)", lambda: 1 - (1 - C) * 0.5),
    "inside": ("ND_inside_color3", "color3f in <- C.out\nfloat mask = 0.5", lambda: 0.5 * C),
    "outside": ("ND_outside_color3", "color3f in <- C.out\nfloat mask = 0.25", lambda: 0.75 * C),
    "luminance": (
        "ND_luminance_color3",
        "color3f in <- C.out\ncolor3f lumacoeffs = (0.2, 0.7, 0.1)",
        lambda: (C @ [0.2, 0.7, 0.1])[:, np.newaxis] + 0 * C,
    ),
    "saturate": (
        "ND_saturate_color3",
        "color3f in <- C.out\nfloat amount = 0.5\ncolor3f lumacoeffs = (0.2, 0.7, 0.1)",
        lambda: 0.5 * C + 0.5 * (C @ [0.2, 0.7, 0.1])[:, np.newaxis],
    ),
    "normalize": ("ND_normalize_vector3", "float3 in <- C.out", lambda: C / np.linalg.norm(C, axis=-1, keepdims=True)),
    "swizzle": (
        "ND_swizzle_vector3_color3",
        'float3 in <- C.out\nstring channels = "yx1"',
        lambda: C[:, [1, 0, 0]] * [1, 1, 0] + [0, 0, 1],
    ),
    "constant": ("ND_constant_color3", "color3f value = (1, 0.5, 0.25)", lambda: 0 * C + [1, 0.5, 0.25]),
    "dot": ("ND_dot_color3", "color3f in <- C.out", lambda: C),
    "ramplr": ("ND_ramplr_color3", "color3f valuer = (1, 2, 3)", lambda: S[:, np.newaxis] * [1, 2, 3]),
    "ramptb": ("ND_ramptb_color3", "color3f valuet = (1, 2, 3)", lambda: T[:, np.newaxis] * [1, 2, 3]),
    "splitlr": ("ND_splitlr_color3", "color3f valuer = (1, 2, 3)", lambda: (S >= 0.5)[:, np.newaxis] * [1, 2, 3]),
    "splittb": (
        "ND_splittb_color3",
        "color3f valuet = (1, 2, 3)\nfloat center = 0.3",
        lambda: (T >= 0.3)[:, np.newaxis] * [1, 2, 3],
    ),
    "switch": ("ND_switch_color3", "color3f in2 <- C.out\nfloat which = 1", lambda: C),
}


@pytest.mark.parametrize(("identifier", "inputs", "expected"), NUMBERS.values(), ids=NUMBERS)
def test_values(tmp_path: Path, identifier: str, inputs: str, expected: Callable[[], Floats]) -> None:
    found = bound(tmp_path, materialx(COLOR, node(identifier, inputs)).replace("diffuseColor", "emissiveColor"))
    found = BoundLook(found.look, tuple(each for each in found.lost if "emissiveColor" not in each.where))
    np.testing.assert_allclose(value(found, "emissiveColor"), expected(), rtol=1e-6, atol=1e-7)


FLOATS: dict[str, tuple[str, str, Callable[[], Floats]]] = {
    "extract": ("ND_extract_vector3", "float3 in <- C.out\nint index = 1", lambda: T),
    "dotproduct": (
        "ND_dotproduct_vector3",
        "float3 in1 <- C.out\nfloat3 in2 = (0.5, 0.25, 9)",
        lambda: C @ [0.5, 0.25, 9],
    ),
    "magnitude": ("ND_magnitude_vector3", "float3 in <- C.out", lambda: np.linalg.norm(C, axis=-1)),
    "ifgreater": (
        "ND_ifgreater_float",
        "float value1 <- X.outx\nfloat value2 = 0.5\nfloat in1 = 1",
        lambda: np.where(S > 0.5, 1.0, 0.0),
    ),
    "ifgreatereq": (
        "ND_ifgreatereq_float",
        "float value1 <- X.outx\nfloat value2 = 0.5\nfloat in2 = 1",
        lambda: np.where(S >= 0.5, 0.0, 1.0),
    ),
    "atan2": ("ND_atan2_float", "float iny = 0.5\nfloat inx <- X.outx", lambda: np.arctan2(0.5, S)),
    "geompropvalue": ("ND_geompropvalue_float", 'string geomprop = "wear"\nfloat default = 0.5', lambda: 0 * S + 0.25),
    "separate2": ("ND_add_float", "float in1 <- X.outy", lambda: T),
    "combine2": ("ND_magnitude_vector2", "float2 in <- P.out", lambda: np.hypot(S, 0.5)),
}
MORE = shader("X", "ND_separate2_vector2", "float2 in <- Uv.out") + shader(
    "P", "ND_combine2_vector2", "float in1 <- X.outx\nfloat in2 = 0.5"
)


@pytest.mark.parametrize(("identifier", "inputs", "expected"), FLOATS.values(), ids=FLOATS)
def test_floats(tmp_path: Path, identifier: str, inputs: str, expected: Callable[[], Floats]) -> None:
    found = bound(tmp_path, materialx(ROUGH, node(identifier, inputs), MORE))
    np.testing.assert_allclose(value(found, "roughness", "float"), expected(), rtol=1e-6, atol=1e-7)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder with an image of distinct texels in 16 bits, so that ``auto`` is raw."""
    pixels = np.linspace(0.0, 1.0, 8 * 8 * 4, dtype=np.float32).reshape(8, 8, 4)
    image = oiio.ImageBuf(pixels)
    assert image.write(str(tmp_path / "a.exr")), image.geterror()
    write_gray(tmp_path / "rgb.png", 3)
    return tmp_path


IMAGE = shader("I", "ND_image_color3", "asset file = @./a.exr@")


def sampled(folder: Path, st: Floats) -> Floats:
    return image_texels(Texture(folder / "a.exr", "rgb", "raw"), st)


def test_arithmetic_on_an_image_stays_a_texture(folder: Path) -> None:
    chain = (
        IMAGE
        + shader("A", "ND_multiply_color3FA", "color3f in1 <- I.out\nfloat in2 = 0.5")
        + shader("N", "ND_invert_color3", "color3f in <- A.out")
    )
    found = bound(folder, materialx(COLOR, chain))
    image = found.look.layers[0].inputs["diffuseColor"]
    assert isinstance(image, Texture)
    assert (image.scale[:3], image.bias[:3]) == ((-0.5,) * 3, (1.0,) * 3)
    np.testing.assert_allclose(value(found, "diffuseColor"), 1 - 0.5 * sampled(folder, ST)[:, :3], atol=1e-6)


def test_two_images_make_an_expression_with_masks_kept(folder: Path) -> None:
    other = shader("J", "ND_image_float", "asset file = @./a.exr@\nfloat2 texcoord <- U.out")
    uv = shader("U", "ND_texcoord_vector2", "int index = 1")
    mix = "color3f fg <- I.out\ncolor3f bg = (1, 0, 0)\n"
    mix += "float mix <- J.out"
    found = bound(folder, materialx(COLOR, IMAGE, other, uv, shader("N", "ND_mix_color3", mix)))
    formula = found.look.layers[0].inputs["diffuseColor"]
    assert isinstance(formula, Formula)
    assert sorted(formula.inputs) == ["I", "J"]
    mask = sampled(folder, 2.0 * ST)[:, :1]
    expected = mask * sampled(folder, ST)[:, :3] + (1 - mask) * [1, 0, 0]
    np.testing.assert_allclose(value(found, "diffuseColor"), expected, atol=1e-6)


@pytest.mark.parametrize("index", range(4))
def test_channels_of_four(folder: Path, index: int) -> None:
    image = shader("I", "ND_image_color4", "asset file = @./a.exr@")
    split = shader("X", "ND_separate4_color4", "color4f in <- I.out")
    link = f"float roughness <- X.out{'rgba'[index]}"
    found = bound(folder, materialx(link, image, split))
    np.testing.assert_allclose(value(found, "roughness", "float"), sampled(folder, ST)[:, index], atol=1e-6)


def rotated(v: Floats, degrees: float) -> Floats:
    """mx_rotate_vector2: clockwise."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.stack([c * v[:, 0] + s * v[:, 1], -s * v[:, 0] + c * v[:, 1]], axis=-1)


PLACE = """float2 pivot = (0.5, 0.25)
float2 scale = (2, 0.5)
float rotate = 30
float2 offset = (0.1, 0.2)
float2 texcoord <- Uv.out
"""
PLACED: dict[str, tuple[str, Callable[[], Floats]]] = {
    "place2d": (
        shader("P", "ND_place2d_vector2", PLACE),
        lambda: rotated((ST - [0.5, 0.25]) / [2, 0.5], 30) - [0.1, 0.2] + [0.5, 0.25],
    ),
    "place2d, the other order": (
        shader("P", "ND_place2d_vector2", PLACE + "int operationorder = 1"),
        lambda: rotated(ST - [0.5, 0.25] - [0.1, 0.2], 30) / [2, 0.5] + [0.5, 0.25],
    ),
    "rotate2d": (shader("P", "ND_rotate2d_vector2", "float2 in <- Uv.out\nfloat amount = 30"), lambda: rotated(ST, 30)),
    "arithmetic": (
        shader("P", "ND_multiply_vector2", "float2 in1 <- Q.out\nfloat2 in2 = (2, 3)")
        + shader("Q", "ND_add_vector2", "float2 in1 <- Uv.out\nfloat2 in2 = (1, 0.5)"),
        lambda: np.add(ST, [1, 0.5]) * [2, 3],
    ),
    "UsdTransform2d": (
        shader("P", "ND_UsdTransform2d", "float2 in <- Uv.out\nfloat2 scale = (2, 3)"),
        lambda: ST * [2, 3],
    ),
    "another set": (shader("P", "ND_geompropvalue_vector2", 'string geomprop = "map1"'), lambda: 2 * ST),
}


@pytest.mark.parametrize(("nodes", "expected"), PLACED.values(), ids=PLACED)
def test_placement(folder: Path, nodes: str, expected: Callable[[], Floats]) -> None:
    body = "asset file = @./a.exr@\nfloat2 texcoord <- P.out"
    found = bound(folder, materialx(COLOR, shader("N", "ND_image_color3", body), nodes, UV))
    np.testing.assert_allclose(value(found, "diffuseColor"), sampled(folder, expected())[:, :3], atol=1e-6)


def test_a_tiled_image(folder: Path) -> None:
    body = """asset file = @./a.exr@
    float2 uvtiling = (2, 3)
    float2 uvoffset = (0.25, 0.5)
    float2 realworldimagesize = (2, 2)
    float2 realworldtilesize = (1, 4)"""
    found = bound(folder, materialx(COLOR, shader("N", "ND_tiledimage_color3", body)))
    expected = sampled(folder, (ST * [2, 3] - [0.25, 0.5]) / 2 * [1, 4])[:, :3]
    np.testing.assert_allclose(value(found, "diffuseColor"), expected, atol=1e-6)


def test_an_image_of_gltf(folder: Path) -> None:
    body = """asset file = @./a.exr@
    color3f factor = (1, 0.5, 0.25)
    float2 scale = (2, 3)
    float2 offset = (0.25, 0.5)
    float rotate = 30"""
    found = bound(folder, materialx(COLOR, shader("N", "ND_gltf_image_color3_color3_1_0", body)))
    # NG_gltf_image: place2d about (0, 1) by 1 / scale, -rotate and offset times (-1, 1).
    st = rotated((ST - [0, 1]) * [2, 3], -30) - [-0.25, 0.5] + [0, 1]
    np.testing.assert_allclose(value(found, "diffuseColor"), sampled(folder, st)[:, :3] * [1, 0.5, 0.25], atol=1e-6)


def test_uv_textures_of_materialx(folder: Path) -> None:
    body = 'asset file = @./rgb.png@ (\ncolorSpace = "srgb_texture"\n)\nstring wrapS = "periodic"'
    link = "color3f diffuseColor <- N.rgb\nfloat roughness <- N.a"
    found = bound(folder, materialx(link, shader("N", "ND_UsdUVTexture_23", body)))
    color, alpha = (found.look.layers[0].inputs[name] for name in ("diffuseColor", "roughness"))
    assert isinstance(color, Texture)
    assert (color.colorspace, color.wrap_s, color.channel) == ("sRGB", "repeat", "rgb")
    assert isinstance(alpha, Texture)
    assert alpha.channel == "a"
    assert not found.lost


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
    found = bound(folder, materialx(COLOR, shader("N", identifier, f"asset file = @./rgb.png@ {metadata}")))
    image = found.look.layers[0].inputs["diffuseColor"]
    assert isinstance(image, Texture)
    assert image.colorspace == expected


NORMAL = "float3 normal <- N.out"


@pytest.mark.parametrize(
    ("inputs", "scale"), [("", 1.0), ("float scale = 0.5", 0.5), ("float2 scale = (0.5, 0.5)", 0.5)]
)
def test_normal_maps(folder: Path, inputs: str, scale: float) -> None:
    node = shader("N", "ND_normalmap", "float3 in <- I.out\n" + inputs)
    found = bound(folder, materialx(NORMAL, node, IMAGE.replace("color3", "vector3")))
    assert isinstance(found.look.layers[0].inputs["normal"], Texture)
    expected = (2 * sampled(folder, ST)[:, :3] - 1) * [scale, scale, 1]
    np.testing.assert_allclose(value(found, "normal", "normal"), expected, atol=1e-6)


def test_a_height_to_a_normal_is_a_bump(folder: Path) -> None:
    nodes = (
        shader("N", "ND_normalmap", "float3 in <- H.out\nfloat scale = 0.5")
        + shader("H", "ND_heighttonormal_vector3", "float in <- A.out\nfloat scale = 4")
        + shader("A", "ND_multiply_float", "float in1 <- I.out\nfloat in2 = 3")
        + shader("I", "ND_image_float", "asset file = @./a.exr@")
    )
    found = bound(folder, materialx(NORMAL, nodes))
    bump = found.look.layers[0].inputs["normal"]
    assert isinstance(bump, Bump)
    assert (bump.scale, bump.height.scale[0]) == (4 * 0.5 / 16, 3.0)


@pytest.mark.parametrize(
    ("nodes", "where", "what"),
    [
        (shader("N", "ND_fractal3d_color3"), "/M/N", "a node of ND_fractal3d_color3 is not supported"),
        (shader("N", ""), "/M/N", "a node of no info:id is not supported"),
        (shader("N", "ND_image_color3"), "N.file", "names no image file"),
        (
            shader("N", "ND_image_color3", 'asset file = @./rgb.png@\nstring filtertype = "cubic"'),
            "N.filtertype",
            "is not carried",
        ),
        (
            shader("N", "ND_image_color3", 'asset file = @./rgb.png@\nstring uaddressmode = "tile"'),
            "N.uaddressmode",
            "unknown value 'tile'",
        ),
        (
            shader("N", "ND_image_color3", 'asset file = @./rgb.png@\nstring layer = "left"'),
            "N.layer",
            "is not carried: ND_image_color3 is read without it",
        ),
        (shader("N", "ND_image_color3", 'string file = "rgb.png"'), "/M/N", "inputs:file is not an asset"),
        (
            shader("N", "ND_extract_color3", "color3f in = (1, 2, 3)\nint index = 3"),
            "/M/N",
            "there is no channel 3 of 3",
        ),
        (shader("N", "ND_swizzle_color3_color3", 'string channels = "rq"'), "/M/N", "'rq' are no channels"),
        (shader("N", "ND_geompropvalue_color3"), "/M/N", "names no primvar"),
        (
            shader("N", "ND_geompropvalue_color4", 'string geomprop = "c"'),
            "/M/N",
            "only primvars of one to three numbers are supported",
        ),
        (shader("N", "ND_add_color3", "color3f in1 <- N.out"), "N.in1", "its connections run in a cycle"),
        (
            shader("N", "ND_add_color3", "color3f in1 <- None.out"),
            "N.in1",
            "is connected to </M/None.outputs:out>",
        ),
        (shader("N", "ND_add_color3", "color3f in1 = (nan, 0, 0)"), "N.in1", "is not finite"),
        (shader("N", "ND_place2d_vector2", "float2 scale = (0, 1)"), "/M/N", "has a scale of 0"),
        (shader("N", "ND_noise2d_color3"), "/M/N", "has another pattern here"),
        (
            shader("N", "ND_image_color3", "asset file = @./rgb.png@\n" + SQUARED)
            + shader("Squared", "ND_multiply_vector2", "\n".join(FROM_UV.format(name) for name in ("in1", "in2")))
            + shader("Uv", "ND_texcoord_vector2"),
            "N.texcoord",
            "is computed",
        ),
    ],
)
def test_what_is_not_carried_is_listed_at_its_node(folder: Path, nodes: str, where: str, what: str) -> None:
    found = bound(folder, materialx(COLOR, nodes))
    assert any(place == where and what in said for place, said in lost(found)), lost(found)


@pytest.mark.parametrize(
    ("nodes", "what"),
    [
        (IMAGE.replace('"I"', '"N"').replace("color3", "vector3"), None),
        (shader("N", "ND_normalmap", 'string space = "object"'), "in object space is not supported"),
        (shader("N", "ND_bump_vector3", "float height <- P.out"), "only one channel"),
    ],
)
def test_normals_that_cannot_be_read(folder: Path, nodes: str, what: str | None) -> None:
    primvar = shader("P", "ND_geompropvalue_float", 'string geomprop = "h"')
    found = bound(folder, materialx(NORMAL, nodes, primvar))
    if what is not None:
        assert "normal" not in found.look.layers[0].inputs
        assert any(what in said for _, said in lost(found)), lost(found)


def chain(count: int, body: str) -> str:
    """Return nodes of which each reads the one before."""
    nodes = [shader("N0", "ND_geompropvalue_float", 'string geomprop = "wear"')]
    nodes += [
        shader(f"N{number}", "ND_multiply_float", body.format(f"N{number - 1}.out")) for number in range(1, count)
    ]
    return "".join(nodes) + shader("N", "ND_dot_float", f"float inputs:in.connect = </M/N{count - 1}.outputs:out>")


@pytest.mark.parametrize(
    ("count", "body", "what"),
    [
        (2000, "float in1 <- {0}\nfloat in2 = 2", "more than 64 nodes are connected in a row"),
        (40, "float in1 <- {0}\nfloat in2 <- {0}", "makes an expression of more than"),
    ],
)
def test_huge_networks_are_refused_soon(tmp_path: Path, count: int, body: str, what: str) -> None:
    before = time.process_time()
    found = bound(tmp_path, materialx(ROUGH, chain(count, body)))
    assert "roughness" not in found.look.layers[0].inputs
    assert any(what in said for _, said in lost(found)), lost(found)
    assert time.process_time() - before < 5.0


def test_shared_nodes_are_read_once(tmp_path: Path) -> None:
    body = "float in1 <- {0}\nfloat in2 <- {0}"
    found = bound(tmp_path, materialx(ROUGH, chain(8, body)))
    np.testing.assert_allclose(value(found, "roughness", "float"), 0.25**128)


def test_coordinates_as_a_colour_are_noted(tmp_path: Path) -> None:
    found = bound(tmp_path, materialx(COLOR, shader("N", "ND_texcoord_vector2")))
    assert lost(found) == [("S.diffuseColor", "has three channels, connected to 2")]
    found = BoundLook(found.look)
    np.testing.assert_allclose(value(found, "diffuseColor"), C)


@pytest.mark.parametrize("category", NODES)
def test_a_node_without_inputs_is_read_or_listed(folder: Path, category: str) -> None:
    kinds = ("", "_color3", "_float", "_vector2", "_vector3")
    for kind in kinds:
        for link in (COLOR, ROUGH, NORMAL):
            found = bound(folder, materialx(link, shader("N", f"ND_{category}{kind}")))
            assert found.look.layers[0].inputs or found.lost
