"""Linear textures and their reference look-up; images inside usdz packages, also as sets of tiles."""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from look_files import faults_of, look, rough, texture
from pxr import Sdf

from lookdev.errors import TextureError
from lookdev.material import Texture
from lookdev.material.textures import image_header, linear_texture, sample_slopes, sample_texture, slope_texture
from lookdev.material.usd import read_look
from lookdev.stage.colorspaces import srgb_to_linear

pytestmark = pytest.mark.both_pythons


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("LOOKDEV_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache" / "content"


def save(file: Path, pixels: np.ndarray, kind: str, names: tuple[str, ...] = (), **attributes: object) -> Path:
    """Write pixels as they are: OpenImageIO would otherwise take RGB as multiplied by alpha."""
    output = oiio.ImageOutput.create(str(file))
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], kind)
    spec["oiio:UnassociatedAlpha"] = 1
    spec.channelnames = names or spec.channelnames
    for name, value in attributes.items():
        spec[name] = value
    assert output.open(str(file), spec), output.geterror()
    assert output.write_image(np.ascontiguousarray(pixels))
    assert output.close()
    return file


def load(file: Path) -> np.ndarray:
    return np.asarray(oiio.ImageBuf(str(file)).get_pixels(oiio.FLOAT))


def test_srgb_is_the_piecewise_curve() -> None:
    # IEC 61966-2-1 puts the knee at 0.04045; both branches give about 0.0031308 there.
    expected = [-0.5 / 12.92, 0.0, 0.04045 / 12.92, (0.555 / 1.055) ** 2.4, 1.0]
    assert srgb_to_linear([-0.5, 0.0, 0.04045, 0.5, 1.0]) == pytest.approx(expected, rel=1e-15)


def test_equal_texels_are_equal_files(tmp_path: Path) -> None:
    """Otherwise frames would be stale after the cache is deleted."""
    texture = Texture(save(tmp_path / "a.png", np.zeros((2, 2, 3), np.uint8), "uint8"), "r", "raw")
    for file in (linear_texture(texture), slope_texture(texture)):
        assert oiio.ImageBuf(str(file)).spec().getattribute("DateTime") == "2000:01:01 00:00:00"


def test_srgb_is_decoded_and_alpha_neither_decoded_nor_multiplied_in(tmp_path: Path) -> None:
    stored = np.array([[[255, 128, 0, 0], [10, 20, 30, 128]]], np.uint8)
    linear = linear_texture(Texture(save(tmp_path / "a.png", stored, "uint8"), "rgb", "sRGB"))
    expected = np.concatenate([srgb_to_linear(stored[..., :3] / 255), stored[..., 3:] / 255], axis=-1)
    # Read and written as float32, each rounds by 2^-24 at most; the curve multiplies the first by up to 2.4.
    np.testing.assert_allclose(load(linear), expected, rtol=3.4 * 2.0**-24, atol=0)
    header = oiio.ImageInput.open(str(linear)).spec()
    assert header.channelnames == ("R", "G", "B", "A")
    assert header.format == oiio.FLOAT


@pytest.mark.parametrize(
    ("stored", "expected"),
    [([0.25], [0.25, 0.25, 0.25, 1]), ([0.25, 0.5], [0.25, 0.25, 0.25, 0.5]), ([1, 0.5, 0.25], [1, 0.5, 0.25, 1])],
)
def test_missing_channels_are_filled_as_in_usd(tmp_path: Path, stored: list[float], expected: list[float]) -> None:
    linear = linear_texture(Texture(save(tmp_path / "a.tif", np.array([[stored]], np.float32), "float"), "r", "raw"))
    np.testing.assert_array_equal(load(linear), [[expected]])


def test_conversion_is_kept_by_content_and_color_space(tmp_path: Path, cache: Path) -> None:
    gray = np.full((2, 2, 1), 0.5, np.float32)
    first = linear_texture(Texture(save(tmp_path / "a.png", gray, "uint8"), "r", "raw"))
    before = first.stat().st_mtime_ns
    assert linear_texture(Texture(save(tmp_path / "copy.png", gray, "uint8"), "g", "raw")) == first
    assert first.stat().st_mtime_ns == before
    other = linear_texture(Texture(tmp_path / "a.png", "r", "sRGB"))
    changed = linear_texture(Texture(save(tmp_path / "a.png", gray / 2, "uint8"), "r", "raw"))
    assert {first, other, changed} == set(cache.iterdir())
    assert len({first, other, changed}) == 3


def test_exr_crop_window_is_put_into_the_whole_image(tmp_path: Path) -> None:
    buffer = oiio.ImageBuf(oiio.ImageSpec(oiio.ROI(1, 2, 0, 1, 0, 1, 0, 3), oiio.FLOAT))
    buffer.set_pixels(buffer.roi, np.full((1, 1, 3), 2.0, np.float32))
    buffer.set_full(0, 3, 0, 1, 0, 1)
    assert buffer.write(str(tmp_path / "crop.exr"))
    linear = load(linear_texture(Texture(tmp_path / "crop.exr", "r", "raw")))
    np.testing.assert_array_equal(linear[..., 0], [[0.0, 2.0, 0.0]])


@pytest.mark.parametrize(
    ("name", "kind", "modes", "expected"),
    [
        ("a.exr", "half", {"wrapmodes": "periodic,mirror"}, (False, False, "repeat", "mirror")),
        ("a.exr", "half", {"wrapmodes": "clamp"}, (False, False, "clamp", "clamp")),
        ("a.exr", "half", {}, (False, False, "black", "black")),
        ("a.png", "uint8", {}, (True, True, "black", "black")),
        ("a.png", "uint16", {}, (False, True, "black", "black")),
        ("a.tif", "float", {}, (False, False, "black", "black")),
    ],
)
def test_header(tmp_path: Path, name: str, kind: str, modes: dict[str, str], expected: tuple[object, ...]) -> None:
    header = image_header(save(tmp_path / name, np.zeros((1, 1, 3), np.float32), kind, **modes))
    assert header.channels == ("R", "G", "B")
    assert (header.is_eight_bit, header.is_unsigned, *header.wraps) == expected


def test_faults_name_the_file(tmp_path: Path, cache: Path) -> None:
    broken = tmp_path / "broken.png"
    broken.write_bytes(b"\x89PNG, but no more")
    five = save(tmp_path / "five.tif", np.zeros((1, 1, 5), np.float32), "float", channelnames="")
    nan = save(tmp_path / "nan.exr", np.array([[[np.nan, 1, np.inf]]], np.float32), "float")
    velocity = save(tmp_path / "velocity.exr", np.zeros((1, 1, 3), np.float32), "float", names=("u", "v", "w"))
    for file, message in (
        (tmp_path / "gone.png", "no such image file"),
        (broken, "cannot be read as an image"),
        (velocity, "no channels R, G, B among u, v, w"),
        (nan, "2 values are NaN or infinite"),
    ):
        with pytest.raises(TextureError, match=f"{file}.*{message}"):
            linear_texture(Texture(file, "r", "raw"))
    assert image_header(five).channels[:3] == ("R", "G", "B")
    assert list(cache.iterdir()) == [], "nothing may be kept of a failed conversion"


RAMP = np.arange(6, dtype=np.float32).reshape(2, 3, 1)  # 0 1 2 over 3 4 5, the top row first


@pytest.fixture
def ramp(tmp_path: Path) -> Path:
    return save(tmp_path / "ramp.exr", RAMP, "float")


def test_texel_centres_and_orientation(ramp: Path) -> None:
    s, t = np.meshgrid((np.arange(3) + 0.5) / 3, (np.arange(2) + 0.5) / 2)
    values = sample_texture(Texture(ramp, "r", "raw"), np.stack([s, t], -1))
    np.testing.assert_allclose(values, [[3, 4, 5], [0, 1, 2]], atol=1e-14)  # t grows upwards


@pytest.mark.parametrize(
    ("wrap", "texels", "below", "beyond"),
    [
        ("repeat", [0, 1, 2, 0, 1, 2, 0, 1, 2], 0.0, [3.0, -3.0]),
        ("clamp", [0, 0, 0, 0, 1, 2, 2, 2, 2], 3.0, [0.0, -3.0]),
        ("mirror", [2, 1, 0, 0, 1, 2, 2, 1, 0], 3.0, [-3.0, -3.0]),
        ("black", [0, 0, 0, 0, 1, 2, 0, 0, 0], 0.0, [0.0, 0.0]),
    ],
)
def test_wrap_modes(ramp: Path, wrap: str, texels: list[float], below: float, beyond: list[float]) -> None:
    # Texels -3 to 5 of the top row, plus 1 by the bias, which black texels get as well.
    biased = Texture(ramp, "r", "raw", wrap, "clamp", bias=(1.0, 0.0, 0.0, 0.0))
    columns, top = np.arange(-3, 6), np.full(9, 0.75)
    at_centres = sample_texture(biased, np.stack([(columns + 0.5) / 3, top], -1))
    np.testing.assert_allclose(at_centres, np.array(texels) + 1.0, atol=1e-12)
    between = sample_texture(biased, np.stack([(columns[:-1] + 1.0) / 3, top[:-1]], -1))
    np.testing.assert_allclose(between, (at_centres[:-1] + at_centres[1:]) / 2, atol=1e-12)
    # The same along t, on a column: row 0 of the file is at the top, texel -1 below row 1.
    column = Texture(ramp, "r", "raw", "clamp", wrap)
    assert sample_texture(column, [0.5 / 3, -0.25]) == pytest.approx(below, abs=1e-12)
    # Rows 0 1 2 over 3 4 5: slopes of 3 a unit along s, and along t (2 texels, half a step at each edge) of -3.
    slopes = sample_slopes(Texture(ramp, "r", "raw", wrap, "clamp"), [[0.5, 0.5], [-0.5, 0.5]])
    np.testing.assert_allclose(slopes, [[3.0, -3.0], beyond], atol=1e-12)


def test_transform_scale_and_bias_per_channel(tmp_path: Path) -> None:
    pixels = np.array([[[0.1, 0.2, 0.3, 0.4], [0.5, 0.6, 0.7, 0.8]]], np.float32)
    file = save(tmp_path / "a.tif", pixels, "float")
    common = {"scale": (1.0, 2.0, 3.0, 4.0), "bias": (0.0, 0.5, 0.0, -1.0)}
    swapped = (0.0, 1.0, 0.0, 1.0, 0.0, 0.5)  # s' = t, t' = s + 0.5
    st = np.array([[[0.0, 0.25], [0.0, 0.75]]])
    color = sample_texture(Texture(file, "rgb", "raw", transform=swapped, **common), st)
    np.testing.assert_allclose(color, pixels[..., :3] * [1, 2, 3] + [0, 0.5, 0], rtol=1e-7)
    alpha = sample_texture(Texture(file, "a", "raw", transform=swapped, **common), st)
    np.testing.assert_allclose(alpha, pixels[..., 3] * 4 - 1, rtol=1e-6)


@pytest.mark.parametrize("wrap", ["repeat", "mirror", "clamp", "black"])
def test_slopes_are_central_differences_of_decoded_texels(tmp_path: Path, wrap: str) -> None:
    stored = np.array([[10, 250, 90], [200, 30, 60]], np.uint8)
    file = save(tmp_path / "a.png", np.stack([np.zeros_like(stored), stored, stored, stored], axis=-1), "uint8")
    for channel, h in (("g", srgb_to_linear(stored / 255) * 3.0), ("a", stored / 255 * 0.5)):
        texture = Texture(file, channel, "sRGB", wrap, wrap, scale=(1.0, 3.0, 1.0, 0.5), bias=(0.0, 9.0, 0.0, 9.0))
        a, b, c = h.T
        left, right = (c, a) if wrap == "repeat" else (a, c)  # what stands beyond the edges
        dh_ds = np.stack([b - left, c - a, right - b], axis=-1) * 3 / 2
        # Two rows: the lower one's neighbours are the upper one, and itself or by repetition the upper one again.
        dh_dt = np.zeros((2, 3)) if wrap == "repeat" else np.stack([h[0] - h[1]] * 2) * 2 / 2
        slopes = load(slope_texture(texture))
        # Texels of up to 3 are kept as float32, and a slope is 3/2 of the difference of two.
        np.testing.assert_allclose(slopes[..., 0], dh_ds, rtol=2.0**-22, atol=9 * 2.0**-23)
        np.testing.assert_allclose(slopes[..., 1], dh_dt, rtol=2.0**-22, atol=9 * 2.0**-23)


def test_slopes_are_kept_by_all_that_they_depend_on(ramp: Path, cache: Path) -> None:
    texture = Texture(ramp, "r", "raw", "clamp", "mirror", scale=(0.1, 1.0, 1.0, 1.0))
    first = slope_texture(texture)
    before = first.stat().st_mtime_ns
    same = {"bias": (5.0, 0.0, 0.0, 0.0), "transform": (2.0, 0.0, 0.0, 0.0, 2.0, 0.0), "st": "map1"}
    assert slope_texture(dataclasses.replace(texture, **same)) == first
    assert first.stat().st_mtime_ns == before
    changes = ({"channel": "g"}, {"scale": (0.2, 1.0, 1.0, 1.0)}, {"wrap_s": "repeat"}, {"wrap_t": "repeat"})
    others = {slope_texture(dataclasses.replace(texture, **change)) for change in changes}
    assert len(others | {first}) == 5
    assert {first, *others, linear_texture(texture)} == set(cache.iterdir())


def test_a_height_is_one_channel(ramp: Path) -> None:
    with pytest.raises(TextureError, match=r"ramp.exr: a height is one channel"):
        slope_texture(Texture(ramp, "rgb", "raw"))


def within(x: np.ndarray) -> np.ndarray:
    return (x >= 0) & (x <= 1)


# A profile along one axis as its wrap mode continues it over all the reals, and its derivative. Both are continuous.
PROFILES: dict[str, tuple[Callable[[np.ndarray], np.ndarray], Callable[[np.ndarray], np.ndarray]]] = {
    "repeat": (lambda x: np.sin(2 * np.pi * x), lambda x: 2 * np.pi * np.cos(2 * np.pi * x)),
    "mirror": (lambda x: np.cos(np.pi * x), lambda x: -np.pi * np.sin(np.pi * x)),
    "clamp": (lambda x: np.cos(np.pi * np.clip(x, 0, 1)), lambda x: -np.pi * np.sin(np.pi * x) * within(x)),
    "black": (lambda x: np.sin(np.pi * x) ** 2 * within(x), lambda x: np.pi * np.sin(2 * np.pi * x) * within(x)),
}


@pytest.mark.parametrize("transform", [(1.0, 0.0, 0.0, 0.0, 1.0, 0.0), (1.2, -0.9, 0.25, 1.6, 2.1, -0.5)])
@pytest.mark.parametrize("wrap_t", PROFILES)
@pytest.mark.parametrize("wrap_s", PROFILES)
def test_slopes_are_the_derivative_of_the_height(tmp_path: Path, wrap_s: str, wrap_t: str, transform: tuple) -> None:
    (f, df), (g, dg) = PROFILES[wrap_s], PROFILES[wrap_t]
    columns, rows = 128, 96
    s, t = (np.arange(columns) + 0.5) / columns, 1 - (np.arange(rows) + 0.5) / rows
    file = save(tmp_path / "h.exr", np.float32(g(t)[:, None] * f(s))[..., None], "float")
    texture = Texture(file, "r", "raw", wrap_s, wrap_t, transform=transform)
    st = np.random.default_rng(7).uniform(-2, 3, (50, 40, 2))
    matrix = np.array(transform).reshape(2, 3)
    u, v = np.moveaxis(st @ matrix[:, :2].T + matrix[:, 2], -1, 0)
    expected = np.stack([df(u) * g(v), f(u) * dg(v)], axis=-1) @ matrix[:, :2]
    # With x = 2 pi / texels the difference quotient loses x^2 / 6 of a sine's slope of 2 pi at most, interpolation
    # x^2 / 8 along each axis; where the slope of a profile has a kink (the edge of `black` and `clamp`: a curvature of
    # 2 pi^2 that ends) it is off by up to half a texel of it.
    x = 2 * np.pi / rows
    off = 2 * np.pi * x**2 * (1 / 6 + 2 / 8) + np.pi**2 / rows
    assert np.abs(expected).max() > 10 * off
    np.testing.assert_allclose(sample_slopes(texture, st), expected, atol=off * np.abs(matrix[:, :2]).sum(axis=0).max())


def package(folder: Path, layers: dict[str, str], images: dict[str, float], name: str = "look.usdz") -> Path:
    """Write a package of layers, the first of which is its root, and of gray images."""
    writer = Sdf.ZipFileWriter.CreateNew(str(folder / name))
    for inner, content in (layers | images).items():
        file = folder / "in" / inner
        file.parent.mkdir(parents=True, exist_ok=True)
        if isinstance(content, str):
            file.write_text(content)
        else:
            save(file, np.full((2, 2, 1), content, np.float32), "uint8")
        writer.AddFile(str(file), inner)
    writer.Save()
    return folder / name


def textured_look(file: str) -> str:
    return look(rough("Tex.r") + texture(file=f"@{file}@"))


def roughness(file: Path) -> Texture:
    return read_look(file).layers[0].inputs["roughness"]


def test_an_image_of_the_root_layer(tmp_path: Path) -> None:
    value = roughness(package(tmp_path, {"look.usda": textured_look("tex/a.png")}, {"tex/a.png": 0.2}))
    assert value.file.name == "a.png"
    np.testing.assert_allclose(sample_texture(value, [0.5, 0.5]), 51 / 255)


def test_an_image_relative_to_a_layer_inside(tmp_path: Path) -> None:
    text = textured_look("./tex/a.png")
    root = '#usda 1.0\n(\n defaultPrim = "M"\n)\ndef "M" (\n references = @parts/mat.usda@\n)\n{\n}\n'
    file = package(tmp_path, {"root.usda": root, "parts/mat.usda": text}, {"parts/tex/a.png": 0.4})
    np.testing.assert_allclose(sample_texture(roughness(file), [0.5, 0.5]), 0.4)


def test_equal_content_is_one_file_and_a_changed_package_another(tmp_path: Path) -> None:
    first, second, changed = (
        roughness(package(tmp_path, {"look.usda": textured_look("a.png")}, {"a.png": value}, f"{number}.usdz"))
        for number, value in enumerate((0.2, 0.2, 0.8))
    )
    assert first == second
    assert changed.file != first.file
    np.testing.assert_allclose(sample_texture(changed, [0.5, 0.5]), 0.8)


def test_a_file_that_left_the_cache_is_copied_again(tmp_path: Path) -> None:
    file = package(tmp_path, {"look.usda": textured_look("a.png")}, {"a.png": 0.2})
    roughness(file).file.unlink()
    np.testing.assert_allclose(sample_texture(roughness(file), [0.5, 0.5]), 0.2)


def test_a_set_of_tiles(tmp_path: Path) -> None:
    text = textured_look("tex/a.<UDIM>.png")
    file = package(tmp_path, {"look.usda": text}, {"tex/a.1001.png": 0.2, "tex/a.1012.png": 0.6})
    np.testing.assert_allclose(sample_texture(roughness(file), [[0.5, 0.5], [1.5, 1.5], [1.5, 0.5]]), [0.2, 0.6, 0.0])


@pytest.mark.parametrize(
    ("file", "more", "summary"),
    [
        ("b.png", {}, "no such image file: b.png"),
        ("b.<UDIM>.png", {}, "no tile of this set: b.<UDIM>.png"),
        ("a.png", {"a.png": "no image"}, "cannot be read as an image"),
    ],
)
def test_an_image_that_cannot_be_read_is_a_fault(tmp_path: Path, file: str, more: dict[str, str], summary: str) -> None:
    layers = {"look.usda": textured_look(file)} | more
    ((where, said, _),) = faults_of(package(tmp_path, layers, {} if more else {"a.png": 0.2}))
    assert where == "Tex.file"
    assert summary in said
