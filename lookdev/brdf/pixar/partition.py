"""Pixar's reflection model for Wall-E and Up.

- Smits, B. Reflection Model Design for Wall-E and Up. Pixar Animation Studios.

"Pick a fixed set of reflection lobes ... and then determine how to partition the incoming energy between those lobes
in such a way that energy is conserved." There are six lobes, each with weights at normal and at grazing incidence,
blended by Schlick's term; four of them, the highlights, have a cone angle; there are two normals, of diffuse lobes and
of highlights. A `Partition` holds all of that for a view; layers are combined as partitions
(`lookdev.brdf.pixar.layering`) before lobes are built.
"""

from __future__ import annotations

import functools
import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from lookdev.brdf import microfacet as mf
from lookdev.brdf.frames import Frame, Upright, frame_of
from lookdev.brdf.fresnel import conductor_absorptance, conductor_fresnel, fresnel_blend, schlick_blend
from lookdev.brdf.lobes import Directions, Lobe
from lookdev.brdf.metal import is_exact, metal_fresnel
from lookdev.brdf.vectors import TINY, Array, Parameters, Real, dot, mean, mix, mix_color, reflect, scale, vector

FRONT = ("reflection", "specular", "diffuse")
"""The lobes on the viewer's side, by how much they blur: "reflection/refraction blurs less than specular, which
blurs less than diffuse" (Smits, "Layering")."""

THROUGH = ("refraction", "specularTransmission", "diffuseTransmission")
"""The lobes on the other side, in the same order."""

# Degrees: "0 (or epsilon in practice)", and the angle from which a lobe's albedo exceeds 1 at a view of 89.999 degrees.
_CONES = (0.25, 54.0)


@dataclass(frozen=True)
class Metal:
    """The part of a lobe that exact metal reflects: its reflectance, times weights as those of a `Term`.

    eta, k : (..., 3), its index of refraction.
    """

    normal: Array
    grazing: Array
    eta: Array
    k: Array

    def weight(self, cos_theta: Array) -> Array:
        """Weight (..., 3) at a cosine (...)."""
        reflectance = conductor_fresnel(np.expand_dims(cos_theta, -1), self.eta, self.k)
        return fresnel_blend(self.normal, self.grazing, cos_theta) * reflectance


@dataclass(frozen=True)
class Term:
    """One lobe of a partition.

    normal, grazing : (..., 3), weights at normal and at grazing incidence.
    cone : (...), degrees at which a highlight has fallen to a tenth; without meaning for diffuse lobes.
    bend : (...), of a transmitted highlight, the index of refraction minus 1, which is exact in float32 near 0; else 0.
    metals : what is added by exact metals, on the viewer's side.
    """

    normal: Array
    grazing: Array
    cone: Real = 0.0
    bend: Real = 0.0
    metals: tuple[Metal, ...] = ()

    def weight(self, cos_theta: Array) -> Array:
        """Weight (..., 3) at a cosine (...)."""
        blend = fresnel_blend(self.normal, self.grazing, cos_theta)
        return functools.reduce(operator.add, (metal.weight(cos_theta) for metal in self.metals), blend)

    def ends(self) -> tuple[Array, Array]:
        """Weights (..., 3) at normal and at grazing incidence, exact metals included."""
        normal, grazing = self.normal, self.grazing
        for metal in self.metals:
            normal, grazing = normal + metal.weight(np.ones(())), grazing + metal.grazing
        return normal, grazing

    def changed(self, normal: Callable[[Array], Array], grazing: Callable[[Array], Array]) -> Term:
        """Return the term with functions of its weights at normal and at grazing incidence."""
        metals = tuple(
            replace(metal, normal=normal(metal.normal), grazing=grazing(metal.grazing)) for metal in self.metals
        )
        return replace(self, normal=normal(self.normal), grazing=grazing(self.grazing), metals=metals)

    def energy(self, cos_theta: Array) -> Array:
        """Mean over RGB of the weight at a cosine (...); cones and normals are averaged by it."""
        return mean(self.weight(cos_theta))


@dataclass(frozen=True)
class Partition:
    """How a surface divides light among the six lobes, seen from `wo`, (..., 3).

    terms : the six lobes by name, weights multiplied by `presence`.
    frames : about the normals of the ``"diffuse"`` lobes and of the ``"highlight"`` lobes.
    presence : (...), how much of the surface is there.
    """

    wo: Array
    terms: Mapping[str, Term]
    frames: Mapping[str, Frame]
    presence: Real

    def cosine(self, name: str) -> Array:
        """Cosine of the view to the normal of a lobe, (...), at least 0."""
        return view_cosine(self.frames[family(name)], self.wo)


def family(name: str) -> Literal["diffuse", "highlight"]:
    """Return which of the two normals a lobe has."""
    return "diffuse" if name in ("diffuse", "diffuseTransmission") else "highlight"


def view_cosine(frame: Frame, wo: Array) -> Array:
    """Cosine of unit views (..., 3), above the horizon, to the normal of a frame, at least 0."""
    cosine: Array = wo[..., 2] if isinstance(frame, Upright) else np.maximum(dot(frame.normal, wo), 0.0)
    return cosine


def layer_partition(p: Parameters, wo: Array) -> Partition:
    """Divide light among the lobes of one layer of parameters `p` for unit views (..., 3), above the horizon."""
    frames = {name: frame_of(p[f"{name}Normal"]) for name in ("diffuse", "highlight")}
    cosines = {name: view_cosine(frame, wo) for name, frame in frames.items()}
    conserving = p["energy"] == "conserving"
    rough, clear, back = p["roughness"], p["clear"], p["back"]
    smooth, color = 1.0 - rough, layer_color(p)

    # Smits, "Diffuse" and "Transmission". A scaled reflectance is at most 1.
    n_diffuse = np.minimum(p["normalScale"] * mix(0.05, 1.0, p["metallic"]), 1.0)
    g_refl = p["grazingScale"]
    # Conserving, light enters by the Fresnel term of the highlights for the diffuse lobes too.
    at_interface = cosines["highlight" if conserving else "diffuse"]
    enters = (1.0 - clear) * schlick_blend(1.0 - n_diffuse, 1.0 - g_refl, at_interface)
    d_n, d_g = (scale(color, mix(enters * (1.0 - each), 1.0, rough)) for each in (n_diffuse, g_refl))
    scattered = Term(d_n, d_g)

    # Smits, "Specular" and "Transmission": "reflRatio".
    m = np.maximum(1.0 - 2.0 * rough, 0.0)
    ratio = m * m * m
    # 1 - ratio, without cancellation where the surface is smooth.
    rest = np.minimum(2.0 * rough, 1.0) * (1.0 + m + m * m)
    reflected = _reflected(p)
    unreflected = _unreflected(p, np.ones(())) if is_exact(p) else 1.0 - reflected.ends()[0]
    through = Term(scale(color * unreflected, clear), scale(color, clear * (1.0 - g_refl)))
    if conserving:
        at_view = reflected.weight(cosines["highlight"])
        # An exact curve is not a blend of its ends.
        view = cosines["highlight"]
        passed = scale(color * _unreflected(p, view), clear) if is_exact(p) else through.weight(view)
        reflected, through = Term(at_view, at_view), Term(passed, passed)

    def term(of: Term, factor: Real, tint: Array, cone: Real = 0.0, bend: Real = 0.0) -> Term:
        def scaled(weight: Array) -> Array:
            return scale(tint * weight, factor * p["presence"])

        return replace(of.changed(scaled, scaled), cone=np.clip(cone, *_CONES), bend=bend)

    broad, tight = smooth * rest, smooth * ratio
    wide, narrow = 30.0 * rough + 5.0, 10.0 * rough
    white, tint, tint_t = np.ones(3), p["specularTint"], p["transmissionTint"]
    terms = {
        "diffuse": term(scattered, (1.0 - back) * p["diffuseScale"], white),
        "specular": term(reflected, broad * p["specularScale"], tint, wide * p["specularConeScale"]),
        "reflection": term(reflected, tight * p["reflectionScale"], tint, narrow * p["reflectionConeScale"]),
        "diffuseTransmission": term(scattered, back * p["diffuseTransmissionScale"], white),
        "specularTransmission": term(
            through,
            broad * p["specularTransmissionScale"],
            tint_t,
            wide * p["specularTransmissionConeScale"],
            p["ior"] - 1.0,
        ),
        "refraction": term(
            through, tight * p["refractionScale"], tint_t, narrow * p["refractionConeScale"], p["ior"] - 1.0
        ),
    }
    return Partition(wo, terms, frames, p["presence"])


def layer_color(p: Parameters) -> Array:
    """Return what is left of the light that enters, (..., 3): of exact metal, what it reflects along its normal."""
    color: Array = p["surfaceColor"]
    return mix_color(color, metal_fresnel(p, np.ones(())), p["metallic"]) if is_exact(p) else color


# Smits, "Specular". A scaled reflectance is at most 1.
def _reflected(p: Parameters) -> Term:
    """Return what the surface reflects where it is smooth."""
    white, rises, metallic = np.ones(3), p["normalScale"], p["metallic"]
    grazing = np.expand_dims(p["grazingScale"], -1) * white
    if not is_exact(p):
        return Term(np.minimum(scale(mix_color(0.05 * white, p["surfaceColor"], metallic), rises), 1.0), grazing)
    dielectric, metal = _scaled(p)
    exact = Metal(scale(white, metal * metallic), scale(grazing, metallic), p["eta"], p["k"])
    return Term(scale(white, dielectric * (1.0 - metallic)), scale(grazing, 1.0 - metallic), metals=(exact,))


def _scaled(p: Parameters) -> tuple[Real, Real]:
    """Return the scaled reflectance at normal incidence of a dielectric, and the factor of that of an exact metal."""
    return np.minimum(0.05 * p["normalScale"], 1.0), np.minimum(p["normalScale"], 1.0)


def _unreflected(p: Parameters, cos_theta: Array) -> Array:
    """Return 1 less what a smooth surface with exact metal reflects, (..., 3), without cancellation."""
    dielectric, metal = _scaled(p)
    absorbed = conductor_absorptance(np.expand_dims(cos_theta, -1), p["eta"], p["k"])
    # Neither reflects it by its scales; or metal absorbs it.
    missed = schlick_blend(mix(1.0 - dielectric, 1.0 - metal, p["metallic"]), 1.0 - p["grazingScale"], cos_theta)
    met = p["metallic"] * schlick_blend(metal, p["grazingScale"], cos_theta)
    return np.expand_dims(missed, -1) + scale(absorbed, met)


def partition_lobes(partition: Partition) -> tuple[Lobe, ...]:
    """Build the six lobes."""
    frames = {kind: frame.facing(partition.wo) for kind, frame in partition.frames.items()}
    builders = {"diffuse": _diffuse, "highlight": _highlight}
    return tuple(
        builders[kind := family(name)](name, partition.terms[name], partition.wo, frames[kind], name in THROUGH)
        for name in (*FRONT[::-1], *THROUGH[::-1])
    )


def _diffuse(name: str, term: Term, wo: Array, frame: Frame, transmits: bool) -> Lobe:
    def evaluate(d: Directions) -> Array:
        # Smits, "Diffuse", where f of a perfect diffuser is 1: divided by pi.
        return term.weight(d.cos_theta_i) * (1.0 / np.pi)

    # The directional albedo: the cosine-weighted mean of (1 - cos)^5 is 1/21.
    at_normal, at_grazing = term.ends()
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
        own_side=True,
        broad=True,
        values={"at_normal": at_normal, "at_grazing": at_grazing},
    )


def _highlight(name: str, term: Term, wo: Array, frame: Frame, transmits: bool) -> Lobe:
    power = _power(term.cone)

    def seen(d: Directions) -> Directions:
        # The view whose reflection is the refraction of this one (Smits, "Transmission").
        return Directions.of(_refracted(d.wo, term.bend), d.wi) if transmits else d

    def evaluate(d: Directions) -> Array:
        d = seen(d)
        # Smits, "Specular": D F / (4 (cos_i^2 + cos_o^2 - cos_i cos_o)), whose squares the scan lost.
        i, o = d.cos_theta_i, d.cos_theta_o
        factor = 0.25 * mf.sin_gaussian(d.wm, power) / np.maximum((i - o) * (i - o) + i * o, TINY)
        return scale(term.weight(d.cos_theta_d), factor)

    def density(d: Directions) -> Array:
        d = seen(d)
        return mf.sin_gaussian(d.wm, power) * d.wm[..., 2] / (4.0 * d.cos_theta_d)

    local = frame.to_local(wo)
    view = _refracted(local, term.bend) if transmits else local

    def sample(u1: Array, u2: Array) -> Array:
        return reflect(view, mf.sample_sin_gaussian(power, u1, u2))

    # Half vectors lean away from the normal: where the weight at the view is 0, the lobe is not black.
    at_normal, at_grazing = term.ends()
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
        own_side=True,
        values={"term": term, "power": power, "view": view},
    )


# Snell's law for a unit view: sin^2 theta_t = sin^2 theta / ior^2. Written by the cosine, which does not cancel where
# the view grazes and the index is near 1.
def _refracted(wo: Array, bend: Real) -> Array:
    ior, z = 1.0 + bend, wo[..., 2]
    cos_t = np.sqrt(bend * (bend + 2.0) + z * z) / ior
    return vector(wo[..., 0] / ior, wo[..., 1] / ior, cos_t)


# Smits, "Specular": exp(-power sin^2 cone) = 0.1.
def _power(cone: Real) -> Array:
    sine = _sin_degrees(cone)
    power: Array = np.log(10.0) / (sine * sine)
    return power


def _sin_degrees(angle: Real) -> Array:
    x = angle * (np.pi / 180.0)
    # OSL's sin() is good to 6e-8 however small the angle; the series is good to 3e-14 of the sine here.
    square = x * x
    small = x * (1.0 - square / 6.0 * (1.0 - square / 20.0 * (1.0 - square / 42.0)))
    return np.where(x < 0.1, small, np.sin(x))
