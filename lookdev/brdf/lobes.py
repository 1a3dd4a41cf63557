"""The records that every model returns: `Bsdf`, the scattering of a surface, and its terms `Lobe` and `Delta`.

`lookdev.brdf.mixture` selects and sums lobes. If a lobe's share is 0, its f is 0 everywhere. Code generation drops a
lobe whose share is a constant 0. If the share varies, the code of the lobe is in an ``if``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from lookdev.brdf.frames import Frame, TiltedFrame, UprightFrame, mirror_across_surface
from lookdev.brdf.vectors import TINY, Array, BooleanArray, Parameters, Real, dot, scale, vector

LobeGroup = Literal["diffuse", "specular", "clearcoat"]
"""The kind of reflection of a lobe, for render passes and for multipliers of lights. Any kind may transmit."""

PartGroup = Literal["sheen"]
"""The kind of a term that is part of a lobe of another kind, and has a render pass of its own."""


@dataclass(frozen=True)
class DirectionPair:
    """The directions to viewer and light in a lobe's frame, and quantities that follow from them.

    `wo` and `wi` (..., 3) are the unit directions to the viewer and to the light, both above the horizon. `wm` (..., 3)
    is the unit half vector. `cos_theta_o` and `cos_theta_i` (...) are the cosines of `wo` and `wi` to the normal.
    `cos_theta_d` (...) is the cosine between either direction and the half vector.
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
        # The floor is for opposite directions along the horizon, whose sum is 0. Its square is a normal float32.
        half = vector(x, y, np.maximum(z, TINY))
        length = np.sqrt(dot(half, half))
        # wi . wm is half the length of wo + wi. The dot product would cancel for wi near -wo.
        return cls(wo, wi, scale(half, 1.0 / length), wo[..., 2], wi[..., 2], 0.5 * length)


@dataclass(frozen=True)
class Lobe:
    """One term of a BSDF, for a given direction to the viewer.

    model, name
        The names of the model, and of the lobe within it.
    share : (...)
        The probability of selecting the lobe when a direction is sampled, at least 0 and not normalised.
    evaluate
        Function of a `DirectionPair` that returns f (..., 3) in 1/sr, without the cosine and without `weight`.
    pdf
        Function of a `DirectionPair` that returns the pdf (...) of `sample` over solid angle.
    sample
        Function of two uniform numbers (...) that returns unit directions to the light (..., 3) in `frame`. They may be
        below the horizon.
    group
        The kind of reflection. Lights have a multiplier for each kind. ``"diffuse"`` is body reflection and its
        transmission, with the terms that a model adds to it in the same lobe: retro-reflection, an approximation of
        subsurface scattering, sheen.
    frame
        The frame about the lobe's normal, which is bent until it faces the viewer.
    transmits
        Whether light and viewer are on opposite sides. The functions above then take and return the light's direction
        mirrored to the viewer's side.
    has_own_horizon
        Whether its own normal alone determines the horizon of a tilted lobe. Otherwise f is also 0 where a direction is
        on the wrong side of the shading normal.
    broad
        Whether the lobe is nearly constant, so that directions drawn in proportion to light times cosine suit it as
        well as its own samples.
    weight : (...)
        Factor of f in [0, 1], in a blend with other surfaces.
    values
        The quantities from which f is computed, by name, for approximations by closures (`lookdev.closures`).
    parts
        Terms of f that have render passes of their own, by group. Each is a function such as `evaluate`.
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
        """Return the lobe with its weight and its share multiplied by a weight (...)."""
        return replace(self, share=self.share * weight, weight=self.weight * weight)

    def local_directions(self, wo: Array, wi: Array) -> tuple[Array, Array]:
        """Express directions of the shading frame in the lobe's frame; `wi` is also mirrored if the lobe transmits."""
        wi = self.frame.to_local(wi)
        return self.frame.to_local(wo), mirror_across_surface(wi) if self.transmits else wi

    def draw(self, u1: Array, u2: Array) -> Array:
        """Draw a direction to the light in the shading frame, by two uniform numbers.

        Where the lobe's f is 0 in the drawn direction, z becomes 0. Such a direction must not be used, even if another
        lobe is above 0 there: the pdf of the mixture does not include this lobe.
        """
        local = self.sample(u1, u2)
        wi = self.frame.from_local(mirror_across_surface(local) if self.transmits else local)
        valid = local[..., 2] > 0.0
        if self.is_tilted and not self.crosses_surface:
            valid = valid & ((wi[..., 2] < 0.0) if self.transmits else (wi[..., 2] > 0.0))
        return vector(wi[..., 0], wi[..., 1], np.where(valid, wi[..., 2], 0.0))


@dataclass(frozen=True)
class Delta:
    """One term of a BSDF that scatters light from a single direction, as a smooth surface does.

    model, name
        The names of the model, and of the term within it.
    direction : (..., 3)
        Unit direction to the light in the shading frame. Its z is 0 where there is no such direction.
    value : (..., 3)
        The radiance towards the viewer, divided by the radiance from `direction`.
    transmits
        Whether light and viewer are on opposite sides.
    """

    model: str
    name: str
    direction: Array
    value: Array
    transmits: bool = False

    def blend(self, weight: Real) -> Delta:
        """Return the term with its value multiplied by a weight (...)."""
        return replace(self, value=scale(self.value, weight))


@dataclass(frozen=True)
class Bsdf:
    """The scattering of a surface: its lobes and deltas as functions of the view.

    lobes
        Function that returns the lobes for unit directions to the viewer (..., 3), above the horizon of the shading
        frame.
    presence : (...)
        The coverage of the surface. A ray continues unchanged with weight ``1 - presence``, which the functions of
        `lookdev.brdf.mixture` do not include.
    two_sided
        Whether the surface is thin. For a view from below the horizon, f then has the value that it has if both
        directions are negated. Other surfaces are black from below.
    deltas
        Function that returns the terms along single directions. Its arguments are the directions to the viewer, and a
        mask (...) that is true where the viewer is inside the solid that the surface bounds. The functions of
        `lookdev.brdf.mixture` do not include these terms.
    """

    lobes: Callable[[Array], tuple[Lobe, ...]]
    presence: Real = 1.0
    two_sided: bool = False
    deltas: Callable[[Array, BooleanArray], tuple[Delta, ...]] = lambda wo, inside: ()

    def transmits(self, wo: Array) -> bool:
        """Return whether a lobe or delta transmits light to any of the views (..., 3)."""
        lobes = any(lobe.transmits and bool(np.any(lobe.share > 0.0)) for lobe in self.lobes(wo))
        return lobes or any(delta.transmits for delta in self.deltas(wo, np.zeros(wo.shape[:-1], np.bool_)))

    def convert(self, matrix: Array) -> Bsdf:
        """Return the BSDF with f and deltas converted to another linear colour space.

        `matrix` (3, 3) converts from linear Rec.709 to that space. Its rows sum to 1. Models are evaluated as
        published, in linear Rec.709, and their results are converted. So tints by luminance keep their colours, and so
        do exact metals and films, which are sums over a spectrum. For a term that is linear in a colour parameter, it
        makes no difference whether the parameter or the term is converted.
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
