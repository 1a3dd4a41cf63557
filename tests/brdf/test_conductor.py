"""Metals: the observer, and colours against published look-dev tables."""

import numpy as np
import pytest
from film_reference import WAVELENGTHS, color_weights, complex_fresnel

import lookdev.brdf.conductor as conductor
from lookdev.brdf.conductor import METALS, metal_curve, metal_indices, metal_reflectance
from lookdev.errors import ModelError

# S. Lagarde, Feeding a physically based shading model (2011), and Hoffman's course notes (2019): linear Rec.709.
TABLES = {
    "gold": (1.0, 0.782, 0.344),
    "silver": (0.972, 0.960, 0.915),
    "copper": (0.955, 0.638, 0.538),
    "aluminium": (0.913, 0.922, 0.924),
}


def fitted_observer(wavelengths: np.ndarray) -> np.ndarray:
    """Return x, y and z by the multi-lobe fit of Wyman, Sloan and Shirley, JCGT 2(2) (2013), table 1."""
    x = (1.056, 599.8, 37.9, 31.0), (0.362, 442.0, 16.0, 26.7), (-0.065, 501.1, 20.4, 26.2)
    y = (0.821, 568.8, 46.9, 40.5), (0.286, 530.9, 16.3, 31.1)
    z = (1.217, 437.0, 11.8, 36.0), (0.681, 459.0, 26.0, 13.8)

    def lobe(peak: float, centre: float, below: float, above: float) -> np.ndarray:
        return peak * np.exp(-0.5 * ((wavelengths - centre) / np.where(wavelengths < centre, below, above)) ** 2)

    return np.stack([sum(lobe(*numbers) for numbers in lobes) for lobes in (x, y, z)])


def test_the_observer_is_the_cie_s() -> None:
    # Its authors state errors of up to 0.03.
    np.testing.assert_allclose(conductor._OBSERVER, fitted_observer(conductor._WAVELENGTHS), atol=0.03)
    # The integral of each from 360 to 830 nm is 106.86 nm.
    np.testing.assert_allclose(10.0 * conductor._OBSERVER.sum(axis=1), 106.86, rtol=1e-3)


def test_the_light_is_d65() -> None:
    x, y, z = conductor._OBSERVER @ conductor._D65
    np.testing.assert_allclose((x / y, z / y), (0.95047, 1.08883), rtol=1e-3)


def test_the_primaries_are_those_of_rec709() -> None:
    # ITU-R BT.709: x and y of red, green, blue and white. The inverse of the matrix is rounded to white's four digits.
    corners = ((0.64, 0.33), (0.3, 0.6), (0.15, 0.06), (0.3127, 0.329))
    *primaries, white = (np.array([x / y, 1.0, (1.0 - x - y) / y]) for x, y in corners)
    to_xyz = np.stack(primaries, axis=1)
    to_xyz *= np.linalg.solve(to_xyz, white)
    np.testing.assert_allclose(conductor._XYZ_TO_REC709 @ to_xyz, np.eye(3), atol=6e-4)


@pytest.mark.parametrize("name", METALS)
def test_a_curve_is_what_complex_amplitudes_give(name: str) -> None:
    # Every half nanometre of the visible range; wavelengths beyond the measurements are errors.
    cosines = np.cos(np.radians([0.0, 30.0, 60.0, 75.0, 85.0, 89.0]))[:, None]
    eta, k = metal_indices(name, WAVELENGTHS)
    expected = complex_fresnel(cosines, np.asarray(eta) + 1j * np.asarray(k)) @ color_weights().T
    np.testing.assert_allclose(metal_curve(name, cosines[:, 0]), expected, atol=1e-3)


@pytest.mark.parametrize(("name", "color"), TABLES.items())
def test_metals_look_as_in_the_tables(name: str, color: tuple[float, float, float]) -> None:
    # Measurements of the same metal differ by this much.
    np.testing.assert_allclose(metal_reflectance(name), color, atol=0.03)


def test_white_stays_white(monkeypatch: pytest.MonkeyPatch) -> None:
    # A metal with eta near 0 and no absorption reflects all light.
    mirror = np.array([[380.0, 1e-12, 5.0], [780.0, 1e-12, 5.0]])
    monkeypatch.setattr(conductor, "_load_spectra", lambda: {"silver": mirror})
    np.testing.assert_allclose(metal_reflectance.__wrapped__("silver"), 1.0, rtol=1e-11)


def test_unknown_metals_and_wavelengths_are_errors() -> None:
    with pytest.raises(ModelError, match=r"unknown metal 'gould' \(did you mean 'gold'"):
        metal_reflectance("gould")
    with pytest.raises(ModelError, match="gold: a wavelength is outside 380 to 780 nm"):
        metal_indices("gold", np.array([500.0, 1000.0]))
