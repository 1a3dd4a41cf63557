"""What every model is made of: lobes, and the surface that they belong to.

A `Bsdf` is a function from the viewing direction to its lobes, since weights may depend on the view. How lobes are
chosen, summed and weighed is in `lookdev.brdf.mixture`. A lobe with share zero contributes nothing anywhere: a renderer
skips it; code generation drops it when the zero is a constant, and guards it by an ``if`` when it varies.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from lookdev.brdf.frames import Frame, Leaning, Upright, mirrored
from lookdev.brdf.vectors import TINY, Array, Parameters, Real, dot, scale, vector


@dataclass(frozen=True)
class Directions:
    """A pair of unit directions in a lobe's frame, both above the horizon, and what all lobes need of it.

    cos_theta_d is ``wi . wm``, the cosine between either direction and the half vector `wm`.
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
        half = vector(x, y, np.maximum(z, TINY))
        length = np.sqrt(dot(half, half))
        # wi . wm is half the length of wo + wi; the dot product would cancel as wi nears -wo.
        return cls(wo, wi, scale(half, 1.0 / length), wo[..., 2], wi[..., 2], 0.5 * length)


@dataclass(frozen=True)
class Lobe:
    """One term of a BSDF, at a viewing direction, in a `frame` of its own.

    model, name
        The model and the term of it: what approximations of a lobe are looked up by.
    share : (...)
        How often the lobe is chosen when a direction is sampled, unnormalised, at least 0.
    evaluate
        From `Directions` to f in 1/sr, cosine and `weight` excluded, (..., 3).
    pdf
        From `Directions` to the solid-angle density (...) of `sample`.
    sample
        From two uniform numbers (...) to unit directions (..., 3) of the frame, which may fall below the horizon.
    frame
        About the lobe's normal, facing the viewer.
    transmits
        Light comes from the side that the viewer is not on. The lobe is written as a reflection: its `wi` is mirrored
        to the viewer's side.
    broad
        The lobe is nearly constant: samples in proportion to light times cosine suit it as well as its own.
    weight : (...)
        What a blend with other surfaces leaves of the lobe, in [0, 1].
    values
        The quantities that f is computed from, by name, for approximations of the lobe.
    """

    model: str
    name: str
    share: Real
    evaluate: Callable[[Directions], Array]
    pdf: Callable[[Directions], Array]
    sample: Callable[[Array, Array], Array]
    frame: Frame = field(default_factory=Upright)
    transmits: bool = False
    broad: bool = False
    weight: Real = 1.0
    values: Parameters = field(default_factory=dict)

    @property
    def leans(self) -> bool:
        """Whether the lobe has a normal other than the shading normal."""
        return isinstance(self.frame, Leaning)

    def blended(self, weight: Real) -> Lobe:
        """Return the lobe as a part of a blend, (...) of it."""
        return replace(self, share=self.share * weight, weight=self.weight * weight)

    def pair(self, wo: Array, wi: Array) -> tuple[Array, Array]:
        """Express directions of the shading frame in the lobe's."""
        wi = self.frame.to_local(wi)
        return self.frame.to_local(wo), mirrored(wi) if self.transmits else wi

    def draw(self, u1: Array, u2: Array) -> Array:
        """Draw a direction in the shading frame, with z = 0 where the lobe itself sends no light to it.

        Another lobe may send light there. The density of the mixture does not count this lobe in such directions, so
        they must not count as drawn.
        """
        drawn = self.sample(u1, u2)
        wi = self.frame.from_local(mirrored(drawn) if self.transmits else drawn)
        valid = drawn[..., 2] > 0.0
        if self.leans:
            valid = valid & ((wi[..., 2] < 0.0) if self.transmits else (wi[..., 2] > 0.0))
        return vector(wi[..., 0], wi[..., 1], np.where(valid, wi[..., 2], 0.0))


@dataclass(frozen=True)
class Bsdf:
    """The lobes of a surface, by the viewing direction above its horizon, in the frame of the shading normal.

    `presence`, (...), is how much of the surface is there: a ray goes on unchanged with weight ``1 - presence``, which
    the functions of `lookdev.brdf.mixture` do not include. A `two_sided` surface is thin, and its back looks like its
    front: below the horizon, f is that of both directions flipped. Any other surface is black from below.
    """

    lobes: Callable[[Array], tuple[Lobe, ...]]
    presence: Real = 1.0
    two_sided: bool = False
