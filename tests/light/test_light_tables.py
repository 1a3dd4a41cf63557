import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from light_cases import SUN, Floats, assert_follows, cells, dome, make_tables_small, overcast, sunny
from looks import quick_among

from lookdev.arrays import Floats32, Ints, Ints32
from lookdev.cache import Content
from lookdev.errors import ContentError
from lookdev.light import Dome, make_environment, prepare_light
from lookdev.light.dome import bins, points, slots
from lookdev.light.dome.environment import read_exr
from lookdev.light.dome.points import draw_points, hilbert_positions
from lookdev.light.dome.slots import MOST_POINTS, SLOTS, cut_slots, pack_ranges
from lookdev.light.dome.warp import BilinearWarp, lookup
from lookdev.light.mapping import direction_to_uv, uv_to_direction

EACH = 11
SEVERAL = [(number,) for number in range(len(bins.AXES[::EACH]))]


@dataclasses.dataclass(frozen=True)
class Tables:
    """The content of a light's files, and the directions of its points."""

    light: Dome
    points: Floats32
    towards: Floats
    slots: Ints32
    numbers: Floats32
    axes: Floats
    """The axes of the bins."""

    @property
    def inverse(self) -> Floats32:
        """One over the integral of each bin."""
        return self.numbers[:, 0]


def drawn(light: Dome, side: int) -> tuple[Floats32, Floats]:
    return draw_points(light.table, BilinearWarp(light.table.mean(axis=-1)), side)


def tables_of(light: Dome, side: int) -> Tables:
    pixels, towards = drawn(light, side)
    cut = cut_slots(towards, BilinearWarp(light.table.mean(axis=-1)).integral)
    return Tables(light, pixels, towards, *cut, bins.AXES)


def decoded(points: Floats32) -> tuple[Floats, Floats, Floats]:
    """Return directions (..., 3), means (...) and radiance (..., 3) of points."""
    azimuth, z, mean, code = np.moveaxis(points.astype(np.float64), -1, 0)
    horizontal = np.sqrt(1.0 - z * z)
    red, green = code // 4096.0, code % 4096.0
    share = np.stack([red, green, np.maximum(4095.0 - red - green, 0.0)], axis=-1) / 4095.0
    towards = np.stack([horizontal * np.cos(azimuth), horizontal * np.sin(azimuth), z], axis=-1)
    return towards, mean, 3.0 * mean[..., None] * share


def unpacked(slots: Ints32) -> tuple[Ints, Ints, Ints]:
    """Return first points, counts of points and counts of equal slots, as `light_sample` does; 0, 0, 0 if empty."""
    first, code = (column.astype(np.int64) for column in ((slots >> 12) & 0xFFFFF, slots & 4095))
    lone = code > MOST_POINTS
    return first, np.where(lone, 1, code), np.where(lone, code - MOST_POINTS + 1, np.minimum(code, 1))


def by_the_shader(tables: Tables, number: int) -> tuple[Floats, Floats]:
    """Return the probability (N,) of each point in one bin's slots, and the shader's q / p."""
    first, count, times = unpacked(tables.slots[number])
    ends = np.cumsum(count)
    position = np.repeat(first, count) + np.arange(ends[-1]) - np.repeat(ends - count, count)
    share = 1.0 / (len(first) * np.maximum(count, 1))
    probability = np.bincount(position, np.repeat(share, count), len(tables.towards))
    factor = np.zeros(len(tables.towards))
    factor[position] = np.repeat(tables.numbers[number, 1] * count / np.maximum(times, 1), count)
    return probability, factor * bins.widened_cosine(tables.towards @ tables.axes[number])


@pytest.fixture(scope="module")
def of_sunny() -> Tables:
    """Return tables of all points for every eleventh bin; to cut all bins takes seconds."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bins, "AXES", bins.AXES[::EACH])
        patch.setattr(bins, "COUNT", len(bins.AXES))
        return tables_of(sunny(), points.SIDE)


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    make_tables_small(monkeypatch)


@pytest.fixture
def cache(few: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("LOOKDEV_CACHE", str(tmp_path))
    return tmp_path / "content"


def files_of(light: Dome) -> list[Content]:
    return [file for file in (light.radiance_file, light.points_file, light.slots_file, light.bins_file) if file]


@pytest.mark.parametrize("light", [sunny, overcast])
def test_points_follow_the_light(light: Callable[[], Dome]) -> None:
    pixels, towards = drawn(light(), 512)
    assert pixels.shape == (512 * 512, 4)
    assert_follows(towards, light().pdf(np.zeros(3), cells(512)[0]))
    np.testing.assert_allclose(pixels[:, 1], towards[:, 2], atol=1e-7)
    # Near the poles the cosine determines an angle only to (2^-23)^1/2.
    np.testing.assert_allclose(decoded(pixels)[0], towards, atol=4e-4)


def test_points_are_one_in_each_cell_along_the_curve() -> None:
    """For a constant light, map coordinates are a simple function of the random numbers."""
    side = 128
    u, v = direction_to_uv(drawn(dome(np.ones((1, 1, 3))), side)[1]).T
    # A row begins at the centre of its first texel; here that is the middle of the map.
    square = np.stack([(u - 0.5) % 1.0, 0.5 - 0.5 * np.cos(np.pi * (1.0 - v))], axis=-1)
    position = hilbert_positions(np.floor(square * side).astype(np.int64), side)
    np.testing.assert_array_equal(position, np.arange(side * side))


def test_points_hold_the_light_where_they_are() -> None:
    light = sunny()
    pixels, _ = drawn(light, 256)
    _, mean, radiance = decoded(pixels)
    # Computed from the azimuth, because in float32 the direction has no azimuth at the pole.
    azimuth, z = pixels[:, :2].astype(np.float64).T
    expected = lookup(light.table, np.stack([0.5 - azimuth / (2.0 * np.pi), 1.0 - np.arccos(z) / np.pi], axis=-1))
    # The look-up rises to the sun by 50 over a texel, and coordinates are float32.
    np.testing.assert_allclose(mean, expected.mean(axis=-1), rtol=1e-5, atol=1e-4)
    # Two channels are each rounded by half a step, 1/4095 of three times the mean; the third has the remainder.
    assert (np.abs(radiance - expected) <= 3.0 * mean[:, None] / 4095.0 + 1e-4).all()
    assert (mean > 0.0).all()


@pytest.mark.parametrize("channel", range(3))
def test_colours_of_one_channel(channel: int) -> None:
    """The two integers are 0 or the largest: the largest code is exact in float32."""
    radiance = np.zeros((4, 8, 3))
    radiance[..., channel] = 7.0
    _, _, got = decoded(drawn(dome(radiance), 4)[0])
    np.testing.assert_allclose(got, np.broadcast_to(radiance[0, 0], (16, 3)), rtol=1e-6)


@pytest.mark.parametrize("number", quick_among(SEVERAL, SEVERAL[::4]))
def test_slots_are_drawn_as_their_bin_weighs(of_sunny: Tables, number: int) -> None:
    axis, scale = of_sunny.axes[number], of_sunny.inverse[number]
    probability, ratio = by_the_shader(of_sunny, number)
    assert probability.sum() == pytest.approx(1.0, rel=1e-12)
    seen = bins.widened_cosine(of_sunny.towards @ axis)
    # Cosines in float32 are off by 2^-24, and so are their limits.
    assert (probability[seen > 1e-6] > 0.0).all()
    # 1 in exact arithmetic.
    assert (probability * ratio).sum() == pytest.approx(1.0, abs=1e-6)
    # What is left to the ratio: found to be 0.06 at most, mostly of points that are drawn in vain.
    assert (probability * (ratio - 1.0) ** 2).sum() < 0.1
    # With these weights the points are a quadrature with the density of multiple importance sampling.
    height = 512
    towards, solid = cells(height)
    density = of_sunny.light.radiance(np.zeros(3), towards).mean(axis=-1) * bins.widened_cosine(towards @ axis) * scale
    # The error of 2^20 stratified points, and that of the midpoint rule.
    assert (density * solid).sum() == pytest.approx(1.0, abs=1e-4)
    expected = (density * solid).reshape(8, height // 8, 16, height // 8).sum(axis=(1, 3)).ravel()
    u, v = direction_to_uv(of_sunny.towards).T
    cell = 16 * np.minimum((1.0 - v) * 8, 7).astype(int) + np.minimum(u * 16, 15).astype(int)
    # Hundreds of points near a cell's border, each of some 1e-6, are random.
    np.testing.assert_allclose(np.bincount(cell, probability * ratio, 128), expected, atol=1e-4)


def test_irradiance_of_a_constant_light_is_pi() -> None:
    """A furnace loses no energy, whatever the resolution of the map."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bins, "AXES", bins.AXES[[0, 5, 40, 100]])
        patch.setattr(bins, "COUNT", 4)
        white = tables_of(dome(np.ones((4, 8, 3))), points.SIDE)
        for number, axis in enumerate(bins.AXES):
            probability, ratio = by_the_shader(white, number)
            seen, weight = np.maximum(white.towards @ axis, 0.0), bins.widened_cosine(white.towards @ axis)
            mean = white.points[:, 2].astype(np.float64)
            density = np.where(seen > 0.0, mean * weight * white.inverse[number], 1.0)
            assert (probability * ratio * seen / density).sum() == pytest.approx(np.pi, rel=1e-4)


def test_every_bin_of_a_lit_sky_has_slots() -> None:
    tables = tables_of(sunny(), 256)
    assert tables.slots.shape == (bins.COUNT + 1, SLOTS)
    assert tables.numbers.shape == (bins.COUNT + 1, 2)
    assert (tables.numbers > 0.0).all()
    assert tables.slots.all()


def test_slots_are_unpacked_as_they_were_packed() -> None:
    last = 2**20
    first, count, times = np.array([[0, 1, 1], [1, MOST_POINTS, 1], [5000, 1, 2], [5000, 1, 2], [last - 1, 1, 1]]).T
    unpack = unpacked(pack_ranges(first, count, times))
    for got, expected in zip(unpack, (first, count, times), strict=True):
        np.testing.assert_array_equal(got, expected)


def test_a_point_of_more_slots_than_there_are_codes_leaves_some_empty() -> None:
    first, count, times = unpacked(pack_ranges(np.full(SLOTS, 7), np.ones(SLOTS, np.int64), np.full(SLOTS, SLOTS)))
    not_empty = count > 0
    assert (first[not_empty] == 7).all()
    assert (times[not_empty] == not_empty.sum()).all()
    assert 500 < not_empty.sum() < SLOTS


def test_bins_that_see_no_light(monkeypatch: pytest.MonkeyPatch) -> None:
    """A map with one bright texel: bins that face it draw points around it; other bins have no weight."""
    monkeypatch.setattr(slots, "SLOTS", 64)
    radiance = np.zeros((8, 16, 3))
    radiance[SUN] = 1e6, 1e5, 1e6
    lone = tables_of(dome(radiance), 64)
    for values in (lone.points, lone.numbers):
        assert np.isfinite(values).all()
    u, v = direction_to_uv(lone.towards).T
    assert (np.abs(u * 16 - SUN[1] - 0.5) < 1.0 + 1e-5).all()
    assert (np.abs((1.0 - v) * 8 - SUN[0] - 0.5) < 1.0 + 1e-5).all()
    assert (lone.points[:, 2] > 0.0).all()
    sun = uv_to_direction([(SUN[1] + 0.5) / 16, 1.0 - (SUN[0] + 0.5) / 8])
    # The sun's texel and those about it reach 32 degrees far along the diagonal.
    angle, far = np.degrees(np.arccos(bins.AXES @ sun)), np.degrees(bins.RADIUS)
    sees_light, sees_none = angle < 90.0, angle > 90.0 + far + 32.0
    assert sees_light.sum() > 50
    assert sees_none.sum() > 10
    assert not lone.slots[:-1][sees_none].any()
    assert not lone.numbers[:-1][sees_none].any()
    assert (lone.numbers[:-1][sees_light] > 0.0).all()
    for number in np.flatnonzero(sees_light):
        probability, ratio = by_the_shader(lone, number)
        assert (probability * ratio).sum() == pytest.approx(1.0, abs=1e-6)


def test_points_of_a_black_map_are_black(few: None) -> None:
    black = tables_of(dome(np.zeros((8, 16, 3))), 32)
    assert not black.points[:, 2:].any()
    for values in (black.points, black.numbers):
        assert np.isfinite(values).all()


@pytest.mark.parametrize("shape", [(1, 1), (1, 2), (2, 1), (3, 7)])
def test_smallest_maps(few: None, shape: tuple[int, int]) -> None:
    radiance = np.random.default_rng(7).random((*shape, 3)) + 0.1
    small = tables_of(dome(radiance), 32)
    towards, mean, _ = decoded(small.points)
    np.testing.assert_allclose(mean, small.light.radiance(np.zeros(3), towards).mean(axis=-1), rtol=1e-4)
    # A widened hemisphere has an integral of the cosine between pi and 2 pi.
    assert (1.0 / small.inverse[:4] > np.pi * radiance.mean(axis=-1).min()).all()
    assert (1.0 / small.inverse[:4] < 2.0 * np.pi * radiance.mean(axis=-1).max()).all()
    # With 16 points a bin has more slots than points.
    for tables in (small, tables_of(small.light, 4)):
        for number in range(4):
            probability, ratio = by_the_shader(tables, number)
            assert (probability * ratio).sum() == pytest.approx(1.0, abs=1e-6)


def test_files_hold_the_tables(cache: Path) -> None:
    light = prepare_light(make_environment("test", sunny().table))
    assert (light.width, light.height, light.constant) == (16, 8, False)
    assert {Content.store_copy(file) for file in cache.iterdir()} == set(files_of(light))
    expected = tables_of(sunny(), 32)
    np.testing.assert_array_equal(read_exr(light.points_file.path, "RGBA").reshape(-1, 4), expected.points)
    with OpenEXR.File(str(light.points_file.path)) as stored_points:
        assert stored_points.header()["compression"] == OpenEXR.NO_COMPRESSION  # the renderer would wait for it
    for file, values in ((light.slots_file, expected.slots), (light.bins_file, expected.numbers)):
        stored = np.load(file.path)
        assert stored.dtype == values.dtype
        np.testing.assert_array_equal(stored, values)


@pytest.mark.parametrize(("level", "sampled"), [(0.5, True), (2.0, False)])
def test_what_draws_no_samples_has_no_tables(cache: Path, level: float, sampled: bool) -> None:
    """No tables are made for a constant light, nor without `sampled`."""
    radiance = np.full((8, 16, 3), 0.5)
    radiance[0] = level
    light = prepare_light(make_environment("test", radiance), sampled=sampled)
    assert light.constant == sampled
    assert [Content.store_copy(file) for file in cache.iterdir()] == [light.radiance_file] == files_of(light)


def test_cache_is_idempotent(cache: Path) -> None:
    asked = make_environment("test", sunny().table)
    light = prepare_light(asked)
    files = sorted(cache.iterdir())
    content = [path.read_bytes() for path in files]
    stamps = [path.stat().st_mtime_ns for path in files]
    assert prepare_light(asked) == light
    assert stamps == [path.stat().st_mtime_ns for path in files]
    for missing in files:
        missing.unlink()
        assert prepare_light(asked) == light
        assert content == [path.read_bytes() for path in files]
    assert prepare_light(dataclasses.replace(asked, digest="other")).digest != light.digest


def test_broken_files_are_reported(cache: Path) -> None:
    asked = make_environment("test", sunny().table)
    light = prepare_light(asked)
    light.radiance_file.path.write_bytes(light.radiance_file.path.read_bytes()[:-30])
    with pytest.raises(ContentError, match="if it was damaged"):
        light.radiance(np.zeros(3), np.array([0.0, 0.0, 1.0]))
    assert prepare_light(asked) == light
    assert light.radiance(np.zeros(3), np.array([0.0, 0.0, 1.0])).max() > 0.0
