"""Lafortune's model: a diffuse lobe, and three lobes that are powers of a generalised cosine.

f = kd / pi + sum of weight_j (C_j . (wo * wi))^{e_j} over the lobes j, where ``*`` is the componentwise product. The
vector C_j * wo is the direction of a lobe. For C_j = (-1, -1, 1) it is the mirror image of the view, as in Phong's
model. For (1, 1, 1) it is the direction back to the viewer.

- Lafortune, E. P., Foo, S.-C., Torrance, K. E. and Greenberg, D. P. 1997. Non-Linear Approximation of Reflectance
  Functions. SIGGRAPH, eq. 7.

Powers are clamped to `MAX_POWER`. A lobe whose peak would exceed this limit has a plateau about its direction.

A lobe is sampled in proportion to a power of the cosine to its direction. The exponent is e_j if the peak without the
clamp is at most twice the limit. For a higher peak, the exponent is smaller, so that the pdf at the end of the plateau
is half of the pdf at the peak.
"""

from __future__ import annotations

import numpy as np

from lookdev.brdf.classic import parts
from lookdev.brdf.frames import Frame
from lookdev.brdf.lobes import DirectionPair, Lobe
from lookdev.brdf.model import Model, Preview
from lookdev.brdf.parameters import Parameter
from lookdev.brdf.special import log1p_ratio
from lookdev.brdf.vectors import TINY, Array, Parameters, Real, dot, mean, scale

MAX_POWER = 1e30
"""The largest value of a power of the generalised cosine."""

LOBES = (1, 2, 3)
"""The numbers of the lobes, as in the names of their parameters."""


def _lobe(number: int) -> parts.LobeBuilder:
    """Return the builder of lobe 1, 2 or 3."""

    def build(p: Parameters, wo: Array, frame: Frame) -> Lobe:
        weight, c, e = (p[f"{name}{number}"] for name in ("weight", "coefficients", "exponent"))
        direction = c * wo
        # The squared length of the direction, minus 1. This form is precise if C is near (-1, -1, 1). It assumes that
        # the view has exactly unit length.
        length2_minus_one = dot((c - 1.0) * (c + 1.0), wo * wo)
        length2 = dot(direction, direction)
        log_length = 0.5 * length2_minus_one * log1p_ratio(length2_minus_one, length2)
        is_zero = length2 < TINY * TINY
        axis = scale(direction, 1.0 / np.sqrt(np.where(is_zero, 1.0, length2)))
        axis = np.where(np.expand_dims(is_zero, -1), np.array([0.0, 0.0, 1.0]), axis)
        # If the peak exceeds the limit by a factor exp(m), the plateau ends where cos^e is exp(-m). Here, cos is the
        # cosine to the lobe's direction. With the exponent e ln(2) / m, the pdf there is half of the pdf at the peak.
        sampled_exponent = e / np.maximum((e * log_length - np.log(MAX_POWER)) * (1.0 / np.log(2.0)), 1.0)

        def evaluate(d: DirectionPair) -> Array:
            o, i = d.wo, d.wi
            # C . (wo * wi) - 1 for unit vectors, without cancellation where C is (-1, -1, 1).
            difference = o - np.where(c < 0.0, -i, i)
            cosine_minus_one = 0.5 * (
                dot(np.absolute(c) - 1.0, o * o + i * i) - dot(np.absolute(c), difference * difference)
            )
            cosine = dot(c, o * i)
            power = np.exp(np.minimum(e * cosine_minus_one * log1p_ratio(cosine_minus_one, cosine), np.log(MAX_POWER)))
            return scale(weight, np.where(cosine > 0.0, power, 0.0))

        # If the peak is below the horizon, the largest value is on the horizon.
        x, y, z = (direction[..., k] for k in range(3))
        horizontal2 = x * x + y * y
        peak2 = np.where(z > 0.0, length2, horizontal2)
        peak = np.exp(np.minimum(e * 0.5 * (peak2 - 1.0) * log1p_ratio(peak2 - 1.0, peak2), np.log(MAX_POWER)))
        return Lobe(
            "lafortune",
            f"lobe{number}",
            mean(weight) * peak * (2.0 * np.pi) / (sampled_exponent + 1.0),
            evaluate,
            pdf=lambda d: parts.power_cosine_pdf(axis, d.wi, sampled_exponent),
            sample=lambda u1, u2: parts.sample_power_cosine(axis, sampled_exponent, u1, u2),
            group="specular",
            frame=frame,
            values={"weight": weight, "coefficients": c, "exponent": e},
        )

    return build


def _inputs(number: int) -> tuple[Parameter, ...]:
    """Return the parameters of lobe 1, 2 or 3."""
    return (
        parts.color_parameter(f"weight{number}", 0.1 if number == 1 else 0.0, f"Factor of lobe {number}; linear."),
        Parameter(
            f"coefficients{number}",
            "color",
            (-1.0, -1.0, 1.0),
            hard=(-4.0, 4.0),
            soft=(-1.0, 1.0),
            help=f"Factors of the x, y and z of the view, which give the direction of lobe {number}.",
        ),
        parts.exponent_parameter(f"exponent{number}", 32.0, f"Of the generalised cosine of lobe {number}."),
    )


def _preview(p: Parameters) -> dict[str, Real]:
    return {"roughness": np.sqrt(np.sqrt(2.0 / (p["exponent1"] + 2.0)))}


LAFORTUNE = Model(
    name="lafortune",
    title="Lafortune",
    text="Lafortune's generalised cosine lobes (Lafortune et al. 1997).",
    parameters=parts.parameters_with_normal(
        parts.color_parameter("diffuse", 0.2, "kd, the colour of the body; linear."),
        *(parameter for number in LOBES for parameter in _inputs(number)),
    ),
    bsdf=parts.bsdf_of_lobes(parts.lambert_builder("lafortune", "diffuse"), *map(_lobe, LOBES)),
    identifier="LookdevLafortune",
    # Lobes are not normalised: each may reach the largest power over the whole hemisphere.
    energy=lambda tokens: 1.0 + len(LOBES) * MAX_POWER * np.pi,
    reciprocal=lambda tokens: ("diffuse", *(f"lobe{number}" for number in LOBES)),
    probe={"weight1": (0.3, 0.3, 0.3), "weight2": (0.2, 0.2, 0.2), "weight3": (0.1, 0.1, 0.1)}
    | {"coefficients2": (-0.8, -0.8, 0.9), "coefficients3": (0.6, 0.6, 0.6), "exponent2": 8.0, "exponent3": 4.0},
    preview=Preview({"diffuseColor": "diffuse"}, _preview),
)
