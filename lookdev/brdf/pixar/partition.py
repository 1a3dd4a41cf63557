"""The division of light among the six lobes of Pixar's reflection model for Wall-E and Up, and the lobes themselves.

- Smits, B. Reflection Model Design for Wall-E and Up. Pixar Animation Studios.

"Pick a fixed set of reflection lobes ... and then determine how to partition the incoming energy between those lobes
in such a way that energy is conserved." Each of the six lobes has two weights, at normal and at grazing incidence,
which Schlick's term blends. Two lobes are diffuse, and share a normal. The other four are highlights. They have a cone
angle each, and share another normal.

A `Partition` has all of these for given views. `layer_partition` computes the partition of one layer,
`lookdev.brdf.pixar.layering` combines the partitions of several layers, and `partition_lobes` builds the lobes.
"""

from __future__ import annotations

import functools
import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from lookdev.brdf import microfacet as mf
from lookdev.brdf.frames import Frame, UprightFrame, frame_of
from lookdev.brdf.fresnel import conductor_absorptance, conductor_fresnel, fresnel_blend, schlick_blend
from lookdev.brdf.lobes import DirectionPair, Lobe
from lookdev.brdf.metal import is_exact, metal_fresnel
from lookdev.brdf.vectors import TINY, Array, Parameters, Real, dot, mean, mix, mix_color, reflect, scale, vector

REFLECTED_LOBES = ("reflection", "specular", "diffuse")
"""The lobes on the viewer's side, in the order of their blur.

"reflection/refraction blurs less than specular, which blurs less than diffuse" (Smits, "Layering").
"""

TRANSMITTED_LOBES = ("refraction", "specularTransmission", "diffuseTransmission")
"""The lobes on the other side, in the same order."""

# The limits of cone angles in degrees. The lower one is "0 (or epsilon in practice)" (Smits). Above the upper one,
# albedos at grazing views exceed 1.
_CONE_LIMITS = (0.25, 54.0)


@dataclass(frozen=True)
class Metal:
    """The part of a lobe that a metal with the exact Fresnel term reflects.

    normal, grazing : (..., 3), weights at normal and at grazing incidence, which multiply the metal's reflectance.
    eta, k : (..., 3), real and imaginary part of the metal's index of refraction.
    """

    normal: Array
    grazing: Array
    eta: Array
    k: Array

    def weight(self, cos_theta: Array) -> Array:
        """Return the weight (..., 3) at a cosine (...)."""
        reflectance = conductor_fresnel(np.expand_dims(cos_theta, -1), self.eta, self.k)
        return fresnel_blend(self.normal, self.grazing, cos_theta) * reflectance


@dataclass(frozen=True)
class PartitionLobe:
    """One lobe of a partition.

    normal, grazing : (..., 3), weights at normal and at grazing incidence.
    cone : (...), angle in degrees at which a highlight has fallen to a tenth. It has no meaning for diffuse lobes.
    ior_minus_one : (...), index of refraction of a transmitted highlight, minus 1, which is exact in float32 near 0. It
        is 0 for other lobes.
    metals : parts that are added for metals with the exact Fresnel term, in lobes on the viewer's side only.
    """

    normal: Array
    grazing: Array
    cone: Real = 0.0
    ior_minus_one: Real = 0.0
    metals: tuple[Metal, ...] = ()

    def weight(self, cos_theta: Array) -> Array:
        """Return the weight (..., 3) at a cosine (...)."""
        blend = fresnel_blend(self.normal, self.grazing, cos_theta)
        return functools.reduce(operator.add, (metal.weight(cos_theta) for metal in self.metals), blend)

    def end_weights(self) -> tuple[Array, Array]:
        """Return the weights (..., 3) at normal and at grazing incidence, including `metals`."""
        normal, grazing = self.normal, self.grazing
        for metal in self.metals:
            normal, grazing = normal + metal.weight(np.ones(())), grazing + metal.grazing
        return normal, grazing

    def with_weights(self, normal: Callable[[Array], Array], grazing: Callable[[Array], Array]) -> PartitionLobe:
        """Return the lobe with functions applied to its weights at normal and grazing incidence, also in `metals`."""
        metals = tuple(
            replace(metal, normal=normal(metal.normal), grazing=grazing(metal.grazing)) for metal in self.metals
        )
        return replace(self, normal=normal(self.normal), grazing=grazing(self.grazing), metals=metals)

    def energy(self, cos_theta: Array) -> Array:
        """Return the mean over RGB of the weight at a cosine (...).

        In means of cone angles and normals over several lobes, this energy is the lobe's weight.
        """
        return mean(self.weight(cos_theta))


@dataclass(frozen=True)
class Partition:
    """The division of light among the six lobes of a surface.

    wo : (..., 3), unit directions to the viewer in the shading frame.
    terms : the six lobes by name, with weights multiplied by `presence`.
    frames : the frames about the normals of the two families of lobes, ``"diffuse"`` and ``"highlight"``.
    presence : (...), coverage of the surface.
    """

    wo: Array
    terms: Mapping[str, PartitionLobe]
    frames: Mapping[str, Frame]
    presence: Real

    def cosine(self, name: str) -> Array:
        """Return the cosine of the view to the normal of a lobe, (...), at least 0."""
        return view_cosine(self.frames[lobe_family(name)], self.wo)


def lobe_family(name: str) -> Literal["diffuse", "highlight"]:
    """Return the family of a lobe; the lobes of a family share a normal."""
    return "diffuse" if name in ("diffuse", "diffuseTransmission") else "highlight"


def view_cosine(frame: Frame, wo: Array) -> Array:
    """Return the cosine of unit views (..., 3), above the horizon, to the normal of a frame, at least 0."""
    cosine: Array = wo[..., 2] if isinstance(frame, UprightFrame) else np.maximum(dot(frame.normal, wo), 0.0)
    return cosine


def layer_partition(p: Parameters, wo: Array) -> Partition:
    """Return the partition of one layer with parameters `p`, for unit views (..., 3) above the horizon."""
    frames = {name: frame_of(p[f"{name}Normal"]) for name in ("diffuse", "highlight")}
    cosines = {name: view_cosine(frame, wo) for name, frame in frames.items()}
    conserving = p["energy"] == "conserving"
    rough, clear, back = p["roughness"], p["clear"], p["back"]
    smooth, color = 1.0 - rough, layer_color(p)

    # Smits, "Diffuse" and "Transmission". `n_diffuse` is the reflectance at normal incidence for the diffuse lobes, and
    # `g_refl` the reflectance at grazing incidence. A scaled reflectance is at most 1.
    n_diffuse = np.minimum(p["normalScale"] * mix(0.05, 1.0, p["metallic"]), 1.0)
    g_refl = p["grazingScale"]
    # With the token "conserving", the Fresnel term at the highlights' normal also decides how much light reaches the
    # diffuse lobes.
    at_interface = cosines["highlight" if conserving else "diffuse"]
    # `entering` is the share of the light that enters and is not transmitted straight. d_n and d_g are the weights of
    # the diffuse lobes at normal and at grazing incidence.
    entering = (1.0 - clear) * schlick_blend(1.0 - n_diffuse, 1.0 - g_refl, at_interface)
    d_n, d_g = (scale(color, mix(entering * (1.0 - reflectance), 1.0, rough)) for reflectance in (n_diffuse, g_refl))
    scattered = PartitionLobe(d_n, d_g)

    # Smits, "Specular" and "Transmission". `ratio` is "reflRatio": of two highlights, the share of the light that the
    # sharper one has.
    m = np.maximum(1.0 - 2.0 * rough, 0.0)
    ratio = m * m * m
    # This form of 1 - ratio does not cancel where the surface is smooth.
    one_minus_ratio = np.minimum(2.0 * rough, 1.0) * (1.0 + m + m * m)
    reflected = _reflected_term(p)
    unreflected = _unreflected_weight(p, np.ones(())) if is_exact(p) else 1.0 - reflected.end_weights()[0]
    through = PartitionLobe(scale(color * unreflected, clear), scale(color, clear * (1.0 - g_refl)))
    if conserving:
        at_view = reflected.weight(cosines["highlight"])
        # The exact Fresnel term is not a blend of its values at normal and at grazing incidence.
        view = cosines["highlight"]
        transmitted = scale(color * _unreflected_weight(p, view), clear) if is_exact(p) else through.weight(view)
        reflected, through = PartitionLobe(at_view, at_view), PartitionLobe(transmitted, transmitted)

    def term(
        base: PartitionLobe, factor: Real, tint: Array, cone: Real = 0.0, ior_minus_one: Real = 0.0
    ) -> PartitionLobe:
        """Return a lobe whose weights are those of `base`, times factor, tint and presence."""

        def scaled(weight: Array) -> Array:
            return scale(tint * weight, factor * p["presence"])

        weighted = base.with_weights(scaled, scaled)
        return replace(weighted, cone=np.clip(cone, *_CONE_LIMITS), ior_minus_one=ior_minus_one)

    # The broad highlights are specular and specular transmission, the tight ones reflection and refraction.
    broad_weight, tight_weight = smooth * one_minus_ratio, smooth * ratio
    broad_cone, tight_cone, ior_minus_one = 30.0 * rough + 5.0, 10.0 * rough, p["ior"] - 1.0
    white, tint, tint_t = np.ones(3), p["specularTint"], p["transmissionTint"]
    terms = {
        "diffuse": term(scattered, (1.0 - back) * p["diffuseScale"], white),
        "specular": term(reflected, broad_weight * p["specularScale"], tint, broad_cone * p["specularConeScale"]),
        "reflection": term(reflected, tight_weight * p["reflectionScale"], tint, tight_cone * p["reflectionConeScale"]),
        "diffuseTransmission": term(scattered, back * p["diffuseTransmissionScale"], white),
        "specularTransmission": term(
            through,
            broad_weight * p["specularTransmissionScale"],
            tint_t,
            broad_cone * p["specularTransmissionConeScale"],
            ior_minus_one,
        ),
        "refraction": term(
            through, tight_weight * p["refractionScale"], tint_t, tight_cone * p["refractionConeScale"], ior_minus_one
        ),
    }
    return Partition(wo, terms, frames, p["presence"])


def layer_color(p: Parameters) -> Array:
    """Return the colour (..., 3) that tints entering light: the surface colour, or the colour of an exact metal.

    The colour of a metal with the exact Fresnel term is its reflectance at normal incidence.
    """
    color: Array = p["surfaceColor"]
    return mix_color(color, metal_fresnel(p, np.ones(())), p["metallic"]) if is_exact(p) else color


# Smits, "Specular". A scaled reflectance is at most 1.
def _reflected_term(p: Parameters) -> PartitionLobe:
    """Return the weights of the light that a smooth surface reflects."""
    white, normal_scale, metallic = np.ones(3), p["normalScale"], p["metallic"]
    grazing = np.expand_dims(p["grazingScale"], -1) * white
    if not is_exact(p):
        return PartitionLobe(
            np.minimum(scale(mix_color(0.05 * white, p["surfaceColor"], metallic), normal_scale), 1.0), grazing
        )
    dielectric, metal = _scaled_reflectances(p)
    exact = Metal(scale(white, metal * metallic), scale(grazing, metallic), p["eta"], p["k"])
    return PartitionLobe(scale(white, dielectric * (1.0 - metallic)), scale(grazing, 1.0 - metallic), metals=(exact,))


def _scaled_reflectances(p: Parameters) -> tuple[Real, Real]:
    """Return the dielectric's scaled reflectance (...) at normal incidence, and a factor (...) for the metal.

    The factor multiplies the metal's exact reflectance.
    """
    return np.minimum(0.05 * p["normalScale"], 1.0), np.minimum(p["normalScale"], 1.0)


def _unreflected_weight(p: Parameters, cos_theta: Array) -> Array:
    """Return 1 minus the reflectance (..., 3) of a smooth surface at a cosine (...), without cancellation.

    Metals have the exact Fresnel term.
    """
    dielectric, metal = _scaled_reflectances(p)
    absorbed = conductor_absorptance(np.expand_dims(cos_theta, -1), p["eta"], p["k"])
    # `not_reflected` is light that the dielectric does not reflect, and light that the scales remove from the metal's
    # reflection. `incident` is the light that the metal reflects or absorbs by its exact Fresnel term.
    not_reflected = schlick_blend(mix(1.0 - dielectric, 1.0 - metal, p["metallic"]), 1.0 - p["grazingScale"], cos_theta)
    incident = p["metallic"] * schlick_blend(metal, p["grazingScale"], cos_theta)
    return np.expand_dims(not_reflected, -1) + scale(absorbed, incident)


def partition_lobes(partition: Partition) -> tuple[Lobe, ...]:
    """Build the six lobes of a partition."""
    frames = {kind: frame.bend_towards(partition.wo) for kind, frame in partition.frames.items()}
    builders = {"diffuse": _diffuse, "highlight": _highlight}
    return tuple(
        builders[kind := lobe_family(name)](
            name, partition.terms[name], partition.wo, frames[kind], name in TRANSMITTED_LOBES
        )
        for name in (*REFLECTED_LOBES[::-1], *TRANSMITTED_LOBES[::-1])
    )


def _diffuse(name: str, term: PartitionLobe, wo: Array, frame: Frame, transmits: bool) -> Lobe:
    """Build a diffuse lobe."""

    def evaluate(d: DirectionPair) -> Array:
        # Smits, "Diffuse", divided by pi: in the paper, f of a perfect diffuser is 1.
        return term.weight(d.cos_theta_i) * (1.0 / np.pi)

    # The share is the directional albedo. The cosine-weighted mean of Schlick's weight (1 - cos)^5 is 1/21.
    at_normal, at_grazing = term.end_weights()
    share = mean(at_normal) * (20.0 / 21.0) + mean(at_grazing) * (1.0 / 21.0)
    return Lobe(
        "pixar",
        name,
        share,
        evaluate,
        pdf=lambda d: d.cos_theta_i * (1.0 / np.pi),
        sample=mf.sample_cosine,
        group="diffuse",
        frame=frame,
        transmits=transmits,
        has_own_horizon=True,
        broad=True,
        values={"at_normal": at_normal, "at_grazing": at_grazing},
    )


def _highlight(name: str, term: PartitionLobe, wo: Array, frame: Frame, transmits: bool) -> Lobe:
    """Build a highlight; a transmitted one is a reflection of the refracted view, mirrored to the other side."""
    power = _power(term.cone)

    def reflected_pair(d: DirectionPair) -> DirectionPair:
        # The direction of the light in `d` is mirrored to the viewer's side (`Lobe.transmits`). There, the highlight is
        # a reflection of the refracted view (Smits, "Transmission").
        return DirectionPair.from_directions(_refract_view(d.wo, term.ior_minus_one), d.wi) if transmits else d

    def evaluate(d: DirectionPair) -> Array:
        d = reflected_pair(d)
        # Smits, "Specular": D F / (4 (cos_i^2 + cos_o^2 - cos_i cos_o)). In the scan of the paper, the squares are
        # missing.
        i, o = d.cos_theta_i, d.cos_theta_o
        factor = 0.25 * mf.sin_gaussian(d.wm, power) / np.maximum((i - o) * (i - o) + i * o, TINY)
        return scale(term.weight(d.cos_theta_d), factor)

    def density(d: DirectionPair) -> Array:
        d = reflected_pair(d)
        return mf.sin_gaussian(d.wm, power) * d.wm[..., 2] / (4.0 * d.cos_theta_d)

    local = frame.to_local(wo)
    view = _refract_view(local, term.ior_minus_one) if transmits else local

    def sample(u1: Array, u2: Array) -> Array:
        return reflect(view, mf.sample_sin_gaussian(power, u1, u2))

    # The second summand is for a view at which the weight is 0: the weight may be above 0 at half vectors of tilted
    # facets.
    at_normal, at_grazing = term.end_weights()
    share = term.energy(view[..., 2]) + 0.001 * mean(at_normal + at_grazing)
    return Lobe(
        "pixar",
        name,
        share,
        evaluate,
        density,
        sample,
        "specular",
        frame,
        transmits,
        has_own_horizon=True,
        values={"term": term, "power": power, "view": view},
    )


# Snell's law for a unit view: sin^2 theta_t = sin^2 theta / ior^2. The form with the cosine does not cancel for grazing
# views and an index near 1.
def _refract_view(wo: Array, ior_minus_one: Real) -> Array:
    """Return the views (..., 3) refracted towards the normal, on the same side of the surface."""
    ior, z = 1.0 + ior_minus_one, wo[..., 2]
    cos_t = np.sqrt(ior_minus_one * (ior_minus_one + 2.0) + z * z) / ior
    return vector(wo[..., 0] / ior, wo[..., 1] / ior, cos_t)


# Smits, "Specular": exp(-power sin^2 cone) = 0.1.
def _power(cone: Real) -> Array:
    """Return the power of `sin_gaussian` for a cone angle in degrees, at which the Gaussian is a tenth."""
    sine = _sin_degrees(cone)
    power: Array = np.log(10.0) / (sine * sine)
    return power


def _sin_degrees(angle: Real) -> Array:
    """Return the sine of an angle in degrees."""
    x = angle * (np.pi / 180.0)
    # OSL's sin() has an absolute error of 6e-8 at any angle. The series has a relative error of 3e-14 below 0.1.
    square = x * x
    small = x * (1.0 - square / 6.0 * (1.0 - square / 20.0 * (1.0 - square / 42.0)))
    return np.where(x < 0.1, small, np.sin(x))
