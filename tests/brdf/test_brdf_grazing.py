"""Precision at grazing angles and at the ends of ranges: a minimal case of each fault that a stress test revealed."""

import numpy as np
import pytest

from lookdev.arrays import Floats, Floats32
from lookdev.brdf import complete_parameters
from lookdev.brdf.frames import ZENITH
from lookdev.brdf.fresnel import fresnel_blend, schlick_blend
from lookdev.brdf.pixar.layering import combine_partitions
from lookdev.brdf.pixar.partition import layer_partition
from lookdev.brdf.vectors import mix

COSINES = np.array([0.0, 1e-30, 1e-7, 1e-4, 0.01, 0.3, 0.9, 1.0 - 2.0**-24, 1.0], np.float32)
# A dozen float32 operations without cancellation.
ROUNDING = 12.0 * 2.0**-24


def exact_weights(cosine: Floats32) -> tuple[Floats, Floats]:
    c = cosine.astype(np.float64)
    # 1 - (1 - c)^5, multiplied out.
    return c * (5.0 - c * (10.0 - c * (10.0 - c * (5.0 - c)))), (1.0 - c) ** 5


@pytest.mark.parametrize(("normal", "grazing"), [(1.0, 0.0), (0.0, 1.0), (1.0, 1e-7), (1e-7, 1.0), (0.05, 0.05)])
def test_a_blend_is_right_however_far_apart_its_ends_are(normal: float, grazing: float) -> None:
    # Smits' lobe with grazingScale = 0: f is (1 - weight) over the square of the cosine, which cancels in float32.
    at_normal, at_grazing = exact_weights(COSINES)
    n, g = np.float32(normal), np.float32(grazing)
    expected = float(n) * at_normal + float(g) * at_grazing
    np.testing.assert_allclose(schlick_blend(n, g, COSINES) * np.ones(9), expected, rtol=ROUNDING)
    colours = fresnel_blend(np.full(3, n), np.full(3, g), COSINES) * np.ones((9, 3))
    np.testing.assert_allclose(colours, np.repeat(expected[:, None], 3, axis=1), rtol=ROUNDING)


@pytest.mark.parametrize("energy", ["published", "conserving"])
def test_a_nearly_smooth_surface_keeps_its_specular_lobe(energy: str) -> None:
    # At this roughness, 1 - (1 - 2 roughness)^3 has 4 digits in float64, none in float32.
    parameters = complete_parameters("pixar", {"roughness": 1e-12, "metallic": 1.0, "energy": energy})
    terms = layer_partition(parameters, ZENITH).terms
    np.testing.assert_allclose(terms["specular"].normal / terms["reflection"].normal, 6e-12, rtol=1e-10)


@pytest.mark.parametrize("t", [0.0, 1e-4, 0.9999, 1.0 - 2.0**-24, 1.0])
def test_a_mix_keeps_the_small_end(t: float) -> None:
    # A black metal. a + (b - a) t has the rounding error of a.
    a, b, t32 = np.float32(1.0), np.float32(1e-7), np.float32(t)
    expected = float(a) * (1.0 - float(t32)) + float(b) * float(t32)
    np.testing.assert_allclose(mix(a, b, t32), expected, rtol=ROUNDING)


def test_what_passes_many_layers_does_not_cancel() -> None:
    glass = layer_partition(complete_parameters("pixar", {"clear": 1.0, "roughness": 0.0}), ZENITH)
    black = layer_partition(complete_parameters("pixar", {"presence": 0.9999, "surfaceColor": (0, 0, 0)}), ZENITH)
    mask = np.array(1.0)
    stack = combine_partitions([*[(black, mask, "transmit")] * 6, (glass, mask, "transmit")])  # type: ignore[list-item]
    np.testing.assert_allclose(stack.terms["refraction"].normal, 1e-24 * glass.terms["refraction"].normal, rtol=1e-9)


def test_an_averaged_index_near_1_keeps_its_digits() -> None:
    inputs = {"clear": 1.0, "roughness": 0.0, "normalScale": 0.0}
    below, above = (layer_partition(complete_parameters("pixar", inputs | {"ior": ior}), ZENITH) for ior in (1.5, 1.0))
    mask = 1.0 - 2.0**-40
    stack = combine_partitions([(below, 1.0, "over"), (above, np.array(mask), "over")])
    bend = stack.terms["refraction"].ior_minus_one
    np.testing.assert_allclose(bend, 0.5 * 2.0**-40, rtol=1e-9)
