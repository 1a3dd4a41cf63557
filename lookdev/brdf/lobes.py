"""What every model is made of: lobes, and their sum as one BRDF that can be evaluated and sampled.

A lobe with `selection` zero contributes nothing anywhere. A renderer skips it; code generation drops it when the
zero is a constant and guards it by an ``if`` when it varies over the surface.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from lookdev.brdf.vectors import TINY, Array, dot, scale


@dataclass(frozen=True)
class Directions:
    """A pair of unit directions in the local frame, both above the horizon, and what all lobes need of it.

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
    """One term of a BRDF.

    selection(wo) is the lobe's share (unnormalised, >= 0, (...)) when a direction is sampled; evaluate(directions)
    its f in 1/sr, cosine excluded, (..., 3); pdf(directions) the solid angle density of sample(wo, u), which maps
    two uniform numbers to a unit direction that may fall below the horizon.
    """

    name: str
    selection: Callable[[Array], Array]
    evaluate: Callable[[Directions], Array]
    pdf: Callable[[Directions], Array]
    sample: Callable[[Array, Array, Array], Array]


def _above_horizon(wo: Array, wi: Array) -> tuple[Array, Array, Array]:
    """Mask pairs with both directions above the horizon; replace the others by the normal."""
    valid = (wo[..., 2] > 0.0) & (wi[..., 2] > 0.0)
    zenith = np.array([0.0, 0.0, 1.0])
    mask = np.expand_dims(valid, -1)
    return valid, np.where(mask, wo, zenith), np.where(mask, wi, zenith)


def evaluate(lobes: Sequence[Lobe], wo: Array, wi: Array) -> Array:
    """Evaluate the sum of lobes.

    Parameters
    ----------
    wo, wi : (..., 3)
        Unit directions to the viewer and to the light, local frame, z the normal.

    Returns
    -------
    (..., 3)
        f in 1/sr without the cosine; exactly 0 where either direction is on or below the horizon.
    """
    valid, wo, wi = _above_horizon(wo, wi)
    directions = Directions.of(wo, wi)
    total = np.zeros(wi.shape)
    for lobe in lobes:
        total = total + lobe.evaluate(directions)
    return scale(total, np.where(valid, 1.0, 0.0))


def pdf(lobes: Sequence[Lobe], wo: Array, wi: Array) -> Array:
    """Return the solid angle density, (...), with which `sample` draws `wi`; 0 on or below the horizon."""
    valid, wo, wi = _above_horizon(wo, wi)
    directions = Directions.of(wo, wi)
    selections = [lobe.selection(wo) for lobe in lobes]
    total = sum(selections)
    density = sum(share * lobe.pdf(directions) for share, lobe in zip(selections, lobes, strict=True)) / np.where(
        total > 0.0, total, 1.0
    )
    return np.where(valid, density, 0.0)


def sample(lobes: Sequence[Lobe], wo: Array, u: Array) -> Array:
    """Draw directions.

    Parameters
    ----------
    wo : (..., 3)
        Unit directions to the viewer, above the horizon.
    u : (..., 2)
        Uniform numbers in [0, 1). The first also chooses the lobe and is stretched over its share, so that a
        stratified pair stays stratified within each lobe.

    Returns
    -------
    (..., 3)
        Unit directions to the light; one below the horizon carries no light.
    """
    selections = [np.broadcast_to(lobe.selection(wo), wo.shape[:-1]) for lobe in lobes]
    total = sum(selections)
    wi = np.zeros(wo.shape)
    lower = np.zeros(wo.shape[:-1])
    for share, lobe in zip(selections, lobes, strict=True):
        upper = lower + np.where(total > 0.0, share / np.where(total > 0.0, total, 1.0), 0.0)
        chosen = (u[..., 0] >= lower) & (u[..., 0] < upper)
        width = np.where(upper > lower, upper - lower, 1.0)
        stretched = np.clip((u[..., 0] - lower) / width, 0.0, np.nextafter(1.0, 0.0))
        wi = np.where(np.expand_dims(chosen, -1), lobe.sample(wo, stretched, u[..., 1]), wi)
        lower = upper
    # Rounding can leave the last share's end just below 1: such a number belongs to the last lobe.
    missed = np.expand_dims(u[..., 0] >= lower, -1)
    return np.where(missed, lobes[-1].sample(wo, u[..., 0], u[..., 1]), wi)
