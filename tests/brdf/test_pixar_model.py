"""A single layer against the numbers of Smits' document, and the reasons why some lobes are not reciprocal."""

from typing import Any

import numpy as np
import pytest
from plot_pixar_diffuse import diffuse_integral
from random_parameters import Floats, directions, near_the_mirror_image

from lookdev.brdf import MODELS, Bsdf, StackLayer, complete_parameters, evaluate, pdf, sample, stack_bsdf
from lookdev.brdf.frames import ZENITH
from lookdev.brdf.fresnel import conductor_fresnel
from lookdev.brdf.lobes import DirectionPair
from lookdev.brdf.pixar import partition
from lookdev.brdf.pixar.partition import REFLECTED_LOBES, TRANSMITTED_LOBES
from lookdev.closures.setups import view_at


def _pixar(**inputs: Any) -> Bsdf:
    return MODELS["pixar"].bsdf(complete_parameters("pixar", inputs))


def _only(bsdf: Bsdf, *names: str) -> Bsdf:
    return Bsdf(lambda wo: tuple(lobe for lobe in bsdf.lobes(wo) if lobe.name in names), two_sided=bsdf.two_sided)


def test_the_plot_has_the_shape_of_the_document() -> None:
    integral = diffuse_integral(*np.meshgrid(np.linspace(0.0, 90.0, 181), np.linspace(0.0, 1.0, 101)))
    assert (np.diff(integral, axis=1) <= 1e-15).all()  # less and less towards grazing angles
    assert (np.diff(integral, axis=0) >= -1e-15).all()  # and the smoother the surface
    # "Most of the plot above about .9 or (.95 * .95)".
    assert np.mean(integral > 0.9) > 0.55
    some = integral[[0, 0, 50, -1], [0, 120, 90, 60]]
    np.testing.assert_allclose(some, [0.859524, 0.832664, 0.927596, 1.0], atol=5e-7)


def test_the_lobe_of_the_model_has_the_plots_integral_where_they_agree() -> None:
    # The model blends weights by roughness, the plot reflectances: they agree at both ends only.
    for roughness in (0.0, 1.0):
        for degrees in (0.0, 60.0, 85.0):
            wo = view_at(degrees)
            (lobe,) = _only(_pixar(surfaceColor=(1.0, 1.0, 1.0), roughness=roughness), "diffuse").lobes(wo)
            x, weight = np.polynomial.legendre.leggauss(8)
            cos = 0.5 * (x + 1.0)
            wi = np.stack([np.sqrt(1.0 - cos * cos), 0.0 * cos, cos], axis=-1)
            f = lobe.evaluate(DirectionPair.from_directions(np.broadcast_to(wo, wi.shape), wi))[:, 0]
            total = 2.0 * np.pi * np.sum(f * cos * 0.5 * weight)
            assert total == pytest.approx(float(diffuse_integral(degrees, roughness)), rel=1e-12)


_COPPER = {"fresnel": "conductor", "eta": (0.2, 1.0, 1.3), "k": (3.2, 2.6, 2.4)}


@pytest.mark.parametrize("metallic", [0.0, 0.3, 1.0])
def test_what_a_partly_metallic_surface_does_not_reflect_is_the_rest(metallic: float) -> None:
    inputs = {"metallic": metallic, "normalScale": 0.8, "grazingScale": 0.9}
    parameters, cosines = complete_parameters("pixar", _COPPER | inputs), np.array([1.0, 0.7, 0.2, 0.0])
    reflected = partition._reflected_term(parameters).weight(cosines)
    np.testing.assert_allclose(
        partition._unreflected_weight(parameters, cosines), 1.0 - reflected, rtol=1e-12, atol=1e-14
    )


@pytest.mark.parametrize("energy", ["published", "conserving"])
def test_an_exact_metal_is_pixars_with_another_fresnel_term(energy: str) -> None:
    rng = np.random.default_rng(23)
    wo = directions(rng, 400)
    wi = near_the_mirror_image(rng, wo)
    eta, k = np.array(_COPPER["eta"]), np.array(_COPPER["k"])
    inputs = {"roughness": 0.3, "metallic": 1.0, "energy": energy}
    front, rest = REFLECTED_LOBES[:2], (REFLECTED_LOBES[2], *TRANSMITTED_LOBES)

    def f(lobes: tuple[str, ...], **more: Any) -> Floats:
        return evaluate(_only(_pixar(**inputs | more), *lobes), wo, wi)

    # A white metal reflects all light at all angles: its term is 1.
    white = f(front, surfaceColor=(1.0, 1.0, 1.0))
    wm = (wo + wi) / np.linalg.norm(wo + wi, axis=-1, keepdims=True)
    cosine = (wo * wm).sum(axis=-1, keepdims=True) if energy == "published" else wo[:, 2:]
    np.testing.assert_allclose(f(front, **_COPPER), white * conductor_fresnel(cosine, eta, k), rtol=1e-9, atol=1e-30)
    # Its colour is its reflectance at normal incidence.
    color = tuple(conductor_fresnel(1.0, eta, k).tolist())
    np.testing.assert_allclose(f(rest, **_COPPER), f(rest, surfaceColor=color), rtol=1e-12)
    # The dielectric part is unchanged. Scales are factors; the factor at normal incidence is at most 1.
    np.testing.assert_allclose(f(front, **_COPPER | {"metallic": 0.0}), f(front, metallic=0.0), rtol=1e-12)
    np.testing.assert_array_equal(f(front, normalScale=5.0, **_COPPER), f(front, **_COPPER))
    scaled = f(front, normalScale=0.5, grazingScale=0.5, **_COPPER)
    np.testing.assert_allclose(scaled, 0.5 * f(front, **_COPPER), rtol=1e-12)


_METAL = {"metallic": 1.0, "surfaceColor": (0.9, 0.6, 0.3), "roughness": 0.4}
_GLASS = {"clear": 0.8, "roughness": 0.3}

# The view and the light in degrees, below the horizon beyond 90; the stack, upper layers with a mask of 0.5; f of the
# green channel both ways.
_ONE_WAY: dict[str, tuple[float, float, list[dict[str, Any]], float, float]] = {
    "refraction by an index of 1.5": (70.0, 140.0, [_GLASS], 4.85370, 0.00685436),
    "the view's Fresnel term": (80.0, 60.0, [_METAL | {"energy": "conserving"}], 2.28538, 1.87052),
    "a cosine of its own": (20.0, 60.0, [_METAL | {"highlightNormal": (-0.5, 0.0, 1.0)}], 1.58682, 0.738525),
    "cones averaged by energy": (
        80.0, 60.0, [_METAL | {"roughness": 0.7}, {"roughness": 0.1}], 0.785277, 0.666643
    ),
    "normals averaged by energy": (
        80.0, 40.0,
        [{"highlightNormal": (-0.3, 0.0, 1.0)}, _METAL | {"highlightNormal": (0.3, 0.0, 1.0)}],
        0.163025, 3.17586,
    ),
}  # fmt: skip


@pytest.mark.parametrize("reason", _ONE_WAY)
def test_what_is_not_reciprocal(reason: str) -> None:
    view, light, layers, forth, back = _ONE_WAY[reason]
    # The base has no mask.
    bsdf = stack_bsdf([StackLayer("pixar", complete_parameters("pixar", layer), 0.5) for layer in layers])
    wo, wi = view_at(view), view_at(light, 180.0)
    np.testing.assert_allclose([evaluate(bsdf, wo, wi)[1], evaluate(bsdf, wi, wo)[1]], [forth, back], rtol=1e-5)


def test_a_leaning_lobe_has_its_own_horizon() -> None:
    # A white diffuser: f |wi.z| is |wi.n| / pi, on either side of the shading normal's horizon.
    normal = np.array([0.6, 0.0, 0.8])
    leaf = {"roughness": 1.0, "surfaceColor": (1.0, 1.0, 1.0), "diffuseNormal": tuple(normal)}
    for back in (0.0, 1.0):
        bsdf = _pixar(**leaf, back=back)
        for degrees in (-70.0, 85.0, 95.0, 125.0, 130.0, 170.0):
            wi = view_at(degrees)
            is_positive = wi @ normal < 0.0 if back else wi @ normal > 0.0
            expected = is_positive * abs(wi @ normal) / np.pi
            np.testing.assert_allclose(evaluate(bsdf, ZENITH, wi) * abs(wi[2]), expected, rtol=1e-12)
            assert pdf(bsdf, ZENITH, wi) == pytest.approx(expected, rel=1e-12)
        drawn = sample(bsdf, np.tile(ZENITH, (4096, 1)), np.random.default_rng(1).random((4096, 2)))
        crossing = (drawn[:, 2] > 0.0 if back else drawn[:, 2] < 0.0).mean()
        # A cosine lobe that leans by theta has (1 - cos theta) / 2 of its energy on that side.
        assert crossing == pytest.approx(0.1, abs=4.0 * np.sqrt(0.1 * 0.9 / 4096))
