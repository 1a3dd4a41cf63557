"""Lobes, and the surface that they belong to.

`lookdev.brdf.mixture` states how lobes are selected, summed and weighted. A lobe with share 0 is 0 everywhere: code
generation drops it where the 0 is constant, and guards it by an ``if`` where the share varies.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from lookdev.brdf.frames import Frame, TiltedFrame, UprightFrame, mirror_across_surface
from lookdev.brdf.vectors import TINY, Array, BooleanArray, Parameters, Real, dot, scale, vector

LobeGroup = Literal["diffuse", "specular", "clearcoat"]
"""The kind of a lobe's response; a lobe of any kind may transmit."""

PartGroup = Literal["sheen"]
"""The kind of a term within a lobe of another kind."""


@dataclass(frozen=True)
class DirectionPair:
    """A pair of unit directions (..., 3) in a lobe's frame, both above its horizon, with half vector and cosines (...).

    `cos_theta_d` is ``wi . wm``, the cosine between either direction and the half vector `wm`.
    """

    wo: Array
    wi: Array
    wm: Array
    cos_theta_o: Array
    cos_theta_i: Array
    cos_theta_d: Array

    @classmethod
    def from_directions(cls, wo: Array, wi: Array) -> DirectionPair:
        """Derive the half vector and the cosines from `wo` and `wi`."""
        x, y, z = wo[..., 0] + wi[..., 0], wo[..., 1] + wi[..., 1], wo[..., 2] + wi[..., 2]
        # The floor is for opposite directions along the horizon: its square is still a normal float32.
        half = vector(x, y, np.maximum(z, TINY))
        length = np.sqrt(dot(half, half))
        # wi . wm is half the length of wo + wi; the dot product cancels as wi nears -wo.
        return cls(wo, wi, scale(half, 1.0 / length), wo[..., 2], wi[..., 2], 0.5 * length)


@dataclass(frozen=True)
class Lobe:
    """One term of a BSDF, at a viewing direction, in a `frame` of its own.

    model, name
        The names of the model, and of the lobe within it.
    share : (...)
        Unnormalised probability, at least 0, of selecting the lobe when a direction is sampled.
    evaluate
        From `DirectionPair` to f in 1/sr, cosine and `weight` excluded, (..., 3).
    pdf
        From `DirectionPair` to the pdf (...) of `sample` over solid angle.
    sample
        From two uniform numbers (...) to unit directions (..., 3) of the frame, which may be below the horizon.
    group
        The kind of response; lights have a multiplier for each kind. ``"diffuse"`` is body reflection and its
        transmission, with the terms that a model adds to it in the same lobe: retro-reflection, an approximation of
        subsurface scattering, sheen.
    frame
        The frame about the lobe's normal, facing the viewer.
    transmits
        Whether light and viewer are on opposite sides; the functions above take and return the light's direction
        mirrored to the viewer's side.
    has_own_horizon
        Whether only the lobe's own normal separates the directions that a tilted lobe reflects to from those that it
        transmits from. Otherwise a direction must be on the same side of the shading normal, too, or f is 0.
    broad
        Whether the lobe is nearly constant, so that samples of light times cosine suit it as well as its own samples.
    weight : (...)
        Factor in [0, 1] of f in a blend with other surfaces.
    values
        The quantities from which f is computed, by name, for approximations by closures (`lookdev.closures`).
    parts
        Terms of f that are render passes of their own, by group: functions such as `evaluate`.
    """

    model: str
    name: str
    share: Real
    evaluate: Callable[[DirectionPair], Array]
    pdf: Callable[[DirectionPair], Array]
    sample: Callable[[Array, Array], Array]
    group: LobeGroup
    frame: Frame = field(default_factory=UprightFrame)
    transmits: bool = False
    has_own_horizon: bool = False
    broad: bool = False
    weight: Real = 1.0
    values: Parameters = field(default_factory=dict)
    parts: Mapping[PartGroup, Callable[[DirectionPair], Array]] = field(default_factory=dict)

    @property
    def is_tilted(self) -> bool:
        """Whether the lobe has a normal other than the shading normal."""
        return isinstance(self.frame, TiltedFrame)

    @property
    def crosses_surface(self) -> bool:
        """Whether the lobe reflects to, or transmits from, both sides of the shading normal."""
        return self.is_tilted and self.has_own_horizon

    def blend(self, weight: Real) -> Lobe:
        """Return the lobe, its weight and share multiplied by a weight (...) in a blend."""
        return replace(self, share=self.share * weight, weight=self.weight * weight)

    def local_directions(self, wo: Array, wi: Array) -> tuple[Array, Array]:
        """Express directions of the shading frame in the lobe's frame, `wi` mirrored if the lobe transmits."""
        wi = self.frame.to_local(wi)
        return self.frame.to_local(wo), mirror_across_surface(wi) if self.transmits else wi

    def draw(self, u1: Array, u2: Array) -> Array:
        """Draw a direction in the shading frame, with z = 0 where this lobe is 0 in the direction.

        The pdf of the mixture excludes this lobe there, so the direction must not be used, even where another lobe is
        above 0.
        """
        local = self.sample(u1, u2)
        wi = self.frame.from_local(mirror_across_surface(local) if self.transmits else local)
        valid = local[..., 2] > 0.0
        if self.is_tilted and not self.crosses_surface:
            valid = valid & ((wi[..., 2] < 0.0) if self.transmits else (wi[..., 2] > 0.0))
        return vector(wi[..., 0], wi[..., 1], np.where(valid, wi[..., 2], 0.0))


@dataclass(frozen=True)
class Delta:
    """Scattering along a single direction, a term of a smooth surface beside its lobes.

    model, name
        The names of the model, and of the term within it.
    direction : (..., 3)
        Unit direction to the light in the shading frame; z is 0 where there is no such direction.
    value : (..., 3)
        Radiance to the viewer over radiance from `direction`.
    transmits
        Whether light and viewer are on opposite sides.
    """

    model: str
    name: str
    direction: Array
    value: Array
    transmits: bool = False

    def blend(self, weight: Real) -> Delta:
        """Return the term, its value multiplied by a weight (...) in a blend."""
        return replace(self, value=scale(self.value, weight))


@dataclass(frozen=True)
class Bsdf:
    """The lobes of a surface as a function of the view (..., 3), above the horizon of the shading frame.

    `presence`, (...), is the coverage of the surface: a ray continues unchanged with weight ``1 - presence``, which the
    functions of `lookdev.brdf.mixture` exclude. A `two_sided` surface is thin: for a view below the horizon, f is that
    of both directions flipped. Other surfaces are black from below.

    `deltas` is a function of the view and of a mask (...). The mask is true where the viewer is inside the solid that
    the surface bounds, so that the solid's normals point away from the viewer. The functions of `lookdev.brdf.mixture`
    exclude these terms.
    """

    lobes: Callable[[Array], tuple[Lobe, ...]]
    presence: Real = 1.0
    two_sided: bool = False
    deltas: Callable[[Array, BooleanArray], tuple[Delta, ...]] = lambda wo, inside: ()

    def transmits(self, wo: Array) -> bool:
        """Return whether light passes through the surface for any of the views (..., 3)."""
        lobes = any(lobe.transmits and bool(np.any(lobe.share > 0.0)) for lobe in self.lobes(wo))
        return lobes or any(delta.transmits for delta in self.deltas(wo, np.zeros(wo.shape[:-1], np.bool_)))

    def convert(self, matrix: Array) -> Bsdf:
        """Return a BSDF whose f is in the coordinates of another linear colour space.

        `matrix` (3, 3) converts from linear Rec.709 to that space; its rows sum to 1. Models are evaluated as
        published, in linear Rec.709, so that tints by luminance, and exact metals and films, which are sums over a
        spectrum, keep their colours. A term that is linear in a colour parameter equals the term of the converted
        colour.
        """
        rows = np.asarray(matrix, np.float64).tolist()

        def convert_color(color: Array) -> Array:
            r, g, b = color[..., 0], color[..., 1], color[..., 2]
            return vector(*(row[0] * r + row[1] * g + row[2] * b for row in rows))

        def convert_values(evaluate: Callable[[DirectionPair], Array]) -> Callable[[DirectionPair], Array]:
            return lambda d: convert_color(evaluate(d))

        def lobes(wo: Array) -> tuple[Lobe, ...]:
            return tuple(
                replace(
                    lobe,
                    evaluate=convert_values(lobe.evaluate),
                    parts={name: convert_values(part) for name, part in lobe.parts.items()},
                )
                for lobe in self.lobes(wo)
            )

        def deltas(wo: Array, inside: BooleanArray) -> tuple[Delta, ...]:
            return tuple(replace(delta, value=convert_color(delta.value)) for delta in self.deltas(wo, inside))

        return replace(self, lobes=lobes, deltas=deltas)
