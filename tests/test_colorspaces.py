"""Colour spaces: names, constants and images, against MaterialX's matrices and the tags of files."""

import MaterialX as mx
import numpy as np
import OpenImageIO as oiio
import pytest

from lookdev.material import Texture
from lookdev.material.textures import image_header, sample_texture
from lookdev.stage.colorspaces import colorspace_named, to_linear_rec709


def test_names():
    names = {"srgb_texture": "sRGB", "lin_rec709": "raw", "": "raw", "data": "raw", "acescg": "lin_ap1_scene"}
    names |= {"lin_ap1_scene": "lin_ap1_scene", "rec709_display": "g24_rec709_scene", "my_space": None}
    assert {name: colorspace_named(name) for name in names} == names


@pytest.mark.parametrize("name", ["acescg", "lin_adobergb", "lin_displayp3"])
def test_primaries_are_those_of_the_materialx_library(name):
    library = mx.createDocument()
    mx.readFromXmlFile(library, mx.getDefaultDataSearchPath().find("libraries/cmlib/cmlib_ng.mtlx"))
    graph = library.getNodeGraph(f"NG_{name}_to_lin_rec709_color3")
    numbers = next(port for node in graph.getNodes() for port in node.getInputs() if port.getType() == "matrix33")
    matrix = np.array([float(each) for each in numbers.getValueString().split(",")]).reshape(3, 3)
    space = colorspace_named(name)
    assert space is not None
    # The library's numbers have 6 digits at least; USD's are of float32.
    np.testing.assert_allclose(to_linear_rec709(np.eye(3), space), matrix, atol=2e-4)


@pytest.mark.parametrize(("name", "gamma"), [("g18_rec709", 1.8), ("g22_rec709", 2.2), ("rec709_display", 2.4)])
def test_curves(name, gamma):
    space = colorspace_named(name)
    assert space is not None
    color = np.array([[0.2, 0.5, 1.0], [0.0, 0.1, 0.9]])
    np.testing.assert_allclose(to_linear_rec709(color, space), color**gamma, rtol=1e-6, atol=1e-6)


def test_white_is_white_in_every_space():
    for name in ("acescg", "lin_displayp3", "srgb_displayp3", "adobergb", "srgb_texture", "g22_ap1"):
        space = colorspace_named(name)
        assert space is not None
        np.testing.assert_allclose(to_linear_rec709([1.0, 1.0, 1.0], space), 1.0, atol=1e-5)


def test_images_are_converted_before_filtering(tmp_path, monkeypatch):
    monkeypatch.setenv("LOOKDEV_CACHE", str(tmp_path / "cache"))
    pixels = np.array([[[1.0, 0.0, 0.0, 0.5], [0.0, 0.25, 0.0, 1.0]]], np.float32)
    assert oiio.ImageBuf(pixels).write(str(tmp_path / "a.exr"))
    texture = Texture(tmp_path / "a.exr", "rgb", "g22_ap1_scene", "clamp", "clamp")
    texels = to_linear_rec709(pixels[0, :, :3], "g22_ap1_scene")
    np.testing.assert_allclose(sample_texture(texture, [0.5, 0.5]), texels.mean(axis=0), rtol=1e-5)


@pytest.mark.parametrize(
    ("kind", "channels", "tag", "expected"),
    [
        ("uint8", 3, None, True),
        ("uint8", 1, None, False),
        ("uint16", 3, None, False),
        ("uint16", 3, 1, True),
        ("uint16", 3, 65535, False),
        ("float", 3, None, False),
    ],
)
def test_auto_follows_the_tag_of_a_file_then_its_depth(tmp_path, kind, channels, tag, expected):
    spec = oiio.ImageSpec(2, 2, channels, kind)
    if tag is not None:
        spec["Exif:ColorSpace"] = tag
    image = oiio.ImageBuf(spec)
    oiio.ImageBufAlgo.fill(image, (0.5,) * channels)
    assert image.write(str(tmp_path / "a.tif")), image.geterror()
    assert image_header(tmp_path / "a.tif").is_srgb is expected
