"""Stock closures of Cycles as stand-ins for lobes: what the node backend renders, and how far it is from the model.

A lobe's view-dependent factors go into the weight of its closures exactly; what depends on the light as well is fitted
(`lookdev.brdf.fits`): the shape of the lobe, and a factor over the view that gives back the lobe's directional albedo.

The closures are written here as Cycles has them (intern/cycles/kernel/closure/bsdf_microfacet.h, Blender 4.5 and 5.2),
so that the distance can be computed:

- Heitz, E. 2014. Understanding the Masking-Shadowing Function in Microfacet-Based BRDFs. JCGT 3(2).
- Walter, B. et al. 2007. Microfacet Models for Refraction through Rough Surfaces. EGSR.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from lookdev.brdf.frames import ZENITH, to_local
from lookdev.brdf.microfacet import gtr2_aniso
from lookdev.brdf.vectors import TINY, Array, dot, normalize, scale

Kind = Literal["diffuse", "translucent", "ggx", "beckmann", "ggx_refraction", "beckmann_refraction"]

PI = np.pi


@dataclass(frozen=True)
class Closure:
    """One closure of Cycles, seen from a fixed direction, in the frame of the shading normal.

    kind
        ``"diffuse"`` (Lambert), ``"translucent"`` (Lambert on the other side), ``"ggx"`` and ``"beckmann"``
        (microfacets that reflect everything, each light once, height-correlated shadowing), ``"ggx_refraction"`` and
        ``"beckmann_refraction"`` (microfacets that all light goes through).
    weight : (..., 3)
        At least 0.
    alpha_x, alpha_y : (...)
        Along the first two axes of the frame that `frames.to_local` makes of `normal`, in [0.001, 1]; without meaning
        for Lambert's. Cycles takes a microfacet for a mirror where their product is below 2e-10.
    normal : (..., 3)
        Unit normal, the zenith where it is the shading normal.
    ior : (...)
        Index of refraction of the other side, of a refraction.
    """

    kind: Kind
    weight: Array
    alpha_x: Array = 1.0
    alpha_y: Array = 1.0
    normal: Array = field(default_factory=lambda: ZENITH)
    ior: Array = 1.0


def closure_cosine(closure: Closure, wo: Array, wi: Array) -> Array:
    """Evaluate a closure as Cycles does, times the cosine.

    Parameters
    ----------
    wo, wi : (..., 3)
        Unit directions to the viewer, above the horizon, and to the light; z is the shading normal.

    Returns
    -------
    (..., 3)
        The weight times f in 1/sr times the cosine by the closure's normal; 0 where light comes from the wrong side of
        that normal or of the surface.
    """
    o, i = to_local(closure.normal, wo), to_local(closure.normal, wi)
    side = 1.0 if closure.kind in ("diffuse", "ggx", "beckmann") else -1.0
    valid = (o[..., 2] > 0.0) & (side * i[..., 2] > 0.0) & (side * wi[..., 2] > 0.0)
    mask = np.expand_dims(valid, -1)
    o, i = np.where(mask, o, ZENITH), np.where(mask, i, side * ZENITH)
    value = np.abs(i[..., 2]) / PI if closure.kind in ("diffuse", "translucent") else _microfacets(closure, o, i)
    return scale(closure.weight, np.where(valid, value, 0.0))


def _microfacets(closure: Closure, wo: Array, wi: Array) -> Array:
    if closure.kind.endswith("refraction"):
        # Walter et al. 2007, eq. 16 and 21.
        half = -(wo + scale(wi, closure.ior))
        wm = normalize(half)
        jacobian = closure.ior**2 * np.abs(dot(wo, wm) * dot(wi, wm)) / dot(half, half)
    else:
        wm = normalize(wo + wi)
        jacobian = 0.25
    x, y = closure.alpha_x, closure.alpha_y
    facing = wm[..., 2] > 0.0
    wm = np.where(np.expand_dims(facing, -1), wm, ZENITH)
    d, lambda_of = (_beckmann, _beckmann_lambda) if closure.kind.startswith("beckmann") else (gtr2_aniso, _ggx_lambda)
    shadowing = 1.0 / (1.0 + lambda_of(_slope2(wo, x, y)) + lambda_of(_slope2(wi, x, y)))
    return np.where(facing, d(wm, x, y) * shadowing * jacobian / wo[..., 2], 0.0)


def _slope2(w: Array, alpha_x: Array, alpha_y: Array) -> Array:
    x, y, z = w[..., 0] * alpha_x, w[..., 1] * alpha_y, w[..., 2]
    return (x * x + y * y) / np.maximum(z * z, TINY)


# Heitz 2014, eq. 72.
def _ggx_lambda(slope2: Array) -> Array:
    return 0.5 * (np.sqrt(1.0 + slope2) - 1.0)


# Heitz 2014, below eq. 69: the approximation that Cycles uses.
def _beckmann_lambda(slope2: Array) -> Array:
    a = 1.0 / np.sqrt(np.maximum(slope2, 0.39))
    return np.where(slope2 < 0.39, 0.0, (1.0 - 1.259 * a + 0.396 * a * a) / (3.535 * a + 2.181 * a * a))


def _beckmann(wm: Array, alpha_x: Array, alpha_y: Array) -> Array:
    z2 = np.maximum(wm[..., 2] * wm[..., 2], TINY)
    x, y = wm[..., 0] / alpha_x, wm[..., 1] / alpha_y
    return np.exp(-(x * x + y * y) / z2) / (PI * alpha_x * alpha_y * z2 * z2)
