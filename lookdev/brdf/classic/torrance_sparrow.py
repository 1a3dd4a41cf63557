"""Torrance and Sparrow's microfacet model in Cook and Torrance's form: exact Fresnel reflectance, a choice of D and G.

f = kd / pi + ks F D G / (q cos_theta_i cos_theta_o). The divisor q is 4 or pi, the parameter `normalisation`.

- Torrance, K. E. and Sparrow, E. M. 1967. Theory for Off-Specular Reflection from Roughened Surfaces. JOSA 57(9).
- Cook, R. L. and Torrance, K. E. 1982. A Reflectance Model for Computer Graphics. ACM TOG 1(1).
- Walter, B. et al. 2007. Microfacet Models for Refraction through Rough Surfaces. EGSR.
- Heitz, E. 2014. Understanding the Masking-Shadowing Function in Microfacet-Based BRDFs. JCGT 3(2).

Roughness at two scales is modelled by two lobes, `specular` and `specular2`. Both have the G of the first roughness.

If G is for V-grooves, half vectors are drawn from D, and the sample's weight is at most 8 F / q. If G is Smith's,
half vectors are drawn from the visible normals of GGX of the same roughness, because every D except ``"gtr"`` is at
most 1.5 times the D of GGX. ``"gtr"`` may have a heavier tail, so half vectors are drawn from D itself.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from lookdev.brdf import microfacet as mf
from lookdev.brdf.classic import parts
from lookdev.brdf.classic.distributions import DISTRIBUTIONS, smith_beckmann
from lookdev.brdf.frames import Frame
from lookdev.brdf.fresnel import conductor_fresnel
from lookdev.brdf.lobes import DirectionPair, Lobe
from lookdev.brdf.metal import INDEX_QUOTES, named_metal
from lookdev.brdf.model import Model, Preview
from lookdev.brdf.parameters import Parameter, token_parameter
from lookdev.brdf.vectors import Array, Parameters, Real, mean, reflect, scale


def _fresnel(p: Parameters, cos_theta: Array) -> Array:
    """Return F (..., 3) at cosines of incidence (...)."""
    cos_theta, ior, polarisation = (
        np.expand_dims(quantity, -1) for quantity in (cos_theta, p["externalIor"], p["polarisation"])
    )
    return conductor_fresnel(cos_theta, p["eta"], p["k"], ior, polarisation)


def _shadowing(p: Parameters) -> Callable[[DirectionPair], Array]:
    """Return a function that computes ``G / (cos_theta_i cos_theta_o)`` for a pair of directions."""
    if p["geometry"] == "v-groove":
        return _v_groove
    g1 = smith_beckmann if p["distribution"] == "beckmann" else mf.smith_ggx
    # Either function returns G1 / (2 cos theta).
    return lambda d: 4.0 * g1(d.cos_theta_i, p["roughness"]) * g1(d.cos_theta_o, p["roughness"])


# Torrance and Sparrow 1967 as in Cook and Torrance 1982: G = min(1, 2 n.h n.wo / (wo.h), 2 n.h n.wi / (wo.h)).
def _v_groove(d: DirectionPair) -> Array:
    """Return ``G / (cos_theta_i cos_theta_o)`` for V-grooves."""
    i, o = d.cos_theta_i, d.cos_theta_o
    grooves = 2.0 * d.wm[..., 2] / np.maximum(np.maximum(i, o) * d.cos_theta_d, parts.MIN_COSINE_PRODUCT)
    return np.minimum(1.0 / np.maximum(i * o, parts.MIN_COSINE_PRODUCT), grooves)


def _specular(name: str, roughness: str, facet_share: Callable[[Parameters], Real]) -> parts.LobeBuilder:
    """Return the builder of a specular lobe.

    `roughness` is the name of the lobe's parameter m. `facet_share` returns the share of the facets that the lobe has.
    """

    def build(p: Parameters, wo: Array, frame: Frame) -> Lobe:
        m, gamma = p[roughness], p["gamma"]
        distribution, shadowing = DISTRIBUTIONS[p["distribution"]], _shadowing(p)
        tint = scale(p["specular"], facet_share(p) * (1.0 / (np.pi if p["normalisation"] == "pi" else 4.0)))

        def evaluate(d: DirectionPair) -> Array:
            return scale(tint * _fresnel(p, d.cos_theta_d), distribution.density(d.wm, m, gamma) * shadowing(d))

        def visible_pdf(d: DirectionPair) -> Array:
            return mf.visible_ggx_pdf(d.wo, mf.gtr2_aniso(d.wm, m, m), m, m)

        def drawn_pdf(d: DirectionPair) -> Array:
            return distribution.sampled_density(d.wm, m, gamma) * d.wm[..., 2] / (4.0 * d.cos_theta_d)

        samples_visible = p["geometry"] == "smith" and p["distribution"] != "gtr"
        fresnel = _fresnel(p, wo[..., 2])
        return Lobe(
            "torrance-sparrow",
            name,
            # The floor is for an F of 0 at the angle of the view: F may be above 0 at half vectors of tilted facets.
            mean(tint * np.maximum(fresnel, 0.001)) * 4.0,
            evaluate,
            pdf=visible_pdf if samples_visible else drawn_pdf,
            sample=lambda u1, u2: reflect(
                wo,
                mf.sample_visible_ggx(wo, m, m, u1, u2) if samples_visible else distribution.sample(m, gamma, u1, u2),
            ),
            group="specular",
            frame=frame,
            values={**p, "tint": tint, "alpha": m},
        )

    return build


def _preview(p: Parameters) -> dict[str, Real]:
    normal = np.asarray(conductor_fresnel(1.0, p["eta"], p["k"], p["externalIor"]))
    color, metallic = p["specular"] * normal, np.any(p["k"] > 0.0)
    return {
        "diffuseColor": color if metallic else p["diffuse"],
        "metallic": 1.0 if metallic else 0.0,
        "roughness": np.sqrt(p["roughness"]),
        "f0": np.mean(color),
    }


def _roughness(name: str, help: str) -> Parameter:
    """Return a parameter that is the roughness m of a lobe."""
    return Parameter(name, "float", 0.3, hard=(0.001, 1.0), soft=(0.02, 1.0), help=help)


def _energy(tokens: Mapping[str, str]) -> float:
    # Both lobes have the G of the first roughness. With Smith's G, the first m may be as small as 0.001, so that almost
    # nothing is masked, while the D of the second lobe is broad. G / (4 cos_theta_i cos_theta_o) then reaches 1 / m,
    # and sqrt(pi) / m for Beckmann.
    specular = 2000.0 if tokens["geometry"] == "smith" else 1.0
    return 1.0 + specular * (4.0 / np.pi if tokens["normalisation"] == "pi" else 1.0)


TORRANCE_SPARROW = Model(
    name="torrance-sparrow",
    title="Torrance-Sparrow",
    text="Torrance and Sparrow's microfacet model (Torrance and Sparrow 1967, Cook and Torrance 1982).",
    parameters=parts.parameters_with_normal(
        parts.color_parameter("diffuse", 0.0, "kd, the colour of the body; linear."),
        parts.color_parameter("specular", 1.0, "ks, multiplies what facets reflect; linear."),
        token_parameter(
            "distribution",
            tuple(DISTRIBUTIONS),
            "D: beckmann, ggx, gtr by gamma, blinn's power of the cosine, gaussian of the angle.",
        ),
        token_parameter(
            "geometry",
            ("v-groove", "smith"),
            "G: v-groove, Torrance and Sparrow's cavities. smith: separable, of Beckmann or else of GGX.",
        ),
        token_parameter(
            "normalisation",
            ("4", "pi"),
            "The divisor of D: 4, which follows from geometry, or pi (Cook and Torrance 1982).",
        ),
        _roughness("roughness", "m, the root mean square slope times the root of 2; alpha of GGX."),
        _roughness("roughness2", "m of the second scale."),
        Parameter("weight2", "float", 0.0, help="The second scale's part of the facets."),
        Parameter("gamma", "float", 2.0, hard=(0.5, 4.0), soft=(0.5, 4.0), help="The tail of gtr; 2 is ggx."),
        Parameter(
            "eta", "color", (1.5, 1.5, 1.5), hard=(0.05, 10.0), soft=(0.2, 3.0), help="Index of refraction, by channel."
        ),
        Parameter("k", "color", (0.0, 0.0, 0.0), hard=(0.0, 20.0), soft=(0.0, 8.0), help="Extinction, by channel."),
        *named_metal(),
        Parameter("externalIor", "float", 1.0, (1.0, 4.0), (1.0, 2.0), help="Index of refraction around the surface."),
        Parameter("polarisation", "float", 0.5, help="0 all light perpendicular, 1 all parallel to the plane."),
    ),
    bsdf=parts.bsdf_of_lobes(
        parts.lambert_builder("torrance-sparrow", "diffuse"),
        _specular("specular", "roughness", lambda p: 1.0 - p["weight2"]),
        _specular("specular2", "roughness2", lambda p: p["weight2"]),
    ),
    identifier="LookdevTorranceSparrow",
    energy=_energy,
    reciprocal=lambda tokens: ("diffuse", "specular", "specular2"),
    probe={"diffuse": (0.2, 0.2, 0.2), "weight2": 0.3, "roughness2": 0.1},
    preview=Preview({}, _preview),
    quotes={**INDEX_QUOTES, "weight2": "May want to model multiple scales of roughness."},
    quote_source="Trent 2017, section 4; lecture on reflection models, Cook-Torrance",
)
