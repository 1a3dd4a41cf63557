"""Measured reflectance: look-up, files and their faults, and what a file of a known model gives."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from measured_files import known, measured, measured_file, view
from merl_reader import anisotropic, merl
from random_parameters import directions, near_the_mirror_image

from lookdev.brdf import complete_parameters, evaluate, evaluate_cosine, model_named, pdf, sample
from lookdev.brdf.measured.files import MERL_SIZE, write_anisotropic, write_merl
from lookdev.brdf.measured.synthetic import anisotropic_samples, isotropic_samples
from lookdev.brdf.quadrature import half_vector_grid
from lookdev.errors import ModelError

_SIZE = (7, 5, 12, 8)


def _pairs(count: int, seed: int = 3) -> tuple[Any, Any]:
    rng = np.random.default_rng(seed)
    wo, wi = directions(rng, count), directions(rng, count)
    wi[::2] = near_the_mirror_image(rng, wo)[::2]
    return wo, wi


def _noise(shape: tuple[int, ...]) -> Any:
    # A quarter of the samples is negative, as those without a measurement are.
    return np.random.default_rng(4).uniform(-1.0, 3.0, (*shape, 3))


@pytest.mark.parametrize("interpolation", ["nearest", "linear"])
def test_a_merl_binary_is_looked_up_as_by_the_published_reader(tmp_path: Path, interpolation: str) -> None:
    samples = _noise(MERL_SIZE)
    write_merl(tmp_path / "noise.binary", samples)
    wo, wi = _pairs(400)
    got = evaluate(measured(tmp_path / "noise.binary", interpolation=interpolation), wo, wi)
    wanted = [merl(samples, *pair, interpolation) for pair in zip(wo, wi, strict=True)]
    # An arc cosine near 1 loses half of the digits of theta_h, and neighbours differ by their whole value.
    np.testing.assert_allclose(got, wanted, rtol=1e-6, atol=1e-6)
    assert (np.array(wanted) > 0.0).mean() > 0.5


@pytest.mark.parametrize("half", [False, True])
@pytest.mark.parametrize("interpolation", ["nearest", "linear"])
def test_anisotropic_data_are_looked_up_by_their_angles(tmp_path: Path, interpolation: str, half: bool) -> None:
    samples = _noise(_SIZE).astype(np.float32).astype(np.float64)
    write_anisotropic(tmp_path / "noise.dat", samples, half=half)
    wo, wi = _pairs(400)
    got = evaluate(measured(tmp_path / "noise.dat", interpolation=interpolation), wo, wi)
    wanted = [anisotropic(samples, *pair, interpolation, half=half) for pair in zip(wo, wi, strict=True)]
    np.testing.assert_allclose(got, wanted, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(("name", "median"), [("plastic", 3e-4), ("cloth", 3e-4), ("metal", 3e-3)])
def test_a_file_of_a_model_gives_the_model_within_its_interpolation(name: str, median: float) -> None:
    """An eighth of a cell's square times the curvature: metal's is 5 / alpha^2 where a cell is a tenth of alpha."""
    wo, wi = _pairs(20_000)
    # The last cells of theta_d and of grazing directions are half empty: f jumps at the horizon.
    inside = (wo[:, 2] > 0.1) & (wi[:, 2] > 0.1)
    wo, wi = wo[inside], wi[inside]
    got, wanted = evaluate(measured(measured_file(name)), wo, wi), evaluate(known(name), wo, wi)
    error = np.abs(got - wanted) / wanted
    assert np.median(error) < median
    assert np.quantile(error, 0.99) < 0.02


@pytest.mark.parametrize("name", ["plastic", "metal", "satin"])
def test_the_centre_of_a_cell_has_its_sample(name: str, tmp_path: Path) -> None:
    bsdf = known(name)
    if name == "satin":
        write_anisotropic(tmp_path / "f.dat", anisotropic_samples(bsdf, _SIZE))
        found = anisotropic_samples(measured(tmp_path / "f.dat"), _SIZE)
        np.testing.assert_allclose(found, anisotropic_samples(bsdf, _SIZE), rtol=2e-7)
    else:
        # The round trip through directions loses digits where theta_h or theta_d is small.
        found = isotropic_samples(measured(measured_file(name)))
        np.testing.assert_allclose(found, isotropic_samples(bsdf), rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("interpolation", ["nearest", "linear"])
def test_isotropic_data_are_reciprocal_and_have_no_direction(tmp_path: Path, interpolation: str) -> None:
    write_merl(tmp_path / "noise.binary", _noise(MERL_SIZE))
    bsdf = measured(tmp_path / "noise.binary", interpolation=interpolation)
    wo, wi = _pairs(4000)
    f = evaluate(bsdf, wo, wi)
    np.testing.assert_allclose(evaluate(bsdf, wi, wo), f, rtol=1e-9, atol=1e-9)
    turn = np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(evaluate(bsdf, wo @ turn, wi @ turn), f, rtol=1e-9, atol=1e-9)


def test_half_of_the_data_are_completed_by_reciprocity(tmp_path: Path) -> None:
    write_anisotropic(tmp_path / "half.dat", _noise(_SIZE), half=True)
    bsdf = measured(tmp_path / "half.dat")
    wo, wi = _pairs(2000)
    np.testing.assert_allclose(evaluate(bsdf, wi, wo), evaluate(bsdf, wo, wi), rtol=1e-9)


@pytest.mark.parametrize("interpolation", ["nearest", "linear"])
@pytest.mark.parametrize("name", ["metal", "satin"])
def test_values_are_finite_and_0_on_the_horizon(name: str, interpolation: str) -> None:
    rng = np.random.default_rng(6)
    bsdf = measured(measured_file(name), interpolation=interpolation)
    w = rng.normal(size=(2, 200_000, 3)) * 10.0 ** rng.uniform(-20.0, 0.0, (2, 200_000, 3))
    w[..., 2] += rng.choice([0.0, 1e-30, 1e-8, 1.0], w.shape[:2])
    wo, wi = w / np.linalg.norm(w, axis=-1, keepdims=True)
    wi[::4] = wo[::4]
    wi[1::4] = wo[1::4] * [-1.0, -1.0, 1.0]
    f, density = evaluate(bsdf, wo, wi), pdf(bsdf, wo, wi)
    for found in (f, density):
        assert np.isfinite(found).all()
        assert (found >= 0.0).all()
    below = (wo[:, 2] <= 0.0) | (wi[:, 2] <= 0.0)
    assert (f[below] == 0.0).all()
    drawn = sample(bsdf, np.where(wo[:, 2:] > 0.0, wo, [0.0, 0.0, 1.0]), rng.random((200_000, 2)))
    assert np.isfinite(drawn).all()


@pytest.mark.parametrize("name", ["plastic", "metal", "cloth", "satin"])
def test_no_albedo_is_above_the_bound(name: str) -> None:
    file = str(measured_file(name))
    bound = model_named("measured").energy({"file": file})
    found = []
    for angle in np.linspace(0.0, 89.0, 20):
        wi, weight = half_vector_grid(view(angle), 0.1, (160, 96))
        value = evaluate_cosine(measured(file), np.broadcast_to(view(angle), wi.shape), wi)
        found.append((value * weight[:, None]).sum(axis=0).max())
    assert 0.5 * bound < max(found) <= bound


def test_scale_is_a_factor(tmp_path: Path) -> None:
    wo, wi = _pairs(100)
    file = measured_file("plastic")
    np.testing.assert_allclose(evaluate(measured(file, scale=0.25), wo, wi), 0.25 * evaluate(measured(file), wo, wi))
    assert not evaluate(measured(file, scale=0.0), wo, wi).any()


def _merl(dims: tuple[int, ...] = MERL_SIZE, size: int | None = None, value: float = 1.0) -> bytes:
    count = 3 * int(np.prod(MERL_SIZE)) if size is None else size
    return np.array(dims, "<i4").tobytes() + np.full(count, value).tobytes()


def _ngan(size: int = 3 * 2 * 2 * 2 * 2, **head: int) -> bytes:
    numbers = [2, 2, 2, 2, 0, 0, 1, 0, 0, 0, 3, 0, 0, 0, 0, 0]
    for place, number in head.items():
        numbers[int(place[1:])] = number
    return np.array(numbers, "<i4").tobytes() + np.ones(size, "<f4").tobytes()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is not a file of measured reflectance, of 0 bytes"),
        (b"#usda 1.0\n" * 100, "is not a file of measured reflectance, of 1000 bytes; a MERL binary has 90 x 90 x 180"),
        (_merl((90, 90, 360)), "its header gives 90 x 90 x 360 samples; a MERL binary has 90 x 90 x 180 samples"),
        (_merl(size=90), "has 732 bytes; a MERL binary has .* 34992012 bytes"),
        (_merl(value=np.nan), r"4374000 samples are not finite or are above 1e\+12, the first in channel 0 at \(0, 0"),
        (_merl(value=-np.inf), "4374000 samples are not finite"),
        (_merl(value=np.inf), "4374000 samples are not finite"),
        (_ngan(size=7), "has 92 bytes; 2 x 2 x 2 x 2 samples of three channels, as its header gives, are 256"),
        (_ngan(_0=0), "anisotropic data gives 0 x 2 x 2 x 2 samples"),
        (_ngan(_0=1 << 20, _1=1 << 20), "at most 268435456 in all"),
        (_ngan(_7=1), "gives cells of type 1; 0, for even ones"),
        (_ngan(_9=2), "gives 2 for half the data; 0 or 1"),
        (_ngan(_10=1), "is not a file of measured|its header gives 2 x 2 x 2 samples"),
    ],
)
def test_a_wrong_file_is_an_error_that_names_it(tmp_path: Path, content: bytes, message: str) -> None:
    file = tmp_path / "wrong.binary"
    file.write_bytes(content)
    with pytest.raises(ModelError, match=message) as error:
        complete_parameters("measured", {"file": str(file)})
    assert str(file) in str(error.value)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({}, "measured.file is ''; the path of a file"),
        ({"file": 3.0}, "measured.file is 3.0; the path of a file"),
        ({"file": "a\0b"}, "the path of a file"),
        ({"file": "/nowhere/gold.binary"}, "/nowhere/gold.binary: no such file; a MERL binary or the anisotropic data"),
        ({"file": "/"}, "/: is not a regular file"),
        ({"file": "/dev/null"}, "/dev/null: is not a regular file"),
        ({"file": "x" * 300}, "cannot be read: File name too long"),
        ({"file": "builtin:plastic", "interpolation": "cubic"}, "one of linear, nearest"),
    ],
)
def test_a_missing_file_is_an_error(given: dict[str, object], message: str) -> None:
    with pytest.raises(ModelError, match=message):
        complete_parameters("measured", given)


def test_a_file_that_changes_is_read_again(tmp_path: Path) -> None:
    file = tmp_path / "f.dat"
    wo, wi = _pairs(10)
    found = []
    for value in (1.0, 2.0):
        write_anisotropic(file, np.full((2, 2, 2, 2 + int(value), 3), value))
        found.append(evaluate(measured(file), wo, wi))
    np.testing.assert_allclose(found[1], 2.0 * found[0])
