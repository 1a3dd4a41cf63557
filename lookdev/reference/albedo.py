"""Directional albedo: the share of uniform light from a side of a surface that the surface scatters to a viewer.

There are two independent estimators. One is importance sampling by the BSDF. The other is a quadrature, which uses
neither the BSDF's sampling nor its pdf, only its values. Light that passes where the surface is absent is not included.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import qmc

from lookdev.arrays import Floats
from lookdev.brdf import Bsdf, Lobe, bsdf_for_views, evaluate_cosine, pdf, sample
from lookdev.brdf.frames import mirror_across_surface
from lookdev.brdf.quadrature import half_vector_grid

# The smallest alpha of a microfacet distribution that the models allow; the quadrature must resolve its highlight.
_MIN_ALPHA = 0.001
CELLS = (128, 96)
"""The numbers of cells of the quadrature's grid of half vectors, along slope and along azimuth."""


@dataclass(frozen=True, eq=False)
class Albedo:
    """The albedo of a surface for one view; `value` and `error` have the shape (2, 3).

    The axes are the side (reflected, transmitted) and the channel. The errors are differences between two grids for the
    quadrature, and standard errors for sampling.
    """

    value: Floats
    error: Floats


def integrate_albedo(bsdf: Bsdf, wo: Floats, cells: tuple[int, int] = CELLS) -> Albedo:
    """Integrate f times the cosine over all directions to the light by quadrature, for constant parameters.

    Parameters
    ----------
    wo : (3,)
        Unit direction to the viewer, above the horizon.
    cells
        The numbers of cells of the grid of half vectors, along slope and azimuth, both even. The error is the
        difference from a grid with half of these numbers.
    """
    fine, coarse = (_quadrature(bsdf, wo, (cells[0] // divisor, cells[1] // divisor)) for divisor in (1, 2))
    return Albedo(fine, np.abs(fine - coarse))


def sample_albedo(bsdf: Bsdf, wo: Floats, samples: int, scrambles: int, rng: np.random.Generator) -> Albedo:
    """Estimate the albedo for the view `wo` (3,) by the BSDF's own samples and pdf.

    Each of `scrambles` independent sets has `samples` Sobol points, a power of two. The spread of the sets gives the
    standard error.
    """
    u = np.stack([qmc.Sobol(2, rng=generator).random(samples) for generator in rng.spawn(scrambles)])
    view = np.broadcast_to(wo, (*u.shape[:2], 3))
    bsdf = bsdf_for_views(bsdf, wo)
    wi = sample(bsdf, view, u)
    density = pdf(bsdf, view, wi)
    is_sampled = density > 0.0
    weight = evaluate_cosine(bsdf, view, wi) / np.where(is_sampled, density, 1.0)[..., None] * is_sampled[..., None]
    above = (wi[..., 2:] > 0.0).astype(np.float64)
    below = (1.0 - above) * bsdf.transmits(view)
    sets = np.stack([weight * above, weight * below]).mean(axis=2)
    return Albedo(sets.mean(axis=1) + _delta_albedo(bsdf, wo), sets.std(axis=1, ddof=1) / np.sqrt(scrambles))


def _delta_albedo(bsdf: Bsdf, wo: Floats) -> Floats:
    """Return the reflected and transmitted albedo, (2, 3), of the terms that scatter along single directions."""
    total = np.zeros((2, 3))
    for delta in bsdf.deltas(wo, np.asarray(False)):
        total[int(delta.transmits)] += np.asarray(delta.value) * (np.asarray(delta.direction)[2] != 0.0)
    return total


def _quadrature(bsdf: Bsdf, wo: Floats, cells: tuple[int, int]) -> Floats:
    """Return the albedo (2, 3) by quadrature, lobe by lobe, on a grid of half vectors with `cells` cells."""
    total = np.zeros((2, 3))
    for lobe in bsdf.lobes(wo):
        view = np.asarray(lobe.frame.to_local(wo))
        if view[2] > 0.0:
            wi, weight = half_vector_grid(_refract_view(lobe, view), _MIN_ALPHA, cells)
            # In its own frame, a lobe scatters into the upper hemisphere. A transmitting lobe is mirrored afterwards.
            wi = np.asarray(lobe.frame.from_local(mirror_across_surface(wi) if lobe.transmits else wi))
            single_lobe = replace(bsdf, lobes=lambda _, lobe=lobe: (lobe,))  # type: ignore[misc]
            value, below = evaluate_cosine(single_lobe, wo, wi) * weight[:, None], wi[:, 2] < 0.0
            total += value[~below].sum(axis=0), value[below].sum(axis=0)
    total[1] *= bsdf.transmits(wo)
    return total + _delta_albedo(bsdf, wo)


def _refract_view(lobe: Lobe, view: Floats) -> Floats:
    """Return the view (3,) whose mirror direction is the middle of a lobe; only transmitting lobes change it.

    The grid of half vectors is dense about this mirror direction. The middle of a transmitting lobe is estimated from
    256 samples of the lobe: refraction bends the middle away from the mirror direction of the original view.
    """
    if not lobe.transmits:
        return view
    # The second coordinate has multiples of the golden ratio, which are evenly spread modulo 1.
    u = (np.arange(256) + 0.5) / 256
    directions = np.asarray(lobe.sample(u, (np.arange(256) * 0.6180339887498949) % 1.0))
    mean = np.broadcast_to(directions, (256, 3)).mean(axis=0) * (-1.0, -1.0, 1.0)
    return np.asarray(mean / np.linalg.norm(mean))
