"""Metals: the observer, and colours against published look-dev tables."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

import lookdev.brdf.conductor as conductor
from lookdev.brdf.conductor import METALS, color_matching, metal_indices, metal_reflectance
from lookdev.errors import ModelError

# S. Lagarde, Feeding a physically based shading model (2011), and Hoffman's course notes (2019): linear Rec.709.
TABLES = {
    "gold": (1.0, 0.782, 0.344),
    "silver": (0.972, 0.960, 0.915),
    "copper": (0.955, 0.638, 0.538),
    "aluminium": (0.913, 0.922, 0.924),
}


def test_the_observer_is_the_cie_s() -> None:
    # CIE 1931: x, y and z at three wavelengths, and the integral of each, 106.86 in steps of 1 nm. The fit's authors
    # state errors of up to 0.03.
    tabulated = {450.0: (0.3362, 0.0380, 1.77211), 550.0: (0.43345, 0.99495, 0.00875), 600.0: (1.0622, 0.631, 0.0008)}
    for wavelength, values in tabulated.items():
        np.testing.assert_allclose(color_matching(wavelength), values, atol=0.03)
    np.testing.assert_allclose(color_matching(np.arange(360.0, 831.0)).sum(axis=0), 106.86, rtol=0.005)


def test_the_light_is_d65() -> None:
    x, y, z = color_matching(conductor._WAVELENGTHS).T @ conductor._D65
    np.testing.assert_allclose((x / y, z / y), (0.95047, 1.08883), rtol=2e-3)


@pytest.mark.parametrize("name", METALS)
def test_a_metal_is_measured_over_the_visible_range(name: str) -> None:
    wavelengths = conductor._measured()[name][:, 0]
    assert wavelengths[0] <= 380.0
    assert wavelengths[-1] >= 780.0
    assert all(0.0 < b - a <= 70.0 for a, b in pairwise(wavelengths))
    eta, k = metal_indices(name, wavelengths[1:-1])
    assert np.all((eta > 0.0) & (eta < 5.0))
    assert np.all((k > 1.0) & (k < 10.0))
    color = metal_reflectance(name)
    assert color.shape == (3,)
    assert np.all((color > 0.3) & (color <= 1.0))


def test_the_data_have_no_other_metal() -> None:
    assert set(conductor._measured()) == set(METALS)


@pytest.mark.parametrize(("name", "color"), TABLES.items())
def test_metals_look_as_in_the_tables(name: str, color: tuple[float, float, float]) -> None:
    # Measurements of the same metal differ by this much.
    np.testing.assert_allclose(metal_reflectance(name), color, atol=0.03)


def test_white_stays_white(monkeypatch: pytest.MonkeyPatch) -> None:
    # eta next to 0 and no absorption reflects everything.
    mirror = np.array([[380.0, 1e-12, 5.0], [780.0, 1e-12, 5.0]])
    monkeypatch.setattr(conductor, "_measured", lambda: {"silver": mirror})
    np.testing.assert_allclose(metal_reflectance.__wrapped__("silver"), 1.0, rtol=1e-11)


def test_unknown_metals_and_wavelengths_are_errors() -> None:
    with pytest.raises(ModelError, match=r"unknown metal 'gould' \(did you mean 'gold'"):
        metal_reflectance("gould")
    with pytest.raises(ModelError, match="gold: a wavelength is outside 380 to 780 nm"):
        metal_indices("gold", np.array([500.0, 1000.0]))
