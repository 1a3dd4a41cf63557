"""Linear textures and their reference look-up."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from lookdev.errors import TextureError
from lookdev.material.look import Texture
from lookdev.material.textures import image_header, linear_texture, sample_texture, srgb_to_linear


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("LOOKDEV_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache" / "textures"


def save(file: Path, pixels: np.ndarray, kind: str, **attributes: object) -> Path:
    """Write pixels as they are: OpenImageIO would otherwise take RGB as multiplied by alpha."""
    output = oiio.ImageOutput.create(str(file))
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], kind)
    spec["oiio:UnassociatedAlpha"] = 1
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
    assert srgb_to_linear([0.0, 0.04045, 0.5, 1.0]) == pytest.approx(
        [0.0, 0.04045 / 12.92, (0.555 / 1.055) ** 2.4, 1.0], rel=1e-15
    )
    assert srgb_to_linear(-0.5) == pytest.approx(-0.5 / 12.92)


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
    [
        ([0.25], [0.25, 0.25, 0.25, 1]),
        ([0.25, 0.5], [0.25, 0.25, 0.25, 0.5]),
        ([1, 0.5, 0.25], [1, 0.5, 0.25, 1]),
    ],
)
def test_missing_channels_are_filled_as_usd_says(tmp_path: Path, stored: list[float], expected: list[float]) -> None:
    pixels = np.array([[stored]], np.float32)
    linear = linear_texture(Texture(save(tmp_path / "a.tif", pixels, "float"), "r", "raw"))
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
    ("modes", "expected"),
    [("periodic,mirror", ("repeat", "mirror")), ("clamp", ("clamp", "clamp")), (None, ("black", "black"))],
)
def test_header(tmp_path: Path, modes: str | None, expected: tuple[str, str]) -> None:
    attributes = {} if modes is None else {"wrapmodes": modes}
    file = save(tmp_path / "a.exr", np.zeros((1, 1, 3), np.float32), "half", **attributes)
    header = image_header(file)
    assert (header.channels, header.eight_bit, header.wraps) == (("R", "G", "B"), False, expected)


def test_faults_name_the_file(tmp_path: Path, cache: Path) -> None:
    broken = tmp_path / "broken.png"
    broken.write_bytes(b"\x89PNG, but no more")
    five = save(tmp_path / "five.tif", np.zeros((1, 1, 5), np.float32), "float", channelnames="")
    nan = save(tmp_path / "nan.exr", np.array([[[np.nan, 1, np.inf]]], np.float32), "float")
    velocity = tmp_path / "velocity.exr"
    spec = oiio.ImageSpec(1, 1, 3, oiio.FLOAT)
    spec.channelnames = ("u", "v", "w")
    output = oiio.ImageOutput.create(str(velocity))
    assert output.open(str(velocity), spec)
    assert output.write_image(np.zeros((1, 1, 3), np.float32))
    assert output.close()
    for file, says in (
        (tmp_path / "gone.png", "no such image file"),
        (broken, "cannot be read as an image"),
        (velocity, "no channels R, G, B among u, v, w"),
        (nan, "2 values are NaN or infinite"),
    ):
        with pytest.raises(TextureError, match=says) as caught:
            linear_texture(Texture(file, "r", "raw"))
        assert str(file) in str(caught.value)
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
    ("wrap", "texels"),
    [
        ("repeat", [0, 1, 2, 0, 1, 2, 0, 1, 2]),
        ("clamp", [0, 0, 0, 0, 1, 2, 2, 2, 2]),
        ("mirror", [2, 1, 0, 0, 1, 2, 2, 1, 0]),
        ("black", [0, 0, 0, 0, 1, 2, 0, 0, 0]),
    ],
)
def test_wrap_modes(ramp: Path, wrap: str, texels: list[float]) -> None:
    # Texels -3 to 5 of the top row, plus 1 by the bias, which black texels get as well.
    texture = Texture(ramp, "r", "raw", wrap, "clamp", bias=(1.0, 0.0, 0.0, 0.0))
    columns = np.arange(-3, 6)
    top = np.full(9, 0.75)
    at_centres = sample_texture(texture, np.stack([(columns + 0.5) / 3, top], -1))
    np.testing.assert_allclose(at_centres, np.array(texels) + 1.0, atol=1e-12)
    between = sample_texture(texture, np.stack([(columns[:-1] + 1.0) / 3, top[:-1]], -1))
    np.testing.assert_allclose(between, (at_centres[:-1] + at_centres[1:]) / 2, atol=1e-12)
    # The same along t, on a column: row 0 of the file is at the top, texel -1 below row 1.
    turned = Texture(ramp, "r", "raw", "clamp", wrap)
    below = sample_texture(turned, [0.5 / 3, -0.25])
    assert below == pytest.approx({"repeat": 0.0, "clamp": 3.0, "mirror": 3.0, "black": 0.0}[wrap], abs=1e-12)


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
