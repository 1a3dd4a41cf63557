"""What every model is made of: lobes, and their sum as one BSDF that can be evaluated and sampled.

A `Bsdf` is a function from the viewing direction to its lobes: weights may depend on the view. A lobe with share
zero contributes nothing anywhere. A renderer skips it; code generation drops it when the zero is a constant and
guards it by an ``if`` when it varies over the surface.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from lookdev.brdf.closures import Closure
from lookdev.brdf.frames import ZENITH, from_local, mirrored, to_local
from lookdev.brdf.vectors import TINY, Array, dot, same, scale


@dataclass(frozen=True)
class Directions:
    """A pair of unit directions in a lobe's frame, both above the horizon, and what all lobes need of it.

    cos_theta_d is ``wi . wm``, the angle between either direction and the half vector `wm`.
    """

    wo: Array
    wi: Array
    wm: Array
    cos_theta_o: Array
    cos_theta_i: Array
    cos_theta_d: Array

    @classmethod
    def of(cls, wo: Array, wi: Array) -> Directions:
        """Derive the half vector and the cosines from `wo` and `wi`, (..., 3)."""
        x, y, z = wo[..., 0] + wi[..., 0], wo[..., 1] + wi[..., 1], wo[..., 2] + wi[..., 2]
        # Opposite directions along the horizon: the floor's square is still a normal float32.
        half = np.stack([x, y, np.maximum(z, TINY)], axis=-1)
        length = np.sqrt(dot(half, half))
        # wi . wm is half the length of wo + wi; the dot product would cancel as wi nears -wo.
        return cls(wo, wi, scale(half, 1.0 / length), wo[..., 2], wi[..., 2], 0.5 * length)


@dataclass(frozen=True)
class Lobe:
    """One term of a BSDF, at a viewing direction, in the frame of its own `normal`.

    `share` is how often the lobe is chosen when a direction is sampled (unnormalised, >= 0, (...));
    evaluate(directions) its f in 1/sr, cosine excluded, (..., 3); pdf(directions) the solid angle density of
    sample(u1, u2), which maps two uniform numbers to a unit direction that may fall below the horizon.

    A lobe that `transmits` sends light to the side that the viewer is not on. It is written as if it reflected:
    its `wi` is mirrored to the viewer's side.

    A `broad` lobe is nearly constant: directions in proportion to light times cosine suit it as well as its own.

    closures() is what stands for the lobe where only Cycles' own closures can be had, in the surface's frame.
    """

    name: str
    share: Array
    evaluate: Callable[[Directions], Array]
    pdf: Callable[[Directions], Array]
    sample: Callable[[Array, Array], Array]
    closures: Callable[[], tuple[Closure, ...]]
    transmits: bool = False
    normal: Array = field(default_factory=lambda: ZENITH)
    broad: bool = False

    def pair(self, wo: Array, wi: Array) -> tuple[Array, Array]:
        """Bring directions of the surface's frame into the lobe's."""
        wi = to_local(self.normal, wi)
        return to_local(self.normal, wo), mirrored(wi) if self.transmits else wi

    def draw(self, u1: Array, u2: Array) -> Array:
        """Draw a direction in the surface's frame, flat on the horizon where the lobe itself sends no light to it.

        Another lobe may: but no density tells that this one draws there too, so it must not count.
        """
        drawn = self.sample(u1, u2)
        wi = from_local(self.normal, mirrored(drawn) if self.transmits else drawn)
        valid = drawn[..., 2] > 0.0
        if not same(self.normal, ZENITH):
            valid = valid & ((wi[..., 2] < 0.0) if self.transmits else (wi[..., 2] > 0.0))
        return np.stack([wi[..., 0], wi[..., 1], np.where(valid, wi[..., 2], 0.0)], axis=-1)


@dataclass(frozen=True)
class Bsdf:
    """The lobes of a surface, by the viewing direction above its horizon, in the frame of the shading normal.

    `presence`, (...), is how much of the surface is there: a ray goes on unchanged with weight ``1 - presence``,
    which none of the functions below count. A `two_sided` surface is thin, and its back looks like its front:
    below the horizon, a viewer sees what one opposite does. Of any other surface a viewer below sees nothing.
    """

    lobes: Callable[[Array], tuple[Lobe, ...]]
    presence: Array = 1.0
    two_sided: bool = False


def _from_the_front(bsdf: Bsdf, wo: Array, *others: Array) -> tuple[Array, ...]:
    """Turn directions about, through the origin, where the viewer of a two-sided surface is behind it."""
    if not bsdf.two_sided:
        return wo, *others
    behind = wo[..., 2:] < 0.0
    return tuple(np.where(behind, -w, w) for w in (wo, *others))


def seen_along(bsdf: Bsdf, wo: Array) -> Bsdf:
    """Return a BSDF for this one view, (..., 3), above the horizon or of a two-sided surface: lobes derived once."""
    lobes = bsdf.lobes(_from_the_front(bsdf, wo)[0])
    return replace(bsdf, lobes=lambda _: lobes)


def _pairs(bsdf: Bsdf, wo: Array, wi: Array) -> Iterator[tuple[Lobe, Directions, Array]]:
    """Yield each lobe, the directions in its frame, and where they are valid; elsewhere they are the normal."""
    above = wo[..., 2] > 0.0
    lobes = bsdf.lobes(np.where(np.expand_dims(above, -1), wo, ZENITH))
    known: dict[tuple[int, bool], tuple[Directions, Array]] = {}
    for lobe in lobes:
        key = (id(lobe.normal), lobe.transmits)
        if key not in known:
            local_o, local_i = lobe.pair(wo, wi)
            side = -wi[..., 2] if lobe.transmits else wi[..., 2]
            valid = above & (side > 0.0) & (local_o[..., 2] > 0.0) & (local_i[..., 2] > 0.0)
            mask = np.expand_dims(valid, -1)
            known[key] = Directions.of(np.where(mask, local_o, ZENITH), np.where(mask, local_i, ZENITH)), valid
        yield lobe, *known[key]


def evaluate(bsdf: Bsdf, wo: Array, wi: Array) -> Array:
    """Evaluate a BSDF.

    Parameters
    ----------
    wo, wi : (..., 3)
        Unit directions to the viewer and to the light; z is the shading normal.

    Returns
    -------
    (..., 3)
        f in 1/sr without the cosine; exactly 0 where either direction is on the horizon, or where no lobe sends
        light. A lobe with a normal of its own has its cosine over that of the shading normal as a factor.
    """
    wo, wi = _from_the_front(bsdf, wo, wi)
    cosine = np.abs(wi[..., 2])
    total = np.zeros(np.broadcast_shapes(wo.shape, wi.shape))
    for lobe, directions, valid in _pairs(bsdf, wo, wi):
        # The quotient first: it is exactly 1 without a normal of its own, however small the cosines are. With one, it
        # has no bound at the horizon: the floor keeps it finite.
        own = directions.cos_theta_i
        ratio = np.where(valid, own / np.maximum(cosine, TINY * own), 0.0)
        total = total + scale(lobe.evaluate(directions), ratio)
    return total


def evaluate_cosine(bsdf: Bsdf, wo: Array, wi: Array) -> Array:
    """Return f times the cosine of `wi`, each lobe's by its own normal, (..., 3): what a renderer integrates."""
    wo, wi = _from_the_front(bsdf, wo, wi)
    total = np.zeros(np.broadcast_shapes(wo.shape, wi.shape))
    for lobe, directions, valid in _pairs(bsdf, wo, wi):
        total = total + scale(lobe.evaluate(directions), np.where(valid, directions.cos_theta_i, 0.0))
    return total


def pdf(bsdf: Bsdf, wo: Array, wi: Array) -> Array:
    """Return the solid angle density, (...), with which `sample` draws `wi`; 0 where no lobe sends light."""
    wo, wi = _from_the_front(bsdf, wo, wi)
    total, density = np.zeros(wo.shape[:-1]), np.zeros(np.broadcast_shapes(wo.shape, wi.shape)[:-1])
    for lobe, directions, valid in _pairs(bsdf, wo, wi):
        total = total + lobe.share
        density = density + np.where(valid, lobe.share * lobe.pdf(directions), 0.0)
    return density / np.where(total > 0.0, total, 1.0)


def sample(bsdf: Bsdf, wo: Array, u: Array) -> Array:
    """Draw directions.

    Parameters
    ----------
    wo : (..., 3)
        Unit directions to the viewer, not on the horizon.
    u : (..., 2)
        Uniform numbers in [0, 1). The first also chooses the lobe and is stretched over its share, so that a
        stratified pair stays stratified within each lobe.

    Returns
    -------
    (..., 3)
        Unit directions to the light. One that its lobe sends no light to has z = 0, and so neither value nor density.
    """
    (front,) = _from_the_front(bsdf, wo)
    lobes = bsdf.lobes(front)
    shares = [np.broadcast_to(lobe.share, wo.shape[:-1]) for lobe in lobes]
    total = sum(shares)
    wi = np.zeros(wo.shape)
    lower = np.zeros(wo.shape[:-1])
    for share, lobe in zip(shares, lobes, strict=True):
        upper = lower + np.where(total > 0.0, share / np.where(total > 0.0, total, 1.0), 0.0)
        chosen = (u[..., 0] >= lower) & (u[..., 0] < upper)
        width = np.where(upper > lower, upper - lower, 1.0)
        stretched = np.minimum(np.where(chosen, u[..., 0] - lower, 0.0) / width, np.nextafter(1.0, 0.0))
        wi = np.where(np.expand_dims(chosen, -1), lobe.draw(stretched, u[..., 1]), wi)
        lower = upper
    # Rounding can leave the last share's end just below 1: such a number belongs to the last lobe that has a share.
    for index in range(len(lobes)):
        rest = sum(shares[index + 1 :]) if index + 1 < len(lobes) else 0.0
        last = (u[..., 0] >= lower) & (shares[index] > 0.0) & (rest == 0.0)
        if last.any():
            wi = np.where(np.expand_dims(last, -1), lobes[index].draw(u[..., 0], u[..., 1]), wi)
    if bsdf.two_sided:
        wi = np.where(wo[..., 2:] < 0.0, -wi, wi)
    return wi
