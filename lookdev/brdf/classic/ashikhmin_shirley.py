"""Ashikhmin and Shirley's anisotropic Phong model, whose diffuse lobe is attenuated by the highlight.

- Ashikhmin, M. and Shirley, P. 2000. An Anisotropic Phong BRDF Model. Journal of Graphics Tools 5(2). Equations 4 to 6,
  sampling by equations 8 to 10.

nu and nv, the exponents of the highlight along tangent and bitangent, are the parameters `exponentU` and `exponentV`.
"""

from __future__ import annotations

import numpy as np

from lookdev.brdf.classic import parts
from lookdev.brdf.frames import Frame
from lookdev.brdf.fresnel import fresnel_blend, schlick_weights
from lookdev.brdf.lobes import DirectionPair, Lobe
from lookdev.brdf.model import Model, Preview
from lookdev.brdf.special import log1p_ratio
from lookdev.brdf.vectors import TINY, Array, Parameters, Real, mean, reflect, scale, vector


def _diffuse(p: Parameters, wo: Array, frame: Frame) -> Lobe:
    """Build the diffuse lobe (eq. 5)."""
    reflected = p["diffuse"] * (1.0 - p["specular"])

    def diffuse_factor(cosine: Array) -> Array:
        """Return ``1 - (1 - cosine / 2)^5``."""
        return schlick_weights(0.5 * cosine)[0]

    # Eq. 5. The cosine-weighted mean of `diffuse_factor` is 23 / 28.
    attenuated = scale(reflected, diffuse_factor(wo[..., 2]))

    def evaluate(d: DirectionPair) -> Array:
        return scale(attenuated, 28.0 / (23.0 * np.pi) * diffuse_factor(d.cos_theta_i))

    return parts.diffuse_lobe("ashikhmin-shirley", mean(attenuated), attenuated, frame, evaluate)


def _specular(p: Parameters, wo: Array, frame: Frame) -> Lobe:
    """Build the highlight (eq. 4)."""
    u_plus_1, v_plus_1 = p["exponentU"] + 1.0, p["exponentV"] + 1.0
    norm = np.sqrt(u_plus_1 * v_plus_1)

    def fresnel(cos_theta: Array) -> Array:
        return fresnel_blend(p["specular"], np.ones(3), cos_theta)

    def power(d: DirectionPair) -> Array:
        """Return the power ``hz^((nu hx^2 + nv hy^2) / (1 - hz^2))`` of eq. 4, for the half vector h.

        It is computed from log(hz^2) / (hz^2 - 1), which `log1p_ratio` returns, and which is finite at hz = 1.
        """
        x2, y2, z = d.wm[..., 0] * d.wm[..., 0], d.wm[..., 1] * d.wm[..., 1], d.wm[..., 2]
        weighted = p["exponentU"] * x2 + p["exponentV"] * y2
        value: Array = np.exp(-0.5 * weighted * log1p_ratio(-(x2 + y2), z * z))
        return value

    def evaluate(d: DirectionPair) -> Array:
        # Eq. 4.
        greater = np.maximum(d.cos_theta_i, d.cos_theta_o)
        factor = power(d) * norm * (0.125 / np.pi) / np.maximum(d.cos_theta_d * greater, TINY)
        return scale(fresnel(d.cos_theta_d), factor)

    def sample(u1: Array, u2: Array) -> Array:
        # Eq. 9 in all quadrants: tan phi = sqrt((nu + 1) / (nv + 1)) tan(2 pi u1).
        x, y = np.sqrt(v_plus_1) * np.cos(2.0 * np.pi * u1), np.sqrt(u_plus_1) * np.sin(2.0 * np.pi * u1)
        square = x * x + y * y
        # The denominator in eq. 10 is the exponent at this azimuth, plus 1.
        denominator = (u_plus_1 * x * x + v_plus_1 * y * y) / square
        sin2 = parts.sin2_of_power(2.0 / denominator, u2)
        radius = np.sqrt(sin2 / square)
        return reflect(wo, vector(x * radius, y * radius, np.sqrt(np.maximum(1.0 - sin2, 0.0))))

    return Lobe(
        "ashikhmin-shirley",
        "specular",
        # The floor is for a specular colour of 0: the Fresnel term is then 0 for a view along the normal, but above 0
        # for the half vectors of tilted facets.
        np.maximum(mean(fresnel(wo[..., 2])), 0.001),
        evaluate,
        # Eq. 8.
        pdf=lambda d: power(d) * norm * (0.125 / np.pi) / d.cos_theta_d,
        sample=sample,
        group="specular",
        frame=frame,
        values={"specular": p["specular"], "exponentU": p["exponentU"], "exponentV": p["exponentV"]},
    )


def _preview(p: Parameters) -> dict[str, Real]:
    mean_exponent = np.sqrt((p["exponentU"] + 1.0) * (p["exponentV"] + 1.0))
    return {
        "diffuseColor": p["diffuse"] * (1.0 - p["specular"]),
        "roughness": np.sqrt(np.sqrt(2.0 / (mean_exponent + 1.0))),
        "f0": mean(p["specular"]),
    }


ASHIKHMIN_SHIRLEY = Model(
    name="ashikhmin-shirley",
    title="Ashikhmin-Shirley",
    text="Ashikhmin and Shirley's anisotropic Phong model (Ashikhmin and Shirley 2000).",
    parameters=parts.parameters_with_normal(
        parts.color_parameter("diffuse", 0.5, "Rd, the colour of the body beneath the highlight; linear."),
        parts.color_parameter("specular", 0.05, "Rs, the reflectance at normal incidence; linear."),
        parts.exponent_parameter("exponentU", 100.0, "Of the cosine where the half vector leans along the tangent."),
        parts.exponent_parameter("exponentV", 100.0, "Of the cosine where the half vector leans along the bitangent."),
    ),
    bsdf=parts.bsdf_of_lobes(_diffuse, _specular),
    identifier="LookdevAshikhminShirley",
    reciprocal=lambda tokens: ("diffuse", "specular"),
    preview=Preview({}, _preview),
    quotes=dict.fromkeys(("exponentU", "exponentV"), "q_u, q_v: Exponents to control shape of specular peak."),
    quote_source="Lecture on reflection models, modern Phong",
)
