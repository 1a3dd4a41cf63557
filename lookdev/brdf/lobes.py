"""Lobes, and the surface that they belong to.

`lookdev.brdf.mixture` states how lobes are chosen, summed and weighted. A lobe with share 0 is 0 everywhere: code
generation drops it where the 0 is constant, and guards it by an ``if`` where the share varies.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from lookdev.brdf.frames import Frame, Leaning, Upright, mirrored
from lookdev.brdf.vectors import TINY, Array, Mask, Parameters, Real, dot, scale, vector

Group = Literal["diffuse", "specular", "clearcoat"]
"""The kind of response; a lobe of any kind may transmit."""

PartGroup = Literal["sheen"]
"""The kind of a term that a lobe of another kind has."""


@dataclass(frozen=True)
class Directions:
    """A pair of unit directions (..., 3) in a lobe's frame, both above its horizon, with half vector and cosines (...).

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
        """Derive the half vector and the cosines from `wo` and `wi`."""
        x, y, z = wo[..., 0] + wi[..., 0], wo[..., 1] + wi[..., 1], wo[..., 2] + wi[..., 2]
        # Opposite directions along the horizon: the floor's square is still a normal float32.
        half = vector(x, y, np.maximum(z, TINY))
        length = np.sqrt(dot(half, half))
        # wi . wm is half the length of wo + wi; the dot product cancels as wi nears -wo.
        return cls(wo, wi, scale(half, 1.0 / length), wo[..., 2], wi[..., 2], 0.5 * length)


@dataclass(frozen=True)
class Lobe:
    """One term of a BSDF, at a viewing direction, in a `frame` of its own.

    model, name
        Of the model, and of the lobe within it.
    share : (...)
        Unnormalised probability, at least 0, with which the lobe is chosen when a direction is sampled.
    evaluate
        From `Directions` to f in 1/sr, cosine and `weight` excluded, (..., 3).
    pdf
        From `Directions` to the pdf (...) of `sample` over solid angle.
    sample
        From two uniform numbers (...) to unit directions (..., 3) of the frame, which may be below the horizon.
    group
        The kind of response, by which lights have multipliers: ``"diffuse"`` is body reflection, with what a model adds
        to it in the same lobe (retro-reflection, a stand-in for subsurface scattering, sheen), and its transmission.
    frame
        About the lobe's normal, facing the viewer.
    transmits
        The light is on the other side than the viewer; the functions above take and return its direction mirrored to
        the viewer's side.
    own_side
        Where the lobe leans, its own normal alone decides on which side a direction is. Otherwise the shading normal
        must agree.
    broad
        The lobe is nearly constant: samples in proportion to light times cosine suit it as well as its own.
    weight : (...)
        Factor in [0, 1] of f in a blend with other surfaces.
    values
        What f is computed from, by name, for stand-ins (`lookdev.closures`).
    parts
        Terms of f that are passes of their own, by their groups: functions as `evaluate`.
    """

    model: str
    name: str
    share: Real
    evaluate: Callable[[Directions], Array]
    pdf: Callable[[Directions], Array]
    sample: Callable[[Array, Array], Array]
    group: Group
    frame: Frame = field(default_factory=Upright)
    transmits: bool = False
    own_side: bool = False
    broad: bool = False
    weight: Real = 1.0
    values: Parameters = field(default_factory=dict)
    parts: Mapping[PartGroup, Callable[[Directions], Array]] = field(default_factory=dict)

    @property
    def leans(self) -> bool:
        """Whether the lobe has a normal other than the shading normal."""
        return isinstance(self.frame, Leaning)

    @property
    def crosses(self) -> bool:
        """Whether the lobe reflects to, or transmits from, both sides of the shading normal."""
        return self.leans and self.own_side

    def blended(self, weight: Real) -> Lobe:
        """Return the lobe with a weight (...) in a blend."""
        return replace(self, share=self.share * weight, weight=self.weight * weight)

    def pair(self, wo: Array, wi: Array) -> tuple[Array, Array]:
        """Express directions of the shading frame in the lobe's."""
        wi = self.frame.to_local(wi)
        return self.frame.to_local(wo), mirrored(wi) if self.transmits else wi

    def draw(self, u1: Array, u2: Array) -> Array:
        """Draw a direction in the shading frame, with z = 0 where the lobe itself is 0.

        The pdf of the mixture excludes this lobe there, so the direction must not be used, though another lobe may be
        above 0.
        """
        drawn = self.sample(u1, u2)
        wi = self.frame.from_local(mirrored(drawn) if self.transmits else drawn)
        valid = drawn[..., 2] > 0.0
        if self.leans and not self.crosses:
            valid = valid & ((wi[..., 2] < 0.0) if self.transmits else (wi[..., 2] > 0.0))
        return vector(wi[..., 0], wi[..., 1], np.where(valid, wi[..., 2], 0.0))


@dataclass(frozen=True)
class Delta:
    """Scattering along a single direction: what a smooth surface adds to the lobes.

    model, name
        Of the model, and of the term within it.
    direction : (..., 3)
        To the light, unit, in the shading frame; z is 0 where there is none.
    value : (..., 3)
        Radiance to the viewer over radiance from there.
    transmits
        The light is on the other side than the viewer.
    """

    model: str
    name: str
    direction: Array
    value: Array
    transmits: bool = False

    def blended(self, weight: Real) -> Delta:
        """Return the term with a weight (...) in a blend."""
        return replace(self, value=scale(self.value, weight))


@dataclass(frozen=True)
class Bsdf:
    """The lobes of a surface as a function of the view (..., 3), above the horizon of the shading frame.

    `presence`, (...), is how much of the surface is there: a ray goes on unchanged with weight ``1 - presence``, which
    the functions of `lookdev.brdf.mixture` exclude. A `two_sided` surface is thin: seen from below the horizon, f is
    that of both directions flipped. Any other surface is black from below.

    `deltas` are functions of the view, too, and of where the viewer is inside the solid that the surface bounds, (...):
    where its normals point away from the viewer. The functions of `lookdev.brdf.mixture` exclude them.
    """

    lobes: Callable[[Array], tuple[Lobe, ...]]
    presence: Real = 1.0
    two_sided: bool = False
    deltas: Callable[[Array, Mask], tuple[Delta, ...]] = lambda wo, inside: ()

    def transmits(self, wo: Array) -> bool:
        """Return whether light passes, seen along any of some views (..., 3); what is opaque is lit from its front."""
        lobes = any(lobe.transmits and bool(np.any(lobe.share > 0.0)) for lobe in self.lobes(wo))
        return lobes or any(each.transmits for each in self.deltas(wo, np.zeros(wo.shape[:-1], np.bool_)))

    def converted(self, matrix: Array) -> Bsdf:
        """Return a BSDF whose f has the coordinates of another linear space.

        `matrix` (3, 3) leads there, and its rows sum up to 1. Models are as published, in linear Rec.709: their tints
        by luminance, exact metals and films, which are sums over a spectrum, keep their colours. What is linear in a
        colour is as if that colour had been converted.
        """
        rows = np.asarray(matrix, np.float64).tolist()

        def convert(color: Array) -> Array:
            r, g, b = color[..., 0], color[..., 1], color[..., 2]
            return vector(*(row[0] * r + row[1] * g + row[2] * b for row in rows))

        def function(evaluate: Callable[[Directions], Array]) -> Callable[[Directions], Array]:
            return lambda d: convert(evaluate(d))

        def lobes(wo: Array) -> tuple[Lobe, ...]:
            return tuple(
                replace(
                    lobe,
                    evaluate=function(lobe.evaluate),
                    parts={name: function(part) for name, part in lobe.parts.items()},
                )
                for lobe in self.lobes(wo)
            )

        def deltas(wo: Array, inside: Mask) -> tuple[Delta, ...]:
            return tuple(replace(each, value=convert(each.value)) for each in self.deltas(wo, inside))

        return replace(self, lobes=lobes, deltas=deltas)
