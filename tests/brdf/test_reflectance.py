"""A coat withholds its directional albedo; the layers beneath receive the rest."""

import json

import numpy as np
import pytest

from lookdev.brdf import StackLayer, complete_parameters, evaluate, model_named, reflectance, stack_bsdf
from lookdev.brdf.frames import ZENITH, UprightFrame
from lookdev.brdf.lobes import DirectionPair
from lookdev.brdf.quadrature import half_vector_grid
from lookdev.brdf.reflectance import FITS_FILE, ggx_albedo
from lookdev.closures.setups import view_at
from lookdev.errors import ModelError

WO, WI = np.array([0.6, 0.0, 0.8]), np.array([-0.36, 0.48, 0.8])


def coat(mask: float = 1.0, **inputs: object) -> StackLayer:
    return StackLayer("disney", complete_parameters("disney", {"metallic": 1.0, **inputs}), mask, "coat")


EXACT = {"fresnel": "conductor", "eta": (1.5, 0.15, 1.0), "k": (0.0, 3.5, 7.0)}


@pytest.mark.parametrize("degrees", [0.0, 45.0, 75.0, 85.0])
@pytest.mark.parametrize("roughness", [0.0, 0.1, 0.3, 0.6, 1.0])
@pytest.mark.parametrize("inputs", [*({"baseColor": (f0,) * 3} for f0 in (0.0, 0.04, 1.0)), EXACT], ids=str)
def test_it_is_the_albedo_of_the_specular_lobe(degrees: float, roughness: float, inputs: dict[str, object]) -> None:
    wo, layer = view_at(degrees), coat(roughness=roughness, **inputs)
    (lobe,) = (lobe for lobe in model_named("disney").bsdf(layer.parameters).lobes(wo) if lobe.name == "specular")
    wi, weight = half_vector_grid(wo, max(roughness * roughness, 0.001), (64, 48))
    albedo = ((np.asarray(lobe.evaluate(DirectionPair.from_directions(wo, wi))) * wi[:, 2:]).T @ weight).mean()
    largest = sum(entry["residual"]["largest"] for entry in json.loads(FITS_FILE.read_text()).values())
    assert reflectance(layer, wo) == pytest.approx(albedo, abs=0.015 if inputs is EXACT else largest + 0.002)


def test_no_coat_withholds_more_than_all() -> None:
    whole, typical = ggx_albedo(*np.meshgrid(np.linspace(0.0, 1.0, 21), np.linspace(0.01, 1.0, 100)))
    for share in (whole, typical):
        assert (share >= 0.0).all()
        assert (share <= 1.0).all()
    # For a near mirror, seen along its normal, the fit overshoots.
    assert reflectance(coat(roughness=0.2, baseColor=(1.0, 1.0, 1.0)), ZENITH) == 1.0


def test_it_is_that_of_the_lobes_own_normal() -> None:
    facing, upright = coat(normal=(0.6, 0.0, 0.8)), coat()
    assert reflectance(facing, WO) == pytest.approx(reflectance(upright, np.asarray(UprightFrame.normal)))


def test_what_is_beneath_has_the_rest() -> None:
    base = StackLayer("disney", complete_parameters("disney", {"presence": 0.5}))
    for above in (coat(0.7, baseColor=(0.2, 0.3, 0.4)), coat(0.7, presence=0.5), coat(0.0)):
        coating, beneath = (evaluate(stack_bsdf([layer]), WO, WI) for layer in (above, base))
        stack = stack_bsdf([base, above])
        withheld = above.mask * above.parameters["presence"] * reflectance(above, WO)
        np.testing.assert_allclose(
            evaluate(stack, WO, WI), above.mask * coating + (1.0 - withheld) * beneath, rtol=1e-12
        )
        assert stack.presence == 0.5


def test_a_layer_over_a_coat_is_blended_with_both() -> None:
    base = StackLayer("disney", complete_parameters("disney", {}))
    top = StackLayer("disney", complete_parameters("disney", {"roughness": 0.2}), 0.25)
    coated, above = (evaluate(stack_bsdf(layers), WO, WI) for layers in ([base, coat()], [top]))
    stack = evaluate(stack_bsdf([base, coat(), top]), WO, WI)
    np.testing.assert_allclose(stack, 0.75 * coated + 0.25 * above, rtol=1e-12)


def test_a_model_that_withholds_nothing_is_no_coat() -> None:
    base = StackLayer("disney", complete_parameters("disney", {}))
    varnish = StackLayer("pixar", complete_parameters("pixar", {}), 1.0, "coat")
    with pytest.raises(ModelError, match="layer 1: mode 'coat' needs Disney layers only"):
        stack_bsdf([base, varnish])
