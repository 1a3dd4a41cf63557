"""Directional albedo of the closures that stand for a BSDF, by quadrature; looks as BSDFs at random points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lookdev.brdf import Bsdf
from lookdev.brdf.frames import ZENITH
from lookdev.brdf.quadrature import half_vector_grid, hemisphere_grid
from lookdev.checks.samples import constant_looks
from lookdev.closures import Closure, closure_cosine, lobe_closures
from lookdev.closures.setups import view_at
from lookdev.material import Look
from lookdev.material.values import look_bsdf

Floats = NDArray[np.float64]

CELLS = (32, 32)


def closures_albedo(bsdf: Bsdf, wo: Floats) -> Floats:
    """Return the albedos of the closures of a BSDF for a view (3,): reflected and transmitted, (2, 3)."""
    total = np.zeros((2, 3))
    for lobe in bsdf.lobes(wo):
        for closure in lobe_closures(lobe, wo):
            wi, weight = _directions(closure, wo)
            energy = closure_cosine(closure, wo, wi) * weight[:, None]
            total += [energy[wi[:, 2] > 0.0].sum(axis=0), energy[wi[:, 2] < 0.0].sum(axis=0)]
    return total


def _directions(closure: Closure, wo: Floats) -> tuple[Floats, Floats]:
    width = float(min(closure.alpha_x, closure.alpha_y))
    if closure.kind in ("diffuse", "rough_diffuse", "translucent", "sheen"):
        wi, weight = hemisphere_grid(24)
    elif not closure.transmits:
        wi, weight = half_vector_grid(closure.frame.to_local(wo), width, CELLS)
    else:
        # Light leaves along the microfacets' normals, twice as far from the zenith as its half vectors.
        wi, weight = half_vector_grid(ZENITH, 0.5 * width, CELLS)
    side = -1.0 if closure.transmits else 1.0
    return side * closure.frame.from_local(wi), weight


def view(angle: float, azimuth: float = 0.35) -> Floats:
    """Return a unit direction, from degrees off the normal and radians around it."""
    return view_at(angle, np.degrees(azimuth))


def bsdfs_of(look: Look, points: int, seed: int = 0) -> list[Bsdf]:
    """Return the constant surfaces of a look at random points, or the one where nothing varies."""
    rng = np.random.default_rng(seed)
    return [look_bsdf(each, _Anywhere()) for each in constant_looks(look, points, rng)]


class _Anywhere:
    def handedness(self) -> Floats:
        return np.ones(())
