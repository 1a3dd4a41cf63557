"""Albedo by quadrature against closed forms, and by sampling against quadrature."""

from typing import Any

import numpy as np
import pytest

from lookdev.brdf import Bsdf, StackLayer, complete_parameters, stack_bsdf
from lookdev.reference.albedo import integrate_albedo, sample_albedo


def bsdf_of(model: str, **inputs: Any) -> Bsdf:
    return stack_bsdf([StackLayer(model, complete_parameters(model, inputs))])


def view(degrees: float) -> np.ndarray:
    theta, phi = np.radians(degrees), 0.7
    return np.array([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)])


@pytest.mark.parametrize("degrees", [0.0, 40.0, 85.0])
def test_a_diffuser_sends_its_color_times_presence_to_each_side(degrees: float) -> None:
    # Rough all over, Pixar's model is Lambertian: its color, shared between both sides.
    color = np.array([0.2, 0.5, 0.8])
    bsdf = bsdf_of("pixar", surfaceColor=tuple(color), roughness=1.0, back=0.25, presence=0.5)
    albedo, expected = integrate_albedo(bsdf, view(degrees)), 0.5 * np.stack([0.75 * color, 0.25 * color])
    np.testing.assert_allclose(albedo.value, expected, rtol=3e-4)
    assert (np.abs(albedo.value - expected) <= albedo.error + 1e-12).all()


@pytest.mark.parametrize("degrees", [0.0, 30.0, 60.0])
@pytest.mark.parametrize("cone_scale", [0.0, 1.0])
def test_a_tight_highlight_reflects_its_fresnel_term(degrees: float, cone_scale: float) -> None:
    # A lobe of 0.25 degrees is a mirror: (1 - cos)^5 blends its color to white; the cone widens that by about
    # sin^2(0.25 degrees).
    bsdf = bsdf_of("pixar", surfaceColor=(0.9, 0.5, 0.1), metallic=1.0, roughness=0.0, reflectionConeScale=cone_scale)
    color = np.array([0.9, 0.5, 0.1])
    expected = color + (1.0 - color) * (1.0 - np.cos(np.radians(degrees))) ** 5
    np.testing.assert_allclose(integrate_albedo(bsdf, view(degrees)).value[0], expected, rtol=1e-4)


NORMALS = {"diffuseNormal": (0.3, -0.2, 0.9), "highlightNormal": (-0.4, 0.3, 0.8)}
SURFACES = {
    "brushed": bsdf_of("disney", metallic=1.0, roughness=0.3, anisotropic=1.0, clearcoat=1.0, clearcoatGloss=1.0),
    "leaning": bsdf_of("pixar", roughness=0.3, clear=0.5, back=0.3, **NORMALS),
}


@pytest.mark.parametrize("name", SURFACES)
@pytest.mark.parametrize("degrees", [10.0, 75.0])
def test_samples_agree_with_the_quadrature(name: str, degrees: float) -> None:
    exact = integrate_albedo(SURFACES[name], view(degrees))
    sampled = sample_albedo(SURFACES[name], view(degrees), 1024, 16, np.random.default_rng(3))
    # Student's t with 15 degrees of freedom: beyond 6 once in 40,000.
    assert (np.abs(sampled.value - exact.value) <= 6.0 * sampled.error + exact.error).all()
    assert (sampled.error < 2e-3).all()


def test_an_opaque_surface_is_not_lit_from_behind() -> None:
    # A cosine lobe that leans by theta has (1 - cos theta) / 2 below the horizon of the shading normal.
    leaning = {"roughness": 1.0, "surfaceColor": (1.0, 1.0, 1.0), "diffuseNormal": (0.6, 0.0, 0.8)}
    opaque, leaf = (bsdf_of("pixar", **leaning, back=back) for back in (0.0, 0.25))
    sampled = sample_albedo(opaque, view(0.0), 1024, 16, np.random.default_rng(3))
    for albedo in (integrate_albedo(opaque, view(0.0)), sampled):
        np.testing.assert_allclose(albedo.value[0], 0.9, atol=2e-3)
        np.testing.assert_array_equal(albedo.value[1], 0.0)
    np.testing.assert_allclose(integrate_albedo(leaf, view(0.0)).value[:, 0], [0.7, 0.3], atol=2e-3)
