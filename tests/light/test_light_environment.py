import subprocess
import sys
from collections.abc import Callable
from importlib.machinery import ModuleSpec
from pathlib import Path

import numpy as np
import OpenEXR
import OpenImageIO as oiio
import pytest
from light_cases import write_exr

from lookdev.errors import EnvironmentMapError
from lookdev.images import PIXELS_VARIABLE
from lookdev.light import BUILTIN_LIGHTS, load_environment, make_environment
from lookdev.light.dome.environment import MAX_PEAK, MIN_PEAK, Repairs, check_exposed

pytestmark = pytest.mark.both_pythons


def write_map(path: Path, pixels: np.ndarray) -> Path:
    return write_exr(path, **{name: np.ascontiguousarray(pixels[..., i]) for i, name in enumerate("RGB")})


@pytest.fixture
def pixels() -> np.ndarray:
    return np.random.default_rng(2).random((4, 8, 3)).astype(np.float32)


def test_exr_is_read_as_it_is(tmp_path: Path, pixels: np.ndarray) -> None:
    env = load_environment(write_map(tmp_path / "sky.exr", pixels))
    np.testing.assert_array_equal(env.radiance, pixels)
    assert (env.name, env.repairs, env.radiance.dtype) == ("sky", Repairs(), np.float32)
    assert not env.repairs
    assert not env.is_constant


def test_channels_are_half_floats_packed_or_grey(tmp_path: Path, pixels: np.ndarray) -> None:
    rgba = np.concatenate([pixels, np.ones((4, 8, 1))], axis=-1).astype(np.float16)
    radiance = load_environment(write_exr(tmp_path / "h.exr", RGBA=rgba)).radiance
    np.testing.assert_array_equal(radiance, pixels.astype(np.float16))
    grey = np.ascontiguousarray(pixels[..., 0])
    # Readers put G before Y.
    for name, beside in (("y.exr", {}), ("gy.exr", {"G": np.zeros_like(grey)})):
        radiance = load_environment(write_exr(tmp_path / name, Y=grey, **beside)).radiance
        np.testing.assert_array_equal(radiance, np.repeat(grey[..., None], 3, axis=-1))


def test_colour_in_a_later_part(tmp_path: Path, pixels: np.ndarray) -> None:
    depth = OpenEXR.Part({}, {"Z": np.zeros((4, 8), np.float32)}, "depth")
    color = OpenEXR.Part({}, {name: pixels[..., i].copy() for i, name in enumerate("RGB")}, "color")
    with OpenEXR.File([depth, color]) as exr:
        exr.write(str(tmp_path / "parts.exr"))
    np.testing.assert_array_equal(load_environment(tmp_path / "parts.exr").radiance, pixels)


def test_a_later_part_is_no_larger_than_images_may_be(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(PIXELS_VARIABLE, "40")
    begin, end, below = (np.array(corner, np.int32) for corner in ((0, 0), (7, 3), (7, 5)))
    small = OpenEXR.Part({"displayWindow": (begin, end)}, {"Z": np.zeros((4, 8), np.float32)}, "depth")
    windows = {"displayWindow": (begin, end), "dataWindow": (begin, below)}
    large = OpenEXR.Part(windows, {"Y": np.ones((6, 8), np.float32)}, "grey")
    with OpenEXR.File([small, large]) as exr:
        exr.write(str(tmp_path / "parts.exr"))
    with pytest.raises(EnvironmentMapError, match=rf"is 8 x 6 pixels large; at most {PIXELS_VARIABLE} = 40"):
        load_environment(tmp_path / "parts.exr")


def test_hdr(tmp_path: Path, pixels: np.ndarray) -> None:
    path = tmp_path / "sky.HDR"
    output = oiio.ImageOutput.create("hdr")
    assert output.open(str(path), oiio.ImageSpec(8, 4, 3, oiio.FLOAT))
    assert output.write_image(pixels)
    output.close()
    # RGBE shares one exponent: an absolute step of 1/256 of the texel's largest channel, which is below 1.
    np.testing.assert_allclose(load_environment(path).radiance, pixels, atol=1 / 256)


def test_damage_is_repaired_and_counted(tmp_path: Path) -> None:
    pixels = np.ones((4, 8, 3), np.float32)
    pixels[1, 2] = (5.0, 9.0, 2.0)
    pixels[0, 0] = (np.nan, np.nan, np.nan)
    pixels[2, 5] = (-1.0, 3.0, -np.inf)
    pixels[3, 7, 1] = np.inf
    env = load_environment(write_map(tmp_path / "bad.exr", pixels))
    assert env.repairs == Repairs(negative=1, nan=1, infinite=1)
    assert str(env.repairs) == "1 negative and 1 NaN and 1 infinite texels repaired"
    expected = pixels.copy()
    expected[0, 0] = 1.0  # all neighbours are 1, also across the seam and at the clamped pole
    expected[2, 5] = (0.0, 3.0, 0.0)
    expected[3, 7, 1] = 9.0
    np.testing.assert_array_equal(env.radiance, expected)


def test_nan_takes_the_mean_of_what_is_beside_it(tmp_path: Path) -> None:
    pixels = np.zeros((3, 6, 3), np.float32)
    pixels[0:2, 1:3] = np.nan
    pixels[1, 0] = 4.0
    env = load_environment(write_map(tmp_path / "nan.exr", pixels))
    assert env.repairs == Repairs(nan=4)
    assert env.repairs
    # Of the texels around (1, 1), four are NaN, itself included, and one of the other five is 4.
    np.testing.assert_allclose(env.radiance[1, 1], 4.0 / 5.0)
    # Texel (0, 1): row 0 is repeated above, so that column 0 has 0, 0 and 4; all other texels are NaN.
    np.testing.assert_allclose(env.radiance[0, 1], 4.0 / 3.0)
    assert env.radiance[0, 2].tolist() == [0.0, 0.0, 0.0]


def test_all_black_and_any_aspect_are_fine(tmp_path: Path) -> None:
    env = load_environment(write_map(tmp_path / "black.exr", np.zeros((1, 2, 3), np.float32)))
    assert env.radiance.shape == (1, 2, 3)
    assert env.is_constant


def test_digest_follows_content_not_name(tmp_path: Path, pixels: np.ndarray) -> None:
    digest = load_environment(write_map(tmp_path / "a.exr", pixels)).digest
    assert load_environment(write_map(tmp_path / "b.exr", pixels)).digest == digest
    assert load_environment(write_map(tmp_path / "c.exr", pixels.reshape(8, 4, 3))).digest != digest
    pixels[0, 0, 0] += 1.0
    assert load_environment(write_map(tmp_path / "d.exr", pixels)).digest != digest


@pytest.mark.parametrize("name", [name for name in BUILTIN_LIGHTS if name != "white"])
def test_builtin_lights(name: str) -> None:
    env = load_environment(builtin=name)
    assert (env.name, env.radiance.shape) == (name, (512, 1024, 3))
    assert np.isfinite(env.radiance).all()
    assert env.radiance.min() >= 0.0
    assert env.radiance.max() > 1.0
    if name == "city":
        assert env.radiance.max() == 35456.0  # the sun, as Poly Haven clamped and stored it


def test_white() -> None:
    env = load_environment(builtin="white")
    assert env.is_constant
    assert (env.radiance == 1.0).all()
    height, width, _ = env.radiance.shape
    assert width == 2 * height  # 360 degrees around, 180 from pole to pole


@pytest.mark.parametrize("installed", [True, False])
def test_a_builtin_light_that_is_not_there_is_looked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, installed: bool
) -> None:
    spec = ModuleSpec("bpy", None, is_package=True)
    spec.submodule_search_locations = [str(tmp_path)]
    monkeypatch.setattr("importlib.util.find_spec", lambda name: spec if installed else None)
    missing = f"not under {tmp_path}" if installed else "bpy is not installed"
    with pytest.raises(EnvironmentMapError, match=f"'city' comes with Blender's bpy wheel: {missing}$"):
        load_environment(builtin="city")


def test_blender_is_not_imported() -> None:
    code = "import sys, lookdev.light as ibl; ibl.load_environment(builtin='city'); print('bpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout == "False\n"


ONES = np.ones((4, 8), np.float32)
WINDOW = (np.array([0, 0], np.int32), np.array([15, 7], np.int32))


def truncated(path: Path) -> None:
    write_map(path, np.ones((64, 128, 3), np.float32))
    path.write_bytes(path.read_bytes()[:-40])


UNREAD = "cannot be read as an image"
RGBE = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n"
BROKEN: dict[str, tuple[str, Callable[[Path], object]]] = {
    "text.exr": (UNREAD, lambda path: path.write_text("not an image")),
    "truncated.exr": (UNREAD, truncated),
    "channels.exr": ("needs channels R, G, B", lambda path: write_exr(path, Z=ONES)),
    "nan.exr": ("no finite value", lambda path: write_map(path, np.full((4, 8, 3), np.nan, np.float32))),
    "cropped.exr": ("map uncropped", lambda path: write_exr(path, {"displayWindow": WINDOW}, R=ONES, G=ONES, B=ONES)),
    "empty.hdr": (UNREAD, lambda path: path.write_bytes(RGBE + b"-Y 16 +X 32\n")),
    "xyz.hdr": (
        "cannot be read",
        lambda path: path.write_bytes(RGBE.replace(b"rgbe", b"xyze") + b"-Y 1 +X 2\n" + bytes([9, 9, 9, 128] * 2)),
    ),
    "map.png": ("lat-long .exr or .hdr", lambda path: None),
    "missing.exr": ("no such image file", lambda path: None),
}


@pytest.mark.parametrize("name", BROKEN)
def test_errors_name_unreadable_files_and_the_fault(tmp_path: Path, name: str) -> None:
    message, write = BROKEN[name]
    write(tmp_path / name)
    with pytest.raises(EnvironmentMapError, match=message) as caught:
        load_environment(tmp_path / name)
    assert str(tmp_path / name) in str(caught.value)


def test_unknown_builtin_names_the_nearest() -> None:
    with pytest.raises(EnvironmentMapError, match="did you mean 'sunset'"):
        load_environment(builtin="sunsett")


def test_file_or_builtin_not_both_or_none() -> None:
    for arguments in ({}, {"file": Path("x.exr"), "builtin": "city"}):
        with pytest.raises(EnvironmentMapError, match="either by file or by built-in name"):
            load_environment(**arguments)


ORIENTED: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "-Y 2 +X 3": lambda map: map,
    "+Y 2 +X 3": lambda map: map[::-1],
    "-Y 2 -X 3": lambda map: map[:, ::-1],
    "+Y 2 -X 3": lambda map: map[::-1, ::-1],
    # Columns, each from one end to the other.
    "+X 3 -Y 2": lambda map: map.T,
    "-X 3 -Y 2": lambda map: map[:, ::-1].T,
    "+X 3 +Y 2": lambda map: map[::-1].T,
    "-X 3 +Y 2": lambda map: map[::-1, ::-1].T,
}


@pytest.mark.parametrize("orientation", ORIENTED)
def test_an_hdr_of_any_orientation_is_read_rightly(tmp_path: Path, orientation: str) -> None:
    """The order of a file's pixels is that of its orientation."""
    upright = np.array([[1, 2, 3], [4, 5, 6]], np.uint8)
    pixels = bytes(byte for value in ORIENTED[orientation](upright).ravel() for byte in (value, value, 2 * value, 136))
    (tmp_path / "map.hdr").write_bytes(RGBE + orientation.encode() + b"\n" + pixels)
    radiance = load_environment(tmp_path / "map.hdr").radiance
    np.testing.assert_array_equal(radiance[..., 0], upright)
    np.testing.assert_array_equal(radiance[..., 2], 2 * upright)


@pytest.mark.parametrize(("level", "exposure"), [(1.1e18, 0.0), (1e17, 4.0), (9e-19, 0.0), (1e-17, -4.0)])
def test_radiance_that_shaders_cannot_compute_with_is_refused(level: float, exposure: float) -> None:
    with pytest.raises(EnvironmentMapError, match=r"bright: its largest radiance.* from 1e-18 to 1e"):
        check_exposed(float(make_environment("bright", np.full((4, 8, 3), level)).radiance.max()), exposure, "bright")


@pytest.mark.parametrize("level", [0.0, 1e-17, 1e17])
def test_other_radiance_is_taken(level: float) -> None:
    check_exposed(float(make_environment("map", np.full((4, 8, 3), level)).radiance.max()), 3.0, "map")


@pytest.mark.parametrize("level", [MIN_PEAK, MAX_PEAK])
def test_the_ends_of_the_range_are_taken(level: float) -> None:
    check_exposed(level, 0.0, "map")
