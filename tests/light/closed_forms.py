"""Irradiance on a plane from lights of radiance 1, in closed form, and by quadrature of a light's own sampling.

- Lambert, Photometria, 1760: polygons.
- Lagarde, de Rousiers, "Moving Frostbite to Physically Based Rendering", 2014, listing 8: spheres, cut by the horizon.
"""

import numpy as np

from lookdev.arrays import Floats
from lookdev.light.base import Emitter


def of_polygon(corners: Floats, point: Floats, normal: Floats) -> float:
    """Return the irradiance at a point from a polygon (N, 3), corners in order, which the horizon may cut."""
    visible: list[Floats] = []
    relative = corners - point
    for here, there in zip(relative, np.roll(relative, -1, axis=0), strict=True):
        above, next_above = here @ normal, there @ normal
        if above > 0.0:
            visible.append(here)
        if above * next_above < 0.0:
            visible.append(here + (there - here) * above / (above - next_above))
    total = 0.0
    for here, there in zip(visible, [*visible[1:], *visible[:1]], strict=True):
        across = np.cross(here, there)
        length = np.linalg.norm(across)
        if length > 0.0:
            total += np.arctan2(length, here @ there) * (across @ normal) / length
    return abs(0.5 * total)


def of_cone(sine: float, cosine: float) -> float:
    """Return the irradiance from a cone: `sine` of its half angle, `cosine` between its axis and the normal."""
    sine2, sine_tilt = sine * sine, np.sqrt(1.0 - cosine * cosine)
    if cosine >= sine:
        return float(np.pi * sine2 * cosine)
    if cosine <= -sine:
        return 0.0
    x = np.sqrt(1.0 / sine2 - 1.0)
    y = -x * cosine / sine_tilt
    flat = sine_tilt * np.sqrt(1.0 - y * y)
    return float((cosine * np.arccos(y) - x * flat) * sine2 + np.arctan(flat / x))


def by_sampling(light: Emitter, point: Floats, normal: Floats, panels: int = 64) -> float:
    """Return the irradiance of the first channel by quadrature of `sample`: Gauss' rule, 8 nodes in each panel."""
    node, weight = np.polynomial.legendre.leggauss(8)
    nodes = ((np.arange(panels)[:, None] + 0.5 + 0.5 * node) / panels).ravel()
    weights = np.tile(0.5 * weight / panels, panels)
    total = 0.0
    for rows, shares in zip(np.array_split(nodes, 4), np.array_split(weights, 4), strict=True):
        u = np.stack(np.meshgrid(nodes, rows), axis=-1).reshape(-1, 2)
        points = np.broadcast_to(point, (len(u), 3))
        wi = light.sample(points, u)
        value, pdf = light.radiance(points, wi)[:, 0] * np.maximum(wi @ normal, 0.0), light.pdf(points, wi)
        drawn = np.divide(value, pdf, out=np.zeros_like(value), where=pdf > 0.0)
        assert (pdf[value > 0.0] > 0.0).all()
        total += float(shares @ drawn.reshape(len(rows), len(nodes)) @ weights)
    return total
