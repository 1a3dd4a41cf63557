"""What holds for a reflectance model whatever its parameters, and what its distributions promise."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from random_parameters import EVERY, directions, random_parameters

from lookdev.brdf import MODELS, Bsdf, complete_parameters, evaluate, evaluate_cosine, pdf, sample
from lookdev.brdf import microfacet as mf
from lookdev.brdf.layering import blend_parameters
from lookdev.errors import ModelError

Floats = NDArray[np.float64]


@pytest.mark.parametrize("variant", MODELS["disney"].parameters["variant"].choices)
def test_light_may_go_either_way(variant: str) -> None:
    rng = np.random.default_rng(1)
    wo, wi = directions(rng, 4000), directions(rng, 4000)
    bsdf = MODELS["disney"].bsdf(random_parameters(rng, "disney", {"variant": variant}, 4000, leaning=0.0))
    np.testing.assert_allclose(evaluate(bsdf, wo, wi), evaluate(bsdf, wi, wo), rtol=1e-12)


def _turned_down(above: Floats, z: float) -> Floats:
    """Return the same azimuths at height `z`."""
    return above * [1.0, 1.0, 0.0] / np.hypot(above[:, :1], above[:, 1:2]) * np.sqrt(1.0 - z * z) + [0.0, 0.0, z]


def _are_dark(bsdf: Bsdf, wo: Floats, wi: Floats) -> bool:
    return not any(np.any(function(bsdf, wo, wi)) for function in (evaluate, evaluate_cosine, pdf))


@EVERY
@pytest.mark.parametrize("z", [0.0, -0.0])
def test_nothing_on_the_horizon(model: str, tokens: dict[str, str], z: float) -> None:
    rng = np.random.default_rng(2)
    above = directions(rng, 500)
    level = _turned_down(above, z)
    bsdf = MODELS[model].bsdf(random_parameters(rng, model, tokens, 500))
    for wo, wi in ((above, level), (level, above), (level, level), (-above, level), (level, -above)):
        assert _are_dark(bsdf, wo, wi)


@pytest.mark.parametrize("variant", MODELS["disney"].parameters["variant"].choices)
@pytest.mark.parametrize("z", [-5e-324, -1e-9, -0.7])
def test_disney_is_dark_below_the_horizon(variant: str, z: float) -> None:
    rng = np.random.default_rng(2)
    above = directions(rng, 500)
    below = _turned_down(above, z)
    bsdf = MODELS["disney"].bsdf(random_parameters(rng, "disney", {"variant": variant}, 500))
    for wo, wi in ((above, below), (below, above), (below, below)):
        assert _are_dark(bsdf, wo, wi)


def _extreme_pairs() -> tuple[Floats, Floats]:
    """Return pairs of every height and every kind of opposition, down to denormal cosines."""
    heights = [1.0, 0.5, 1e-3, 1e-7, 1e-18, 1e-160, 5e-324]
    turns = [0.0, 1e-9, 1.0, np.pi - 1e-7, np.pi]
    pairs = []
    for z_o, z_i, turn in product(heights, heights, turns):
        s_o, s_i = np.sqrt(1.0 - z_o * z_o), np.sqrt(1.0 - z_i * z_i)
        pairs.append(((s_o, 0.0, z_o), (s_i * np.cos(turn), s_i * np.sin(turn), z_i)))
        pairs.append(((s_o, 0.0, z_o), (-s_i, 0.0, z_i)))
    wo, wi = np.array(pairs).transpose(1, 0, 2)
    return wo, wi


@EVERY
def test_no_input_gives_nonsense(model: str, tokens: dict[str, str]) -> None:
    wo, wi = _extreme_pairs()
    rng = np.random.default_rng(3)
    # Corners of the parameter space, and what is just beside them.
    count = 40
    values: dict[str, Any] = dict(tokens)
    for name, parameter in MODELS[model].parameters.items():
        if parameter.kind == "token":
            continue
        column = rng.choice([0.0, 5e-324, 1e-12, 1.0 - 2**-53, 1.0], (count, 1))
        column[:2] = [[0.0], [1.0]]
        low, high = parameter.hard
        if parameter.kind == "normal":
            # Straight ones, then such as lean anywhere, some of them upside down.
            column = rng.choice([-1.0, 0.0, 5e-324, 1e-12, 1.0], (count, 1, 3))
            column[: count // 2] = [0.0, 0.0, 1.0]
            column[~column.any(axis=-1)] = [0.0, 0.0, -1.0]
            values[name] = column
        else:
            extreme = low + column * (high - low)
            values[name] = np.repeat(extreme[..., None], 3, axis=-1) if parameter.kind == "color" else extreme
    bsdf = MODELS[model].bsdf(values)
    numbers = np.broadcast_to(rng.choice([0.0, 5e-324, 0.5, 1.0 - 2**-53], (count, len(wo), 2)), (count, len(wo), 2))
    wos = np.broadcast_to(wo, (count, *wo.shape))
    drawn = sample(bsdf, wos, numbers)
    # Unit directions, or flat ones that carry no light: all are, where a surface reflects nothing.
    length = np.linalg.norm(drawn, axis=-1)
    assert np.isfinite(length).all()
    np.testing.assert_allclose(length[drawn[..., 2] != 0.0], 1.0, rtol=1e-9)
    lit = np.broadcast_to(sum(lobe.share for lobe in bsdf.lobes(wo[None])) > 0.0, length.shape)
    assert (drawn[~lit, 2] == 0.0).all()
    # Each lobe by itself, then all of them.
    lobes = bsdf.lobes(wo[None])
    for chosen in (*((lobe,) for lobe in lobes), lobes):
        part = Bsdf(lambda _, chosen=chosen: chosen, two_sided=bsdf.two_sided)
        for light, function in product((wi[None], -wi[None], drawn), (evaluate, evaluate_cosine, pdf)):
            result = function(part, wo[None], light)
            assert np.isfinite(result).all()
            assert (result >= 0.0).all()


def test_what_can_reflect_can_be_sampled() -> None:
    # As published, specular = 0 keeps Schlick's rise, also seen along the normal; on black nothing else reflects.
    bsdf = MODELS["disney"].bsdf(complete_parameters("disney", {"baseColor": (0.0, 0.0, 0.0), "specular": 0.0}))
    wo, wi = np.array([0.0, 0.0, 1.0]), np.array([0.6, 0.0, 0.8])
    assert (evaluate(bsdf, wo, wi) > 0.0).all()
    assert pdf(bsdf, wo, wi) > 0.0


def _half_vectors(alpha: float) -> tuple[Floats, Floats]:
    """Return half vectors (n, m, 3) and weights of ``cos theta_h d omega_h``: Gauss in log(1 + sin^2 / alpha^2)."""
    x, weight = np.polynomial.legendre.leggauss(400)
    length = np.log1p(1.0 / alpha**2)
    grown = np.exp(0.5 * (x + 1.0) * length)
    sin2 = np.minimum(alpha**2 * (grown - 1.0), 1.0)
    phi = np.arange(720) * (2.0 * np.pi / 720)
    sin, cos = np.sqrt(sin2)[:, None], np.sqrt(1.0 - sin2)[:, None]
    wm = np.stack([sin * np.cos(phi), sin * np.sin(phi), np.broadcast_to(cos, (400, 720))], axis=-1)
    # cos theta d omega = d(sin^2 theta) d phi / 2; the azimuth's trapezoid rule is exact for periodic functions.
    return wm, (0.25 * weight * alpha**2 * grown * length)[:, None] * (2.0 * np.pi / 720)


@pytest.mark.parametrize("alpha", [0.001, 0.01, 0.1, 0.25, 0.9])
def test_gtr1_is_normalised(alpha: float) -> None:
    wm, weight = _half_vectors(alpha)
    assert (mf.gtr1(wm, alpha) * weight).sum() == pytest.approx(1.0, rel=1e-9)


@pytest.mark.parametrize(
    ("alpha_x", "alpha_y"), [(0.001, 0.001), (0.003, 0.001), (0.06, 0.02), (0.3, 0.3), (0.7, 0.9), (1.0, 1.0)]
)
def test_gtr2_is_normalised(alpha_x: float, alpha_y: float) -> None:
    wm, weight = _half_vectors(np.sqrt(alpha_x * alpha_y))
    assert (mf.gtr2_aniso(wm, alpha_x, alpha_y) * weight).sum() == pytest.approx(1.0, rel=1e-9)


@pytest.mark.parametrize("cone", [0.25, 1.0, 10.0, 35.0, 70.0])
def test_the_sin_gaussian_is_normalised(cone: float) -> None:
    power = np.log(10.0) / np.sin(np.radians(cone)) ** 2
    wm, weight = _half_vectors(1.0 / np.sqrt(power))
    assert (mf.sin_gaussian(wm, power) * weight).sum() == pytest.approx(1.0, rel=1e-9)
    # At the cone angle it has fallen to a tenth.
    at_cone = np.array([np.sin(np.radians(cone)), 0.0, np.cos(np.radians(cone))])
    straight = np.array([0.0, 0.0, 1.0])
    assert mf.sin_gaussian(at_cone, power) == pytest.approx(0.1 * mf.sin_gaussian(straight, power), rel=1e-12)


def test_shadowing_lies_between_nothing_and_everything() -> None:
    w = directions(np.random.default_rng(4), 1000)
    cos = w[:, 2]
    alphas = np.array([0.001, 0.1, 0.5, 1.0])[:, None]
    for g1 in (2.0 * cos * mf.smith_ggx(cos, alphas), 2.0 * cos * mf.smith_ggx_aniso(w, alphas, alphas)):
        assert ((g1 > 0.0) & (g1 <= 1.0)).all()
        assert (np.diff(g1, axis=0) < 0.0).all()  # the rougher, the more is hidden
    np.testing.assert_allclose(mf.smith_ggx_aniso(w, alphas, alphas), mf.smith_ggx(cos, alphas), rtol=1e-12)
    assert mf.smith_ggx(0.0, 0.25) == 4.0


def test_the_variants_differ_in_the_shadowing_of_the_specular_lobe_only() -> None:
    rng = np.random.default_rng(5)
    wo, wi = directions(rng, 300), directions(rng, 300)
    given = {"roughness": 0.3, "anisotropic": 0.5, "clearcoat": 1.0, "sheen": 1.0, "subsurface": 0.5}
    lobes = {
        variant: {
            lobe.name: Bsdf(lambda _, lobe=lobe: (lobe,))
            for lobe in MODELS["disney"].bsdf(complete_parameters("disney", given | {"variant": variant})).lobes(wo)
        }
        for variant in ("2014", "2012")
    }
    for name in ("diffuse", "clearcoat"):
        np.testing.assert_array_equal(evaluate(lobes["2014"][name], wo, wi), evaluate(lobes["2012"][name], wo, wi))
    aspect = np.sqrt(1.0 - 0.9 * 0.5)
    alpha_x, alpha_y, alpha_g = 0.09 / aspect, 0.09 * aspect, (0.5 + 0.3 / 2.0) ** 2
    g_2014 = mf.smith_ggx_aniso(wo, alpha_x, alpha_y) * mf.smith_ggx_aniso(wi, alpha_x, alpha_y)
    g_2012 = mf.smith_ggx(wo[:, 2], alpha_g) * mf.smith_ggx(wi[:, 2], alpha_g)
    new, old = (evaluate(lobes[variant]["specular"], wo, wi) for variant in ("2014", "2012"))
    np.testing.assert_allclose(old, new * (g_2012 / g_2014)[:, None], rtol=1e-12)


def test_a_mask_of_nothing_or_everything_is_exact() -> None:
    rng = np.random.default_rng(6)
    known = {name: MODELS["disney"].parameters[name] for name in ("roughness", "baseColor", "variant")}
    # Three points: a float's (3,) is no colour.
    below, above = ({"roughness": rng.random(3), "baseColor": rng.random((3, 3)), "variant": "2014"} for _ in range(2))
    for mask, wanted in ((0.0, below), (1.0, above)):
        for given in (np.asarray(mask), np.full(3, mask)):
            blended = blend_parameters(known, below, above, given)
            assert blended["variant"] == "2014"
            np.testing.assert_array_equal(blended["roughness"], wanted["roughness"])
    plain, rough = complete_parameters("disney", {}), complete_parameters("disney", {"roughness": 1.0})
    half = blend_parameters(MODELS["disney"].parameters, plain, rough, 0.5)
    assert half["roughness"] == 0.75
    np.testing.assert_array_equal(half["baseColor"], [0.8, 0.8, 0.8])


def test_layers_agree_on_tokens() -> None:
    layers = [complete_parameters("disney", {"variant": variant}) for variant in ("2014", "2012")]
    with pytest.raises(ModelError, match="layers disagree on 'variant': '2014' below, '2012' above"):
        blend_parameters(MODELS["disney"].parameters, *layers, np.asarray(0.5))


@pytest.mark.parametrize(
    ("model", "given", "message"),
    [
        ("disny", {}, "unknown model 'disny'.*'disney'"),
        ("disney", {"roughnes": 0.5}, "disney: unknown parameter 'roughnes'.*'roughness'"),
        ("disney", {"roughness": 1.5}, r"disney.roughness is 1.5; its range is 0 to 1"),
        ("disney", {"roughness": -1e-9}, r"disney.roughness is -1e-09; its range is 0 to 1"),
        ("disney", {"specular": 13.0}, r"disney.specular is 13.0; its range is 0 to 12.5"),
        ("disney", {"baseColor": (0.5, 2.0, 0.5)}, r"disney.baseColor is \(0.5, 2.0, 0.5\); its range is 0 to 1"),
        ("disney", {"roughness": float("nan")}, "disney.roughness is nan; its range is 0 to 1"),
        ("disney", {"baseColor": (0.5, 0.5, float("inf"))}, "disney.baseColor is .*inf"),
        ("disney", {"baseColor": 0.5}, "disney.baseColor is 0.5; three numbers would be right"),
        ("disney", {"roughness": (0.5, 0.5, 0.5)}, "a number would be right"),
        ("disney", {"roughness": "0.5"}, "disney.roughness is '0.5'; a number would be right"),
        ("disney", {"roughness": True}, "disney.roughness is True; a number would be right"),
        ("disney", {"roughness": None}, "disney.roughness is None"),
        ("disney", {"baseColor": (True, "x", None)}, "three numbers would be right"),
        ("disney", {"variant": "2013"}, "disney.variant is '2013'; one of 2014, 2012 would be right"),
        ("disney", {"variant": [1]}, r"disney.variant is \[1\]; one of"),
        ("pixar", {"ior": 0.9}, r"pixar.ior is 0.9; its range is 1 to 10"),
        ("pixar", {"energy": "free"}, "pixar.energy is 'free'; one of published, conserving would be right"),
        ("pixar", {"diffuseNormal": 1.0}, "pixar.diffuseNormal is 1.0; three numbers would be right"),
        ("pixar", {"diffuseNormal": (0.0, 0.0, 1.5)}, r"pixar.diffuseNormal is .*; its range is -1 to 1"),
        ("pixar", {"highlightNormal": (0.0, 0.0, 0.0)}, "pixar.highlightNormal is .*; a vector with a direction"),
    ],
)
def test_a_wrong_parameter_is_told(model: str, given: dict[str, object], message: str) -> None:
    with pytest.raises(ModelError, match=message):
        complete_parameters(model, given)


def test_defaults_are_complete() -> None:
    for model, parameters in ((name, each.parameters) for name, each in MODELS.items()):
        complete = complete_parameters(model, {})
        assert list(complete) == list(parameters)
        for name, parameter in parameters.items():
            np.testing.assert_array_equal(complete[name], parameter.default)
