"""Evaluate and sample a BSDF: the sum of its lobes, their pdf, and the selection of a lobe for a sample.

The class `Mixture` defines all of these. The functions of this module call it with arrays of numbers. Code generation
traces it, and adds only branches that skip absent lobes.
"""

from __future__ import annotations

import functools
import operator
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lookdev.arrays import Floats
from lookdev.brdf.frames import ZENITH
from lookdev.brdf.lobes import Bsdf, DirectionPair, Lobe
from lookdev.brdf.vectors import TINY, Array, BooleanArray, Real, normalize, scale

ONE_MINUS_EPSILON = 0.99999994
"""The largest float32 below 1, to which uniform numbers are clamped."""


@dataclass(frozen=True)
class LobeTerms:
    """The terms of one lobe in the sums of a mixture, for the directions to viewer and light.

    directions
        The two directions in the lobe's frame.
    valid : (...)
        Whether both directions are on the sides on which the lobe scatters. Elsewhere `f` and `cosine` have no meaning.
    f : (..., 3)
        The lobe's f in 1/sr, without the cosine, times `Lobe.weight`.
    cosine : (...)
        The cosine of the light's direction to the lobe's normal.
    density : (...)
        The lobe's share times the pdf of its samples, 0 where not valid.
    """

    lobe: Lobe
    directions: DirectionPair
    valid: BooleanArray
    f: Array
    cosine: Array
    density: Array

    @property
    def value(self) -> Array:
        """The product of f and the cosine, (..., 3), 0 where not valid."""
        return scale(self.f, np.where(self.valid, self.cosine, 0.0))


@dataclass(frozen=True)
class LobeChoice:
    """A lobe of a mixture, and the interval of uniform numbers that select it.

    The intervals of the lobes divide [0, 1) in proportion to the shares.

    is_below_end : (...)
        Whether a number is below the end of the lobe's interval. A number selects the first lobe for which this is
        true.
    remapped : (...)
        The position of the number in the interval, in [0, 1). The lobe is sampled with it, so that stratified numbers
        stay stratified within each lobe.
    """

    lobe: Lobe
    is_below_end: BooleanArray
    remapped: Array


@dataclass(frozen=True)
class Mixture:
    """The lobes of a surface for given views, as a sum, and as a distribution from which directions are drawn.

    `wo` (..., 3) are unit directions to the viewer, above the horizon. Lobes are selected in proportion to their
    shares.
    """

    lobes: Sequence[Lobe]
    wo: Array

    @property
    def total_share(self) -> Real:
        """The sum of the shares, (...)."""
        return functools.reduce(operator.add, (lobe.share for lobe in self.lobes), 0.0)

    def terms(self, wi: Array) -> Iterator[LobeTerms]:
        """Yield the terms of each lobe for light from unit directions `wi`, (..., 3)."""
        pairs: dict[tuple[int, bool], tuple[DirectionPair, BooleanArray]] = {}
        for lobe in self.lobes:
            key = id(lobe.frame), lobe.transmits
            if key not in pairs:
                pairs[key] = _directions(lobe, self.wo, wi)
            directions, valid = pairs[key]
            f = scale(lobe.evaluate(directions), lobe.weight)
            # A single lobe has probability 1, unless its share is 0.
            share = lobe.share if len(self.lobes) > 1 else np.where(lobe.share > 0.0, 1.0, 0.0)
            density = np.where(valid, share * lobe.pdf(directions), 0.0)
            yield LobeTerms(lobe, directions, valid, f, directions.cos_theta_i, density)

    def normalise(self, density: Array) -> Array:
        """Return the pdf (...) of the mixture from the sum of the densities of its terms."""
        if len(self.lobes) < 2:
            return density
        return density / np.where(self.total_share > 0.0, self.total_share, 1.0)

    def choices(self, u: Array) -> Iterator[LobeChoice]:
        """Yield the lobes with their intervals for uniform numbers `u` (...), in the order of the intervals."""
        if len(self.lobes) == 1:
            yield LobeChoice(self.lobes[0], self.lobes[0].share + 0.0 * u > 0.0, u)
            return
        # `position` is the number, `offset` its distance from the beginning of a lobe's interval, and `upper` the end
        # of the interval. All three are in units of the shares.
        position = u * self.total_share
        offset, upper = position, 0.0
        for lobe in self.lobes:
            upper = upper + lobe.share  # type: ignore[assignment]
            width = np.where(lobe.share > 0.0, lobe.share, 1.0)
            # The clip before the division keeps it from overflowing. The minimum after it is for a quotient that is
            # rounded to 1.
            remapped = np.minimum(np.clip(offset, 0.0, width) / width, ONE_MINUS_EPSILON)
            yield LobeChoice(lobe, position < upper, remapped)
            offset = offset - lobe.share

    def response(self, wi: Array) -> tuple[Array, Array]:
        """Return f times the cosine (..., 3), summed over the lobes, and the pdf (...) of directions `wi` (..., 3)."""
        total: Array = np.zeros(3)
        density: Array = np.zeros(())
        for term in self.terms(wi):
            total, density = total + term.value, density + term.density
        return total, self.normalise(density)

    def draw(self, u1: Array, u2: Array) -> Array:
        """Draw directions to the light (..., 3) by uniform numbers (...).

        The first number also selects a lobe. If the lobe's f is 0 in a direction, z of the direction is 0.
        """
        wi: Array = np.zeros(3)
        remaining: BooleanArray = np.ones((), np.bool_)
        # A number that is rounded to 1 in float32 would be beyond the last interval.
        for choice in self.choices(np.minimum(u1, ONE_MINUS_EPSILON)):
            is_selected = remaining & choice.is_below_end
            wi = np.where(np.expand_dims(is_selected, -1), choice.lobe.draw(choice.remapped, u2), wi)
            remaining = remaining & ~is_selected
        return wi


def estimate_albedo(mixture: Mixture) -> Array:
    """Return an estimate (..., 3) of the directional albedo, which has no noise.

    Each lobe adds ``f cos / pdf`` of one sample, which is drawn with the uniform numbers (0.5, 0.5). The estimate is
    exact for lobes whose pdf is proportional to f times the cosine.
    """
    total: Array = np.zeros(3)
    for lobe in mixture.lobes:
        lobe_mixture = Mixture([lobe], mixture.wo)
        (term,) = lobe_mixture.terms(lobe.draw(*np.full(2, 0.5)))
        has_density = term.density > 0.0
        total = total + scale(term.value, np.where(has_density, 1.0, 0.0) / np.where(has_density, term.density, 1.0))
    return total


def mean_normal(mixture: Mixture) -> Array:
    """Return the mean normal of the lobes, weighted by their shares: unit vectors (..., 3) in the shading frame."""
    total: Array = np.zeros(3)
    for lobe in mixture.lobes:
        total = total + scale(lobe.frame.normal, lobe.share)
    return normalize(total)


def _directions(lobe: Lobe, wo: Array, wi: Array) -> tuple[DirectionPair, BooleanArray]:
    """Return a pair of directions in the frame of a lobe, and the mask (...) `LobeTerms.valid`.

    Directions that are not valid are replaced by the normal, so that the lobe's functions can be called.
    """
    local_o, local_i = lobe.local_directions(wo, wi)
    below, above = wi[..., 2] < 0.0, wi[..., 2] > 0.0
    valid = below | above if lobe.crosses_surface else below if lobe.transmits else above
    if lobe.is_tilted:
        valid = valid & (local_o[..., 2] > 0.0) & (local_i[..., 2] > 0.0)
    mask = np.expand_dims(valid, -1)
    return DirectionPair.from_directions(np.where(mask, local_o, ZENITH), np.where(mask, local_i, ZENITH)), valid


def _mixture_for_view(bsdf: Bsdf, wo: Array, wi: Array) -> tuple[Mixture, Array, BooleanArray]:
    """Return the mixture for views, the directions to the light, and the mask (...) of views above the horizon.

    For a two-sided BSDF, views from below and their directions to the light are negated first. Views that are still
    below are replaced by the normal.
    """
    if bsdf.two_sided:
        behind = wo[..., 2:] < 0.0
        wo, wi = np.where(behind, -wo, wo), np.where(behind, -wi, wi)
    above = wo[..., 2] > 0.0
    wo = np.where(np.expand_dims(above, -1), wo, ZENITH)
    return Mixture(bsdf.lobes(wo), wo), wi, above


def bsdf_for_views(bsdf: Bsdf, wo: Floats) -> Bsdf:
    """Return the BSDF with its lobes already computed for views (..., 3), for several calls with these views.

    The views are above the horizon, unless the BSDF is two-sided.
    """
    lobes = bsdf.lobes(np.where(wo[..., 2:] < 0.0, -wo, wo) if bsdf.two_sided else wo)
    return replace(bsdf, lobes=lambda _: tuple(lobes))


def evaluate(bsdf: Bsdf, wo: Floats, wi: Floats) -> Floats:
    """Return f (..., 3) in 1/sr, without the cosine, for unit directions to the viewer and to the light, (..., 3).

    z is along the shading normal. f is exactly 0 where either direction is on the horizon. The f of a lobe with another
    normal is multiplied by the cosine of `wi` to that normal, and divided by the cosine to the shading normal.
    """
    mixture, light, above = _mixture_for_view(bsdf, wo, wi)
    cosine = np.abs(light[..., 2])
    total: Array = np.zeros(np.broadcast_shapes(wo.shape, wi.shape))
    for term in mixture.terms(light):
        # The quotient of the cosines is computed first: for the shading normal it is exactly 1, even if the cosines are
        # tiny. For another normal it is unbounded at the horizon, and the floor keeps it finite.
        ratio = term.cosine / np.maximum(cosine, TINY * term.cosine)
        total = total + scale(term.f, np.where(above & term.valid, ratio, 0.0))
    return np.asarray(total)


def evaluate_cosine(bsdf: Bsdf, wo: Floats, wi: Floats) -> Floats:
    """Return f times the cosine of `wi` to the lobe's normal, summed over the lobes, (..., 3).

    A renderer integrates this product times the radiance from `wi`.
    """
    return _sum_of_values(bsdf, wo, wi, lambda lobe: True)


def evaluate_diffuse(bsdf: Bsdf, wo: Floats, wi: Floats) -> Floats:
    """Return the part of `evaluate_cosine` (..., 3) from lobes of group ``"diffuse"``."""
    return _sum_of_values(bsdf, wo, wi, lambda lobe: lobe.group == "diffuse")


def _sum_of_values(bsdf: Bsdf, wo: Floats, wi: Floats, is_counted: Callable[[Lobe], bool]) -> Floats:
    """Return f times the cosine (..., 3), summed over those lobes for which `is_counted` returns true."""
    mixture, light, above = _mixture_for_view(bsdf, wo, wi)
    total: Array = np.zeros(np.broadcast_shapes(wo.shape, wi.shape))
    for term in mixture.terms(light):
        if is_counted(term.lobe):
            total = total + np.where(np.expand_dims(above, -1), term.value, 0.0)
    return np.asarray(total)


def pdf(bsdf: Bsdf, wo: Floats, wi: Floats) -> Floats:
    """Return the pdf over solid angle, (...), with which `sample` draws `wi`."""
    mixture, light, above = _mixture_for_view(bsdf, wo, wi)
    density: Array = np.zeros(np.broadcast_shapes(wo.shape, wi.shape)[:-1])
    for term in mixture.terms(light):
        density = density + np.where(above, term.density, 0.0)
    return np.asarray(mixture.normalise(density))


def sample(bsdf: Bsdf, wo: Floats, u: Floats) -> Floats:
    """Draw unit directions to the light, (..., 3), for unit views (..., 3) that are not on the horizon.

    `u` (..., 2) are uniform numbers in [0, 1). The first number also selects a lobe. If the lobe's f is 0 in a
    direction, z of the direction is 0, and so are `evaluate` and `pdf` there.
    """
    mixture, _, _ = _mixture_for_view(bsdf, wo, wo)
    wi = np.asarray(np.broadcast_to(mixture.draw(u[..., 0], u[..., 1]), wo.shape))
    return np.where(wo[..., 2:] < 0.0, -wi, wi) if bsdf.two_sided else wi
