"""Sampling against pdf: of every lobe at random parameters by the Jacobian, and at some parameters by chi-square.

Lobes are tested in their own frame, where those that transmit are reflections. The grid of half vectors is that of the
view by whose half vectors a lobe falls off, for a transmitted highlight the refracted one.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
import pytest
from looks import quick_among
from random_parameters import VARIANTS, Floats, directions, random_parameters
from sample_density import jacobian, p_value
from sphere_quadrature import CELLS, HalfVectorGrid, Integral, f_cosine, half_vector_view

from lookdev.brdf import CONTINUOUS_MODELS, MODELS, Bsdf, Lobe, evaluate_cosine, pdf, sample
from lookdev.brdf import microfacet as mf
from lookdev.brdf.classic.distributions import DISTRIBUTIONS
from lookdev.brdf.classic.lafortune import MAX_POWER
from lookdev.brdf.classic.parts import sample_power_cosine
from lookdev.brdf.frames import ZENITH, UprightFrame
from lookdev.brdf.lobes import DirectionPair
from lookdev.closures.setups import view_at

_SAMPLES = 1 << 16
_VIEWS = {"normal": (0.0, 0.0), "tilted": (0.3, 40.0), "45": (45.0, 0.0), "80": (80.0, 110.0), "grazing": (89.0, 200.0)}
_GOLD = {"fresnel": "conductor", "eta": (0.15, 0.45, 1.35), "k": (3.5, 2.4, 1.9)}
_GLASS = {"fresnel": "conductor", "eta": (1.5, 0.05, 10.0), "k": (0.0, 0.0, 20.0)}
# Roughness 0 is alpha at its floor, the narrowest lobe. A model without settings is tested by its probe.
_SETTINGS: dict[str, list[dict[str, Any]]] = {
    "disney": [
        {"roughness": 0.0, "clearcoatGloss": 1.0},
        {"roughness": 0.2, "anisotropic": 1.0, "clearcoatGloss": 0.0, "variant": "2012"},
        {"roughness": 0.5, "anisotropic": 0.6, "clearcoatGloss": 0.5, "metallic": 0.7},
        {"roughness": 0.1, "gamma": 1.5, "normal": (0.3, 0.2, 1.0), "specularNormal": (-0.5, 0.1, 0.8)},
        {"roughness": 0.4, "gamma": 0.5, "clearcoatNormal": (0.3, 0.2, 1.0)},
        {"roughness": 1.0, "anisotropic": 1.0, "specular": 0.0, "subsurface": 1.0},
        {"roughness": 0.5, "gamma": 4.0, "anisotropic": 1.0, "metallic": 1.0, "clearcoat": 0.0, **_GOLD},
    ],
    # Roughness 0 is a cone of 0.25 degrees; from 0.5 on reflection has share 0, at 1 all but diffuse lobes.
    "pixar": [
        {"roughness": 0.0, "ior": 1.0},
        {"roughness": 0.1, "ior": 1.5, "highlightNormal": (0.3, 0.2, 1.0), "diffuseNormal": (-0.2, 0.5, 1.0)},
        {"roughness": 0.5, "ior": 1.5, "highlightNormal": (-1.0, 0.5, 0.2), "diffuseNormal": (0.9, 0.5, -1.0)},
        {"roughness": 0.9, "ior": 1.0, "specularConeScale": 2.0, "highlightNormal": (0.0, 0.4, 1.0)},
        {"roughness": 1.0, "diffuseNormal": (0.3, 0.0, 1.0), "energy": "conserving"},
        {"roughness": 0.3, "metallic": 0.8, "grazingScale": 0.5, "highlightNormal": (0.3, 0.2, 1.0), **_GOLD},
        {"roughness": 0.4, "metallic": 0.5, "energy": "conserving", **_GLASS},
    ],
    "oren-nayar": [{"sigma": 0.3}, {"sigma": 0.5 * np.pi, "interreflection": "none", "normal": (0.3, -0.2, 1.0)}],
    "ward": [{"alphaX": 0.08, "alphaY": 0.4}, {"alphaX": 1.0, "alphaY": 0.6, "variant": "dur"}, {"alphaX": 0.005}],
    "ashikhmin-shirley": [{"exponentU": u, "exponentV": v} for u, v in ((8.0, 600.0), (0.0, 0.3), (1e5, 1e5))],
    # Half vectors resolve lobes about other directions only where they are broad.
    "lafortune": [
        {"exponent1": 8.0, "exponent2": 8.0, "exponent3": 2.0, "coefficients2": (-0.1, -0.7, 0.6)},
        {"exponent1": 600.0, "exponent2": 30.0, "exponent3": 1.0, "coefficients3": (1.0, 1.0, 1.0)},
    ],
    "torrance-sparrow": [
        {
            "distribution": distribution,
            "geometry": geometry,
            "roughness": (0.3, 0.01, 0.1, 1.0, 0.04)[(2 * k + j) % 5],
            "roughness2": (0.6, 0.2, 0.8)[k % 3],
            "gamma": (0.5, 1.0 + 1e-9, 3.7)[(k + j) % 3],
        }
        for j, geometry in enumerate(("v-groove", "smith"))
        for k, distribution in enumerate(DISTRIBUTIONS)
    ],
} | {name: [{"exponent": e} for e in (8.0, 0.0, 1e5)] for name in ("phong", "blinn-phong", "modified-phong")}
_EVERYWHERE: dict[str, dict[str, Any]] = {
    "disney": {"clearcoat": 1.0, "sheen": 1.0, "baseColor": (0.2, 0.5, 0.8)},
    "pixar": {"clear": 0.6, "back": 0.4, "metallic": 0.3, "surfaceColor": (0.9, 0.5, 0.8)},
}


def _bsdf(model: str, setting: dict[str, Any]) -> Bsdf:
    record = MODELS[model]
    return record.bsdf(record.complete(_EVERYWHERE.get(model, record.probe) | setting))


# Measured data have two pairs of uniform numbers for each direction: see test_measured.py.
@pytest.mark.parametrize(("model", "tokens"), [variant for variant in VARIANTS if variant[0] != "measured"], ids=str)
def test_the_pdf_is_one_over_the_jacobian(model: str, tokens: dict[str, str]) -> None:
    rng, count = np.random.default_rng(20), 1000
    wo, u = directions(rng, count), rng.uniform(0.02, 0.98, (count, 2))
    parameters = random_parameters(rng, model, tokens, count)
    for lobe in MODELS[model].bsdf(parameters).lobes(wo):

        def drawn(u: Floats, lobe: Lobe = lobe) -> Floats:
            return np.broadcast_to(np.asarray(lobe.sample(u[:, 0], u[:, 1])), wo.shape)

        wi, local = drawn(u), np.asarray(lobe.frame.to_local(wo))
        valid = (wi[:, 2] > 1e-3) & (local[:, 2] > 1e-3) & (np.asarray(lobe.share) > 0.0)
        assert np.count_nonzero(valid) > 100, lobe.name
        np.testing.assert_allclose(np.linalg.norm(wi, axis=-1), 1.0, rtol=1e-12)
        density, (spread, error) = np.asarray(lobe.pdf(DirectionPair.from_directions(local, wi))), jacobian(drawn, u)
        off = np.where(valid, np.abs(density * spread - 1.0) - 3.0 * density * error, 0.0)
        worst = int(np.argmax(off))
        case = {name: v if isinstance(v, str) else v[worst] for name, v in parameters.items()}
        assert off[worst] < 1e-6, (lobe.name, wo[worst], u[worst], case)


def test_half_vectors_are_drawn_by_the_published_equations() -> None:
    rng = np.random.default_rng(21)
    u1, u2, alpha = (rng.uniform(0.01, 0.99, 500) for _ in range(3))
    a2, e, power = alpha * alpha, 100.0 * u1 + 0.5, 30.0 * alpha
    # The squared cosine, and the uniform number that is the azimuth in turns.
    for wm, cos2, turns in (
        (mf.sample_cosine(u1, u2), 1.0 - u1, u2),
        (mf.sample_gtr1(alpha, u1, u2), (1.0 - a2 ** (1.0 - u2)) / (1.0 - a2), u1),
        (mf.sample_sin_gaussian(power, u1, u2), 1.0 + np.log(1.0 - u1 * (1.0 - np.exp(-power))) / power, u2),
        (sample_power_cosine(np.broadcast_to(ZENITH, (500, 3)), e, u1, u2), (1.0 - u2) ** (2.0 / (e + 1.0)), u1),
        (DISTRIBUTIONS["beckmann"].sample(alpha, 2.0, u1, u2), 1.0 / (1.0 - a2 * np.log(1.0 - u2)), u1),
        (DISTRIBUTIONS["ggx"].sample(alpha, 2.0, u1, u2), 1.0 / (1.0 + a2 * u2 / (1.0 - u2)), u1),
        (DISTRIBUTIONS["gaussian"].sample(alpha, 2.0, u1, u2), 1.0 / (1.0 + a2 * u2 / (1.0 - u2)), u1),
        (DISTRIBUTIONS["blinn"].sample(alpha, 2.0, u1, u2), (1.0 - u2) ** a2, u1),
        (DISTRIBUTIONS["gtr"].sample(alpha, 3.0, u1, u2), 1.0 / (1.0 + _tan2_gtr(a2, 3.0, u2)), u1),
    ):
        np.testing.assert_allclose(wm[:, 2] ** 2, cos2, rtol=1e-8, atol=1e-10)
        np.testing.assert_allclose(np.arctan2(wm[:, 1], wm[:, 0]) / (2.0 * np.pi) % 1.0, turns, rtol=1e-9)


@pytest.mark.parametrize(
    ("coefficients", "exponent", "wo"),
    [((-4.0, -4.0, 4.0), 100.0, (0.6, 0.0, 0.8)), ((-1.02, -1.02, 1.0), 1e5, (np.sqrt(0.99), 0.0, 0.1))],
)
def test_the_pdf_of_a_lafortune_lobe_is_half_where_its_plateau_ends(
    coefficients: tuple[float, float, float], exponent: float, wo: tuple[float, float, float]
) -> None:
    inputs = {"weight1": (1.0, 1.0, 1.0), "coefficients1": coefficients, "exponent1": exponent}
    lobe = MODELS["lafortune"].bsdf(MODELS["lafortune"].complete(inputs)).lobes(np.array(wo))[1]
    direction = np.multiply(coefficients, wo)
    length = np.linalg.norm(direction)
    # In this direction, the power of the length and the cosine is the largest.
    cosine = MAX_POWER ** (1.0 / exponent) / length
    end = cosine * direction / length + np.sqrt(1.0 - cosine**2) * np.array([0.0, 1.0, 0.0])
    at_peak, at_end = (lobe.pdf(DirectionPair.from_directions(np.array(wo), wi)) for wi in (direction / length, end))
    assert at_end / at_peak == pytest.approx(0.5, rel=1e-9)


def _tan2_gtr(a2: Floats, gamma: float, u: Floats) -> Floats:
    """Burley 2012, eq. 3: the squared tangent of the half vector's angle."""
    cos2 = (1.0 - (a2 ** (1.0 - gamma) * (1.0 - u) + u) ** (1.0 / (1.0 - gamma))) / (1.0 - a2)
    return 1.0 / cos2 - 1.0


def test_visible_normals_mirror_the_view_into_a_spherical_cap() -> None:
    # Dupuy and Benyoub 2023, section 3.2: in the configuration of alpha 1, the mirrored view is uniform over a cap.
    rng = np.random.default_rng(22)
    wo, (u1, u2) = directions(rng, 500), rng.random((2, 500))
    stretch = np.concatenate([rng.uniform(0.01, 1.0, (500, 2)), np.ones((500, 1))], axis=-1)
    wm = mf.sample_visible_ggx(wo, stretch[:, 0], stretch[:, 1], u1, u2) / stretch
    view = wo * stretch
    wm, view = (w / np.linalg.norm(w, axis=-1, keepdims=True) for w in (wm, view))
    cap = 2.0 * (wm * view).sum(axis=-1, keepdims=True) * wm - view
    np.testing.assert_allclose(cap[:, 2], (1.0 - u2) * (1.0 + view[:, 2]) - view[:, 2], atol=1e-9)
    np.testing.assert_allclose(np.exp(1j * np.arctan2(cap[:, 1], cap[:, 0])), np.exp(2j * np.pi * u1), atol=1e-6)


def _in_its_frame(lobe: Lobe, wo: Floats) -> tuple[Bsdf, Floats, Floats]:
    """Return a lobe as a BSDF that reflects about the zenith, its view there, and the view of its half vectors."""
    alone = replace(lobe, transmits=False, frame=UprightFrame())
    return Bsdf(lambda _: (alone,)), lobe.frame.to_local(wo), half_vector_view(lobe, wo)


def _cases() -> list[object]:
    cases: list[object] = []
    for name, model in CONTINUOUS_MODELS.items():
        if any(parameter.file for parameter in model.parameters.values()):  # test_measured.py
            continue
        for number, setting in enumerate(_SETTINGS.get(name, [{}])):
            bsdf = _bsdf(name, setting)
            for view_number, view in enumerate(_VIEWS):
                wo = view_at(*_VIEWS[view])
                # A Jacobian does not reveal directions that are never drawn, or drawn twice. Chi-square does.
                quick = 4 if name in _EVERYWHERE else 1
                marks = [pytest.mark.proof] * (number >= quick or view_number != (2, 4, 1, 3)[number])
                lobes = [lobe for lobe in bsdf.lobes(wo) if lobe.share > 0.0]
                if not any(lobe.transmits or lobe.is_tilted for lobe in lobes):
                    cases.append(pytest.param(bsdf, wo, wo, id=f"{name}-mixture-{number}-{view}", marks=marks))
                cases += [
                    pytest.param(*_in_its_frame(lobe, wo), id=f"{name}-{lobe.name}-{number}-{view}", marks=marks)
                    for lobe in lobes
                ]
    return cases


_CASES = _cases()
# Šidák: the probability that any of the tests fails by chance is 1e-3.
_SIGNIFICANCE = 1.0 - (1.0 - 1e-3) ** (1.0 / len(_CASES))


def _numbers() -> Floats:
    return np.random.default_rng(20120808).random((_SAMPLES, 2))


def _likely(wi: Floats, grid: HalfVectorGrid, density: Integral) -> float:
    """Return the p-value of samples `wi` against a pdf by bins; below the horizon is one more bin."""
    above = wi[:, 2] > 0.0
    counts = np.bincount(grid.bin_of(wi[above]), minlength=density.bins.size)
    return p_value(np.append(counts, np.count_nonzero(~above)), _shares(density) * len(wi))


def _shares(density: Integral) -> Floats:
    """Return the share of samples in each bin, and the share below the horizon."""
    return np.append(density.bins, max(1.0 - density.total, 0.0))


@lru_cache(maxsize=8)
def _grid(wo: tuple[float, ...], fineness: float = 1.0) -> HalfVectorGrid:
    return HalfVectorGrid(np.array(wo), (int(CELLS[0] * fineness), int(CELLS[1] * fineness)))


def _distance(coarse: Integral, fine: Integral) -> float:
    """Return the chi-square statistic between two densities; bins of less than one sample are pooled with others."""
    shares = _shares(fine)
    return ((_shares(coarse) - shares) ** 2 / np.maximum(shares, 1.0 / _SAMPLES)).sum() * _SAMPLES


def _resolved(bsdf: Bsdf, wo: Floats, view: tuple[float, ...]) -> tuple[HalfVectorGrid, HalfVectorGrid]:
    """Return a grid so fine that halving it hardly changes the chi-square statistic of a pdf, and the halved one."""

    def integrate(fineness: float) -> Integral:
        return _grid(view, fineness).integrate(lambda _, i: pdf(bsdf, wo, i))

    fineness, coarse, fine = 1.0, integrate(0.5), integrate(1.0)
    while fineness < 8.0 and _distance(coarse, fine) > 0.01 * fine.bins.size:
        fineness, coarse, fine = 2.0 * fineness, fine, integrate(2.0 * fineness)
    return _grid(view, fineness), _grid(view, 0.5 * fineness)


@pytest.mark.parametrize(("bsdf", "wo", "grid_view"), _CASES)
def test_samples_follow_the_density(bsdf: Bsdf, wo: Floats, grid_view: Floats) -> None:
    wos = np.broadcast_to(wo, (_SAMPLES, 3))
    wi = sample(bsdf, wos, _numbers())
    up = wi[:, 2] > 0.0
    np.testing.assert_allclose(np.linalg.norm(wi[up], axis=-1), 1.0, rtol=1e-12)
    assert (wi[~up, 2] == 0.0).all()

    grid, halved = _resolved(bsdf, wo, tuple(grid_view))
    density, change = _with_change(grid, halved, lambda _, i: pdf(bsdf, wo, i))
    assert _likely(wi, grid, density) > _SIGNIFICANCE

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
    """Integrate a function; return the integral, and the change of its total on a coarser grid."""
    fine = grid.integrate(function)
    return fine, abs(fine.total - halved.integrate(function).total)


def _weights(bsdf: Bsdf, wo: Floats, wi: Floats) -> Floats:
    """Return the mean channel of ``f cos theta_i / pdf``, 0 where the pdf is 0."""
    density = pdf(bsdf, wo, wi)
    is_positive = density > 0.0
    weights = np.where(
        is_positive, evaluate_cosine(bsdf, wo, wi).mean(axis=-1) / np.where(is_positive, density, 1.0), 0.0
    )
    assert np.isfinite(weights).all()
    return weights


_MIXTURES = [("disney", 3), ("pixar", 2), ("disney", 4), *(("pixar", number) for number in (0, 1, 3, 4, 5, 6))]


@pytest.mark.parametrize("view", ["45", pytest.param("grazing", marks=pytest.mark.proof)])
@pytest.mark.parametrize(("model", "number"), quick_among(_MIXTURES, _MIXTURES[:2]))
def test_mixtures_estimate_what_their_lobes_send(model: str, number: int, view: str) -> None:
    bsdf = _bsdf(model, _SETTINGS[model][number])
    wo = view_at(*_VIEWS[view])
    wos = np.broadcast_to(wo, (_SAMPLES, 3))
    weights = _weights(bsdf, wos, sample(bsdf, wos, _numbers()))
    parts = [
        _grid(tuple(half_vector_view(lobe, wo))).integrate(lambda _, i, lobe=lobe: f_cosine(lobe, wo, i).mean(axis=-1))
        for lobe in bsdf.lobes(wo)
        if lobe.share > 0.0
    ]
    total, error = sum(part.total for part in parts), sum(part.error for part in parts)
    noise = 4.0 * weights.std() / np.sqrt(_SAMPLES)
    # The grid does not resolve the surface's horizon across a leaning lobe, about one in a thousand of its nodes.
    cut = any(lobe.is_tilted and not lobe.crosses_surface for lobe in bsdf.lobes(wo))
    assert abs(weights.mean() - total) <= noise + error + (1e-3 if cut else 1e-4) * total
