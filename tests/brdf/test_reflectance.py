"""What a coat withholds is its directional albedo, and layers beneath have the rest."""

from __future__ import annotations

import json

import numpy as np
import pytest

from lookdev.brdf import StackLayer, complete_parameters, evaluate, model_named, reflectance, stack_bsdf
from lookdev.brdf.frames import Upright
from lookdev.brdf.lobes import Directions
from lookdev.brdf.quadrature import half_vector_grid
from lookdev.brdf.reflectance import DATA
from lookdev.errors import ModelError

_CELLS = (64, 48)


def coat(mask: float = 1.0, **given: object) -> StackLayer:
    return StackLayer("disney", complete_parameters("disney", {"metallic": 1.0, **given}), mask, "coat")


@pytest.mark.parametrize("degrees", [0.0, 45.0, 75.0, 85.0])
@pytest.mark.parametrize("roughness", [0.0, 0.1, 0.3, 0.6, 1.0])
@pytest.mark.parametrize("f0", [0.0, 0.04, 1.0])
def test_it_is_the_albedo_of_the_specular_lobe(degrees: float, roughness: float, f0: float) -> None:
    wo = np.array([np.sin(np.radians(degrees)), 0.0, np.cos(np.radians(degrees))])
    layer = coat(roughness=roughness, baseColor=(f0, f0, f0))
    lobes = model_named("disney").bsdf(layer.parameters).lobes(wo)
    lobe = next(each for each in lobes if each.name == "specular")
    wi, weight = half_vector_grid(wo, max(roughness * roughness, 0.001), _CELLS)
    albedo = (np.asarray(lobe.evaluate(Directions.of(wo, wi)))[:, 0] * wi[:, 2]) @ weight
    largest = sum(entry["residual"]["largest"] for entry in json.loads(DATA.read_text()).values())
    assert reflectance(layer, wo) == pytest.approx(albedo, abs=largest + 0.002)


@pytest.mark.parametrize("degrees", [0.0, 45.0, 75.0, 85.0])
@pytest.mark.parametrize("roughness", [0.0, 0.3, 1.0])
def test_it_is_that_of_an_exact_metal(degrees: float, roughness: float) -> None:
    wo = np.array([np.sin(np.radians(degrees)), 0.0, np.cos(np.radians(degrees))])
    layer = coat(roughness=roughness, fresnel="conductor", eta=(1.5, 0.15, 1.0), k=(0.0, 3.5, 7.0))
    (lobe,) = (each for each in model_named("disney").bsdf(layer.parameters).lobes(wo) if each.name == "specular")
    wi, weight = half_vector_grid(wo, max(roughness * roughness, 0.001), _CELLS)
    albedo = ((np.asarray(lobe.evaluate(Directions.of(wo, wi))) * wi[:, 2:]).T @ weight).mean()
    assert reflectance(layer, wo) == pytest.approx(albedo, abs=0.015)


def test_it_is_that_of_the_lobes_own_normal() -> None:
    wo = np.array([0.6, 0.0, 0.8])
    facing, upright = coat(normal=(0.6, 0.0, 0.8)), coat()
    assert reflectance(facing, wo) == pytest.approx(reflectance(upright, np.asarray(Upright.normal)))


def test_what_is_beneath_has_the_rest() -> None:
    wo, wi = np.array([0.6, 0.0, 0.8]), np.array([-0.36, 0.48, 0.8])
    base = StackLayer("disney", complete_parameters("disney", {"presence": 0.5}))
    for above in (coat(0.7, baseColor=(0.2, 0.3, 0.4)), coat(0.7, presence=0.5), coat(0.0)):
        own, beneath = (evaluate(stack_bsdf([each]), wo, wi) for each in (above, base))
        stack = stack_bsdf([base, above])
        withheld = above.mask * above.parameters["presence"] * reflectance(above, wo)
        np.testing.assert_allclose(evaluate(stack, wo, wi), above.mask * own + (1.0 - withheld) * beneath, rtol=1e-12)
        assert stack.presence == 0.5


def test_a_layer_over_a_coat_is_blended_with_both() -> None:
    wo, wi = np.array([0.6, 0.0, 0.8]), np.array([-0.36, 0.48, 0.8])
    base = StackLayer("disney", complete_parameters("disney", {}))
    top = StackLayer("disney", complete_parameters("disney", {"roughness": 0.2}), 0.25)
    coated, above = (evaluate(stack_bsdf(each), wo, wi) for each in ([base, coat()], [top]))
    np.testing.assert_allclose(
        evaluate(stack_bsdf([base, coat(), top]), wo, wi), 0.75 * coated + 0.25 * above, rtol=1e-12
    )


def test_a_model_that_withholds_nothing_is_no_coat() -> None:
    base = StackLayer("disney", complete_parameters("disney", {}))
    varnish = StackLayer("pixar", complete_parameters("pixar", {}), 1.0, "coat")
    with pytest.raises(ModelError, match="layer 1: mode 'coat' needs Disney layers only"):
        stack_bsdf([base, varnish])
