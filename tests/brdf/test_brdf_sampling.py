"""Sampling against pdf: a chi-square test of every lobe of every model, as in Mitsuba 3's chi2.py.

Lobes are tested in their own frame, where those that transmit are reflections. The grid of half vectors is that of the
view by whose half vectors a lobe falls off, for a transmitted highlight the refracted one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from lobe_frames import half_vector_view, sent
from numpy.typing import NDArray
from scipy import stats
from sphere_quadrature import CELLS, HalfVectorGrid, Integral

from lookdev.brdf import CONTINUOUS, MODELS, Bsdf, Lobe, complete_parameters, evaluate_cosine, pdf, sample
from lookdev.brdf.frames import Upright
from lookdev.closures.setups import view_at

Floats = NDArray[np.float64]

_SAMPLES = 1 << 16
_VIEWS = {
    "normal": (0.0, 0.0),
    "tilted": (0.3, 40.0),
    "45": (45.0, 0.0),
    "80": (80.0, 110.0),
    "grazing": (89.0, 200.0),
}
_GOLD = {"fresnel": "conductor", "eta": (0.15, 0.45, 1.35), "k": (3.5, 2.4, 1.9)}
_GLASS = {"fresnel": "conductor", "eta": (1.5, 0.05, 10.0), "k": (0.0, 0.0, 20.0)}
# Roughness 0 is alpha at its floor, the narrowest lobe. A model without settings is tested by its probe.
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
        {"roughness": 0.1, "gamma": 1.5, "normal": (0.3, 0.2, 1.0), "specularNormal": (-0.5, 0.1, 0.8)},
        {"roughness": 0.3, "gamma": 1.0, "anisotropic": 0.8},
        {"roughness": 0.4, "gamma": 0.5, "clearcoatNormal": (0.3, 0.2, 1.0)},
        {"roughness": 0.5, "gamma": 4.0, "anisotropic": 1.0, "variant": "2012"},
        {"roughness": 1.0, "gamma": 3.0},
        {"roughness": 0.0, "metallic": 1.0, "clearcoat": 0.0, **_GOLD},
        {"roughness": 0.4, "metallic": 1.0, "clearcoat": 0.0, "anisotropic": 0.6, **_GOLD},
        {"roughness": 0.7, "metallic": 0.5, "variant": "2012", **_GLASS},
    ],
    # Roughness 0 is a cone of 0.25 degrees; from 0.5 on reflection has share 0, at 1 all but diffuse lobes.
    "pixar": [
        {"roughness": 0.0, "ior": 1.0},
        {"roughness": 0.1, "ior": 1.5, "highlightNormal": (0.3, 0.2, 1.0), "diffuseNormal": (-0.2, 0.5, 1.0)},
        {"roughness": 0.3, "ior": 2.0, "grazingScale": 0.0},
        {"roughness": 0.5, "ior": 1.5, "highlightNormal": (-1.0, 0.5, 0.2), "diffuseNormal": (0.9, 0.5, -1.0)},
        {"roughness": 0.9, "ior": 1.0, "specularConeScale": 2.0, "highlightNormal": (0.0, 0.4, 1.0)},
        {"roughness": 1.0, "diffuseNormal": (0.3, 0.0, 1.0), "energy": "conserving"},
        {"roughness": 0.0, "metallic": 1.0, "clear": 0.0, "back": 0.0, **_GOLD},
        {"roughness": 0.3, "metallic": 0.8, "grazingScale": 0.5, "highlightNormal": (0.3, 0.2, 1.0), **_GOLD},
        {"roughness": 0.6, "metallic": 1.0, **_GLASS},
        {"roughness": 0.4, "metallic": 0.5, "energy": "conserving", **_GLASS},
    ],
}

# Exponents, roughnesses and alphas of the classics: smooth, usual, rough, and the ends of the range.
_EXPONENTS = (0.0, 0.3, 1.0, 2.5, 8.0, 32.0, 100.0, 600.0, 4000.0, 1e5)
_ALPHAS = (0.005, 0.01, 0.03, 0.08, 0.15, 0.25, 0.4, 0.6, 0.8, 1.0)
_ROUGHNESSES = (0.001, 0.01, 0.04, 0.1, 0.2, 0.3, 0.45, 0.6, 0.8, 1.0)
_SIGMAS = (0.0, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 0.8, 1.1, 0.5 * np.pi)
_NORMALS = ((0.0, 0.0, 1.0), (0.3, -0.2, 1.0))
_SETTINGS |= {
    "lambert": [{"reflectance": (0.1 * k, 0.5, 1.0), "normal": _NORMALS[k % 2]} for k in range(10)],
    "oren-nayar": [
        {"sigma": sigma, "interreflection": ("included", "none")[k % 2], "normal": _NORMALS[k // 2 % 2]}
        for k, sigma in enumerate(_SIGMAS)
    ],
    "ward": [
        {"alphaX": alpha, "alphaY": _ALPHAS[max(k - 3, 0) if k % 2 else k], "variant": ("1992", "dur")[k % 2]}
        for k, alpha in enumerate(_ALPHAS)
    ],
    "ashikhmin-shirley": [
        {"exponentU": e, "exponentV": _EXPONENTS[(3 * k + 1) % 10 if k % 2 else k]} for k, e in enumerate(_EXPONENTS)
    ],
    # Half vectors resolve lobes about other directions only where they are broad.
    "lafortune": [
        {
            "exponent1": e,
            "exponent2": min(e, 30.0),
            "exponent3": (e % 7.0) + 1.0,
            "coefficients2": (0.1 * k - 0.5, -0.7, 0.9 - 0.08 * k),
            "coefficients3": (1.0, 1.0, 1.0),
        }
        for k, e in enumerate(_EXPONENTS)
    ],
    "torrance-sparrow": [
        {
            "distribution": distribution,
            "geometry": geometry,
            "normalisation": ("4", "pi")[k % 2],
            "roughness": _ROUGHNESSES[(3 * k + j) % 10],
            "roughness2": _ROUGHNESSES[(7 * k + 5) % 10],
            "gamma": (0.5, 0.9, 1.0, 1.0 + 1e-9, 1.5, 2.0, 2.5, 3.0, 3.7, 4.0)[(2 * k + j) % 10],
            "eta": (0.2, 1.0, 1.5),
            "k": (3.0, 1.0, 0.0),
        }
        for j, geometry in enumerate(("v-groove", "smith"))
        for distribution in ("beckmann", "ggx", "gtr", "blinn", "gaussian")
        for k in (range(5) if distribution == "gtr" else range(2))
    ],
} | {name: [{"exponent": e} for e in _EXPONENTS] for name in ("phong", "blinn-phong", "modified-phong")}
_EVERYWHERE: dict[str, dict[str, object]] = {
    "disney": {"clearcoat": 1.0, "sheen": 1.0, "baseColor": (0.2, 0.5, 0.8)},
    "pixar": {"clear": 0.6, "back": 0.4, "metallic": 0.3, "surfaceColor": (0.9, 0.5, 0.8)},
}


def _settings() -> list[tuple[str, int, Bsdf]]:
    return [
        (name, number, model.bsdf(model.complete(_EVERYWHERE.get(name, model.probe) | setting)))
        for name, model in CONTINUOUS.items()
        if not any(each.file for each in model.parameters.values())  # test_measured_sampling.py
        for number, setting in enumerate(_SETTINGS.get(name, [{}]))
    ]


def _in_its_frame(lobe: Lobe, wo: Floats) -> tuple[Bsdf, Floats, Floats]:
    """Return a lobe as a BSDF that reflects about the zenith, its view there, and the view of its half vectors."""
    alone = replace(lobe, transmits=False, frame=Upright())
    return Bsdf(lambda _: (alone,)), lobe.frame.to_local(wo), half_vector_view(lobe, wo)


def _cases() -> list[object]:
    cases: list[object] = []
    for place, view in enumerate(_VIEWS):
        wo = view_at(*_VIEWS[view])
        for model, number, bsdf in _settings():
            # Pixar's lobes depend on the view by their half vectors alone: every other view is enough.
            if model == "pixar" and (place + number) % 2:
                continue
            marks = [pytest.mark.proof] * (model not in ("disney", "pixar") and (place + number) % 3 > 0)
            lobes = [lobe for lobe in bsdf.lobes(wo) if lobe.share > 0.0]
            if not any(lobe.transmits or lobe.leans for lobe in lobes):
                cases.append(pytest.param(bsdf, wo, wo, id=f"{model}-mixture-{number}-{view}", marks=marks))
            cases += [
                pytest.param(*_in_its_frame(lobe, wo), id=f"{model}-{lobe.name}-{number}-{view}", marks=marks)
                for lobe in lobes
            ]
    return cases


_CASES = _cases()
# Šidák: the probability that any of the tests fails by chance is 1e-3.
_SIGNIFICANCE = 1.0 - (1.0 - 1e-3) ** (1.0 / len(_CASES))


def _numbers() -> Floats:
    return np.random.default_rng(20120808).random((_SAMPLES, 2))


def p_value(wi: Floats, grid: HalfVectorGrid, density: Integral) -> float:
    """Return the chi-square p-value of samples `wi` against a pdf by bins; below the horizon is one more bin."""
    above = wi[:, 2] > 0.0
    counts = np.bincount(grid.bin_of(wi[above]), minlength=density.bins.size)
    counts = np.append(counts, np.count_nonzero(~above))
    expected = np.append(density.bins, max(1.0 - density.total, 0.0)) * len(wi)
    order = np.argsort(expected)
    expected, counts = expected[order], counts[order]
    # Bins that expect fewer than 5 are pooled, with the next one where together they expect fewer.
    pooled = max(np.count_nonzero(expected < 5.0), 1 + np.searchsorted(np.cumsum(expected), 5.0))
    expected = np.append(expected[pooled:], expected[:pooled].sum())
    counts = np.append(counts[pooled:], counts[:pooled].sum())
    statistic = float(((counts - expected) ** 2 / expected).sum())
    return float(stats.chi2.sf(statistic, expected.size - 1))


@lru_cache(maxsize=8)
def _grid(wo: tuple[float, ...], fineness: float = 1.0) -> HalfVectorGrid:
    return HalfVectorGrid(np.array(wo), (int(CELLS[0] * fineness), int(CELLS[1] * fineness)))


def resolved(bsdf: Bsdf, wo: Floats, view: tuple[float, ...]) -> tuple[HalfVectorGrid, HalfVectorGrid]:
    """Return a grid so fine that halving it hardly changes the chi-square statistic of a pdf, and the halved one."""

    def integrate(fineness: float) -> Integral:
        return _grid(view, fineness).integrate(lambda _, i: pdf(bsdf, wo, i))

    fineness, coarse, fine = 1.0, integrate(0.5), integrate(1.0)
    while fineness < 8.0 and _SAMPLES * _distance(coarse.bins, fine.bins) > 0.05 * fine.bins.size:
        fineness, coarse, fine = 2.0 * fineness, fine, integrate(2.0 * fineness)
    return _grid(view, fineness), _grid(view, 0.5 * fineness)


def _distance(a: Floats, b: Floats) -> float:
    # Bins that expect less than one sample are pooled with others.
    return float(((a - b) ** 2 / np.maximum(b, 1.0 / _SAMPLES)).sum())


@pytest.mark.parametrize(("bsdf", "wo", "grid_view"), _CASES)
def test_samples_follow_the_density(bsdf: Bsdf, wo: Floats, grid_view: Floats) -> None:
    wos = np.broadcast_to(wo, (_SAMPLES, 3))
    wi = sample(bsdf, wos, _numbers())
    up = wi[:, 2] > 0.0
    np.testing.assert_allclose(np.linalg.norm(wi[up], axis=-1), 1.0, rtol=1e-12)
    assert (wi[~up, 2] == 0.0).all()

    grid, halved = resolved(bsdf, wo, tuple(grid_view))
    density, change = _with_change(grid, halved, lambda _, i: pdf(bsdf, wo, i))
    assert p_value(wi, grid, density) > _SIGNIFICANCE

    # The density integrates to what lies above the horizon: four standard deviations of a fraction, and quadrature.
    above = np.count_nonzero(up) / _SAMPLES
    noise = 4.0 * np.sqrt(above * (1.0 - above) / _SAMPLES)
    assert abs(density.total - above) <= noise + density.error + change + 1e-4

    # Sampling estimates the albedo that quadrature gives.
    weights = _weights(bsdf, wos, wi)
    albedo, change = _with_change(grid, halved, lambda _, i: evaluate_cosine(bsdf, wo, i).mean(axis=-1))
    noise = 4.0 * weights.std() / np.sqrt(_SAMPLES)
    assert abs(weights.mean() - albedo.total) <= noise + albedo.error + change + 1e-4 * albedo.total


def _with_change(
    grid: HalfVectorGrid, halved: HalfVectorGrid, function: Callable[[Floats, Floats], Floats]
) -> tuple[Integral, float]:
    """Integrate a function, and return by how much a coarser grid changes the total."""
    fine = grid.integrate(function)
    return fine, abs(fine.total - halved.integrate(function).total)


def _weights(bsdf: Bsdf, wo: Floats, wi: Floats) -> Floats:
    """Return the mean channel of ``f cos theta_i / pdf``, 0 where the pdf is 0."""
    density = pdf(bsdf, wo, wi)
    lit = density > 0.0
    weights = np.where(lit, evaluate_cosine(bsdf, wo, wi).mean(axis=-1) / np.where(lit, density, 1.0), 0.0)
    assert np.isfinite(weights).all()
    return weights


@pytest.mark.parametrize("view", ["45", "grazing"])
@pytest.mark.parametrize(
    ("model", "number"), [("disney", 9), ("disney", 11), *(("pixar", n) for n in range(len(_SETTINGS["pixar"])))]
)
def test_mixtures_estimate_what_their_lobes_send(model: str, number: int, view: str) -> None:
    bsdf = MODELS[model].bsdf(complete_parameters(model, _EVERYWHERE[model] | _SETTINGS[model][number]))
    wo = view_at(*_VIEWS[view])
    wos = np.broadcast_to(wo, (_SAMPLES, 3))
    weights = _weights(bsdf, wos, sample(bsdf, wos, _numbers()))
    parts = [
        _grid(tuple(half_vector_view(lobe, wo))).integrate(lambda _, i, lobe=lobe: sent(lobe, wo, i).mean(axis=-1))
        for lobe in bsdf.lobes(wo)
        if lobe.share > 0.0
    ]
    total, error = sum(part.total for part in parts), sum(part.error for part in parts)
    noise = 4.0 * weights.std() / np.sqrt(_SAMPLES)
    # The grid does not resolve the surface's horizon across a leaning lobe, about one in a thousand of its nodes.
    cut = any(lobe.leans and not lobe.crosses for lobe in bsdf.lobes(wo))
    assert abs(weights.mean() - total) <= noise + error + (1e-3 if cut else 1e-4) * total


def _specular(roughness: float) -> Bsdf:
    bsdf = MODELS["disney"].bsdf(complete_parameters("disney", {"roughness": roughness}))
    return Bsdf(lambda wo: tuple(lobe for lobe in bsdf.lobes(wo) if lobe.name == "specular"))


@pytest.mark.parametrize(
    ("factor", "roughness"), [(1.05, 0.3), (0.95, 0.3), (1.0, 0.315)], ids=["larger", "smaller", "wider"]
)
@pytest.mark.parametrize("view", _VIEWS)
def test_a_wrong_density_is_found(factor: float, roughness: float, view: str) -> None:
    wo = view_at(*_VIEWS[view])
    grid = HalfVectorGrid(wo)
    wi = sample(_specular(0.3), np.broadcast_to(wo, (_SAMPLES, 3)), _numbers())
    wrong = _specular(roughness)
    density = grid.integrate(lambda o, i: factor * pdf(wrong, o, i))
    assert p_value(wi, grid, density) < _SIGNIFICANCE
