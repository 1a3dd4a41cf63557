"""Computes the fits of `lookdev.material.translate.lobes`: ``python -m lookdev.material.translate.fitting``.

Each fit is a rational function of one number from 0 to 1. Five of them are *mean albedos*: means over all views of a
directional albedo, weighted by the square of the view's cosine.

- ``"lost"``: 1 minus the mean albedo of Disney's specular lobe with a Fresnel term of 1, as a function of alpha.
- ``"hidden"``: how much larger the mean albedo of this lobe is with the height-correlated shadowing of other models,
  as a function of alpha.
- ``"sheen"``: the mean albedo of MaterialX's `sheen_bsdf` in mode ``conty_kulla`` (Estevez and Kulla 2017), as a
  function of its roughness.
- ``"fuzz"``: the same in mode ``zeltner`` (Zeltner, Burley and Chiang 2022).
- ``"rough"``: the mean albedo of `oren_nayar_diffuse_bsdf` without energy compensation (Oren and Nayar 1994), as a
  function of its roughness.

``"sheen"``, ``"fuzz"`` and ``"rough"`` use MaterialX's own formulas. The sixth fit, ``"edge"``, is f90, at most 1: the
reflectance at grazing incidence of the Schlick term that is closest to the Fresnel term of a dielectric from 0 to 80
degrees. It is a function of sqrt(f0) / `MIN_SQRT_F0_OF_UNIT_F90`, where f0 is the dielectric's reflectance at normal
incidence. The residual of a fit is its largest error.
"""

from __future__ import annotations

import json
from collections.abc import Callable

import numpy as np

from lookdev.arrays import Floats
from lookdev.brdf.fresnel import schlick_weight
from lookdev.brdf.lobes import DirectionPair
from lookdev.brdf.quadrature import half_vector_grid, hemisphere_grid
from lookdev.closures.rational import Degree, RationalProblem, fit_rational
from lookdev.closures.setups import WHITE, disney_lobe
from lookdev.material.translate.lobes import FITS_FILE, MIN_SQRT_F0_OF_UNIT_F90

_POINTS = np.linspace(0.0, 1.0, 41)  # the arguments at which functions are fitted
_NUMERATOR_DEGREE, _DENOMINATOR_DEGREE = Degree(3, 0, 3), Degree(2, 0, 2)
_CELLS = (48, 32)  # of `half_vector_grid`, along slope and azimuth


def multiple_scattering_energy(alpha: float) -> float:
    """Return 1 minus the mean albedo of Disney's specular lobe: about the light that is scattered several times."""
    return 1.0 - _mean_over_views(lambda view: _lobe_albedo(view, alpha, correlated=False))


def overshadowed_energy(alpha: float) -> float:
    """Return how much larger the lobe's mean albedo is with height-correlated than with separable shadowing.

    See Heitz 2014, section 5.3.
    """
    return _mean_over_views(
        lambda view: _lobe_albedo(view, alpha, correlated=True) - _lobe_albedo(view, alpha, correlated=False)
    )


def _lobe_albedo(view: Floats, alpha: float, *, correlated: bool) -> float:
    """Return the directional albedo of Disney's specular lobe for a direction `view` (3,), with a Fresnel term of 1.

    `correlated` replaces the lobe's separable shadowing by height-correlated shadowing.
    """
    lobe = disney_lobe("specular", view, metallic=1.0, baseColor=WHITE, roughness=np.sqrt(alpha))
    wi, weight = half_vector_grid(view, max(alpha, 0.001), _CELLS)
    energy = np.asarray(lobe.evaluate(DirectionPair.from_directions(view, wi)))[:, 0] * wi[:, 2]
    if correlated:
        # With root = sqrt(1 + alpha^2 tan^2 theta), here `i` for the light and `o` for the view, G1 is 2 / (1 + root).
        # The separable product of both G1 is replaced by G2 = 2 / (root_i + root_o).
        i, o = (np.sqrt(1.0 + alpha * alpha * (1.0 / cosine**2 - 1.0)) for cosine in (wi[:, 2], view[2]))
        energy = energy * 0.5 * (1.0 + i) * (1.0 + o) / (i + o)
    return float(energy @ weight)


def sheen_albedo(roughness: float) -> float:
    """Return the mean albedo of MaterialX's ``conty_kulla`` sheen, which has Estevez and Kulla's distribution."""
    inverse = 1.0 / max(roughness, 0.005)

    def f(d: DirectionPair) -> Floats:
        cosine = np.asarray(d.wm)[..., 2]
        sine2 = np.maximum(1.0 - cosine * cosine, 0.0)
        distribution = (2.0 + inverse) * sine2 ** (0.5 * inverse) / (2.0 * np.pi)
        i, o = d.cos_theta_i, d.cos_theta_o
        return np.asarray(distribution / (4.0 * (i + o - i * o)))

    return _mean_over_views(_albedo_of(f))


def fuzz_albedo(roughness: float) -> float:
    """Return the mean albedo of MaterialX's ``zeltner`` sheen.

    MaterialX fits Zeltner's table of directional albedos by a Gaussian in the view's cosine.
    """
    # `s` is the width, `m` the mean and `o` the offset of the Gaussian, functions of the roughness `y`.
    y = max(roughness, 0.01)
    s = y * (0.0206607 + 1.58491 * y) / (0.0379424 + y * (1.32227 + y))
    m = y * (-0.193854 + y * (-1.14885 + y * (1.7932 - 0.95943 * y * y))) / (0.046391 + y)
    o = y * (0.000654023 + (-0.0207818 + 0.119681 * y) * y) / (1.26264 + y * (-1.92021 + y))
    return _mean_over_views(
        lambda view: float(np.exp(-0.5 * ((view[2] - m) / s) ** 2) / (s * np.sqrt(2.0 * np.pi)) + o)
    )


def oren_nayar_albedo(roughness: float) -> float:
    """Return the mean albedo of Oren and Nayar's diffuse reflection of a white surface."""
    # `a`, `b` and `s` are A, B and the cosine term of Oren and Nayar 1994, with the roughness as their sigma.
    variance = roughness * roughness
    a, b = 1.0 - 0.5 * variance / (variance + 0.33), 0.45 * variance / (variance + 0.09)

    def f(d: DirectionPair) -> Floats:
        i, o = np.asarray(d.cos_theta_i), np.asarray(d.cos_theta_o)
        s = (d.wo * d.wi).sum(axis=-1) - i * o
        return np.asarray((a + b * np.maximum(s, 0.0) / np.maximum(i, o)) / np.pi)

    return _mean_over_views(_albedo_of(f))


def grazing_reflectance(share: float) -> float:
    """Return f90 of the Schlick term that is closest to the Fresnel term of a dielectric, in least squares.

    `share` is sqrt(f0) / `MIN_SQRT_F0_OF_UNIT_F90`.
    """
    root = MIN_SQRT_F0_OF_UNIT_F90 * share
    ior = (1.0 + root) / (1.0 - root)
    # The exact Fresnel equations, with the cosine c of the view and g^2 = ior^2 + c^2 - 1.
    c = np.cos(np.radians(np.linspace(0.0, 80.0, 81)))
    g = np.sqrt(ior * ior + c * c - 1.0)
    exact = 0.5 * ((g - c) / (g + c)) ** 2 * (1.0 + (((g + c) * c - 1.0) / ((g - c) * c + 1.0)) ** 2)
    # Schlick's term is f0 + (f90 - f0) weight, where f0 is the square of `root`.
    weight = np.asarray(schlick_weight(c))
    return min(float(((exact - root * root) * weight).sum() / (weight * weight).sum() + root * root), 1.0)


FUNCTIONS: dict[str, Callable[[float], float]] = {
    "lost": multiple_scattering_energy,
    "hidden": overshadowed_energy,
    "sheen": sheen_albedo,
    "fuzz": fuzz_albedo,
    "rough": oren_nayar_albedo,
    "edge": grazing_reflectance,
}
"""The functions to be fitted, by the name of the fit."""


def make_table() -> dict[str, dict[str, object]]:
    """Compute all fits; return ``"numerator"``, ``"denominator"`` and ``"residual"`` of each by its name."""
    table = {}
    for name, function in FUNCTIONS.items():
        target = np.array([function(float(x)) for x in _POINTS])
        fitted = fit_rational(
            RationalProblem(_POINTS, np.zeros_like(_POINTS), target, np.full(41, 0.001)),
            _NUMERATOR_DEGREE,
            _DENOMINATOR_DEGREE,
        )
        error = np.abs(np.asarray(fitted(_POINTS)) - target).max()
        residual = float(f"{error:.2g}")
        table[name] = {"numerator": fitted.numerator, "denominator": fitted.denominator, "residual": residual}
    return table


def _mean_over_views(albedo: Callable[[Floats], float]) -> float:
    """Return the mean of a directional albedo over all views, weighted by the square of the view's cosine."""
    # Gauss's rule over the cosine from 0 to 1. The weights are normalised: the integral of 3 c^2 is 1.
    x, weight = np.polynomial.legendre.leggauss(16)  # type: ignore[no-untyped-call]
    cosines = 0.5 * (x + 1.0)
    views = np.stack([np.sqrt(1.0 - cosines**2), np.zeros(16), cosines], axis=-1)
    return float(sum(1.5 * w * c * c * albedo(view) for view, c, w in zip(views, cosines, weight, strict=True)))


def _albedo_of(f: Callable[[DirectionPair], Floats]) -> Callable[[Floats], float]:
    """Return the function from a direction (3,) to the viewer to the directional albedo of a BRDF `f`."""
    wi, weight = hemisphere_grid(64)
    return lambda view: float((f(DirectionPair.from_directions(view, wi)) * wi[:, 2]) @ weight)


if __name__ == "__main__":
    FITS_FILE.write_text(json.dumps(make_table(), indent=1) + "\n")
