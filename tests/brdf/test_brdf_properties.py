"""Properties of every reflectance model at any parameters, and the normalisation of distributions."""

from itertools import product
from typing import Any

import numpy as np
import pytest
from film_reference import complex_fresnel
from random_parameters import EVERY, VARIANTS, Floats, directions, near_the_mirror_image, random_parameters

from lookdev.brdf import CONTINUOUS_MODELS, MODELS, Bsdf, complete_parameters, evaluate, evaluate_cosine, pdf, sample
from lookdev.brdf import microfacet as mf
from lookdev.brdf.frames import ZENITH
from lookdev.brdf.fresnel import conductor_fresnel
from lookdev.brdf.mixture import Mixture
from lookdev.errors import ModelError
from lookdev.reference.albedo import integrate_albedo

FUNCTIONS = (evaluate, evaluate_cosine, pdf)


@EVERY
def test_reciprocal_lobes(model: str, tokens: dict[str, str]) -> None:
    rng = np.random.default_rng(1)
    wo = directions(rng, 2000)
    wi = np.concatenate([directions(rng, 1000), near_the_mirror_image(rng, wo[1000:])])
    whole = MODELS[model].bsdf(random_parameters(rng, model, tokens, 2000, leaning=0.0))
    names = [lobe.name for lobe in whole.lobes(wo) if not lobe.transmits]
    assert set(MODELS[model].reciprocal(tokens)) <= set(names)
    for name in names:
        bsdf = Bsdf(lambda wo, name=name: tuple(lobe for lobe in whole.lobes(wo) if lobe.name == name))
        f, back = evaluate(bsdf, wo, wi), evaluate(bsdf, wi, wo)
        assert np.count_nonzero(f.max(axis=-1) > 1e-6) > 100
        claimed = name in MODELS[model].reciprocal(tokens) or (name, tokens.get("energy")) == ("diffuse", "conserving")
        assert np.allclose(f, back, rtol=1e-12, atol=0.0) == claimed, name


@EVERY
def test_the_albedo_is_below_the_bound_of_the_model(model: str, tokens: dict[str, str]) -> None:
    rng = np.random.default_rng(7)
    # The bound holds where optional numbers are at their defaults.
    tokens = {name: value for name, value in tokens.items() if name != "options"}
    count = 4
    drawn = random_parameters(rng, model, tokens, count, leaning=0.0)
    for name, parameter in MODELS[model].parameters.items():
        if parameter.kind == "float" and parameter.default <= 1.0:
            drawn[name] = np.minimum(drawn[name], 1.0)
    for index, wo in enumerate(directions(rng, count)):
        parameters_of_one = {name: value if isinstance(value, str) else value[index] for name, value in drawn.items()}
        bsdf = MODELS[model].bsdf(parameters_of_one)
        albedo = integrate_albedo(bsdf, wo, (48, 32))
        assert (albedo.value.sum(axis=0) <= MODELS[model].energy(tokens) + albedo.error.sum(axis=0)).all()


@EVERY
def test_black_on_the_horizon_and_below_it_if_one_sided(model: str, tokens: dict[str, str]) -> None:
    rng, count = np.random.default_rng(2), 100
    above, bsdf = directions(rng, count), MODELS[model].bsdf(random_parameters(rng, model, tokens, count))
    z = np.array([0.0, -0.0] if bsdf.two_sided else [0.0, -0.0, -5e-324, -1e-9, -0.7])[:, None]
    low = above * np.sqrt(1.0 - z * z)[..., None] / np.hypot(above[:, :1], above[:, 1:2])
    low[..., 2] = z
    above = np.broadcast_to(above, low.shape)
    wo, wi = np.array([(above, low), (low, above), (low, low), (-above, low), (low, -above)]).swapaxes(0, 1)
    assert not any(function(bsdf, wo, wi).any() for function in FUNCTIONS)


@EVERY
def test_light_from_where_the_view_goes_is_finite_and_alike_from_both_sides(model: str, tokens: dict[str, str]) -> None:
    rng, count = np.random.default_rng(24), 300
    bsdf = MODELS[model].bsdf(random_parameters(rng, model, tokens, count))
    wo, u = directions(rng, count), rng.random((count, 2))
    anywhere = directions(rng, count) * rng.choice([-1.0, 1.0], (count, 1))
    wi = np.stack([wo, -wo, wo * [-1.0, -1.0, 1.0], wo * [1.0, 1.0, -1.0], anywhere])
    for function in FUNCTIONS:
        values = function(bsdf, wo[None], wi)
        assert np.isfinite(values).all()
        assert (values >= 0.0).all()
        assert values[-1].any()
        if bsdf.two_sided:
            np.testing.assert_array_equal(function(bsdf, -wo[None], -wi), values)
    assert bsdf.two_sided == MODELS[model].two_sided
    if bsdf.two_sided:
        np.testing.assert_array_equal(sample(bsdf, -wo, u), -sample(bsdf, wo, u))


def _extreme_pairs() -> tuple[Floats, Floats]:
    """Return pairs of every height and azimuth, down to denormal cosines."""
    heights = [1.0, 0.5, 1e-3, 1e-7, 1e-18, 1e-160, 5e-324]
    turns = [0.0, 1e-9, 1.0, np.pi - 1e-7, np.pi]
    pairs = []
    for z_o, z_i, turn in product(heights, heights, [*turns, None]):
        s_o, s_i = np.sqrt(1.0 - z_o * z_o), np.sqrt(1.0 - z_i * z_i)
        x, y = (-1.0, 0.0) if turn is None else (np.cos(turn), np.sin(turn))
        pairs.append(((s_o, 0.0, z_o), (s_i * x, s_i * y, z_i)))
    wo, wi = np.array(pairs).transpose(1, 0, 2)
    return wo, wi


@EVERY
def test_finite_and_not_negative(model: str, tokens: dict[str, str]) -> None:
    wo, wi = _extreme_pairs()
    rng = np.random.default_rng(3)
    # Corners of the parameter space, and points just beside them.
    count = 8
    values: dict[str, Any] = dict(tokens)
    for name, parameter in MODELS[model].parameters.items():
        if parameter.kind == "token":
            continue
        column = rng.choice([0.0, 5e-324, 1e-12, 1.0 - 2**-53, 1.0], (count, 1))
        column[:2] = [[0.0], [1.0]]
        low, high = parameter.hard
        if parameter.kind == "normal":
            # Upright, then leaning anywhere, some upside down.
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
    # Unit directions, or z = 0 where f is 0; always where all shares are 0.
    length = np.linalg.norm(drawn, axis=-1)
    assert np.isfinite(length).all()
    np.testing.assert_allclose(length[drawn[..., 2] != 0.0], 1.0, rtol=1e-9)
    is_positive = np.broadcast_to(sum(lobe.share for lobe in bsdf.lobes(wo[None])) > 0.0, length.shape)
    assert (drawn[~is_positive, 2] == 0.0).all()
    for light in (wi[None], -wi[None], drawn):
        # Each lobe by itself; their sums are finite as well.
        terms = Mixture(bsdf.lobes(wo[None]), wo[None]).terms(light)
        values = [value for term in terms for value in (term.value, term.density)]
        for result in (*values, evaluate(bsdf, wo[None], light)):
            assert np.isfinite(result).all()
            assert (np.asarray(result) >= 0.0).all()


def test_shares_are_estimates_of_albedos() -> None:
    """The shares of the lobes of every probe, at a view of cosine 0.6, are as computed by hand."""
    schlick = 0.4**5
    # Pixar's: what enters, and the part of the diffuse lobes; weights of highlights at the view and at both ends.
    enters = 0.5 * 0.95 * (1.0 - schlick)
    diffuse = 0.4 * 0.8 * ((0.95 * 0.7 * enters + 0.3) * 20.0 + 0.3) / 21.0
    reflected, both = 0.05 + 0.95 * schlick, 0.001 * 1.05
    seen = (1.0 - np.sqrt(1.25 + 0.36) / 1.5) ** 5  # the view that index 1.5 bends
    passed, ends = 0.5 * 0.8 * 0.95 * (1.0 - seen), 0.001 * 0.5 * 0.8 * 0.95
    broad, tight = 0.8 * 0.7 * (1.0 - 0.4**3), 0.8 * 0.7 * 0.4**3
    glass = complex_fresnel(np.array(0.6), np.array(1.5))
    expected = {
        "disney": (0.8 + 0.1 * 0.5, 0.04 + 0.96 * schlick, 0.25 * 0.5 * (0.04 + 0.96 * schlick)),
        "pixar": (
            *(diffuse, broad * (reflected + both), tight * (reflected + both)),
            *(diffuse, broad * (passed + ends), tight * (passed + ends)),
        ),
        "lambert": (0.8,),
        "oren-nayar": (0.8 * (1.0 - 0.045 / 0.66), 0.8 * 0.225 / np.pi * 1.5 * 0.7 * 0.8),
        "phong": (0.2 * np.pi, 0.3 * 2.0 * np.pi / 33.0),
        "blinn-phong": (0.2 * np.pi, 0.3 * 8.0 * np.pi / 36.0 * np.sqrt(0.36 + 0.64 / 36.0)),
        "modified-phong": (0.2, 0.3 * np.sqrt(0.36 + 1.0 / 34.0)),
        "ward": (0.2, 0.3),
        "lafortune": (
            *(0.2, 0.3 * 2.0 * np.pi / 33.0),
            *(0.2 * 2.0 * np.pi / 9.0 * (0.64**2 + 0.54**2) ** 4, 0.1 * 2.0 * np.pi / 5.0 * 0.36**2),
        ),
        "torrance-sparrow": (0.2, 0.7 * glass, 0.3 * glass),
        "ashikhmin-shirley": (0.5 * 0.95 * (1.0 - 0.7**5), 0.05 + 0.95 * schlick),
    }
    for name, model in CONTINUOUS_MODELS.items():
        shares = [lobe.share for lobe in model.bsdf(model.complete(model.probe)).lobes(np.array([0.8, 0.0, 0.6]))]
        if name == "measured":  # the mean of the albedos of its views, of which the models' is near
            (share,), (diffuse, specular, _) = shares, expected["disney"]
            assert 0.2 < share < diffuse + specular
        else:
            np.testing.assert_allclose(shares, expected[name], rtol=1e-12, err_msg=name)


def test_bounds_of_albedos_are_as_stated() -> None:
    """The bounds are as computed by hand: white parts add up, and a model without a bound has an infinite one."""
    phong = 3.0 * np.pi
    expected = {"disney": {4.0}, "pixar": {1.0, 2.0}, "oren-nayar": {1.05, 1.016}, "ward": {2.0, np.inf}}
    expected |= {"phong": {phong}, "blinn-phong": {phong}, "modified-phong": {2.0}, "lafortune": {1.0 + 3e30 * np.pi}}
    expected |= {"torrance-sparrow": {2.0, 2001.0, 1.0 + 4.0 / np.pi, 1.0 + 8000.0 / np.pi}}
    for name, bounds in expected.items():
        energies = {MODELS[name].energy(tokens) for model, tokens in VARIANTS if model == name}
        assert sorted(energies) == pytest.approx(sorted(bounds)), name


def test_what_can_reflect_can_be_sampled() -> None:
    # As published, specular = 0 keeps Schlick's term, even for a view along the normal. On black, only it reflects.
    bsdf = MODELS["disney"].bsdf(complete_parameters("disney", {"baseColor": (0.0, 0.0, 0.0), "specular": 0.0}))
    assert all((function(bsdf, ZENITH, np.array([0.6, 0.0, 0.8])) > 0.0).all() for function in FUNCTIONS)


_ALPHA_PAIRS = [(0.001, 0.001), (0.003, 0.001), (0.06, 0.02), (0.3, 0.3), (0.7, 0.9), (1.0, 1.0)]


def test_the_general_gtr_is_the_published_ones() -> None:
    rng = np.random.default_rng(31)
    wm, u = directions(rng, 1000), rng.random((2, 1000))
    alpha, other = rng.uniform(0.001, 0.99, (2, 1000))
    np.testing.assert_allclose(mf.gtr_aniso(wm, alpha, alpha, 1.0), mf.gtr1(wm, alpha), rtol=1e-9)
    np.testing.assert_allclose(mf.gtr_aniso(wm, alpha, other, 2.0), mf.gtr2_aniso(wm, alpha, other), rtol=1e-9)
    np.testing.assert_allclose(mf.gtr_aniso(wm, 1.0, 1.0, 3.0), 1.0 / np.pi, rtol=1e-12)
    for gamma in (0.5, 1.5, 2.0, 4.0):
        # Burley 2012, eq. 1 and 3, as printed.
        a2, e = alpha * alpha, 1.0 - gamma
        c = (gamma - 1.0) * (a2 - 1.0) / (np.pi * (1.0 - a2**e))
        printed = c / (1.0 + (a2 - 1.0) * wm[:, 2] ** 2) ** gamma
        np.testing.assert_allclose(mf.gtr_aniso(wm, alpha, alpha, gamma), printed, rtol=1e-9)
        cosine = np.sqrt((1.0 - (a2**e * (1.0 - u[1]) + u[1]) ** (1.0 / e)) / (1.0 - a2))
        drawn = mf.sample_gtr_aniso(alpha, alpha, gamma, *u)
        np.testing.assert_allclose(drawn[:, 2], cosine, rtol=1e-6)
        np.testing.assert_allclose(np.arctan2(drawn[:, 1], drawn[:, 0]) / (2.0 * np.pi) % 1.0, u[0], rtol=1e-9)


def test_disney_lobes_have_their_own_normals() -> None:
    rng = np.random.default_rng(6)
    wo, wi = directions(rng, 500), directions(rng, 500)
    normals = {"diffuse": (0.3, 0.1, 1.0), "specular": (-0.2, 0.4, 0.8), "clearcoat": (0.0, -0.3, 0.9)}
    parameters = {"roughness": 0.4, "clearcoat": 1.0, "normal": normals["diffuse"]}

    def alone(name: str, **inputs: Any) -> Floats:
        whole = MODELS["disney"].bsdf(complete_parameters("disney", parameters | inputs))
        return evaluate(Bsdf(lambda wo: tuple(lobe for lobe in whole.lobes(wo) if lobe.name == name)), wo, wi)

    lobe_normals = {f"{name}Normal": normals[name] for name in ("specular", "clearcoat")}
    for name, normal in normals.items():
        np.testing.assert_array_equal(alone(name, **lobe_normals), alone(name, normal=normal))
    # Where they are not given, all lobes share one frame.
    lobes = MODELS["disney"].bsdf(complete_parameters("disney", parameters)).lobes(wo)
    assert len({id(lobe.frame) for lobe in lobes}) == 1


def test_an_exact_metal_is_disneys_with_another_fresnel_term() -> None:
    rng = np.random.default_rng(8)
    wo, wi = directions(rng, 300), directions(rng, 300)
    eta, k = (0.15, 0.45, 1.35), (3.5, 2.4, 1.9)
    parameters = {
        "roughness": 0.4,
        "anisotropic": 0.5,
        "specular": 0.7,
        "specularTint": 0.5,
        "baseColor": (0.2, 0.6, 0.9),
    }

    def f(**more: object) -> Floats:
        return evaluate(MODELS["disney"].bsdf(complete_parameters("disney", parameters | more)), wo, wi)

    exact = {"fresnel": "conductor", "eta": eta, "k": k}
    # Where Schlick's term is 1.
    white = f(metallic=1.0, baseColor=(1.0, 1.0, 1.0))
    wm = (wo + wi) / np.linalg.norm(wo + wi, axis=-1, keepdims=True)
    curve = conductor_fresnel((wo * wm).sum(axis=-1, keepdims=True), np.array(eta), np.array(k))
    np.testing.assert_allclose(f(metallic=1.0, **exact), white * curve, rtol=1e-11)
    # The dielectric part is unchanged, and metallic blends both parts linearly.
    np.testing.assert_array_equal(f(metallic=0.0, **exact), f(metallic=0.0))
    blended = 0.7 * f(metallic=0.0) + 0.3 * f(metallic=1.0, **exact)
    np.testing.assert_allclose(f(metallic=0.3, **exact), blended, rtol=1e-11)


@pytest.mark.parametrize(
    ("model", "parameters", "message"),
    [
        ("disny", {}, "unknown model 'disny'.*'disney'"),
        ("disney", {"roughnes": 0.5}, "disney: unknown parameter 'roughnes'.*'roughness'"),
        ("disney", {"roughness": 1.5}, r"disney.roughness is 1.5; its range is 0 to 1"),
        ("disney", {"roughness": -1e-9}, r"disney.roughness is -1e-09; its range is 0 to 1"),
        ("disney", {"baseColor": (0.5, 2.0, 0.5)}, r"disney.baseColor is \(0.5, 2.0, 0.5\); its range is 0 to 1"),
        ("disney", {"roughness": float("nan")}, "disney.roughness is nan; its range is 0 to 1"),
        ("disney", {"baseColor": 0.5}, "disney.baseColor is 0.5; three numbers would be right"),
        ("disney", {"roughness": (0.5, 0.5, 0.5)}, "a number would be right"),
        ("disney", {"roughness": "0.5"}, "disney.roughness is '0.5'; a number would be right"),
        ("disney", {"roughness": True}, "disney.roughness is True; a number would be right"),
        ("disney", {"baseColor": (True, "x", None)}, "three numbers would be right"),
        ("disney", {"variant": "2013"}, "disney.variant is '2013'; one of 2014, 2012 would be right"),
        ("disney", {"variant": [1]}, r"disney.variant is \[1\]; one of"),
        ("pixar", {"diffuseNormal": 1.0}, "pixar.diffuseNormal is 1.0; three numbers would be right"),
        ("pixar", {"diffuseNormal": (0.0, 0.0, 1.5)}, r"pixar.diffuseNormal is .*; its range is -1 to 1"),
        ("pixar", {"highlightNormal": (0.0, 0.0, 0.0)}, "pixar.highlightNormal is .*; a vector with a direction"),
    ],
)
def test_a_wrong_parameter_is_an_error(model: str, parameters: dict[str, object], message: str) -> None:
    with pytest.raises(ModelError, match=message):
        complete_parameters(model, parameters)


def test_defaults_are_complete() -> None:
    for model in MODELS.values():
        parameters = {parameter.name: parameter.choices[0] for parameter in model.parameters.values() if parameter.file}
        complete = model.complete(parameters)
        assert list(complete) == list(model.parameters)
        for name, parameter in model.parameters.items():
            np.testing.assert_array_equal(complete[name], parameters.get(name, parameter.default))
