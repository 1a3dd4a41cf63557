"""Disney's specular lobe alone, of metals, in white light from above: what films and general GTRs reflect of it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from lookdev.brdf import MODELS, complete_parameters
from lookdev.reference.albedo import integrate_albedo

ANGLES = np.linspace(0.0, 87.0, 20)
WHITE = {"metallic": 1.0, "baseColor": (1.0, 1.0, 1.0)}


def albedos(angles: Any = ANGLES, cells: tuple[int, int] = (48, 36), **inputs: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return the largest albedo of the channels at each angle of view, degrees, and its error."""
    bsdf = MODELS["disney"].bsdf(complete_parameters("disney", inputs))
    theta = np.radians(angles)
    sine = np.sin(theta)
    views = np.stack([sine * np.cos(0.3), sine * np.sin(0.3), np.cos(theta)], axis=-1)
    found = [integrate_albedo(bsdf, wo, cells) for wo in views]
    return np.array([each.value[0].max() for each in found]), np.array([each.error[0].max() for each in found])


@pytest.mark.parametrize("roughness", [0.2, 1.0])
@pytest.mark.parametrize(("thickness", "ior"), [(430.0, 1.6), (2500.0, 3.0)])
def test_a_film_reflects_no_more_than_arrives(roughness: float, thickness: float, ior: float) -> None:
    film = {"roughness": roughness, "filmThickness": thickness, "filmIor": ior}
    value, error = albedos(metallic=1.0, baseColor=(0.9, 0.6, 0.3), **film)
    assert (value <= 1.0 + error + 1e-9).all()
    # A film over what reflects all light hides nothing of it: what passes comes back.
    bare, _ = albedos(**WHITE, roughness=roughness)
    value, _ = albedos(**WHITE, **film)
    np.testing.assert_allclose(value, bare, atol=2e-3)


@pytest.mark.parametrize("gamma", [2.0, 4.0])
@pytest.mark.parametrize("roughness", [0.2, 1.0])
@pytest.mark.parametrize("anisotropic", [0.0, 1.0])
def test_a_shorter_tail_reflects_no_more_than_arrives(gamma: float, roughness: float, anisotropic: float) -> None:
    value, error = albedos(**WHITE, gamma=gamma, roughness=roughness, anisotropic=anisotropic)
    assert (value <= 1.0 + error + 1e-9).all()


@pytest.mark.parametrize(
    ("gamma", "isotropic", "anisotropic"), [(1.5, 1.05, 2.15), (1.0, 1.85, 12.3), (0.5, 3.93, 35.7)]
)
def test_a_longer_tail_reflects_more_as_documented(gamma: float, isotropic: float, anisotropic: float) -> None:
    """docs/models.md has the numbers."""
    white = {**WHITE, "roughness": 0.1, "gamma": gamma}
    assert albedos([85.0], (128, 96), **white)[0] == pytest.approx(isotropic, rel=0.01)
    assert albedos([89.0], (128, 96), **white, anisotropic=1.0)[0] == pytest.approx(anisotropic, rel=0.02)
