"""Directional albedos of translated looks, compared with the foreign models' own definitions.

An error is that of the albedo itself: a part of the light that arrives.
"""

from __future__ import annotations

import numpy as np
import pytest
from foreign_albedo import Floats, lobe, schlick
from foreign_sets import FOREIGN, VIEWS, Compared, compare, translated_albedo


def agreeing(name: str, sets: list[Compared]) -> tuple[Floats, Floats]:
    """Return the errors, (n,), where the models can agree: of dielectrics, and of what is part metal."""
    near = np.array(VIEWS) <= FOREIGN[name].metals_agree
    dielectrics = [each.error for each in sets if each.metal == 0.0]
    metals = [each.error[near] for each in sets if each.metal > 0.0]
    return np.concatenate(dielectrics), np.concatenate(metals)


@pytest.mark.parametrize("count", [50, pytest.param(200, marks=pytest.mark.proof)])
@pytest.mark.parametrize("name", FOREIGN)
def test_albedos_of_random_sets_agree_with_the_definition(name: str, count: int) -> None:
    dielectrics, metals = agreeing(name, compare(name, count, seed=7))
    # Two of a hundred values may be up to 0.03 away: docs/translation.md has the distribution.
    assert np.median(dielectrics) < 0.004
    assert np.quantile(dielectrics, 0.98) < 0.02
    assert dielectrics.max() < 0.03
    assert np.median(metals) < 0.008
    assert np.quantile(metals, 0.95) < 0.02
    assert metals.max() < 0.035


def test_a_definition_reflects_all_light_at_its_best() -> None:
    # A white metal of any roughness, compensated.
    for roughness in (0.1, 0.5, 1.0):
        for degrees in VIEWS:
            np.testing.assert_allclose(lobe(roughness, degrees, schlick(1.0, 1.0)), 1.0, rtol=1e-3)


def test_a_white_translation_reflects_all_light_at_its_best() -> None:
    white = {"metalness": 1.0, "base_color": (1.0, 1.0, 1.0)}
    for roughness in (0.1, 0.5, 1.0):
        for degrees in VIEWS:
            albedo = translated_albedo("standard_surface", white | {"specular_roughness": roughness}, degrees)
            np.testing.assert_allclose(albedo, 1.0, atol=0.03)
