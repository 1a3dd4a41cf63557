"""Dome lights, cells of the sphere, and the chi-square test of directions against a density."""

from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from sample_density import p_value

from lookdev.arrays import Floats
from lookdev.light import Dome, make_environment, prepare_light
from lookdev.light.dome import bins, points, slots
from lookdev.light.mapping import direction_to_uv, uv_to_direction

SUN = (2, 11)  # row, column


def make_tables_small(patch: pytest.MonkeyPatch) -> None:
    """Reduce the tables of a dome to four bins with 64 slots each, and 32 x 32 points."""
    for module, name, value in ((slots, "SLOTS", 64), (points, "SIDE", 32), (bins, "COUNT", 4)):
        patch.setattr(module, name, value)


def write_exr(file: Path, header: dict[str, object] | None = None, **channels: np.ndarray) -> Path:
    with OpenEXR.File(header or {}, channels) as exr:
        exr.write(str(file))
    return file


def dome(radiance: Floats) -> Dome:
    """Return a dome light without the tables of the shader."""
    return prepare_light(make_environment("test", radiance), sampled=False)


def sunny() -> Dome:
    """Return a dim sky with a sun of fifty times its radiance, and one texel that is black."""
    radiance = np.random.default_rng(3).uniform(0.5, 1.5, (8, 16, 3))
    radiance[SUN] = (60.0, 50.0, 30.0)
    radiance[4, 3] = 0.0
    return dome(radiance)


def overcast() -> Dome:
    """Return a sky with bright poles, where enough samples fall to show a fault."""
    radiance = np.random.default_rng(9).uniform(0.5, 1.5, (8, 16, 3))
    radiance[[0, -1]] *= 20.0
    return dome(radiance)


def cells(height: int) -> tuple[Floats, Floats]:
    """Return the central directions (h, 2 h, 3) of lat-long cells, row 0 at the zenith, and solid angles (h, 1)."""
    u, v = np.meshgrid((np.arange(2 * height) + 0.5) / (2 * height), 1.0 - (np.arange(height) + 0.5) / height)
    edge = np.cos(np.pi * np.arange(height + 1) / height)
    solid = (edge[:-1] - edge[1:])[:, None] * np.pi / height
    return uv_to_direction(np.stack([u, v], axis=-1)), solid


def assert_follows(towards: Floats, density: Floats) -> None:
    """Test directions (n, 3) by chi-square, in 32 x 16 cells, against a density at the centres of `cells`."""
    height = len(density)
    mass = (density * cells(height)[1]).reshape(16, height // 16, 32, height // 16).sum(axis=(1, 3)).ravel()
    expected = mass * len(towards)
    u, v = direction_to_uv(towards).T
    row, column = np.minimum((1.0 - v) * 16, 15).astype(int), np.minimum(u * 32, 31).astype(int)
    observed = np.bincount(32 * row + column, minlength=512)
    assert expected.sum() == pytest.approx(len(towards), rel=1e-3)
    assert np.count_nonzero(expected >= 10.0) > 20
    assert p_value(observed, expected, fewest=10.0) > 1e-3
