"""Closures of Cycles that approximate the lobes of Pixar's model (`lookdev.brdf.pixar`).

Pixar's highlight is a sin-Gaussian: ``exp(-power sin^2 theta_h)``, where theta_h is the angle from the normal to the
half vector. A narrow highlight is nearly a Beckmann lobe with ``alpha^2 = 1 / power``. A wide highlight ends at the
horizon; for it, GGX is mixed with Beckmann.

A transmitted highlight becomes a refraction closure. The closure's normal is the refracted direction to the viewer. The
closure's index of refraction is so high that light leaves along the microfacet's normal for every view. In the plane of
incidence, mirrored directions are twice as far from their mean as half vectors are from theirs. At right angles to this
plane, they are less far. The closure's alpha is therefore twice the alpha of the half vectors, times the square root of
the refracted view's cosine.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lookdev.brdf.frames import Frame, TiltedFrame
from lookdev.brdf.lobes import Lobe
from lookdev.brdf.reflectance import relative_cosine
from lookdev.brdf.vectors import Array, are_equal, dot, scale
from lookdev.closures.closure import Closure, ClosureKind, StandIn
from lookdev.closures.fits import HighlightShape, closure_fit, closure_table

TRANSMITTED_IOR = 1000.0
"""The index of refraction of the closures for transmitted highlights. It need only be very high."""

_MAX_RATIO = 1.25  # the largest ratio of a lobe's directional albedo to the albedo of its closures


def diffuse_closures(lobe: Lobe, wo: Array) -> tuple[Closure, ...]:
    """Return the closure for a diffuse lobe. Its directional albedo is exact, and the same for all views."""
    # At a cosine of the light, the lobe's weight is a mixture of the two weights below: (1 - cosine)^5 is the share of
    # the second. The cosine-weighted mean of this share over the light is 1/21.
    weight = lobe.values["at_normal"] * (20.0 / 21.0) + lobe.values["at_grazing"] * (1.0 / 21.0)
    return (Closure("translucent" if lobe.transmits else "diffuse", weight, frame=lobe.frame),)


def highlight_closures(lobe: Lobe, wo: Array) -> tuple[Closure, ...]:
    """Return closures for a reflected or transmitted highlight: Beckmann, and also GGX if the highlight is wide."""
    # `p` has the values of the lobe by name. `local` is the direction to the viewer in the lobe's frame. `view` is the
    # same direction, but refracted if the lobe transmits.
    p = lobe.values
    local, view = lobe.frame.to_local(wo), p["view"]
    alpha, cos_theta = 1.0 / np.sqrt(p["power"]), view[..., 2]
    relative = relative_cosine(cos_theta, alpha)
    if lobe.transmits:
        tilt = 1.0 - np.minimum(dot(local, view), 1.0)
        factor = ggx_share(alpha, closure_table()["shapes"]["highlight"]) * alpha * tilt
        ratio = closure_fit("transmitted")(relative, alpha) + factor * closure_fit("transmitted_tilt")(tilt, cos_theta)
    else:
        ratio = closure_fit("highlight")(relative, alpha)
    # The limits apply in the last half degree before grazing, where the fits are far off.
    ratio = np.clip(ratio, 0.0, _MAX_RATIO)
    # The cosine at which Schlick's weight equals its mean over the lobe.
    typical_cosine = np.clip(closure_fit("highlight_cosine")(cos_theta, alpha), 0.0, 1.0)
    fresnel = p["term"].weight(typical_cosine)
    mix = highlight_mix(alpha, view, lobe.frame, lobe.transmits, closure_table()["shapes"]["highlight"])
    return tuple(replace(closure, weight=scale(fresnel, ratio * closure.weight)) for closure in mix)


def highlight_mix(
    alpha: Array, view: Array, frame: Frame, transmits: bool, shape: HighlightShape
) -> tuple[Closure, ...]:
    """Return the closures of a highlight, Beckmann and GGX. The weight of a closure is its share in the mix, (...).

    `alpha` (...) is the alpha of the highlight's half vectors. `view` (..., 3) is the direction to the viewer in
    `frame`, refracted if the highlight `transmits`. `shape` has three numbers. The share of GGX is 0 up to the alpha
    `start`, and then grows with the slope `slope`. The alpha of GGX is `width` times the alpha of Beckmann.
    """
    share = ggx_share(alpha, shape)
    kinds: tuple[ClosureKind, ClosureKind] = ("beckmann", "ggx")
    ior = 1.0
    if transmits:
        alpha = 2.0 * alpha * np.sqrt(view[..., 2])
        frame, ior = TiltedFrame(frame.from_local(view)), TRANSMITTED_IOR
        kinds = "beckmann_refraction", "ggx_refraction"
    parts = (kinds[0], 1.0 - share, alpha), (kinds[1], share, shape["width"] * alpha)
    return tuple(
        Closure(kind, part, np.minimum(part_alpha, 1.0), np.minimum(part_alpha, 1.0), frame, ior)
        for kind, part, part_alpha in parts
        if not are_equal(part, 0.0)
    )


def ggx_share(alpha: Array, shape: HighlightShape) -> Array:
    """Return the share of GGX in a highlight's mix, (...), which is exactly 0 for alpha up to the shape's `start`."""
    return np.clip(shape["slope"] * (alpha - shape["start"]), 0.0, 1.0)


STAND_INS: dict[tuple[str, str], StandIn] = {
    ("pixar", "diffuse"): diffuse_closures,
    ("pixar", "specular"): highlight_closures,
    ("pixar", "reflection"): highlight_closures,
    ("pixar", "diffuseTransmission"): diffuse_closures,
    ("pixar", "specularTransmission"): highlight_closures,
    ("pixar", "refraction"): highlight_closures,
}
"""The functions that return the closures of a lobe, by the names of the model and of the lobe."""
