"""Images of domes: mirrored balls and angular maps as lat-long maps, formats by file and aspect."""

from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from light_cases import Floats, cells, write_exr
from rig_files import light, rig, write_image

from lookdev.arrays import Floats32
from lookdev.errors import RigError
from lookdev.light import make_environment
from lookdev.light.rig.images import BALLS, ball_point, ball_power, load_light_image, unroll_ball

SIDE = 128
TO_DOME = (1, 2, 0)
"""The indices of a dome's x, y and z in its map's axes."""


def sky(direction: Floats) -> Floats:
    """Return a smooth radiance (..., 3) towards directions of a dome whose pole is +y."""
    x, y, z = np.moveaxis(direction, -1, 0)
    return np.stack([1.5 + x, 1.5 + y, 1.5 + z * z], axis=-1)


def ball(kind: str) -> Floats32:
    """Return an image of a ball that shows the sky, black beyond the rim."""
    middle = (np.arange(SIDE) + 0.5) * 2.0 / SIDE - 1.0
    x, y = np.meshgrid(middle, -middle)
    radius = np.minimum(np.hypot(x, y), 1.0)
    angle = np.pi * radius if kind == "angular" else 2.0 * np.arcsin(radius)
    scale = np.sin(angle) / np.where(radius > 0.0, radius, 1.0)
    radiance = sky(np.stack([scale * x, scale * y, np.cos(angle)], axis=-1))
    return np.where((np.hypot(x, y) <= 1.0)[..., None], radiance, 0.0).astype(np.float32)


@pytest.mark.parametrize("kind", BALLS)
def test_a_ball_shows_the_same_as_a_lat_long_map(kind: str) -> None:
    converted, power_error = unroll_ball(make_environment("ball", ball(kind)), kind)
    towards, solid = cells(SIDE)
    expected = sky(towards[..., TO_DOME])
    error = np.abs(converted.radiance - expected).max(axis=-1) / expected.max(axis=-1)
    # Look-ups within 3 texels of the ball's rim would read texels beyond it; they are moved inside.
    rim = 1.0 - 3.0 * 2.0 / SIDE
    sky_cosine = np.cos(np.pi * rim if kind == "angular" else 2.0 * np.arcsin(rim))
    assert error[towards[..., 0] > sky_cosine].max() < 0.01
    # The sky changes by at most the distance of two directions, and its largest channel is at least 2.
    assert error.max() < np.sqrt(2.0 + 2.0 * sky_cosine) / 2.0
    power = (expected.mean(axis=-1) * solid).sum()
    assert ball_power(ball(kind), kind) == pytest.approx(power, rel=2e-3)
    assert power_error < 5e-3


@pytest.mark.parametrize("kind", BALLS)
def test_texels_beyond_the_rim_of_a_ball_are_not_met(kind: str) -> None:
    middle = (np.arange(16) + 0.5) / 8.0 - 1.0
    beyond = np.hypot(middle, middle[:, None]) > 1.0
    pixels = np.repeat(np.where(beyond, 100.0, 1.0)[..., None], 3, axis=-1).astype(np.float32)
    converted, _ = unroll_ball(make_environment("ball", pixels), kind)
    assert converted.radiance == pytest.approx(np.ones((16, 32, 3)))


def test_the_mean_of_a_map_is_over_the_sphere(tmp_path: Path) -> None:
    rows = np.arange(8.0)
    pixels = np.broadcast_to(rows[:, None, None], (8, 16, 3)).astype(np.float32)
    image = load_light_image(write_image(tmp_path / "sky.exr", pixels), "", "latlong")
    height = np.cos(np.pi * np.arange(9) / 8)
    assert image.mean == pytest.approx([(rows * (height[:-1] - height[1:])).sum() / 2.0] * 3)


@pytest.mark.parametrize("kind", BALLS)
def test_a_ball_is_the_inverse_of_its_formula(kind: str) -> None:
    axes = np.array([(0, 0, 1), (1, 0, 0), (0, 1, 0), (-1, 0, 0), (1e-9, 0, -1)], np.float64)
    side = 0.5 if kind == "angular" else np.sqrt(0.5)
    expected = np.array([(0, 0), (side, 0), (0, side), (-side, 0), (1, 0)])
    assert ball_point(axes, kind) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("kind", BALLS)
def test_a_dome_with_a_ball_is_seen_as_with_its_map(tmp_path: Path, kind: str) -> None:
    write_image(tmp_path / "ball.exr", ball(kind))
    image = f'asset inputs:texture:file = @ball.exr@; token inputs:texture:format = "{kind}"'
    of_ball = rig(tmp_path, light("DomeLight", image), 'upAxis = "Y"')
    # The result has z up: the pole, +y of the stage, is +z.
    towards = np.array([(1, 0, 0), (-0.6, 0.8, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)], np.float64)
    stage = np.stack([towards[:, 0], towards[:, 2], -towards[:, 1]], axis=-1)
    assert of_ball.lights[0].radiance(np.zeros(3), towards) == pytest.approx(sky(stage), rel=0.02)
    assert "converted from a ball to a lat-long map of 256 x 128; its power is off by 0." in of_ball.notes[0]


@pytest.mark.parametrize(
    ("size", "stated", "fault"),
    [
        ((8, 16), "automatic", None),
        ((8, 9), "latlong", None),
        ((8, 8), "automatic", "is 8 x 8 pixels large, and states no format"),
        ((8, 6), "automatic", "is a cube map, of format cubeMapVerticalCross"),
        ((8, 16), "cubeMapVerticalCross", "is a cube map, of format cubeMapVerticalCross"),
        ((8, 16), "angular", "is 16 x 8 pixels large; of format angular, it is a square"),
        ((8, 16), "latlon", "is 'latlon' (did you mean 'latlong'?)"),
    ],
)
def test_a_format_is_stated_or_seen_by_the_aspect(
    tmp_path: Path, size: tuple[int, int], stated: str, fault: str | None
) -> None:
    write_image(tmp_path / "sky.exr", np.random.default_rng(1).random((*size, 3)).astype(np.float32))
    text = light("DomeLight_1", f'asset inputs:texture:file = @sky.exr@; token inputs:texture:format = "{stated}"')
    if fault is None:
        assert rig(tmp_path, text).lights[0].width == size[1]  # type: ignore[attr-defined]
    else:
        with pytest.raises(RigError) as raised:
            rig(tmp_path, text)
        assert fault in str(raised.value)


@pytest.mark.parametrize(("number", "fits"), [(0, True), (1, False)])
def test_an_exr_that_states_its_format_is_believed(tmp_path: Path, number: int, fits: bool) -> None:
    pixels = np.random.default_rng(2).random((8, 8, 3)).astype(np.float32)
    header = {"type": OpenEXR.scanlineimage, "envmap": OpenEXR.Envmap(number)}
    write_exr(tmp_path / "sky.exr", header, RGB=pixels)
    text = light("DomeLight_1", "asset inputs:texture:file = @sky.exr@")
    if fits:
        assert rig(tmp_path, text).lights[0].width == 8  # type: ignore[attr-defined]
    else:
        with pytest.raises(RigError, match="is a cube map"):
            rig(tmp_path, text)
