"""Irradiance on a plane from lights of radiance 1, in closed form, and by quadrature of a light's own sampling.

- Lambert, Photometria, 1760: polygons.
- Lagarde, de Rousiers, "Moving Frostbite to Physically Based Rendering", 2014, listing 8: spheres, cut by the horizon.
"""

import numpy as np
from numpy.typing import NDArray

from lookdev.light import Emitter

Floats = NDArray[np.float64]


def of_polygon(corners: Floats, place: Floats, normal: Floats) -> float:
    """Return the irradiance from a polygon (N, 3) at a place whose horizon cuts it, corners in order."""
    kept: list[Floats] = []
    relative = corners - place
    for here, there in zip(relative, np.roll(relative, -1, axis=0), strict=True):
        above, next_above = here @ normal, there @ normal
        if above > 0.0:
            kept.append(here)
        if above * next_above < 0.0:
            kept.append(here + (there - here) * above / (above - next_above))
    total = 0.0
    for here, there in zip(kept, [*kept[1:], *kept[:1]], strict=True):
        across = np.cross(here, there)
        length = np.linalg.norm(across)
        if length > 0.0:
            total += np.arctan2(length, here @ there) * (across @ normal) / length
    return abs(0.5 * total)


def of_cone(sine: float, cosine: float) -> float:
    """Return the irradiance from a cone of directions, `sine` of half its angle, its axis at `cosine` to the normal."""
    sine2, sine_tilt = sine * sine, np.sqrt(1.0 - cosine * cosine)
    if cosine >= sine:
        return float(np.pi * sine2 * cosine)
    if cosine <= -sine:
        return 0.0
    x = np.sqrt(1.0 / sine2 - 1.0)
    y = -x * cosine / sine_tilt
    flat = sine_tilt * np.sqrt(1.0 - y * y)
    return float((cosine * np.arccos(y) - x * flat) * sine2 + np.arctan(flat / x))


def by_sampling(light: Emitter, place: Floats, normal: Floats, panels: int = 64) -> float:
    """Return the irradiance of the first channel by the light's directions: Gauss' rule of 8 points in each panel."""
    node, weight = np.polynomial.legendre.leggauss(8)
    points = ((np.arange(panels)[:, None] + 0.5 + 0.5 * node) / panels).ravel()
    weights = np.tile(0.5 * weight / panels, panels)
    total = 0.0
    for rows, shares in zip(np.array_split(points, 4), np.array_split(weights, 4), strict=True):
        u = np.stack(np.meshgrid(points, rows), axis=-1).reshape(-1, 2)
        places = np.broadcast_to(place, (len(u), 3))
        wi = light.sample(places, u)
        value, pdf = light.radiance(places, wi)[:, 0] * np.maximum(wi @ normal, 0.0), light.pdf(places, wi)
        drawn = np.divide(value, pdf, out=np.zeros_like(value), where=pdf > 0.0)
        assert (pdf[value > 0.0] > 0.0).all()
        total += float(shares @ drawn.reshape(len(rows), len(points)) @ weights)
    return total
