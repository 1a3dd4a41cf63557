"""Iridescence: a thin film of a clear dielectric on a surface whose reflectance is known, in colour.

Light that has crossed the film m times interferes with what the film's face reflects. Its amplitudes are summed to all
orders (Airy), once for each polarisation; spectra become colour by the CIE 1931 observer under D65, linear Rec.709. A
surface reflects amplitudes of the phase of a dielectric's, the same for both polarisations, and its reflectance without
a film is what it is at the same angle: without an index of its own, a film has no effect, nor has one of no thickness.

The series of Airy's sum over m has the colours of ``cos(2 pi m x / wavelength)``, x being the optical path: functions
of m x alone, here sums of Gaussians of wavenumber, evenly spaced. Two approximations remain: those sums, and that the
series ends. docs/models.md has their errors.

- Airy, G. B. 1833. On the phenomena of Newton's rings when formed between two transparent substances of different
  refractive powers. Philosophical Magazine 2.
- Born, M. and Wolf, E. Principles of Optics, section 7.6.
- Belcour, L. and Barla, P. 2017. A Practical Extension to Microfacet Theory for the Modeling of Varying Iridescence.
  ACM TOG 36(4).
- Burley, B. 2012. Physically Based Shading at Disney, section 6.3.
"""

from __future__ import annotations

import numpy as np

from lookdev.brdf.vectors import TINY, Array, Real

_ORDERS = 10

# Wavenumbers in 1/nm of the Gaussians' centres, their standard deviation, and their weights in red, green and blue:
# least squares of the colours of ``cos(2 pi x / wavelength)`` for x up to 16 micrometres, their sum fixed to 1.
_CENTRES = np.linspace(1.0 / 645.0, 1.0 / 425.0, 10)
_WIDTH = 0.65 * (_CENTRES[1] - _CENTRES[0])
_WEIGHTS = np.array([
    [0.1402, -0.0166, 0.0002], [0.9664, -0.0852, -0.0095], [0.3932, 0.2343, -0.0349], [-0.0876, 0.4342, -0.0549],
    [-0.3003, 0.3822, -0.0265], [-0.1261, 0.1064, 0.0284], [-0.0704, 0.0446, 0.1648], [0.0125, -0.0353, 0.4430],
    [0.0528, -0.0462, 0.3632], [0.0193, -0.0184, 0.1262],
])  # fmt: skip


def film_reflectance(bare: Array, cos_theta: Array, thickness: Real, ior: Real) -> Array:
    """Return the reflectance (..., 3), in [0, 1], of a surface under a film, in air.

    bare : (..., 3), reflectance of the surface without the film, at the same angle; above 1 it counts as 1.
    cos_theta : (...), cosine of the angle of incidence.
    thickness : (...), in nanometres.
    ior : (...), index of refraction of the film, at least 1.
    """
    cos_theta = np.maximum(cos_theta, TINY)
    # ior times the cosine in the film.
    inside = np.sqrt((ior - 1.0) * (ior + 1.0) + cos_theta * cos_theta)
    colors = _path_colors(2.0 * inside * thickness)
    root = np.sqrt(np.minimum(bare, 1.0))
    whole = (1.0 - root) / (1.0 + root)
    total: Real = 0.0
    # An amplitude r as the ratio (1 + r) / (1 - r) of admittances: those of successive faces are multiplied.
    for face in (cos_theta / inside, inside / (ior * ior * cos_theta)):
        a = np.expand_dims(face, -1)
        b = whole / a
        below, both = 1.0 - b, (1.0 + whole) * (a + b)
        incoherent = (a * below * below + b * (1.0 - a) * (1.0 - a)) / both
        transmitted = 4.0 * whole / both
        product = (a - 1.0) * below / ((a + 1.0) * (1.0 + b))
        # By powers of minus the product of the faces' amplitudes.
        series: Real = 0.0
        for color in reversed(colors):
            series = product * (color + series)
        total = total + 0.5 * (incoherent - 2.0 * transmitted * series)
    reflectance: Array = np.clip(total, 0.0, 1.0)
    return reflectance


def _path_colors(path: Array) -> list[Array]:
    """Return the colours (..., 3) of ``cos(2 pi m path / wavelength)`` for each order m; paths (...) in nanometres."""
    decay = 2.0 * np.square(np.pi * _WIDTH * path)
    now = [np.cos(2.0 * np.pi * centre * path) for centre in _CENTRES]
    twice, before = [2.0 * cosine for cosine in now], [1.0 + 0.0 * path for _ in now]
    colors = []
    for order in range(1, _ORDERS + 1):
        summed = sum(np.expand_dims(cosine, -1) * weight for cosine, weight in zip(now, _WEIGHTS, strict=True))
        colors.append(np.expand_dims(np.exp(-float(order * order) * decay), -1) * summed)
        # Chebyshev's recurrence for cosines of multiples.
        now, before = [t * n - b for t, n, b in zip(twice, now, before, strict=True)], now
    return colors
