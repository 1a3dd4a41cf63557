"""Oren and Nayar's qualitative model of rough diffuse reflection, from V-grooves of Lambertian facets.

f = reflectance / pi (A + B max(0, cos(phi_i - phi_o)) sin(max theta) tan(min theta)).

- Oren, M. and Nayar, S. K. 1994. Generalization of Lambert's Reflectance Model. SIGGRAPH, eq. 30.

The model has two lobes: `diffuse` is the term with A, `retroreflection` the term with B. Directions of the second lobe
are drawn in proportion to ``max(0, cos(phi_i - phi_o)) cos_theta_i / max(cos_theta_i, cos_theta_o)``. In the weight
of a sample, f times the cosine over the pdf, only the sines then vary.
"""

from __future__ import annotations

import numpy as np

from lookdev.brdf.classic.parts import bsdf_of_lobes, color_parameter, diffuse_lobe, parameters_with_normal
from lookdev.brdf.frames import Frame
from lookdev.brdf.lobes import DirectionPair, Lobe
from lookdev.brdf.model import Model, Preview
from lookdev.brdf.parameters import Parameter, token_parameter
from lookdev.brdf.vectors import TINY, Array, Parameters, Real, mean, scale, vector


def _factors(p: Parameters) -> tuple[Real, Real]:
    """Return A and B of the formula in the module's docstring."""
    variance = p["sigma"] * p["sigma"]
    variance_offset = 0.57 if p["interreflection"] == "included" else 0.33
    return 1.0 - 0.5 * variance / (variance + variance_offset), 0.45 * variance / (variance + 0.09)


def _diffuse(p: Parameters, wo: Array, frame: Frame) -> Lobe:
    """Build the lobe of the term with A."""
    color = scale(p["reflectance"], _factors(p)[0])
    return diffuse_lobe("oren-nayar", mean(color), color, frame, lambda d: color * (1.0 / np.pi))


def _retroreflection(p: Parameters, wo: Array, frame: Frame) -> Lobe:
    """Build the lobe of the term with B."""
    albedo = scale(p["reflectance"], _factors(p)[1])
    color = albedo * (1.0 / np.pi)
    cos_o, sin_o = wo[..., 2], _sine(wo)
    # The integral of cos_theta_i / max(cos_theta_i, cos_theta_o) over cos_theta_i, from 0 to 1.
    integral = 1.0 - 0.5 * cos_o

    def evaluate(d: DirectionPair) -> Array:
        # sin(max theta) tan(min theta) is the product of both sines over the greater cosine.
        return scale(color, np.maximum(_azimuth_product(d), 0.0) / np.maximum(_max_cosine(d), TINY))

    def pdf(d: DirectionPair) -> Array:
        azimuth = np.clip(_azimuth_product(d) / np.maximum(_sine(d.wo) * _sine(d.wi), TINY), 0.0, 1.0)
        density: Array = 0.5 * azimuth * d.cos_theta_i / np.maximum(_max_cosine(d), TINY) / integral
        return density

    def sample(u1: Array, u2: Array) -> Array:
        position = u2 * integral
        # The density of cos_theta_i rises linearly up to the cosine of the view, and is constant beyond.
        cos_i = np.where(position < 0.5 * cos_o, np.sqrt(2.0 * cos_o * position), position + 0.5 * cos_o)
        sin_i, sin_phi = np.sqrt(np.maximum((1.0 - cos_i) * (1.0 + cos_i), 0.0)), 2.0 * u1 - 1.0
        cos_phi = np.sqrt(np.maximum(1.0 - sin_phi * sin_phi, 0.0))
        # For a view along the normal the lobe is 0, so the azimuth does not matter.
        upright = sin_o < TINY
        x, y = (component / np.maximum(sin_o, TINY) for component in (wo[..., 0], wo[..., 1]))
        x, y = np.where(upright, 1.0, x), np.where(upright, 0.0, y)
        return vector(sin_i * (x * cos_phi - y * sin_phi), sin_i * (y * cos_phi + x * sin_phi), cos_i)

    return Lobe(
        "oren-nayar",
        "retroreflection",
        # The mean sine of the sampled directions is about 3/4.
        mean(color) * 1.5 * integral * sin_o,
        evaluate,
        pdf,
        sample,
        group="diffuse",
        frame=frame,
        broad=True,
        values={"color": albedo},
    )


def _sine(w: Array) -> Array:
    """Return the sine of the angle to the normal."""
    sine: Array = np.sqrt(w[..., 0] * w[..., 0] + w[..., 1] * w[..., 1])
    return sine


def _azimuth_product(d: DirectionPair) -> Array:
    """Return the product of both sines and the cosine of the azimuth between the directions."""
    return d.wo[..., 0] * d.wi[..., 0] + d.wo[..., 1] * d.wi[..., 1]


def _max_cosine(d: DirectionPair) -> Array:
    """Return the greater of both cosines to the normal."""
    greater: Array = np.maximum(d.cos_theta_i, d.cos_theta_o)
    return greater


OREN_NAYAR = Model(
    name="oren-nayar",
    title="Oren-Nayar",
    text="Oren and Nayar's rough diffuse reflection, the qualitative model (Oren and Nayar 1994).",
    parameters=parameters_with_normal(
        color_parameter("reflectance", 0.8, "The part of light that a facet reflects; linear."),
        Parameter(
            "sigma",
            "float",
            0.3,
            hard=(0.0, 0.5 * np.pi),
            soft=(0.0, 1.0),
            help="Standard deviation of the facets' slope angle; 0 is Lambert's reflection.",
            unit="rad",
        ),
        token_parameter(
            "interreflection",
            ("included", "none"),
            "included: the constant 0.57, for what facets reflect to each other. none: 0.33.",
        ),
    ),
    bsdf=bsdf_of_lobes(_diffuse, _retroreflection),
    identifier="LookdevOrenNayar",
    # A + B / 2 at grazing views.
    energy=lambda tokens: 1.05 if tokens["interreflection"] == "included" else 1.016,
    reciprocal=lambda tokens: ("diffuse", "retroreflection"),
    preview=Preview({"diffuseColor": "reflectance"}, lambda p: {"roughness": 1.0, "f0": 0.0}),
)
