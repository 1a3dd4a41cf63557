"""Iridescence: the reflectance of a surface under a thin film of a clear dielectric, for Disney's specular lobe.

Light that has crossed the film m times, there and back, interferes with the light that the film's upper face reflects.
Airy's sum adds the amplitudes of all orders m, separately for each polarisation. The CIE 1931 observer under D65
converts the resulting spectrum to linear Rec.709. A film of index 1, or of no thickness, has no effect.

Two kinds of surfaces can be under the film:

- Of a surface in general, only the reflectance without a film is known, at the same angle of incidence. The
  amplitudes that the surface reflects are assumed to have the phase that they have for a dielectric, and to be the same
  for both polarisations.
- Of a metal, the complex index of refraction is known. The metal reflects the complex amplitudes of Fresnel's equations
  between film and metal, as in Belcour and Barla, section 3.

The terms of Airy's sum have the colours of the spectra ``cos(2 pi m x / wavelength)``, where x is the optical path
through the film and back. These colours are functions of m x alone. There are two approximations. The observer under
D65 is a sum of Gaussians, evenly spaced in wavenumber, so that each colour is a sum of damped cosines of m x. The
series ends at m = 10. docs/models.md has the errors of both.

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

_ORDER_COUNT = 10  # the largest m of the series

# Wavenumbers in 1/nm of the Gaussians' centres, their standard deviation, and their weights in red, green and blue. The
# weights fit the colours of ``cos(2 pi x / wavelength)``, for x up to 16 micrometres, by least squares. The sum of each
# channel is fixed to 1.
_CENTRES = np.linspace(1.0 / 645.0, 1.0 / 425.0, 10)
_WIDTH = 0.65 * (_CENTRES[1] - _CENTRES[0])
_WEIGHTS = np.array([
    [0.1402, -0.0166, 0.0002], [0.9664, -0.0852, -0.0095], [0.3932, 0.2343, -0.0349], [-0.0876, 0.4342, -0.0549],
    [-0.3003, 0.3822, -0.0265], [-0.1261, 0.1064, 0.0284], [-0.0704, 0.0446, 0.1648], [0.0125, -0.0353, 0.4430],
    [0.0528, -0.0462, 0.3632], [0.0193, -0.0184, 0.1262],
])  # fmt: skip


def film_reflectance(bare: Array, cos_theta: Array, thickness: Real, ior: Real) -> Array:
    """Return the reflectance (..., 3), in [0, 1], of a surface under a film, in air.

    bare : (..., 3), reflectance of the surface without the film, at the same angle. Values above 1 count as 1.
    cos_theta : (...), cosine of the angle of incidence.
    thickness : (...), in nanometres.
    ior : (...), index of refraction of the film, at least 1.
    """
    cos_theta, inside = _cosines(cos_theta, ior)
    colors = _path_colors(2.0 * inside * thickness)
    root = np.sqrt(np.minimum(bare, 1.0))
    bare_ratio = (1.0 - root) / (1.0 + root)  # the ratio of admittances of the bare surface, for the amplitude -root
    total: Real = 0.0
    # An amplitude r can be written as a ratio of admittances, (1 + r) / (1 - r). The product of both faces' ratios is
    # the ratio of the bare surface. For each polarisation, a is the ratio of the film's upper face, and b the ratio of
    # the lower face. In Airy's sum, `incoherent` is the part without interference.
    for upper_ratio in (cos_theta / inside, inside / (ior * ior * cos_theta)):
        a = np.expand_dims(upper_ratio, -1)
        b = bare_ratio / a
        one_minus_b, denominator = 1.0 - b, (1.0 + bare_ratio) * (a + b)
        incoherent = (a * one_minus_b * one_minus_b + b * (1.0 - a) * (1.0 - a)) / denominator
        transmitted = 4.0 * bare_ratio / denominator
        product = (a - 1.0) * one_minus_b / ((a + 1.0) * (1.0 + b))
        # `series` is a power series in -r s, where r and s are the amplitudes of both faces. Horner's rule sums it.
        series: Real = 0.0
        for color, _ in reversed(colors):
            series = product * (color + series)
        total = total + 0.5 * (incoherent - 2.0 * transmitted * series)
    reflectance: Array = np.clip(total, 0.0, 1.0)
    return reflectance


def metal_film_reflectance(eta: Array, k: Array, cos_theta: Array, thickness: Real, ior: Real) -> Array:
    """Return the reflectance (..., 3), in [0, 1], of a metal under a film, in air.

    eta, k : (..., 3), real and imaginary part of the metal's index of refraction, by channel.
    cos_theta, thickness, ior : as in `film_reflectance`.
    """
    cos_theta, inside = _cosines(cos_theta, ior)
    colors = _path_colors(2.0 * inside * thickness)
    c, film, square = (np.expand_dims(quantity, -1) for quantity in (cos_theta, inside, ior * ior))
    # u + iv is the metal's index times the cosine of the refracted angle.
    u, v = square_root((eta - 1.0) * (eta + 1.0) - k * k + c * c, eta * k)
    # The amplitude at a face is (p - q) / (p + q). At the film's upper face, p and q are the real numbers `over` and
    # `under`. At the lower face, they are the complex numbers a + i ia and b + i ib.
    perpendicular = c, film, (film, 0.0), (u, v)
    parallel = film, square * c, (square * u, square * v), (film * (eta - k) * (eta + k), 2.0 * film * eta * k)
    total: Real = 0.0
    for over, under, (a, ia), (b, ib) in (perpendicular, parallel):
        # The amplitude and the transmitted share at the upper face, and the reflected and absorbed shares at the lower.
        amplitude = (over - under) / (over + under)
        transmitted = 4.0 * (over / (over + under)) * (under / (over + under))
        norm = np.maximum((a + b) * (a + b) + (ia + ib) * (ia + ib), TINY * TINY)
        reflected, absorbed = ((a - b) * (a - b) + (ia - ib) * (ia - ib)) / norm, 4.0 * (a * b + ia * ib) / norm
        squared = amplitude * amplitude
        denominator = np.maximum(transmitted + squared * absorbed, TINY)
        # The series is a power series in -r s, where r and s are the complex amplitudes of both faces: `real` and
        # `imaginary` are the parts of -r s. Horner's rule sums it.
        real = amplitude * ((b - a) * (b + a) + (ib - ia) * (ib + ia)) / norm
        imaginary = amplitude * 2.0 * (a * ib - ia * b) / norm
        series: Real = 0.0
        iseries: Real = 0.0
        for cosine, sine in reversed(colors):
            next_real, next_imaginary = cosine + series, sine + iseries
            series = real * next_real - imaginary * next_imaginary
            iseries = real * next_imaginary + imaginary * next_real
        total = (
            total
            + 0.5 * (transmitted * reflected + squared * absorbed - 2.0 * transmitted * absorbed * series) / denominator
        )
    reflectance: Array = np.clip(total, 0.0, 1.0)
    return reflectance


def _cosines(cos_theta: Array, ior: Real) -> tuple[Array, Array]:
    """Return the cosine of incidence, above 0, and `ior` times the cosine of the angle inside the film."""
    cos_theta = np.maximum(cos_theta, TINY)
    return cos_theta, np.sqrt((ior - 1.0) * (ior + 1.0) + cos_theta * cos_theta)


def _path_colors(path: Array) -> list[tuple[Array, Array]]:
    """Return, for each order m from 1, the colours (..., 3) of cosine and sine of ``2 pi m path / wavelength``.

    Optical paths (...) are in nanometres.
    """
    decay = 2.0 * np.square(np.pi * _WIDTH * path)
    phases = [2.0 * np.pi * centre * path for centre in _CENTRES]
    waves = [(np.cos(phase), np.sin(phase)) for phase in phases]
    # For each Gaussian, `waves` has the cosine and sine of m times the phase, for the order m of the loop. `previous`
    # has them for m - 1.
    doubled, previous = [2.0 * cosine for cosine, _ in waves], [(1.0 + 0.0 * path, 0.0 * path) for _ in waves]
    colors = []
    for order in range(1, _ORDER_COUNT + 1):
        envelope = np.expand_dims(np.exp(-float(order * order) * decay), -1)
        cosine, sine = (
            envelope
            * sum(np.expand_dims(phase[part], -1) * weight for phase, weight in zip(waves, _WEIGHTS, strict=True))
            for part in (0, 1)
        )
        colors.append((cosine, sine))
        # Chebyshev's recurrence for cosines and sines of multiples of an angle.
        waves, previous = (
            [(t * c - a, t * s - b) for t, (c, s), (a, b) in zip(doubled, waves, previous, strict=True)],
            waves,
        )
    return colors
