import colorsys
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import PyOpenColorIO as ocio
import pytest

from lookdev.errors import OutputError
from lookdev.output.color import DISPLAY, SHIPPED, SOURCE, VIEWS, DisplayView, default_display, default_view
from lookdev.output.config import FILE, KNEE, OCIO_CONFIG, WHITE, make_config, shoulder_scale
from lookdev.output.display import to_display

STUDIO = "ocio://studio-config-v2.2.0_aces-v1.3_ocio-v2.4"


def view_codes(rgb: object, view: str = SHIPPED) -> np.ndarray:
    """Return code values in [0, 1] of colours in a view of the config that ships, not rounded."""
    pixels = np.array(rgb, np.float32).reshape(1, -1, 3)
    DisplayView(view).processor.applyRGB(pixels)
    return pixels[0].astype(np.float64)


def decode_srgb(code: np.ndarray) -> np.ndarray:
    """Return linear values of sRGB code values by IEC 61966-2-1."""
    return np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)


@pytest.fixture
def colors() -> np.ndarray:
    rng = np.random.default_rng(62)
    return rng.random((2000, 3)) * 10.0 ** rng.uniform(-3.0, 3.0, (2000, 1))


def test_the_shipped_config_is_what_its_program_writes() -> None:
    assert make_config().serialize() == FILE.read_text()
    assert tuple(ocio.Config.CreateFromFile(str(FILE)).getViews(DISPLAY)) == VIEWS
    assert (default_display(SHIPPED), default_view(SHIPPED, DISPLAY)) == (DISPLAY, VIEWS[0])


def test_the_rest_of_the_shipped_config_is_opencolorio_s() -> None:
    config, base = make_config(), ocio.Config.CreateFromBuiltinConfig(OCIO_CONFIG)
    for view in VIEWS[1:]:
        shipped, builtin = (
            cfg.getProcessor(SOURCE, DISPLAY, view, ocio.TRANSFORM_DIR_FORWARD).getDefaultCPUProcessor().getCacheID()
            for cfg in (config, base)
        )
        assert shipped == builtin
    for display in ("Rec.1886 Rec.709 - Display", "Display P3 - Display", "P3-D65 - Display"):
        assert config.getDefaultView(display) == "lookdev"


# OpenColorIO computes in float32, with fast logarithms and powers of about 1e-5.
TOLERANCE = 1e-4


def test_hue_and_saturation_stay(colors: np.ndarray) -> None:
    for light, display in zip(colors, decode_srgb(view_codes(colors)), strict=True):
        hue, saturation, value = colorsys.rgb_to_hsv(*light)
        display_hue, display_saturation, display_value = colorsys.rgb_to_hsv(*display)
        if display_value < 0.01:
            continue  # hue is a ratio of differences, which have no digits left
        assert display_saturation == pytest.approx(saturation, abs=10 * TOLERANCE)
        assert abs((display_hue - hue + 0.5) % 1.0 - 0.5) * saturation < 10 * TOLERANCE
        a = shoulder_scale()
        curve = value if value <= KNEE else min(KNEE + a * np.log1p((value - KNEE) / a), 1.0)
        assert display_value == pytest.approx(curve, abs=10 * TOLERANCE)


def test_the_curve_rises_to_white_without_a_corner() -> None:
    values = np.geomspace(1e-3, WHITE, 4000)
    curve = decode_srgb(view_codes(np.repeat(values[:, None], 3, axis=-1)))[:, 0]
    assert (np.diff(curve) > 0.0).all()
    assert curve[-1] == pytest.approx(1.0, abs=TOLERANCE)
    assert view_codes([[WHITE * 100.0] * 3]) == pytest.approx(1.0, abs=TOLERANCE)


def test_what_rec709_does_not_show_is_clipped_first() -> None:
    np.testing.assert_allclose(view_codes([[-0.3, 0.5, 0.2]]), view_codes([[0.0, 0.5, 0.2]]), atol=TOLERANCE)


@pytest.mark.both_pythons
def test_a_studio_s_config_knows_linear_rec709_by_its_roles() -> None:
    rgb = np.random.default_rng(1).random((4, 4, 3))
    view = DisplayView(VIEWS[1], default_display(STUDIO), STUDIO)
    np.testing.assert_array_equal(to_display(rgb, view), to_display(rgb, VIEWS[1]))
    named = DisplayView(view.view, view.display, STUDIO, SOURCE)
    np.testing.assert_array_equal(to_display(rgb, named), to_display(rgb, view))
    wider = DisplayView(view.view, view.display, STUDIO, "ACEScg")  # the same numbers are other colours
    assert (to_display(rgb, wider) != to_display(rgb, view)).any()


def studio(folder: Path, gain: float = 2.0) -> Path:
    """Write a minimal config without interchange roles, with a table beside it."""
    folder.mkdir(exist_ok=True)
    config = ocio.Config()
    config.setVersion(2, 0)
    config.setSearchPath(".")
    config.addColorSpace(ocio.ColorSpace(name="plain"))
    config.addColorSpace(ocio.ColorSpace(name="bright", fromReference=ocio.FileTransform("gain.spimtx")))
    config.setRole("default", "plain")
    config.setRole("scene_linear", "plain")
    config.addDisplayView("wall", "house", "bright")
    (folder / "gain.spimtx").write_text(f"{gain} 0 0 0\n0 {gain} 0 0\n0 0 {gain} 0\n")
    path = folder / "config.ocio"
    path.write_text(config.serialize())
    return path


def test_a_config_without_roles_needs_the_name_of_the_space(tmp_path: Path) -> None:
    view = DisplayView("house", "wall", str(studio(tmp_path)), "plain")
    assert to_display(np.full((1, 1, 3), 0.25), view).tolist() == [[[128, 128, 128]]]
    for changes, message in (
        ({"space": ""}, "name its colour space of linear Rec.709 by 'ocio_space'"),
        ({"space": "plian"}, "no colour space called 'plian' .did you mean 'plain'"),
        ({"view": "hose"}, "no view of wall called 'hose' .did you mean 'house'"),
        ({"display": "wal"}, "no display called 'wal' .did you mean 'wall'"),
    ):
        with pytest.raises(OutputError, match=message):
            replace(view, **changes).check()


def test_a_digest_is_that_of_what_is_done_to_colours(tmp_path: Path) -> None:
    paths = [studio(tmp_path / name, gain) for name, gain in (("a", 2.0), ("b", 2.0), ("c", 3.0))]
    digests = [DisplayView("house", "wall", str(path), "plain").digest for path in paths]
    assert digests[0] == digests[1] != digests[2]
    assert len({DisplayView(view).digest for view in VIEWS}) == len(VIEWS)


def test_a_config_that_cannot_be_read(tmp_path: Path) -> None:
    (tmp_path / "bad.ocio").write_text("ocio: no")
    for config, message in (
        (str(tmp_path / "none.ocio"), "cannot read the config .*none.ocio"),
        (str(tmp_path / "bad.ocio"), "cannot read the config"),
        ("ocio://aces", "built-in ones are ocio://"),
    ):
        with pytest.raises(OutputError, match=message):
            default_display(config)


def test_a_config_without_its_table_is_reported(tmp_path: Path) -> None:
    path = studio(tmp_path)
    (tmp_path / "gain.spimtx").unlink()
    with pytest.raises(OutputError, match=r"cannot show 'house .wall.'.*gain.spimtx"):
        DisplayView("house", "wall", str(path), "plain").check()


def test_the_default_view_is_known_without_opencolorio() -> None:
    program = "import sys; from lookdev.output.color import *; DisplayView().check(); DisplayView().digest; "
    program += "assert 'PyOpenColorIO' not in sys.modules"
    subprocess.run([sys.executable, "-c", program], check=True)
