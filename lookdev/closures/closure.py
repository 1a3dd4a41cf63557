"""Represent the closures of Cycles as records, and evaluate them in NumPy as Cycles does, for fits and tests.

Closures approximate the lobes of our models. The formulas are those of
intern/cycles/kernel/closure/bsdf_microfacet.h, Blender 4.5 and 5.2:

- Heitz, E. 2014. Understanding the Masking-Shadowing Function in Microfacet-Based BRDFs. JCGT 3(2).
- Walter, B. et al. 2007. Microfacet Models for Refraction through Rough Surfaces. EGSR.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from lookdev.arrays import Floats
from lookdev.brdf.frames import ZENITH, Frame, UprightFrame
from lookdev.brdf.fresnel import conductor_fresnel, schlick_weight
from lookdev.brdf.lobes import Lobe
from lookdev.brdf.microfacet import gtr2_aniso
from lookdev.brdf.vectors import TINY, Array, Real, dot, mix_color, normalize, scale

ClosureKind = Literal[
    "diffuse", "rough_diffuse", "translucent",
    "ggx", "beckmann", "metal", "conductor", "sheen", "ggx_refraction", "beckmann_refraction",
]  # fmt: skip


@dataclass(frozen=True)
class Closure:
    """One closure of Cycles, for a fixed direction to the viewer.

    kind
        ``"diffuse"`` (Lambert), ``"rough_diffuse"`` (Oren and Nayar), ``"translucent"`` (Lambert on the other side),
        ``"ggx"`` and ``"beckmann"`` (reflecting microfacets, single scattering, height-correlated shadowing),
        ``"metal"`` (GGX with Schlick's Fresnel term), ``"conductor"`` (GGX with the exact Fresnel term of conductors),
        ``"sheen"`` (a metal of alpha 1 and `f0` 0), ``"ggx_refraction"`` and ``"beckmann_refraction"`` (microfacets
        that transmit all light).
    weight : (..., 3)
        The factor of the closure, at least 0. For a metal, a conductor and a rough diffuse closure, it is grey and at
        most 1.
    alpha_x, alpha_y : (...)
        The roughness of microfacets along the first two axes of `frame`, in [0.001, 1]. `alpha_x` is 1 to 10 times
        `alpha_y`. Lambert's closures and sheen do not use the alphas. Where the product of the alphas is below 2e-10,
        Cycles renders a mirror.
    frame
        The frame of the closure, relative to the shading frame. The closure's normal is the z axis of `frame`.
    ior : (...)
        For a refraction: the index of refraction of the other side.
    f0 : (..., 3)
        For a metal: the reflectance at normal incidence, in [0, 1]. For a rough diffuse closure: the colour, at least
        0.
    roughness : (...)
        For a rough diffuse closure: Oren and Nayar's roughness, in [0, 1].
    eta, k : (..., 3)
        For a conductor: the index of refraction and the extinction coefficient.
    """

    kind: ClosureKind
    weight: Array
    alpha_x: Real = 1.0
    alpha_y: Real = 1.0
    frame: Frame = field(default_factory=UprightFrame)
    ior: Real = 1.0
    f0: Array = field(default_factory=lambda: np.zeros(3))
    roughness: Real = 0.0
    eta: Array = field(default_factory=lambda: np.ones(3))
    k: Array = field(default_factory=lambda: np.zeros(3))

    @property
    def transmits(self) -> bool:
        """Whether light and viewer are on opposite sides of the surface."""
        return self.kind in ("translucent", "ggx_refraction", "beckmann_refraction")


StandIn = Callable[[Lobe, Array], tuple[Closure, ...]]
"""A function of a lobe, and of the directions to the viewer (..., 3) with which the lobe was made; returns closures."""


def closure_cosine(closure: Closure, wo: Floats, wi: Floats) -> Floats:
    """Return weight times BSDF (1/sr) times cosine of a closure, (..., 3), as in Cycles.

    The cosine is the one between the light and the closure's normal. `wo` and `wi`, (..., 3), are unit directions: `wo`
    to the viewer, above the horizon, and `wi` to the light; z is the shading normal. The result is 0 where light comes
    from the wrong side of the closure's normal or of the surface.
    """
    wo_local, wi_local = closure.frame.to_local(wo), closure.frame.to_local(wi)
    side = -1.0 if closure.transmits else 1.0
    valid = (wo_local[..., 2] > 0.0) & (side * wi_local[..., 2] > 0.0) & (side * wi[..., 2] > 0.0)
    mask = np.expand_dims(valid, -1)
    # Where the result is 0 anyway, directions along the normal avoid divisions by 0.
    wo_local, wi_local = np.where(mask, wo_local, ZENITH), np.where(mask, wi_local, side * ZENITH)
    color = closure.weight
    shape: Array
    if closure.kind in ("diffuse", "translucent", "rough_diffuse"):
        shape = np.abs(wi_local[..., 2]) / np.pi
    else:
        shape = _microfacets(closure, wo_local, wi_local)
    if closure.kind == "rough_diffuse":
        color = color * _oren_nayar(closure, wo_local, wi_local)
    if closure.kind in ("metal", "sheen"):
        color = color * mix_color(closure.f0, np.ones(3), schlick_weight(dot(wo_local, normalize(wo_local + wi_local))))
    if closure.kind == "conductor":
        # As in Cycles 5.2; Cycles 4.5 approximates it.
        cos_theta_d = np.expand_dims(dot(wo_local, normalize(wo_local + wi_local)), -1)
        color = color * conductor_fresnel(np.minimum(cos_theta_d, 1.0), closure.eta, closure.k)
    return np.asarray(scale(color, np.where(valid, shape, 0.0)))


# Fujii, Y. A tiny improvement of Oren-Nayar reflectance model. Multiple scattering is as in OpenPBR 1.1.
def _oren_nayar(closure: Closure, wo: Array, wi: Array) -> Array:
    """Return the ratio of Oren and Nayar's BRDF to Lambert's of reflectance 1, (..., 3), in the closure's frame."""
    # `nv` and `nl` are the cosines of view and light, and `t` is the term that roughness multiplies. `ev`, `el` and
    # `mean` are albedos of single scattering: at the view, at the light and on average.
    sigma, nv, nl = closure.roughness, wo[..., 2], wi[..., 2]
    single = 1.0 / (1.0 + sigma * (0.5 - 2.0 / (3.0 * np.pi)))
    t = dot(wo, wi) - nl * nv
    t = np.where(t > 0.0, t / np.maximum(np.maximum(nl, nv), TINY), t)
    ev, el = (rough_diffuse_albedo(sigma, oren_nayar_g(cosine)) for cosine in (nv, nl))
    mean = single * (1.0 + sigma * (2.0 - 5.6 / np.pi) / 3.0)
    color = np.clip(closure.f0, 0.0, 1.0)
    multiple = color * color * np.expand_dims(mean / np.maximum(1.0 - mean, TINY) * (1.0 - ev) * (1.0 - el), -1)
    multiple = multiple / (1.0 - color * np.expand_dims(1.0 - mean, -1))
    return np.multiply(closure.f0, np.expand_dims(single * (1.0 + sigma * t), -1) + multiple)


def rough_diffuse_albedo(sigma: Real, g: Real) -> Real:
    """Return the directional albedo (...) of Oren and Nayar's single scattering for a white surface.

    `sigma` is the roughness, and `g` the value of `oren_nayar_g` at the direction.
    """
    return (1.0 + sigma * g * (1.0 / np.pi)) / (1.0 + sigma * (0.5 - 2.0 / (3.0 * np.pi)))


def oren_nayar_g(cos_theta: Array) -> Array:
    """Return the integral of Oren and Nayar's rough term over the hemisphere of light, (...).

    Roughness multiplies the rough term. `cos_theta` (...) is the cosine of the view.
    """
    sin_theta = np.sqrt(np.maximum(1.0 - cos_theta * cos_theta, 0.0))
    tan = sin_theta / np.maximum(cos_theta, 1e-6)
    theta = np.arctan2(sin_theta, cos_theta)
    g: Array = sin_theta * (theta - 2.0 / 3.0 - sin_theta * cos_theta) + 2.0 / 3.0 * tan * (1.0 - sin_theta**3)
    return g


def _microfacets(closure: Closure, wo: Array, wi: Array) -> Array:
    """Return BSDF times cosine of a microfacet closure with a Fresnel term of 1, (...).

    `wo` and `wi` (..., 3) are unit directions in the closure's frame. `wo` is above the frame's horizon. `wi` is below
    it for a refraction, and above it for the other closures.
    """
    if closure.kind.endswith("refraction"):
        # Walter et al. 2007, eq. 16 and 21. `jacobian` is d omega_h / d omega_i, times |wo . wm|. For reflection, the
        # product is 1 / 4.
        half = -(wo + scale(wi, closure.ior))
        wm = normalize(half)
        jacobian: Real = closure.ior * closure.ior * np.abs(dot(wo, wm) * dot(wi, wm)) / dot(half, half)
    else:
        wm = normalize(wo + wi)
        jacobian = 0.25
    x, y = closure.alpha_x, closure.alpha_y
    facing = wm[..., 2] > 0.0
    wm = np.where(np.expand_dims(facing, -1), wm, ZENITH)
    d, lambda_of = (_beckmann, _beckmann_lambda) if closure.kind.startswith("beckmann") else (gtr2_aniso, _ggx_lambda)
    shadowing = 1.0 / (1.0 + lambda_of(_slope2(wo, x, y)) + lambda_of(_slope2(wi, x, y)))
    return np.where(facing, d(wm, x, y) * shadowing * jacobian / wo[..., 2], 0.0)


def _slope2(w: Array, alpha_x: Real, alpha_y: Real) -> Array:
    """Return the square of alpha tan theta for directions `w` (..., 3): the variable of Smith's Lambda."""
    x, y, z = w[..., 0] * alpha_x, w[..., 1] * alpha_y, w[..., 2]
    return (x * x + y * y) / np.maximum(z * z, TINY)


# Heitz 2014, eq. 72.
def _ggx_lambda(slope2: Array) -> Array:
    """Return Smith's Lambda of GGX, (...)."""
    return 0.5 * (np.sqrt(1.0 + slope2) - 1.0)


# Heitz 2014, below eq. 69: the approximation that Cycles uses.
def _beckmann_lambda(slope2: Array) -> Array:
    """Return Smith's Lambda of Beckmann's distribution, (...)."""
    a = 1.0 / np.sqrt(np.maximum(slope2, 0.39))
    return np.where(slope2 < 0.39, 0.0, (1.0 - 1.259 * a + 0.396 * a * a) / (3.535 * a + 2.181 * a * a))


def _beckmann(wm: Array, alpha_x: Real, alpha_y: Real) -> Array:
    """Return Beckmann's distribution of microfacet normals `wm` (..., 3), in 1/sr."""
    z2 = np.maximum(wm[..., 2] * wm[..., 2], TINY)
    x, y = wm[..., 0] / alpha_x, wm[..., 1] / alpha_y
    return np.exp(-(x * x + y * y) / z2) / (np.pi * alpha_x * alpha_y * z2 * z2)
