"""Ward's anisotropic model: a Gaussian of the half vector's slopes.

f = kd / pi + ks exp(-tan^2 theta_h (cos^2 phi_h / ax^2 + sin^2 phi_h / ay^2)) / (4 pi ax ay N). kd and ks are the
colours `diffuse` and `specular`, ax and ay the roughness along tangent and bitangent, `alphaX` and `alphaY`. theta_h
and phi_h are the angles of the half vector.

- Ward, G. J. 1992. Measuring and Modeling Anisotropic Reflection. SIGGRAPH, eq. 5a.
- Dür, A. 2006. An Improved Normalization for the Ward Reflectance Model. Journal of Graphics Tools 11(1).

N is the square root of cos_theta_i cos_theta_o (Ward 1992), or with ``variant = "dur"`` the product itself (Dür 2006).
Half vectors are drawn in proportion to the Gaussian of slopes (Ward 1992, eq. 6).
"""

from __future__ import annotations

import numpy as np

from lookdev.brdf.classic import parts
from lookdev.brdf.frames import Frame
from lookdev.brdf.lobes import DirectionPair, Lobe
from lookdev.brdf.model import Model, Preview
from lookdev.brdf.parameters import Parameter, token_parameter
from lookdev.brdf.vectors import Array, Parameters, Real, mean, normalize, reflect, scale, vector


def _specular(p: Parameters, wo: Array, frame: Frame) -> Lobe:
    """Build the highlight."""
    alpha_x, alpha_y = p["alphaX"], p["alphaY"]

    def gaussian(d: DirectionPair) -> Array:
        """Return the exponential of f, divided by ``4 pi ax ay``."""
        x, y, z = d.wm[..., 0] / alpha_x, d.wm[..., 1] / alpha_y, _cosine(d)
        value: Array = np.exp(-(x * x + y * y) / (z * z)) / (4.0 * np.pi * alpha_x * alpha_y)
        return value

    def evaluate(d: DirectionPair) -> Array:
        product = np.maximum(d.cos_theta_i * d.cos_theta_o, parts.MIN_COSINE_PRODUCT)
        return scale(p["specular"], gaussian(d) / (product if p["variant"] == "dur" else np.sqrt(product)))

    def pdf(d: DirectionPair) -> Array:
        z = _cosine(d)
        return gaussian(d) / (z * z * z * d.cos_theta_d)

    def sample(u1: Array, u2: Array) -> Array:
        r, phi = np.sqrt(-parts.log_complement(u2)), 2.0 * np.pi * u1
        x = alpha_x * r * np.cos(phi)
        return reflect(wo, normalize(vector(x, alpha_y * r * np.sin(phi), 1.0 + 0.0 * x)))

    return Lobe(
        "ward",
        "specular",
        mean(p["specular"]),
        evaluate,
        pdf,
        sample,
        group="specular",
        frame=frame,
        values={"specular": p["specular"], "alpha_x": alpha_x, "alpha_y": alpha_y},
    )


def _cosine(d: DirectionPair) -> Array:
    """Return cos theta_h, at least 1e-6."""
    # At this floor, the Gaussian underflows to 0. Without the floor, `pdf`, which divides the Gaussian by the cube of
    # the cosine, would be 0 / 0 at the horizon.
    cosine: Array = np.maximum(d.wm[..., 2], 1e-6)
    return cosine


def _alpha(name: str, along: str) -> Parameter:
    """Return the parameter that is the roughness along the tangent or the bitangent."""
    return Parameter(
        name,
        "float",
        0.15,
        hard=(0.005, 1.0),
        soft=(0.02, 0.5),
        help=f"Standard deviation of the slope along the {along}, times the root of 2.",
    )


def _preview(p: Parameters) -> dict[str, Real]:
    return {"roughness": np.sqrt(np.sqrt(p["alphaX"] * p["alphaY"])), "f0": mean(p["specular"])}


WARD = Model(
    name="ward",
    title="Ward",
    text="Ward's anisotropic model (Ward 1992), or with the normalisation of Dür 2006.",
    parameters=parts.parameters_with_normal(
        parts.color_parameter("diffuse", 0.2, "kd, the colour of the body; linear."),
        parts.color_parameter("specular", 0.3, "ks, the colour of the highlight; linear."),
        _alpha("alphaX", "tangent"),
        _alpha("alphaY", "bitangent"),
        token_parameter(
            "variant",
            ("1992", "dur"),
            "1992: divided by the root of the product of both cosines. dur: by the product (Dür 2006).",
        ),
    ),
    bsdf=parts.bsdf_of_lobes(parts.lambert_builder("ward", "diffuse"), _specular),
    identifier="LookdevWard",
    # Both lobes may be white. Dür's albedo grows without bound towards grazing views.
    energy=lambda tokens: np.inf if tokens["variant"] == "dur" else 2.0,
    reciprocal=lambda tokens: ("diffuse", "specular"),
    probe={"alphaX": 0.2, "alphaY": 0.2},
    preview=Preview({"diffuseColor": "diffuse"}, _preview),
    quotes=dict.fromkeys(("alphaX", "alphaY"), "α: surface roughness, or blur in specular component."),
    quote_source="Lecture on reflection models, Ward-Phong",
)
