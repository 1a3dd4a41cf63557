"""Sampling against density: a chi-square test of every lobe of every model, as Mitsuba 3's chi2.py does it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats
from sphere_quadrature import HalfVectorGrid, Integral

from lookdev.brdf import LOBES, Lobe, complete_parameters, evaluate, pdf, sample

Floats = NDArray[np.float64]

_SAMPLES = 1 << 16
_VIEWS = {
    "normal": (0.0, 0.0),
    "tilted": (0.3, 40.0),
    "45": (45.0, 0.0),
    "80": (80.0, 110.0),
    "grazing": (89.0, 200.0),
}
# Roughness 0 is alpha at its floor, the narrowest lobe there is.
_SETTINGS: dict[str, list[dict[str, object]]] = {
    "disney": [
        {"roughness": 0.0, "anisotropic": 0.0, "clearcoatGloss": 1.0},
        {"roughness": 0.05, "anisotropic": 0.6, "clearcoatGloss": 1.0},
        {"roughness": 0.05, "anisotropic": 1.0, "clearcoatGloss": 0.0},
        {"roughness": 0.2, "anisotropic": 0.0, "clearcoatGloss": 0.0},
        {"roughness": 0.2, "anisotropic": 1.0, "clearcoatGloss": 1.0, "variant": "2012"},
        {"roughness": 0.5, "anisotropic": 0.6, "clearcoatGloss": 0.5, "metallic": 0.7},
        {"roughness": 0.5, "anisotropic": 1.0, "clearcoatGloss": 0.0, "subsurface": 1.0, "specular": 0.0},
        {"roughness": 1.0, "anisotropic": 0.0, "clearcoatGloss": 1.0, "variant": "2012"},
        {"roughness": 1.0, "anisotropic": 1.0, "clearcoatGloss": 0.0},
    ],
}
_EVERYWHERE: dict[str, dict[str, object]] = {"disney": {"clearcoat": 1.0, "sheen": 1.0, "baseColor": (0.2, 0.5, 0.8)}}


def _cases() -> list[object]:
    cases: list[object] = []
    for model, build in LOBES.items():
        for number, setting in enumerate(_SETTINGS.get(model, [{}])):
            parameters = complete_parameters(model, _EVERYWHERE.get(model, {}) | setting)
            lobes = build(parameters)
            chosen = {lobe.name: (lobe,) for lobe in lobes} | {"mixture": lobes}
            cases += [
                pytest.param(members, view, id=f"{model}-{name}-{number}-{view}")
                for name, members in chosen.items()
                for view in _VIEWS
            ]
    return cases


_CASES = _cases()
# Šidák: the chance that any of the tests fails although all is right stays at 1e-3.
_SIGNIFICANCE = 1.0 - (1.0 - 1e-3) ** (1.0 / len(_CASES))


def _view(name: str) -> Floats:
    theta, phi = np.radians(_VIEWS[name])
    return np.array([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)])


def _numbers() -> Floats:
    return np.random.default_rng(20120808).random((_SAMPLES, 2))


def p_value(wi: Floats, grid: HalfVectorGrid, density: Integral) -> float:
    """Return the chance that samples of this density are as far from it as `wi`; below the horizon is one more bin."""
    above = wi[:, 2] > 0.0
    counts = np.bincount(grid.bin_of(wi[above]), minlength=density.bins.size)
    counts = np.append(counts, np.count_nonzero(~above))
    expected = np.append(density.bins, max(1.0 - density.total, 0.0)) * len(wi)
    order = np.argsort(expected)
    expected, counts = expected[order], counts[order]
    # Bins that should hold fewer than 5 are one, with the next one where they do not fill it.
    pooled = max(np.count_nonzero(expected < 5.0), 1 + np.searchsorted(np.cumsum(expected), 5.0))
    expected = np.append(expected[pooled:], expected[:pooled].sum())
    counts = np.append(counts[pooled:], counts[:pooled].sum())
    statistic = float(((counts - expected) ** 2 / expected).sum())
    return float(stats.chi2.sf(statistic, expected.size - 1))


@pytest.mark.parametrize(("lobes", "view"), _CASES)
def test_samples_follow_the_density(lobes: Sequence[Lobe], view: str) -> None:
    wo = _view(view)
    grid, wos = HalfVectorGrid(wo), np.broadcast_to(wo, (_SAMPLES, 3))
    wi = sample(lobes, wos, _numbers())
    np.testing.assert_allclose(np.linalg.norm(wi, axis=-1), 1.0, rtol=1e-12)

    density = grid.integrate(lambda o, i: pdf(lobes, o, i))
    assert p_value(wi, grid, density) > _SIGNIFICANCE

    # The density integrates to what lies above the horizon: four standard deviations of a fraction, and quadrature.
    above = np.count_nonzero(wi[:, 2] > 0.0) / _SAMPLES
    noise = 4.0 * np.sqrt(above * (1.0 - above) / _SAMPLES)
    assert abs(density.total - above) <= noise + density.error + 1e-4

    # Sampling estimates the albedo that quadrature gives.
    weights = np.zeros(_SAMPLES)
    up = wi[:, 2] > 0.0
    weights[up] = _reflected(lobes, wos[up], wi[up]) / pdf(lobes, wos[up], wi[up])
    assert np.isfinite(weights).all()
    albedo = grid.integrate(lambda o, i: _reflected(lobes, o, i))
    noise = 4.0 * weights.std() / np.sqrt(_SAMPLES)
    assert abs(weights.mean() - albedo.total) <= noise + albedo.error + 1e-4 * albedo.total


def _reflected(lobes: Sequence[Lobe], wo: Floats, wi: Floats) -> Floats:
    """Return the mean channel of ``f cos theta_i``."""
    return evaluate(lobes, wo, wi).mean(axis=-1) * np.maximum(wi[..., 2], 0.0)


def _specular(roughness: float) -> tuple[Lobe, ...]:
    lobes = LOBES["disney"](complete_parameters("disney", {"roughness": roughness}))
    return tuple(lobe for lobe in lobes if lobe.name == "specular")


@pytest.mark.parametrize(
    ("factor", "roughness"), [(1.05, 0.3), (0.95, 0.3), (1.0, 0.315)], ids=["larger", "smaller", "wider"]
)
@pytest.mark.parametrize("view", _VIEWS)
def test_a_wrong_density_is_found(factor: float, roughness: float, view: str) -> None:
    wo = _view(view)
    grid = HalfVectorGrid(wo)
    wi = sample(_specular(0.3), np.broadcast_to(wo, (_SAMPLES, 3)), _numbers())
    wrong = _specular(roughness)
    density = grid.integrate(lambda o, i: factor * pdf(wrong, o, i))
    assert p_value(wi, grid, density) < _SIGNIFICANCE
