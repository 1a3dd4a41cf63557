from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from lookdev.errors import EnvironmentMapError
from lookdev.ibl import EnvironmentMap, LightDistribution, Repairs, prepare_light, read_distribution
from lookdev.ibl.mapping import direction_to_uv, uv_to_direction
from lookdev.ibl.tables import build_distribution, lookup, sample_count

SUN = (2, 11)  # row, column


def environment(radiance: np.ndarray, digest: str = "test") -> EnvironmentMap:
    return EnvironmentMap("test", radiance.astype(np.float32), Repairs(), digest)


@pytest.fixture(scope="module")
def sunny() -> EnvironmentMap:
    """A dim sky with a sun of a thousand times its radiance."""
    radiance = np.random.default_rng(3).uniform(0.5, 1.5, (8, 16, 3))
    radiance[SUN] = (1200.0, 1000.0, 600.0)
    return environment(radiance)


@pytest.fixture(scope="module")
def light(sunny: EnvironmentMap) -> LightDistribution:
    return build_distribution(sunny)


@pytest.fixture(scope="module")
def overcast() -> LightDistribution:
    """A map bright at the poles, so that what happens there has samples enough to show."""
    radiance = np.random.default_rng(9).uniform(0.5, 1.5, (8, 16, 3))
    radiance[[0, -1]] *= 20.0
    return build_distribution(environment(radiance))


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("LOOKDEV_CACHE", str(tmp_path))
    return tmp_path / "ibl"


def draw(light: LightDistribution, count: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return light.sample(rng.integers(0, len(light.texels), count), rng.random((count, 2)))


def cell_centres(light: LightDistribution, per_texel: int) -> np.ndarray:
    """Centres (h, w, 2) in uv of cells that cut each texel evenly; row 0 at v near 1."""
    height, width = (size * per_texel for size in light.table.shape[:2])
    u, v = (np.arange(width) + 0.5) / width, 1.0 - (np.arange(height) + 0.5) / height
    return np.stack(np.meshgrid(u, v), axis=-1)


def test_lookup_by_hand() -> None:
    table = np.array([[[1.0], [2.0]], [[3.0], [5.0]]])
    cases = {
        (0.25, 0.75): 1.0,  # the centre of row 0, column 0
        (0.75, 0.25): 5.0,
        (0.5, 0.5): 11 / 4,  # between all four
        (0.0, 0.75): 1.5,  # the seam: half of the last column, half of the first
        (1.0, 0.75): 1.5,
        (0.25, 1.0): 1.0,  # clamped at the zenith
        (0.75, 0.0): 5.0,
        (0.375, 0.75): 1.25,
        (0.25, 0.625): 1.5,
        (1.25, 0.75): 1.0,  # u is periodic
    }
    np.testing.assert_allclose(lookup(table, list(cases))[:, 0], list(cases.values()), atol=1e-15)


def test_tables_hold_counts(light: LightDistribution, sunny: EnvironmentMap) -> None:
    counts = np.zeros((8, 16))
    np.add.at(counts, (light.texels[:, 1], light.texels[:, 0]), 1)
    np.testing.assert_array_equal(light.table[..., 3], counts * (8 * 16 / len(light.texels)))
    np.testing.assert_array_equal(light.table[..., :3], sunny.radiance)
    assert not light.is_constant


def test_texels_follow_the_filtered_light(light: LightDistribution) -> None:
    """Counts differ from the target by what the net allows, not by what chance would."""
    luminance = np.pad(light.table[..., :3] @ [0.2126, 0.7152, 0.0722], ((1, 1), (0, 0)), mode="edge")
    luminance = luminance[:-2] / 8 + luminance[1:-1] * 0.75 + luminance[2:] / 8
    luminance = np.roll(luminance, 1, 1) / 8 + luminance * 0.75 + np.roll(luminance, -1, 1) / 8
    target = luminance * np.sin(np.pi * (np.arange(8) + 0.5) / 8)[:, None]
    target *= len(light.texels) / target.sum()
    counts = light.table[..., 3] * len(light.texels) / 128
    # A row is one interval of a stratified coordinate: each of its ends can split one stratum.
    assert np.abs(counts.sum(axis=1) - target.sum(axis=1)).max() < 2.0
    # A texel is a rectangle: four corners of a (0, m, 2)-net, each within m/2 + 3/2 points (Niederreiter).
    assert np.abs(counts - target).max() < 4 * (16 / 2 + 1.5)
    assert counts[SUN[0] + 1, SUN[1]] > 100 * counts[SUN[0] + 3, SUN[1]]  # the dark neighbour gets its share


def test_aligned_blocks_are_stratified(light: LightDistribution) -> None:
    """Every aligned block meets the sun's row in proportion; random entries would miss by 8 and more."""
    share = (light.texels[:, 1] == SUN[0]).mean()
    for size in (16, 256, 4096):
        hits = (light.texels[:, 1] == SUN[0]).reshape(-1, size).sum(axis=1)
        assert np.abs(hits - share * size).max() <= 2.0


def test_density_integrates_to_one(light: LightDistribution) -> None:
    per_texel = 32
    uv = cell_centres(light, per_texel)
    height, width = uv.shape[:2]
    edge = np.cos(np.pi * np.arange(height + 1) / height)
    solid_angle = (edge[:-1] - edge[1:]) * 2 * np.pi / width
    np.testing.assert_allclose(4 * np.pi, solid_angle.sum() * width)
    total = (light.pdf(uv_to_direction(uv)) * solid_angle[:, None]).sum()
    # The midpoint rule on 1/cos(latitude): (step of latitude)^2 / 24, step pi/256, below 1e-5.
    np.testing.assert_allclose(total, 1.0, atol=1e-5)


@pytest.mark.parametrize("name", ["light", "overcast"])
def test_samples_follow_the_density(request: pytest.FixtureRequest, name: str) -> None:
    """Chi-square over quarter texels, where the density over uv is bilinear: its centre value is its mean."""
    light: LightDistribution = request.getfixturevalue(name)
    per_texel, count = 4, 400_000
    uv = cell_centres(light, per_texel)
    height, width = uv.shape[:2]
    jacobian = 2 * np.pi**2 * np.sin(np.pi * uv[..., 1])
    expected = (light.pdf(uv_to_direction(uv)) * jacobian).ravel() * count / (width * height)
    drawn = direction_to_uv(draw(light, count, seed=4))
    column = np.minimum((drawn[:, 0] * width).astype(int), width - 1)
    row = np.minimum(((1.0 - drawn[:, 1]) * height).astype(int), height - 1)
    observed = np.bincount(row * width + column, minlength=width * height)
    assert expected.sum() == pytest.approx(count)
    rare = expected < 10.0  # pooled, as the test's approximation wants
    observed = np.append(observed[~rare], observed[rare].sum())
    expected = np.append(expected[~rare], expected[rare].sum())
    statistic = ((observed - expected) ** 2 / np.maximum(expected, 1.0)).sum()
    assert len(expected) > 100
    assert stats.chi2.sf(statistic, len(expected) - 1) > 1e-3


def test_irradiance_by_light_and_by_uniform_sampling(light: LightDistribution) -> None:
    normal = np.array([0.0, 0.6, 0.8])
    directions = draw(light, 200_000, seed=5)
    uniform = np.random.default_rng(6).normal(size=(400_000, 3))
    uniform /= np.linalg.norm(uniform, axis=-1, keepdims=True)

    def estimate(wi: np.ndarray, pdf: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        value = light.radiance(wi) * np.maximum(wi @ normal, 0.0)[:, None] / pdf[:, None]
        return value.mean(axis=0), value.var(axis=0) / len(value)

    by_light, light_variance = estimate(directions, light.pdf(directions))
    by_chance, chance_variance = estimate(uniform, np.full(len(uniform), 0.25 / np.pi))
    assert (np.abs(by_light - by_chance) < 4.0 * np.sqrt(light_variance + chance_variance)).all()


def test_poles_and_seam(light: LightDistribution) -> None:
    poles = np.array([[0, 0, 1.0], [0, 0, -1.0]])
    assert np.isfinite(light.pdf(poles)).all()
    assert np.isfinite(light.radiance(poles)).all()
    # Tents over the first and last column, and the first and last row, stay on the sphere and in both halves.
    corner = LightDistribution(light.table, np.array([[0, 0], [15, 7]]))
    grid = (np.arange(64) + 0.5) / 64
    u = np.stack(np.meshgrid(grid, grid), axis=-1)
    for entry in (0, 1):
        direction = corner.sample(np.full(u.shape[:2], entry), u)
        np.testing.assert_allclose(np.linalg.norm(direction, axis=-1), 1.0, rtol=1e-14)
        uv = direction_to_uv(direction)
        texels_from_pole = 8 * np.minimum(uv[..., 1], 1 - uv[..., 1])
        assert texels_from_pole.max() <= 1.5
        assert {True, False} == set((uv[..., 0] < 0.5).ravel().tolist())


def test_black_map_is_sampled_evenly() -> None:
    light = build_distribution(environment(np.zeros((32, 64, 3))))
    assert light.is_constant
    z = np.linspace(-0.9, 0.9, 101)
    direction = np.stack([np.sqrt(1 - z**2), np.zeros_like(z), z], axis=-1)
    # Counts are whole: about 20 to 50 a texel here, each off by a few, and bilinear in between.
    np.testing.assert_allclose(light.pdf(direction), 0.25 / np.pi, rtol=0.15)


@pytest.mark.parametrize("shape", [(1, 1), (1, 2), (2, 1), (3, 7)])
def test_smallest_maps(shape: tuple[int, int]) -> None:
    light = build_distribution(environment(np.random.default_rng(7).random((*shape, 3)) + 0.1))
    np.testing.assert_allclose(light.table[..., 3].mean(), 1.0, rtol=1e-6)
    direction = draw(light, 1000, seed=8)
    assert (light.pdf(direction) > 0.0).all()


def test_sample_count() -> None:
    assert [sample_count(64, 32), sample_count(1024, 512), sample_count(2048, 1024)] == [2**16, 2**18, 2**20]
    assert [sample_count(1000, 500), sample_count(16384, 8192)] == [2**18, 2**22]


def test_files_hold_the_distribution(cache: Path, sunny: EnvironmentMap, light: LightDistribution) -> None:
    tables = prepare_light(sunny)
    assert (tables.width, tables.height, tables.sample_count) == (16, 8, 2**16)
    assert sorted(cache.iterdir()) == sorted([tables.radiance, tables.samples])
    read = read_distribution(tables)
    np.testing.assert_array_equal(read.table, light.table)
    np.testing.assert_array_equal(read.texels, light.texels)


def test_cache_is_idempotent(cache: Path, sunny: EnvironmentMap) -> None:
    tables = prepare_light(sunny)
    content = [path.read_bytes() for path in (tables.radiance, tables.samples)]
    stamps = [path.stat().st_mtime_ns for path in (tables.radiance, tables.samples)]
    assert prepare_light(sunny) == tables
    assert stamps == [path.stat().st_mtime_ns for path in (tables.radiance, tables.samples)]
    tables.samples.unlink()
    assert prepare_light(sunny) == tables
    assert content == [path.read_bytes() for path in (tables.radiance, tables.samples)]
    other = prepare_light(dataclasses.replace(sunny, digest="other"))
    assert other.digest != tables.digest


def test_broken_files_are_told(cache: Path, sunny: EnvironmentMap, monkeypatch: pytest.MonkeyPatch) -> None:
    tables = prepare_light(sunny)
    tables.samples.write_bytes(tables.samples.read_bytes()[:-30])
    with pytest.raises(EnvironmentMapError, match="remove it"):
        read_distribution(tables)
    tables.radiance.unlink()
    tables.radiance.mkdir()  # a place where no file can be put
    with pytest.raises(EnvironmentMapError, match="cannot write"):
        prepare_light(sunny)
