"""Phong's model and two variants: a diffuse lobe, and a highlight that is a power of a cosine.

- phong: ``f = kd + ks (r . wi)^e / cos_theta_i``
- blinn-phong: ``f = kd + ks (n . h)^e / cos_theta_i``
- modified-phong: ``f = kd / pi + ks (e + 2) / (2 pi) (r . wi)^e``, which is reciprocal and conserves energy

kd and ks are the colours `diffuse` and `specular`, e is `exponent`, r is the mirrored view, n the normal and h the half
vector. As published, the first two have no 1 / pi.

- Phong, B. T. 1975. Illumination for Computer Generated Pictures. CACM 18(6).
- Blinn, J. F. 1977. Models of Light Reflection for Computer Synthesized Pictures. SIGGRAPH.
- Lafortune, E. P. and Willems, Y. D. 1994. Using the Modified Phong Reflectance Model for Physically Based Rendering.
  Report CW 197, KU Leuven.

Directions of the highlight, or for blinn-phong half vectors, are drawn in proportion to the power of the cosine.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lookdev.brdf.classic import parts
from lookdev.brdf.frames import Frame
from lookdev.brdf.lobes import DirectionPair, Lobe
from lookdev.brdf.microfacet import polar
from lookdev.brdf.model import Model, Preview
from lookdev.brdf.special import cosine_power
from lookdev.brdf.vectors import TINY, Array, Parameters, Real, mean, reflect, scale


def _phong(p: Parameters, wo: Array, frame: Frame) -> Lobe:
    """Build the highlight of phong."""
    e, r = p["exponent"], parts.mirror(wo)

    def evaluate(d: DirectionPair) -> Array:
        return scale(p["specular"], parts.power_cosine(r, d.wi, e) / np.maximum(d.cos_theta_i, TINY))

    return _mirror_lobe("phong", p, r, frame, mean(p["specular"]) * (2.0 * np.pi) / (e + 1.0), evaluate)


def _modified_phong(p: Parameters, wo: Array, frame: Frame) -> Lobe:
    """Build the highlight of modified-phong."""
    e, r = p["exponent"], parts.mirror(wo)
    factor = (e + 2.0) * (0.5 / np.pi)

    def evaluate(d: DirectionPair) -> Array:
        return scale(p["specular"], factor * parts.power_cosine(r, d.wi, e))

    # The albedo is about the mean of cos_theta_i over the highlight, which is about the cosine of the view.
    albedo = np.minimum(np.sqrt(wo[..., 2] * wo[..., 2] + 1.0 / (e + 2.0)), 1.0)
    return _mirror_lobe("modified-phong", p, r, frame, mean(p["specular"]) * albedo, evaluate)


def _mirror_lobe(
    model: str, p: Parameters, r: Array, frame: Frame, share: Real, evaluate: Callable[[DirectionPair], Array]
) -> Lobe:
    """Return a highlight about the mirrored view `r`; `share` and `evaluate` are as in `Lobe`."""
    e = p["exponent"]
    return Lobe(
        model,
        "specular",
        share,
        evaluate,
        pdf=lambda d: parts.power_cosine_pdf(r, d.wi, e),
        sample=lambda u1, u2: parts.sample_power_cosine(r, e, u1, u2),
        group="specular",
        frame=frame,
        values={"specular": p["specular"], "exponent": e},
    )


def _blinn(p: Parameters, wo: Array, frame: Frame) -> Lobe:
    """Build the highlight of blinn-phong."""
    e = p["exponent"]

    def power(d: DirectionPair) -> Array:
        return cosine_power(d.wm[..., 2], parts.versine(d.wm), e)

    def sample(u1: Array, u2: Array) -> Array:
        return reflect(wo, polar(parts.sin2_of_power(2.0 / (e + 1.0), u2), u1))

    # The albedo is the integral of ks (n . h)^e 4 wi . h over half vectors, about 8 pi / (e + 4) for a view along the
    # normal. The mean of wi . h is about the cosine of the view.
    mean_cosine = np.sqrt(wo[..., 2] * wo[..., 2] + (1.0 - wo[..., 2] * wo[..., 2]) / (e + 4.0))
    return Lobe(
        "blinn-phong",
        "specular",
        mean(p["specular"]) * (8.0 * np.pi) / (e + 4.0) * mean_cosine,
        evaluate=lambda d: scale(p["specular"], power(d) / np.maximum(d.cos_theta_i, TINY)),
        pdf=lambda d: power(d) * ((e + 1.0) * (0.125 / np.pi)) / d.cos_theta_d,
        sample=sample,
        group="specular",
        frame=frame,
        values={"specular": p["specular"], "exponent": e},
    )


def _preview(diffuse: float) -> Preview:
    """Return the preview of a model whose diffuse lobe has the albedo `diffuse` where kd is white."""

    def derived(p: Parameters) -> dict[str, Real]:
        return {
            "diffuseColor": np.minimum(diffuse * p["diffuse"], 1.0),
            # A power e of the cosine to the half vector is about Beckmann's D with alpha^2 = 2 / (e + 2).
            "roughness": np.sqrt(np.sqrt(2.0 / (p["exponent"] + 2.0))),
        }

    return Preview({}, derived)


_PARAMETERS = parts.parameters_with_normal(
    parts.color_parameter("diffuse", 0.2, "kd, the colour of the body; linear."),
    parts.color_parameter("specular", 0.3, "ks, the colour of the highlight; linear."),
    parts.exponent_parameter("exponent", 32.0, "Of the cosine: the higher, the smaller the highlight."),
)

PHONG = Model(
    name="phong",
    title="Phong",
    text="Phong's model as published, without 1/pi (Phong 1975).",
    parameters=_PARAMETERS,
    bsdf=parts.bsdf_of_lobes(parts.lambert_builder("phong", "diffuse", np.pi), _phong),
    identifier="LookdevPhong",
    # The albedo of the diffuse lobe is at most pi. The albedo of the highlight is at most 2 pi, at exponent 0.
    energy=lambda tokens: 3.0 * np.pi,
    reciprocal=lambda tokens: ("diffuse",),
    preview=_preview(np.pi),
)

BLINN_PHONG = Model(
    name="blinn-phong",
    title="Blinn-Phong",
    text="Blinn's form of Phong's model, by the half vector (Blinn 1977).",
    parameters=_PARAMETERS,
    bsdf=parts.bsdf_of_lobes(parts.lambert_builder("blinn-phong", "diffuse", np.pi), _blinn),
    identifier="LookdevBlinnPhong",
    energy=lambda tokens: 3.0 * np.pi,
    reciprocal=lambda tokens: ("diffuse",),
    preview=_preview(np.pi),
)

MODIFIED_PHONG = Model(
    name="modified-phong",
    title="Modified Phong",
    text="Phong's model, reciprocal and normalised (Lafortune and Willems 1994).",
    parameters=_PARAMETERS,
    bsdf=parts.bsdf_of_lobes(parts.lambert_builder("modified-phong", "diffuse"), _modified_phong),
    identifier="LookdevModifiedPhong",
    # Both lobes may be white, and each of them reflects at most the light that it receives.
    energy=lambda tokens: 2.0,
    reciprocal=lambda tokens: ("diffuse", "specular"),
    preview=_preview(1.0),
)
