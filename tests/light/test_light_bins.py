import numpy as np
import pytest

from lookdev.arrays import Floats
from lookdev.light import Dome
from lookdev.light.dome import bins


@pytest.fixture(scope="module")
def normals() -> Floats:
    """Normals of every bin, (COUNT, n, 3): inside, on its borders and in its corners."""
    rng = np.random.default_rng(1)
    position = rng.random((300, 2))
    position[:100, 0] = position[:100, 0] > 0.5
    position[50:150, 1] = position[50:150, 1] > 0.5
    row = np.repeat(np.arange(bins.ROWS), bins.CELLS)
    cell = np.concatenate([np.arange(cells) for cells in bins.CELLS])
    theta = np.pi * (row[:, None] + position[:, 0]) / bins.ROWS
    phi = 2.0 * np.pi * (cell[:, None] + position[:, 1]) / np.array(bins.CELLS)[row][:, None]
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)


def test_shaders_have_the_sizes_of_the_tables() -> None:
    lines = dict(line.removeprefix("#define DOME_").split(" ", 1) for line in Dome.table_constants())
    assert lines.pop("CELLS") == "{3, 9, 14, 17, 19, 19, 17, 14, 9, 3}"  # rows are 18 degrees high, cells about as wide
    assert lines.pop("FIRST") == "{0, 3, 12, 26, 43, 62, 81, 98, 112, 121}"
    numbers = {name: float(value) for name, value in lines.items()}
    # There is one bin more, for no normal. A slot is the highest 12 of the 32 bits of a number.
    expected = {"ROWS": 10, "ALL": 124, "SLOTS": 4096, "ALL_SLOTS": 125 * 4096, "BIN_NUMBERS": 250, "SLOTS_SHIFT": 20}
    expected |= {"CODE_BITS": 12, "MOST_POINTS": 3583}
    expected |= {"COS_RADIUS": np.cos(bins.RADIUS), "SIN_RADIUS": np.sin(bins.RADIUS)}
    assert numbers == pytest.approx(expected, rel=1e-12)


def test_cones_hold_their_bins_and_little_more(normals: Floats) -> None:
    np.testing.assert_allclose(np.linalg.norm(bins.AXES, axis=-1), 1.0, rtol=1e-14)
    angle = np.arccos(np.clip(np.einsum("bni,bi->bn", normals, bins.AXES), -1.0, 1.0))
    # The shader's arc tangents may assign a normal to a bin although it is 1e-5 outside.
    assert angle.max() < bins.RADIUS - 5e-4
    assert angle.max() > bins.RADIUS - 2e-3
    # All bins have about the same size, so that the largest cone is not much too wide for any of them.
    assert angle.max(axis=1).min() > 0.7 * bins.RADIUS


def test_no_normal_sees_what_its_bin_does_not(normals: Floats) -> None:
    wi = np.random.default_rng(2).normal(size=(500, 3))
    # Directions near each horizon are included, where the margin is least.
    wi = np.concatenate([wi, np.cross(wi, normals[:, -1][np.arange(500) % bins.COUNT])])
    wi /= np.linalg.norm(wi, axis=-1, keepdims=True)
    for axis, of_bin in zip(bins.AXES, normals, strict=True):
        weight = bins.widened_cosine(wi @ axis)
        assert (weight[:, None] >= wi @ of_bin.T).all()
        assert (weight >= 0.0).all()


def test_widened_is_the_cosine_to_the_nearest_normal_of_the_cone() -> None:
    angle = np.linspace(0.0, np.pi, 2001)
    expected = np.clip(np.cos(np.maximum(angle - bins.RADIUS, 0.0)), 0.0, 1.0)
    np.testing.assert_allclose(bins.widened_cosine(np.cos(angle)), expected, atol=1e-12)
    # A rounded cosine may exceed 1.
    assert bins.widened_cosine(np.array([1.0 + 1e-15, -1.0 - 1e-15])).tolist() == [1.0, 0.0]
