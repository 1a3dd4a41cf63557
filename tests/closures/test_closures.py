"""Closures of Cycles: their formulas against closed forms, and their albedos against those of the lobes."""

from dataclasses import replace
from itertools import cycle
from pathlib import Path

import numpy as np
import pytest
from random_parameters import VARIANTS, random_parameters

from lookdev.arrays import Floats
from lookdev.brdf import MODELS, Bsdf, StackLayer, complete_parameters, stack_bsdf
from lookdev.brdf.frames import ZENITH, TiltedFrame
from lookdev.brdf.lobes import DirectionPair
from lookdev.brdf.metal import CONDUCTOR
from lookdev.brdf.quadrature import half_vector_grid, hemisphere_grid
from lookdev.checks.samples import constant_looks
from lookdev.closures import STAND_INS, Closure, ClosureKind, closure_cosine, lobe_closures
from lookdev.closures.disney import diffuse_albedo
from lookdev.closures.setups import disney_lobe, view_at
from lookdev.errors import CodegenError
from lookdev.material import Look
from lookdev.material.library import read_preset
from lookdev.material.library.edit import preset_look
from lookdev.material.usd import read_look
from lookdev.material.values import look_bsdf
from lookdev.reference.albedo import integrate_albedo

ONE = np.ones(3)
MATERIALS = Path(__file__).parents[2] / "materials"
PRESETS = sorted([*(MATERIALS / "presets").glob("*.usda"), *(MATERIALS / "metals").glob("*.usda")])
LOOKS = sorted(MATERIALS.glob("*.usda"))
MODELS_WITH_STAND_INS = dict.fromkeys(model for model, _ in STAND_INS)
# 1 %, and 0.001 of albedos below 0.1. The errors of the quadratures are a twentieth of that.
TOLERANCE = 0.01
CELLS = (48, 32)


class ConstantSurface:
    """Points of constant surfaces."""

    def handedness(self) -> Floats:
        return np.ones(())


def bsdfs_of(look: Look, points: int) -> list[Bsdf]:
    """Return the constant surfaces of a look at random points, or the only one if nothing varies."""
    looks = constant_looks(look, points, np.random.default_rng(0))
    return [look_bsdf(constant, ConstantSurface()) for constant in looks]


def view(angle: float, azimuth: float = 0.35) -> Floats:
    """Return a unit direction, from degrees off the normal and radians around it."""
    return view_at(angle, np.degrees(azimuth))


def closures_albedo(bsdf: Bsdf, wo: Floats) -> Floats:
    """Return the albedos of the closures of a BSDF for a view (3,): reflected and transmitted, (2, 3)."""
    total = np.zeros((2, 3))
    for lobe in bsdf.lobes(wo):
        for closure in lobe_closures(lobe, wo):
            wi, weight = _directions(closure, wo)
            energy = closure_cosine(closure, wo, wi) * weight[:, None]
            total += [energy[wi[:, 2] > 0.0].sum(axis=0), energy[wi[:, 2] < 0.0].sum(axis=0)]
    return total


def _directions(closure: Closure, wo: Floats) -> tuple[Floats, Floats]:
    width = float(min(closure.alpha_x, closure.alpha_y))
    if closure.kind in ("diffuse", "rough_diffuse", "translucent", "sheen"):
        wi, weight = hemisphere_grid(24)
    elif not closure.transmits:
        wi, weight = half_vector_grid(closure.frame.to_local(wo), width, (32, 32))
    else:
        # Light leaves along the microfacets' normals, twice as far from the zenith as its half vectors.
        wi, weight = half_vector_grid(ZENITH, 0.5 * width, (32, 32))
    side = -1.0 if closure.transmits else 1.0
    return side * closure.frame.from_local(wi), weight


def deviation(bsdf: Bsdf, wo: Floats) -> float:
    """Return the largest error of the closures' albedo on either side of the surface, relative to at least 0.1."""
    expected = integrate_albedo(bsdf, wo, CELLS).value
    return float((np.abs(closures_albedo(bsdf, wo) - expected) / np.maximum(expected, 0.1)).max())


@pytest.mark.parametrize("model", MODELS)
def test_every_lobe_has_stand_ins_or_an_error_that_names_it(model: str) -> None:
    wo = view(40.0)
    for lobe in MODELS[model].bsdf(complete_parameters(model, MODELS[model].probe)).lobes(wo):
        absent = lobe
        if (model, lobe.name) in STAND_INS:
            assert lobe_closures(lobe, wo)
            absent = replace(lobe, name="other")
        with pytest.raises(CodegenError, match=f"stand for lobe '{absent.name}' of model '{model}'"):
            lobe_closures(absent, wo)


@pytest.mark.parametrize(("roughness", "allowed"), [(0.1, 0.035), (0.3, 0.1)])
def test_the_albedo_under_a_film(roughness: float, allowed: float) -> None:
    film = {"filmThickness": 400.0, "filmIor": 1.5, "roughness": roughness}
    gold = {"metal": "gold", "metallic": 1.0}
    for base in ({"baseColor": (0.02, 0.02, 0.02)}, {"baseColor": (0.9, 0.8, 0.5), "metallic": 1.0}, gold):
        bsdf = MODELS["disney"].bsdf(complete_parameters("disney", base | film))
        assert max(deviation(bsdf, view(angle)) for angle in (0.0, 45.0, 75.0)) <= allowed


def test_a_gamma_that_no_closure_has_is_an_error() -> None:
    _, specular, _ = MODELS["disney"].bsdf(complete_parameters("disney", {"gamma": 1.5})).lobes(view(40.0))
    with pytest.raises(CodegenError, match="whose gamma is not 2; backend 'exact' or 'nodes-exact'"):
        lobe_closures(specular, view(40.0))


@pytest.mark.parametrize("kind", ["ggx", "beckmann"])
def test_reflecting_closures_are_reciprocal(kind: ClosureKind) -> None:
    wo, wi = view(50.0), view(70.0, 2.0)
    closure = Closure(kind, ONE, 0.2, 0.5)
    forth, back = closure_cosine(closure, wo, wi) / wi[2], closure_cosine(closure, wi, wo) / wo[2]
    np.testing.assert_allclose(forth, back, rtol=1e-12)


def test_ggx_of_alpha_1_is_the_term_of_hanrahan_and_krueger() -> None:
    for wo, wi in ((view(20.0), view(60.0, 2.0)), (view(83.0), view(80.0, 0.5))):
        expected = wi[2] / (2.0 * np.pi * (wi[2] + wo[2]))
        np.testing.assert_allclose(closure_cosine(Closure("ggx", ONE), wo, wi), expected, rtol=1e-12)


@pytest.mark.parametrize("roughness", [0.0, 0.5, 1.0])
@pytest.mark.parametrize(("angle", "most"), [(0.0, 0.02), (50.0, 0.03), (83.0, 0.07)])
def test_the_shape_of_the_subsurface_term(roughness: float, angle: float, most: float) -> None:
    wo = view(angle)
    lobe = disney_lobe("diffuse", wo, baseColor=ONE, roughness=roughness, subsurface=1.0)
    wi, weight = hemisphere_grid(64)
    model = lobe.evaluate(DirectionPair.from_directions(wo, wi))[:, 0] * wi[:, 2] * weight
    closures = sum(closure_cosine(closure, wo, wi)[:, 0] for closure in lobe_closures(lobe, wo)) * weight
    assert 0.5 * np.abs(model / model.sum() - closures / closures.sum()).sum() < most


@pytest.mark.parametrize(("kind", "alpha"), [("ggx", 0.05), ("ggx", 0.6), ("beckmann", 0.05), ("beckmann", 0.6)])
def test_a_microfacet_closure_seen_from_above_is_its_distribution(kind: ClosureKind, alpha: float) -> None:
    # For this view G1 is 1 and f cos_i = D G1(wi) / 4; for light nearly along the normal G1 is nearly 1.
    theta_h = 0.05
    wi = np.array([np.sin(2.0 * theta_h), 0.0, np.cos(2.0 * theta_h)])
    t2, cos4 = np.tan(theta_h) ** 2, np.cos(theta_h) ** 4
    d = np.exp(-t2 / alpha**2) / (np.pi * alpha**2 * cos4)
    if kind == "ggx":
        d = 1.0 / (np.pi * alpha**2 * cos4 * (1.0 + t2 / alpha**2) ** 2)
    value = closure_cosine(Closure(kind, ONE, alpha, alpha), ZENITH, wi)
    # Smith's term: alpha^2 tan^2 / 4 at most.
    np.testing.assert_allclose(value, d / 4.0, rtol=0.25 * alpha**2 * np.tan(2.0 * theta_h) ** 2 + 1e-12)


@pytest.mark.parametrize("kind", ["ggx_refraction", "beckmann_refraction"])
def test_a_refraction_sends_light_along_its_normal(kind: ClosureKind) -> None:
    normal = view(30.0, 1.0)
    frame = TiltedFrame(normal)
    closure = Closure(kind, ONE, 0.02, 0.02, frame, 1000.0)
    wi, weight = half_vector_grid(ZENITH, 0.01, (64, 64))
    wi = -frame.from_local(wi)
    energy = closure_cosine(closure, view(60.0), wi)[:, 0] * weight
    assert not closure_cosine(closure, view(60.0), -wi).any()
    # The deviation is a 1000th of the view's sine, in radians.
    mean = energy @ wi / energy.sum()
    assert np.linalg.norm(mean / np.linalg.norm(mean) + normal) < 2e-3


@pytest.mark.parametrize(("kind", "side"), [("diffuse", 1.0), ("translucent", -1.0)])
def test_lambert_reflects_its_weight(kind: ClosureKind, side: float) -> None:
    wi, weight = hemisphere_grid(16)
    closure = Closure(kind, np.array([0.2, 0.5, 1.0]))
    energy = weight @ closure_cosine(closure, view(40.0), side * wi)
    np.testing.assert_allclose(energy, closure.weight, rtol=1e-12)
    assert not closure_cosine(closure, view(40.0), -side * wi).any()


@pytest.mark.parametrize("sigma", [0.01, 0.4])
@pytest.mark.parametrize("angle", [0.0, 60.0, 85.0])
def test_a_white_rough_surface_loses_nothing(sigma: float, angle: float) -> None:
    wi, weight = hemisphere_grid(48)
    closure = Closure("rough_diffuse", 0.5 * ONE, f0=ONE, roughness=sigma)
    # The mean albedo in Cycles is rounded to 0.2 % of multiple scattering.
    np.testing.assert_allclose(weight @ closure_cosine(closure, view(angle), wi), 0.5, rtol=2e-3)


def test_metals_are_ggx_by_schlick() -> None:
    wo, wi = view(50.0), view(80.0, 2.0)
    ggx = closure_cosine(Closure("ggx", ONE, 0.5, 0.2), wo, wi)
    white, gold = (closure_cosine(Closure("metal", ONE, 0.5, 0.2, f0=f0), wo, wi) for f0 in (ONE, 0.3 * ONE))
    np.testing.assert_allclose(white, ggx, rtol=1e-12)
    cos_theta_d = np.sqrt(0.5 * (1.0 + wo @ wi))
    np.testing.assert_allclose(gold / ggx, 0.3 + 0.7 * (1.0 - cos_theta_d) ** 5, rtol=1e-12)
    # With an alpha of 1, D is 1 / pi, and G 2 cos_i cos_o / (cos_i + cos_o).
    sheen = closure_cosine(Closure("sheen", ONE), wo, wi)
    expected = (1.0 - cos_theta_d) ** 5 * wi[2] / (2.0 * np.pi * (wi[2] + wo[2]))
    np.testing.assert_allclose(sheen, expected, rtol=1e-12)


@pytest.mark.parametrize("roughness", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("angle", [0.0, 40.0, 85.0, 89.9])
def test_the_diffuse_albedo_is_exact(roughness: float, angle: float) -> None:
    lobe = disney_lobe("diffuse", view(angle), roughness=roughness, baseColor=ONE)
    wi, weight = hemisphere_grid(32)
    expected = weight @ (lobe.evaluate(DirectionPair.from_directions(view(angle), wi))[:, 0] * wi[:, 2])
    np.testing.assert_allclose(diffuse_albedo(view(angle)[2], np.array(roughness)), expected, rtol=1e-12)


def look_of(file: Path) -> Look:
    return read_look(file) if file in LOOKS else preset_look(read_preset(file), file.stem)


PRESET_VIEWS = list(zip(PRESETS, cycle((65.0, 85.0))))


@pytest.mark.parametrize(("file", "angle"), PRESET_VIEWS, ids=lambda x: getattr(x, "stem", x))
def test_the_albedo_of_every_preset(file: Path, angle: float) -> None:
    (bsdf,) = bsdfs_of(look_of(file), 1)
    assert deviation(bsdf, view(angle)) <= TOLERANCE


@pytest.mark.parametrize("file", LOOKS, ids=lambda file: file.stem)
def test_the_albedo_of_every_look(file: Path) -> None:
    assert max(deviation(bsdf, view(75.0)) for bsdf in bsdfs_of(look_of(file), 2)) <= TOLERANCE


@pytest.mark.proof
@pytest.mark.parametrize("azimuth", [0.0, 45.0, 90.0])
def test_the_albedo_of_every_preset_and_look_from_everywhere(azimuth: float) -> None:
    views = [view(angle, np.radians(azimuth)) for angle in (0.0, 20.0, 40.0, 60.0, 70.0, 75.0, 80.0, 83.0, 85.0)]
    deviations = {
        file.stem: max(deviation(bsdf, wo) for bsdf in bsdfs_of(look_of(file), 3) for wo in views)
        for file in (*PRESETS, *LOOKS)
    }
    assert {name: value for name, value in deviations.items() if value > TOLERANCE} == {}


ISOTROPIC = [variant for variant in VARIANTS if variant[0] in MODELS_WITH_STAND_INS and "options" not in variant[1]]


@pytest.mark.parametrize("count", [4, pytest.param(12, marks=pytest.mark.proof)])
@pytest.mark.parametrize(("model", "tokens"), ISOTROPIC, ids=str)
def test_the_albedo_of_random_isotropic_surfaces(model: str, tokens: dict[str, str], count: int) -> None:
    parameters = random_parameters(np.random.default_rng(3), model, tokens, count, leaning=0.0)
    parameters |= {"anisotropic": np.zeros(count)} if model == "disney" else {}
    if "ior" in parameters:
        parameters["ior"] = np.clip(parameters["ior"], 1.0, 2.5)
        # As for metals. Without absorption, total reflection begins at a single angle.
        parameters["k"] = np.maximum(parameters["k"], 2.0)
    deviations = []
    for index in range(count):
        point = {name: value if isinstance(value, str) else value[index] for name, value in parameters.items()}
        deviations.append(max(deviation(MODELS[model].bsdf(point), view(angle)) for angle in (20.0, 70.0, 85.0)))
    # The error of Pixar's exact metals is 1.6 % at 85 degrees.
    most = 0.016 if model == "pixar" and tokens["fresnel"] == CONDUCTOR else TOLERANCE
    # The error of wide cones in a refracted view is 2 %.
    assert np.sum(np.array(deviations) > most) <= 1
    assert max(deviations) <= 0.03


def test_weights_stay_bounded_however_a_view_grazes() -> None:
    rng = np.random.default_rng(5)
    for model in MODELS_WITH_STAND_INS:
        parameters = random_parameters(rng, model, {}, 50)
        if model == "pixar":
            parameters |= {name: np.ones(50) for name in parameters if name.endswith("Scale") and "Cone" not in name}
        for angle in (85.0, 89.0, 89.9, 89.99, 89.9999):
            wo = np.broadcast_to(view(angle), (50, 3))
            lobes = MODELS[model].bsdf(parameters).lobes(wo)
            for name, closure in ((lobe.name, closure) for lobe in lobes for closure in lobe_closures(lobe, wo)):
                # The weight of sheen is up to its tint, the inverse of the luminance of a pure blue.
                most = {"sheen": 80.0, "metal": 1.0}.get(closure.kind, 2.5)
                bounded = [(closure.weight, most), (closure.alpha_x, 1.0), (closure.alpha_y, 1.0)]
                bounded += [(closure.f0, 1.0)] if closure.kind == "metal" else []
                for value, limit in bounded:
                    assert np.all((np.asarray(value) >= 0.0) & (np.asarray(value) <= limit)), (name, angle)


def test_the_closures_of_a_blend_are_weighted_by_the_mask() -> None:
    layers = [StackLayer(model, complete_parameters(model, {})) for model in ("disney", "pixar")]
    alone = [stack_bsdf([layer]) for layer in layers]
    blend = stack_bsdf([layers[0], StackLayer("pixar", layers[1].parameters, mask=0.3)])
    wo = view(50.0)
    expected = 0.7 * closures_albedo(alone[0], wo) + 0.3 * closures_albedo(alone[1], wo)
    np.testing.assert_allclose(closures_albedo(blend, wo), expected, rtol=1e-12)
