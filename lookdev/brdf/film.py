"""Iridescence: a thin film of a clear dielectric on a surface whose reflectance, or index, is known, in colour.

Light that has crossed the film m times interferes with what the film's face reflects. Its amplitudes are summed to all
orders (Airy), once for each polarisation; spectra become colour by the CIE 1931 observer under D65, linear Rec.709.
Without an index of its own, a film has no effect, nor has one of no thickness.

A surface whose reflectance alone is known reflects amplitudes of the phase of a dielectric's, the same for both
polarisations, and its reflectance without a film is what it is at the same angle. A metal of an index of refraction
reflects the complex amplitudes of Fresnel's equations between film and metal, as in Belcour and Barla, section 3.

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

from lookdev.brdf.fresnel import square_root
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
    cos_theta, inside = _cosines(cos_theta, ior)
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
        for color, _ in reversed(colors):
            series = product * (color + series)
        total = total + 0.5 * (incoherent - 2.0 * transmitted * series)
    reflectance: Array = np.clip(total, 0.0, 1.0)
    return reflectance


def metal_film_reflectance(eta: Array, k: Array, cos_theta: Array, thickness: Real, ior: Real) -> Array:
    """Return the reflectance (..., 3), in [0, 1], of a metal under a film, in air.

    eta, k : (..., 3), of the metal, by channel.
    cos_theta, thickness, ior : as of `film_reflectance`.
    """
    cos_theta, inside = _cosines(cos_theta, ior)
    colors = _path_colors(2.0 * inside * thickness)
    c, film, square = (np.expand_dims(each, -1) for each in (cos_theta, inside, ior * ior))
    # u + iv is the metal's index times the cosine in it.
    u, v = square_root((eta - 1.0) * (eta + 1.0) - k * k + c * c, eta * k)
    # Amplitudes are (a - b) / (a + b): at the upper face both are real, at the lower one a + ia' and b + ib'.
    perpendicular = c, film, (film, 0.0), (u, v)
    parallel = film, square * c, (square * u, square * v), (film * (eta - k) * (eta + k), 2.0 * film * eta * k)
    total: Real = 0.0
    for over, under, (a, ia), (b, ib) in (perpendicular, parallel):
        amplitude = (over - under) / (over + under)
        enters = 4.0 * (over / (over + under)) * (under / (over + under))
        norm = np.maximum((a + b) * (a + b) + (ia + ib) * (ia + ib), TINY * TINY)
        reflected, absorbed = ((a - b) * (a - b) + (ia - ib) * (ia - ib)) / norm, 4.0 * (a * b + ia * ib) / norm
        twice = amplitude * amplitude
        both = np.maximum(enters + twice * absorbed, TINY)
        # By powers of minus the product of the faces' amplitudes.
        real = amplitude * ((b - a) * (b + a) + (ib - ia) * (ib + ia)) / norm
        imaginary = amplitude * 2.0 * (a * ib - ia * b) / norm
        series: Real = 0.0
        iseries: Real = 0.0
        for cosine, sine in reversed(colors):
            next_real, next_imaginary = cosine + series, sine + iseries
            series = real * next_real - imaginary * next_imaginary
            iseries = real * next_imaginary + imaginary * next_real
        total = total + 0.5 * (enters * reflected + twice * absorbed - 2.0 * enters * absorbed * series) / both
    reflectance: Array = np.clip(total, 0.0, 1.0)
    return reflectance


def _cosines(cos_theta: Array, ior: Real) -> tuple[Array, Array]:
    """Return the cosine of incidence, above 0, and ior times the cosine in the film."""
    cos_theta = np.maximum(cos_theta, TINY)
    return cos_theta, np.sqrt((ior - 1.0) * (ior + 1.0) + cos_theta * cos_theta)


def _path_colors(path: Array) -> list[tuple[Array, Array]]:
    """Return the colours (..., 3) of cosine and sine of ``2 pi m path / wavelength`` for each order m.

    Paths (...) are in nanometres.
    """
    decay = 2.0 * np.square(np.pi * _WIDTH * path)
    waves = [2.0 * np.pi * centre * path for centre in _CENTRES]
    now = [(np.cos(wave), np.sin(wave)) for wave in waves]
    twice, before = [2.0 * cosine for cosine, _ in now], [(1.0 + 0.0 * path, 0.0 * path) for _ in now]
    colors = []
    for order in range(1, _ORDERS + 1):
        fades = np.expand_dims(np.exp(-float(order * order) * decay), -1)
        cosine, sine = (
            fades * sum(np.expand_dims(wave[part], -1) * weight for wave, weight in zip(now, _WEIGHTS, strict=True))
            for part in (0, 1)
        )
        colors.append((cosine, sine))
        # Chebyshev's recurrence for cosines and sines of multiples.
        now, before = (
            [(t * c - a, t * s - b) for t, (c, s), (a, b) in zip(twice, now, before, strict=True)],
            now,
        )
    return colors
