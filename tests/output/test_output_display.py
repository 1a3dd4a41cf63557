from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from lookdev.errors import OutputError
from lookdev.output.color import VIEWS
from lookdev.output.display import composite, quantise, straight_codes, to_display, write_pixels


def read_png(path: Path) -> tuple[np.ndarray, oiio.ImageSpec]:
    """Return the pixels in a file, alpha unassociated, and its spec."""
    config = oiio.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)
    image = oiio.ImageInput.open(str(path), config)
    pixels, spec = image.read_image(oiio.UINT8), image.spec()
    image.close()
    return pixels, spec


def test_raw_quantises_and_clips() -> None:
    rgb = np.array([[[-1.0, 0.5, 7.0]]])
    assert to_display(rgb, "Raw").tolist() == [[[0, 128, 255]]]
    assert rgb.tolist() == [[[-1.0, 0.5, 7.0]]]  # the input is left alone


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_broken_pixels_are_reported(value: float) -> None:
    rgb = np.zeros((4, 5, 3))
    rgb[2, 3, 1] = value
    with pytest.raises(OutputError, match="1 pixels are NaN or infinite, the first in row 2, column 3"):
        to_display(rgb, "Raw")


def test_composite() -> None:
    beauty = np.array([[[0.2, 0.1, 0.0], [1.0, 1.0, 1.0]]])
    alpha = np.array([[0.5, 1.0]])
    np.testing.assert_allclose(composite(beauty, alpha, (1.0, 0.0, 2.0)), [[[0.7, 0.1, 1.0], [1, 1, 1]]], rtol=1e-6)
    image = np.arange(6.0).reshape(1, 2, 3)
    np.testing.assert_allclose(composite(beauty, alpha, image)[0, 0], [0.2, 0.6, 1.0], rtol=1e-6)


def test_png_with_alpha_is_straight(tmp_path: Path) -> None:
    path = tmp_path / "new" / "a.png"
    alpha = np.array([[0.5, 0.0, 1.0, 1e-30]])
    rgb = np.array([[[0.25] * 3, [3.0] * 3, [0.5] * 3, [1e20] * 3]])
    write_pixels(path, quantise(straight_codes(rgb, alpha, "Raw")))
    pixels, spec = read_png(path)
    assert pixels.tolist() == [[[128, 128, 128, 128], [0, 0, 0, 0], [128, 128, 128, 255], [255, 255, 255, 0]]]
    assert "rgb" in spec.getattribute("oiio:ColorSpace").lower()
    assert [file.name for file in path.parent.iterdir()] == ["a.png"]


def test_png_without_alpha_is_opaque(tmp_path: Path) -> None:
    rgb = np.random.default_rng(1).random((3, 5, 3))
    write_pixels(tmp_path / "a.png", to_display(rgb, VIEWS[0]))
    np.testing.assert_array_equal(read_png(tmp_path / "a.png")[0], to_display(rgb, VIEWS[0]))


@pytest.mark.parametrize("name", ["file/a.png", "a.unknown", "folder.png"])
def test_unwritable_place(tmp_path: Path, name: str) -> None:
    (tmp_path / "file").write_text("in the way")
    (tmp_path / "folder.png").mkdir()
    with pytest.raises(OutputError, match="cannot write"):
        write_pixels(tmp_path / name, np.zeros((2, 2, 3), np.uint8))
    assert sorted(file.name for file in tmp_path.iterdir()) == ["file", "folder.png"]
