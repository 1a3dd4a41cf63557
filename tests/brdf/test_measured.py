"""Measured reflectance: look-up, files and their faults, files of known models, and sampling.

Files are small, with tables of few cells and views; in the tier ``proof`` they are as large as MERL's.
"""

from collections.abc import Callable, Mapping
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from looks import quick_among
from merl_reader import anisotropic, merl
from random_parameters import Floats, directions, near_the_mirror_image
from sample_density import jacobian, p_value

from lookdev.brdf import Bsdf, complete_parameters, evaluate, evaluate_cosine, model_named, pdf, sample
from lookdev.brdf.lobes import DirectionPair
from lookdev.brdf.measured import files, proposal, synthetic
from lookdev.brdf.measured.files import MERL_SIZE, read_grid, write_anisotropic, write_merl
from lookdev.brdf.measured.grids import AnisotropicGrid, IsotropicGrid
from lookdev.brdf.measured.synthetic import anisotropic_samples, isotropic_samples, write_synthetic
from lookdev.brdf.quadrature import half_vector_grid
from lookdev.closures.setups import view_at
from lookdev.errors import ModelError

SMALL, SIZE = (9, 8, 12), (7, 5, 12, 8)
BUILT_IN = "builtin:plastic"
# Parameters of Disney's model, one file each; all but the last are isotropic.
MODELS: dict[str, Mapping[str, Any]] = {
    "plastic": {"baseColor": (0.5, 0.2, 0.1), "roughness": 0.35},
    "metal": {"baseColor": (0.9, 0.6, 0.3), "roughness": 0.3, "metallic": 1.0},
    "gloss": {"baseColor": (0.9, 0.6, 0.3), "roughness": 0.15, "metallic": 1.0},
    "cloth": {"baseColor": (0.1, 0.2, 0.5), "roughness": 0.9, "sheen": 1.0},
    "satin": {"baseColor": (0.5, 0.4, 0.1), "roughness": 0.6, "anisotropic": 0.7, "metallic": 0.8},
}
_SAMPLES = 1 << 16
_BINS = (20, 50)


def disney_model(name: str) -> Bsdf:
    """Return the BSDF whose values the file of this name has."""
    return model_named("disney").bsdf(complete_parameters("disney", MODELS[name]))


def measured(file: Path | str, **parameters: Any) -> Bsdf:
    """Return the BSDF of a measured file."""
    return model_named("measured").bsdf(complete_parameters("measured", {"file": str(file), **parameters}))


@pytest.fixture(scope="module")
def large_file(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Return a function that writes the file of a model on its first call, and returns the path."""
    folder = tmp_path_factory.mktemp("measured")

    @cache
    def write(name: str) -> Path:
        file = folder / f"{name}{'.dat' if 'anisotropic' in MODELS[name] else '.binary'}"
        write_synthetic(file, disney_model(name))
        return file

    return write


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Set the size of MERL's files to `SMALL`, and use few cells and views in tables."""
    monkeypatch.setattr(files, "MERL_SIZE", SMALL)
    monkeypatch.setattr(proposal, "_HALF_VECTOR_CELLS", {False: (64, 8), True: (32, 16)})
    monkeypatch.setattr(proposal, "_VIEW_CELLS", {False: (8, 1), True: (4, 4)})


def small_file(folder: Path, name: str) -> Path:
    """Write the measurement of a model as a small file."""
    file = folder / "small"
    if "anisotropic" in MODELS[name]:
        write_anisotropic(file, anisotropic_samples(disney_model(name), SIZE))
    else:
        write_merl(file, isotropic_samples(disney_model(name), SMALL))
    return file


def _pairs(count: int, seed: int = 3) -> tuple[Floats, Floats]:
    rng = np.random.default_rng(seed)
    wo, wi = directions(rng, count), directions(rng, count)
    wi[::2] = near_the_mirror_image(rng, wo)[::2]
    return wo, wi


def _noise(shape: tuple[int, ...]) -> Floats:
    # A quarter of the samples is negative, as those without a measurement are.
    return np.random.default_rng(4).uniform(-1.0, 3.0, (*shape, 3))


def test_a_merl_binary_holds_a_block_for_each_channel_in_units_of_its_own(small: None, tmp_path: Path) -> None:
    assert MERL_SIZE == (90, 90, 180)
    samples = _noise(SMALL)
    write_merl(tmp_path / "noise.binary", samples)
    content = (tmp_path / "noise.binary").read_bytes()
    assert np.frombuffer(content[:12], "<i4").tolist() == list(SMALL)
    for channel, block in enumerate(np.frombuffer(content[12:], "<f8").reshape(3, -1)):
        np.testing.assert_allclose(block * (1.0, 1.15, 1.66)[channel] / 1500.0, samples[..., channel].ravel())
    read = read_grid(tmp_path / "noise.binary")
    np.testing.assert_allclose(read.samples, np.maximum(samples, 0.0), rtol=1e-15)
    assert read_grid(tmp_path / "noise.binary") is read


@pytest.mark.parametrize("interpolation", ["nearest", "linear"])
def test_a_merl_binary_is_looked_up_as_by_the_published_reader(small: None, tmp_path: Path, interpolation: str) -> None:
    samples = _noise(SMALL)
    write_merl(tmp_path / "noise.binary", samples)
    wo, wi = _pairs(400)
    grid = read_grid(tmp_path / "noise.binary")
    got = grid.f(DirectionPair.from_directions(wo, wi), interpolation)
    reference = [merl(samples, *pair, interpolation) for pair in zip(wo, wi, strict=True)]
    # An arc cosine near 1 loses half of the digits of theta_h, and neighbours differ by their whole value.
    np.testing.assert_allclose(got, reference, rtol=1e-6, atol=1e-6)
    assert (np.array(reference) > 0.0).mean() > 0.5
    # Isotropic data are reciprocal, and do not depend on the tangent.
    np.testing.assert_allclose(grid.f(DirectionPair.from_directions(wi, wo), interpolation), got, rtol=1e-9, atol=1e-9)
    turn = np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(
        grid.f(DirectionPair.from_directions(wo @ turn, wi @ turn), interpolation), got, rtol=1e-9, atol=1e-9
    )


@pytest.mark.parametrize("half", [False, True])
@pytest.mark.parametrize("interpolation", ["nearest", "linear"])
def test_anisotropic_data_are_looked_up_by_their_angles(tmp_path: Path, interpolation: str, half: bool) -> None:
    samples = _noise(SIZE).astype(np.float32).astype(np.float64)
    write_anisotropic(tmp_path / "noise.dat", samples, half=half)
    wo, wi = _pairs(400)
    grid = read_grid(tmp_path / "noise.dat")
    got = grid.f(DirectionPair.from_directions(wo, wi), interpolation)
    reference = [anisotropic(samples, *pair, interpolation, half=half) for pair in zip(wo, wi, strict=True)]
    np.testing.assert_allclose(got, reference, rtol=1e-9, atol=1e-9)
    if half:  # the rest is completed by reciprocity
        np.testing.assert_allclose(grid.f(DirectionPair.from_directions(wi, wo), interpolation), got, rtol=1e-9)


@pytest.mark.parametrize("name", ["plastic", "metal", "satin"])
def test_the_centre_of_a_cell_has_its_sample(small: None, name: str, tmp_path: Path) -> None:
    measured_bsdf, bsdf = measured(small_file(tmp_path, name)), disney_model(name)
    if name == "satin":
        np.testing.assert_allclose(anisotropic_samples(measured_bsdf, SIZE), anisotropic_samples(bsdf, SIZE), rtol=2e-7)
    else:
        # The round trip through directions loses digits where theta_h or theta_d is small.
        samples = isotropic_samples(bsdf, SMALL)
        np.testing.assert_allclose(isotropic_samples(measured_bsdf, SMALL), samples, rtol=1e-6, atol=1e-9)


def test_a_synthetic_file_has_its_name_s_format(small: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    samples = {"isotropic": _noise(SMALL) + 1.0, "anisotropic": np.full((*SIZE, 3), 0.5)}
    for kind, values in samples.items():
        monkeypatch.setattr(synthetic, f"{kind}_samples", lambda bsdf, values=values: values)
    for name, kind in (("f.binary", "isotropic"), ("f.dat", "anisotropic")):
        write_synthetic(tmp_path / name, disney_model("plastic"))
        np.testing.assert_allclose(read_grid(tmp_path / name).samples, samples[kind], rtol=1e-12)


@pytest.mark.proof
@pytest.mark.parametrize(("name", "median"), [("plastic", 3e-4), ("cloth", 3e-4), ("metal", 3e-3)])
def test_a_file_of_a_model_gives_the_model(large_file: Callable[[str], Path], name: str, median: float) -> None:
    """The error is an eighth of a cell's square times the curvature, for metal 5 / alpha^2, at cells of alpha / 10."""
    wo, wi = _pairs(20_000)
    # The last cells of theta_d and of grazing directions are half empty: f jumps at the horizon.
    inside = (wo[:, 2] > 0.1) & (wi[:, 2] > 0.1)
    wo, wi = wo[inside], wi[inside]
    got, reference = evaluate(measured(large_file(name)), wo, wi), evaluate(disney_model(name), wo, wi)
    error = np.abs(got - reference) / reference
    assert np.median(error) < median
    assert np.quantile(error, 0.99) < 0.02


@pytest.mark.parametrize("interpolation", ["nearest", "linear"])
@pytest.mark.parametrize("name", ["metal", "satin"])
def test_values_are_finite_and_0_on_the_horizon(small: None, tmp_path: Path, name: str, interpolation: str) -> None:
    rng, count = np.random.default_rng(6), 20_000
    bsdf = measured(small_file(tmp_path, name), interpolation=interpolation)
    w = rng.normal(size=(2, count, 3)) * 10.0 ** rng.uniform(-20.0, 0.0, (2, count, 3))
    w[..., 2] += rng.choice([0.0, 1e-30, 1e-8, 1.0], w.shape[:2])
    wo, wi = w / np.linalg.norm(w, axis=-1, keepdims=True)
    wi[::4] = wo[::4]
    wi[1::4] = wo[1::4] * [-1.0, -1.0, 1.0]
    f, density = evaluate(bsdf, wo, wi), pdf(bsdf, wo, wi)
    for values in (f, density):
        assert np.isfinite(values).all()
        assert (values >= 0.0).all()
    below = (wo[:, 2] <= 0.0) | (wi[:, 2] <= 0.0)
    assert (f[below] == 0.0).all()
    drawn = sample(bsdf, np.where(wo[:, 2:] > 0.0, wo, [0.0, 0.0, 1.0]), rng.random((count, 2)))
    assert np.isfinite(drawn).all()


@pytest.mark.parametrize("name", [BUILT_IN, *(pytest.param(name, marks=pytest.mark.proof) for name in MODELS)])
def test_no_albedo_is_above_the_bound(name: str, large_file: Callable[[str], Path]) -> None:
    file = name if name == BUILT_IN else str(large_file(name))
    bound = model_named("measured").energy({"file": file})
    albedos = []
    for angle in (0.0, 40.0, 75.0, 84.0, 89.0):
        wi, weight = half_vector_grid(view_at(angle, 23.0), 0.1, (96, 64))
        value = evaluate_cosine(measured(file), np.broadcast_to(view_at(angle, 23.0), wi.shape), wi)
        albedos.append((value * weight[:, None]).sum(axis=0).max())
    assert 0.5 * bound < max(albedos) <= bound


def test_scale_is_a_factor() -> None:
    wo, wi = _pairs(100)
    f = evaluate(measured(BUILT_IN), wo, wi)
    assert f.any()
    np.testing.assert_allclose(evaluate(measured(BUILT_IN, scale=0.25), wo, wi), 0.25 * f)
    assert not evaluate(measured(BUILT_IN, scale=0.0), wo, wi).any()


def _merl(dims: tuple[int, ...] = SMALL, count: int = 3 * 9 * 8 * 12, value: float = 1.0) -> bytes:
    return np.array(dims, "<i4").tobytes() + np.full(count, value).tobytes()


def _ngan(size: int = 3 * 2 * 2 * 2 * 2, **head: int) -> bytes:
    numbers = [2, 2, 2, 2, 0, 0, 1, 0, 0, 0, 3, 0, 0, 0, 0, 0]
    for index, number in head.items():
        numbers[int(index[1:])] = number
    return np.array(numbers, "<i4").tobytes() + np.ones(size, "<f4").tobytes()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"#usda 1.0\n" * 100, "is not a file of measured reflectance, of 1000 bytes; a MERL binary has 9 x 8 x 12"),
        (_merl((9, 8, 360)), "its header gives 9 x 8 x 360 samples; a MERL binary has 9 x 8 x 12 samples"),
        (_merl(count=90), "has 732 bytes; a MERL binary has .* 20748 bytes"),
        (_merl(value=np.nan), r"2592 samples are not finite or are above 1e\+12, the first in channel 0 at \(0, 0"),
        (_merl(value=1.1e12), "2592 samples are not finite"),
        (_ngan(size=7), "has 92 bytes; 2 x 2 x 2 x 2 samples of three channels, as its header gives, are 256"),
        (_ngan(_0=0), "anisotropic data gives 0 x 2 x 2 x 2 samples"),
        (_ngan(_0=1 << 20, _1=1 << 20), "at most 268435456 in all"),
        (_ngan(_7=1), "gives cells of type 1; 0, for even ones"),
        (_ngan(_9=2), "gives 2 for half the data; 0 or 1"),
        (_ngan(_10=1), "is not a file of measured|its header gives 2 x 2 x 2 samples"),
    ],
)
def test_a_wrong_file_is_an_error_that_names_it(small: None, tmp_path: Path, content: bytes, message: str) -> None:
    file = tmp_path / "wrong.binary"
    file.write_bytes(content)
    with pytest.raises(ModelError, match=message) as error:
        complete_parameters("measured", {"file": str(file)})
    assert str(file) in str(error.value)


@pytest.mark.parametrize(
    ("inputs", "message"),
    [
        ({}, "measured.file is ''; the path of a file"),
        ({"file": 3.0}, "measured.file is 3.0; the path of a file"),
        ({"file": "a\0b"}, "the path of a file"),
        ({"file": "/nowhere/gold.binary"}, "/nowhere/gold.binary: no such file; a MERL binary or the anisotropic data"),
        ({"file": "/"}, "/: is not a regular file"),
        ({"file": "x" * 300}, "cannot be read: File name too long"),
        ({"file": BUILT_IN, "interpolation": "cubic"}, "one of linear, nearest"),
    ],
)
def test_a_missing_file_is_an_error(inputs: dict[str, object], message: str) -> None:
    with pytest.raises(ModelError, match=message):
        complete_parameters("measured", inputs)


def test_a_file_that_changes_is_read_again(tmp_path: Path) -> None:
    for value in (1.0, 2.0):
        write_anisotropic(tmp_path / "f.dat", np.full((2, 2, 2, 2 + int(value), 3), value))
        assert (read_grid(tmp_path / "f.dat").samples == value).all()


@pytest.mark.parametrize("data", [IsotropicGrid(_noise(SMALL) + 1.0), AnisotropicGrid(_noise(SIZE) + 1.0)])
def test_the_pdf_is_one_over_the_jacobian(small: None, data: IsotropicGrid | AnisotropicGrid) -> None:
    """Directions are drawn by tables of half vectors or by the cosine; the pdf is the sum of both inverse Jacobians."""
    tables, rng = proposal.make_proposal(data), np.random.default_rng(23)
    wo, u = directions(rng, 2000), rng.random((2000, 2))
    wi = tables.sample(wo, u[:, 0], u[:, 1])
    spread, error = jacobian(lambda u: tables.sample(wo, u[:, 0], u[:, 1]), u, 1e-6)
    d = DirectionPair.from_directions(wo, wi)
    cosine_share = tables.cosine.values[tables._view(wo).astype(int), 0]
    drawn, other = tables.pdf(d), cosine_share * wi[:, 2] / np.pi
    by_cosine = u[:, 0] < cosine_share
    valid = (wi[:, 2] > 1e-3) & (error < 1e-4 * spread)  # no number leaves its cell
    assert np.count_nonzero(valid & by_cosine) > 100
    assert np.count_nonzero(valid & ~by_cosine) > 500
    np.testing.assert_allclose(np.where(by_cosine, other, drawn - other)[valid] * spread[valid], 1.0, rtol=1e-4)
    np.testing.assert_allclose(np.linalg.norm(wi, axis=-1), 1.0, rtol=1e-12)


def _numbers(count: int = _SAMPLES) -> Floats:
    return np.random.default_rng(20050629).random((count, 2))


def _expected(bsdf: Bsdf, wo: Floats, *cells: tuple[int, int]) -> tuple[Floats, Floats]:
    """Return the expected number of samples in each bin, and its error: the difference of two grids.

    The pdf is a step function of half vectors; its integrals over the bins, even in cosine and azimuth of the light's
    direction, are sums over a fine grid. What these leave uncertain is added to the variance expected.
    """
    counts = []
    for number in cells:
        light, weight = half_vector_grid(wo, 0.05, number)
        counts.append(_binned(light, _SAMPLES * weight * pdf(bsdf, np.broadcast_to(wo, light.shape), light)))
    return counts[0], np.abs(counts[0] - counts[1])


def _binned(wi: Floats, weights: Floats | None = None) -> Floats:
    row = np.minimum((wi[:, 2] * _BINS[0]).astype(int), _BINS[0] - 1)
    column = (np.arctan2(wi[:, 1], wi[:, 0]) / (2.0 * np.pi) % 1.0 * _BINS[1]).astype(int) % _BINS[1]
    return np.bincount(row * _BINS[1] + column, weights, minlength=_BINS[0] * _BINS[1])


_ANGLES = (45.0, 0.0, 0.3, 80.0, 89.0)
_CASES = [(name, angle) for name in MODELS for angle in _ANGLES]
# Šidák: the probability that any of the tests fails by chance is 1e-3.
_SIGNIFICANCE = 1.0 - (1.0 - 1e-3) ** (1.0 / (2 + len(_CASES)))


def _assert_follows(bsdf: Bsdf, wo: Floats, least: int, *cells: tuple[int, int]) -> None:
    wi = sample(bsdf, np.broadcast_to(wo, (_SAMPLES, 3)), _numbers())
    up = wi[:, 2] > 0.0
    expected, error = _expected(bsdf, wo, *cells)
    assert p_value(_binned(wi[up]), expected, error) > _SIGNIFICANCE
    assert np.count_nonzero(expected >= 5.0) > least
    noise = 4.0 * np.sqrt(up.mean() * (1.0 - up.mean()) / _SAMPLES)
    assert abs(expected.sum() / _SAMPLES - up.mean()) < noise + 1e-3


@pytest.mark.parametrize("name", ["metal", "satin"])
def test_samples_of_small_files_follow_the_density(small: None, tmp_path: Path, name: str) -> None:
    cells = (300, 180), (220, 132)
    wo, bsdf = view_at(45.0, 23.0), measured(small_file(tmp_path, name))
    _assert_follows(bsdf, wo, 150, *cells)


@pytest.mark.proof
@pytest.mark.parametrize(("name", "angle"), _CASES)
def test_samples_follow_the_density(name: str, angle: float, large_file: Callable[[str], Path]) -> None:
    # A glossy highlight is in few bins.
    least = 20 if name == "gloss" else 150
    _assert_follows(measured(large_file(name)), view_at(angle, 23.0), least, (700, 400), (520, 300))


def _weights(bsdf: Bsdf, wo: Floats) -> Floats:
    wos = np.broadcast_to(wo, (_SAMPLES, 3))
    wi = sample(bsdf, wos, _numbers())
    density = pdf(bsdf, wos, wi)
    value = evaluate_cosine(bsdf, wos, wi).mean(axis=-1)
    return np.where(density > 0.0, value / np.where(density > 0.0, density, 1.0), 0.0)


_VARIANCES = [("plastic", BUILT_IN, 45.0), *product(MODELS, [""], (0.0, 30.0, 60.0, 75.0, 85.0))]


@pytest.mark.parametrize(("name", "file", "angle"), quick_among(_VARIANCES, _VARIANCES[:1]))
def test_sampling_costs_at_most_twice_the_variance_of_the_models_own(
    name: str, file: str, angle: float, large_file: Callable[[str], Path]
) -> None:
    wo = view_at(angle, 23.0)
    of_model, of_file = _weights(disney_model(name), wo), _weights(measured(file or large_file(name)), wo)
    # Five standard errors, and the interpolation of coarse data.
    noise = 5.0 * np.hypot(of_model.std(), of_file.std()) / np.sqrt(_SAMPLES)
    assert (
        abs(of_model.mean() - of_file.mean()) < noise + {"satin": 0.1, "gloss": 0.03}.get(name, 0.01) * of_model.mean()
    )
    assert of_file.var() <= 2.0 * of_model.var()
    assert of_file.max() < 40.0 * of_file.mean()


@pytest.mark.parametrize("value", [0.0, 0.3])
def test_samples_without_contrast_are_sampled_by_the_cosine(small: None, tmp_path: Path, value: float) -> None:
    file = tmp_path / "even.dat"
    write_anisotropic(file, np.full((3, 3, 3, 3, 3), value))
    weights = _weights(measured(file), view_at(50.0, 23.0))
    np.testing.assert_allclose(weights.mean(), np.pi * value, rtol=1e-2, atol=0.0)
    assert weights.std() <= 0.2 * np.pi * value
