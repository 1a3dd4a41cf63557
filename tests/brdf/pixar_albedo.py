"""Directional albedo of Pixar's highlight lobes by a quadrature that ends at the horizon.

The integral of ``D F / (4 (cos_i^2 + cos_o^2 - cos_i cos_o)) cos_i`` over the hemisphere, over half vectors instead:
``s = sin^2 theta_h`` and the azimuth phi, ``d omega_i = 4 cos_d d omega_h = 2 cos_d / cos_h ds dphi``. As
``cos_i = cos_o cos 2 theta_h + sin_o sin 2 theta_h cos phi``, directions up to ``s = (1 - sin_o) / 2`` are above the
horizon for all phi, those beyond ``(1 + sin_o) / 2`` for none, and between them phi has a limit. Gauss-Legendre on each
piece, denser within cos_o of the horizon.
"""

import numpy as np
from numpy.typing import ArrayLike

from lookdev.arrays import Floats

# exp(-40) of the distribution is left out.
_REACH = 40.0
_CHUNK = 200


def highlight_albedo(cone: ArrayLike, cosine: ArrayLike, nodes: tuple[int, int] = (40, 16)) -> Floats:
    """Integrate a highlight.

    Parameters
    ----------
    cone, cosine : (...)
        Cone angle in degrees, cosine of the view, above 0.
    nodes
        Of each piece, along s and along phi. With the default the error is below 1e-8 for cones up to 70 degrees and
        views up to 89.9 degrees.

    Returns
    -------
    (2, ...)
        The albedo with F = 1 and with F = (1 - cos_d)^5: that of weights N and G is ``N a[0] + (G - N) a[1]``.
    """
    cone, cosine = np.broadcast_arrays(np.asarray(cone, np.float64), np.asarray(cosine, np.float64))
    pairs = np.stack([cone.ravel(), cosine.ravel()])
    parts = [_integrate(*pairs[:, at : at + _CHUNK], nodes) for at in range(0, pairs.shape[1], _CHUNK)]
    return np.concatenate([np.zeros((2, 0)), *parts], axis=1).reshape(2, *cone.shape)


def _gauss(count: int) -> tuple[Floats, Floats]:
    x, weight = np.polynomial.legendre.leggauss(count)
    return 0.5 * (x + 1.0), 0.5 * weight


def _integrate(cone: Floats, cosine: Floats, nodes: tuple[int, int]) -> Floats:
    o = cosine[:, None, None]
    power = np.log(10.0) / np.sin(np.radians(cone[:, None, None])) ** 2
    sin_o = np.sqrt((1.0 - o) * (1.0 + o))
    first = 0.5 * o * o / (1.0 + sin_o)  # (1 - sin_o) / 2 without cancellation; (1 + sin_o) / 2 is 1 - first
    (x, dx), (y, dy) = (_gauss(count) for count in nodes)
    x, dx = x[:, None], dx[:, None]

    end = np.minimum(first, _REACH / power)
    whole = _piece(o, sin_o, power, end * x, 1.0 - end * x, end * dx, np.pi * y, np.pi * dy)

    def remapped(end: Floats) -> tuple[Floats, Floats]:
        length = np.log(end / first)
        s = first * np.exp(length * x * x)
        return s, s * 2.0 * length * x * dx

    near, near_weight = remapped(np.minimum(0.5, first + _REACH / power))
    far, far_weight = remapped(np.asarray(0.5))
    cut = (
        _piece(o, sin_o, power, s, cos2, weight, *_up_to_horizon(o, sin_o, s, cos2, y, dy))
        for s, cos2, weight in ((near, 1.0 - near, near_weight), (1.0 - far, far, far_weight))
    )
    return sum(cut, whole)


def _up_to_horizon(o: Floats, sin_o: Floats, s: Floats, cos2: Floats, y: Floats, dy: Floats) -> tuple[Floats, Floats]:
    """Return azimuths from 0 to where cos_i is 0, denser there, and their weights."""
    slope = 2.0 * sin_o * np.sqrt(s * cos2)
    last = np.arccos(np.clip(-o * (cos2 - s) / np.maximum(slope, 1e-300), -1.0, 1.0))
    width = o / np.maximum(slope, 1e-300)
    reach = np.arcsinh(last / width)
    return last - width * np.sinh(reach * y), width * np.cosh(reach * y) * reach * dy


def _piece(
    o: Floats, sin_o: Floats, power: Floats, s: Floats, cos2: Floats, ds: Floats, phi: Floats, dphi: Floats
) -> Floats:
    i = np.maximum(o * (cos2 - s) + 2.0 * sin_o * np.sqrt(s * cos2) * np.cos(phi), 0.0)
    cos_d = (i + o) / (2.0 * np.sqrt(cos2))
    # Both halves of the azimuth; cos_d / cos_h is (i + o) / (2 cos^2 theta_h).
    value = i * (i + o) / (i * i - i * o + o * o) * dphi
    weight = power / -np.expm1(-power) * np.exp(-power * s) * ds / (2.0 * np.pi * cos2)
    grazing = np.maximum(1.0 - cos_d, 0.0) ** 5
    return np.stack([(value * weight).sum(axis=(1, 2)), (value * grazing * weight).sum(axis=(1, 2))])
