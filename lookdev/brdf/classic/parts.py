"""Code that several classic models share: BSDFs with one normal, diffuse lobes, parameters, and powers of a cosine."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from lookdev.brdf.frames import Frame, frame_of
from lookdev.brdf.lobes import Bsdf, DirectionPair, Lobe
from lookdev.brdf.microfacet import polar, sample_cosine
from lookdev.brdf.parameters import Parameter, normal_parameter, parameters_by_name
from lookdev.brdf.special import cosine_power, expm1_ratio, log1p_ratio
from lookdev.brdf.vectors import Array, Parameters, Real, cross, dot, mean, perpendicular, scale, vector

MIN_COSINE_PRODUCT = 1e-30
"""A floor for a product of two cosines in a denominator. A highlight divided by it is still a normal float32."""

LobeBuilder = Callable[[Parameters, Array, Frame], Lobe]
"""A function that builds a lobe of a model.

Its arguments are all parameters of the model, the direction to the viewer (..., 3) in the lobe's frame, and this frame.
"""


def bsdf_of_lobes(*builds: LobeBuilder) -> Callable[[Parameters], Bsdf]:
    """Return `Model.bsdf` for a model whose lobes, built by `builds`, all have the normal of parameter ``"normal"``."""

    def bsdf(parameters: Parameters) -> Bsdf:
        def lobes(wo: Array) -> tuple[Lobe, ...]:
            frame = frame_of(parameters["normal"]).bend_towards(wo)
            local = frame.to_local(wo)
            return tuple(build(parameters, local, frame) for build in builds)

        return Bsdf(lobes)

    return bsdf


def lambert_builder(model: str, color: str, albedo: float = 1.0) -> LobeBuilder:
    """Return the builder of a lobe with the constant f = colour * `albedo` / pi.

    The colour is the parameter named `color`. If it is white, the directional albedo of the lobe is `albedo`.
    """

    def build(p: Parameters, wo: Array, frame: Frame) -> Lobe:
        share, value = mean(p[color]) * albedo, p[color] * albedo
        return diffuse_lobe(model, share, value, frame, lambda d: scale(p[color], albedo / np.pi))

    return build


def diffuse_lobe(
    model: str, share: Real, color: Array, frame: Frame, evaluate: Callable[[DirectionPair], Array]
) -> Lobe:
    """Return a diffuse lobe, which is sampled in proportion to the cosine.

    `share` (...) and `evaluate`, which returns f, are as in `Lobe`. `color` (..., 3) is the lobe's directional
    albedo.
    """
    return Lobe(
        model,
        "diffuse",
        share,
        evaluate,
        cosine_pdf,
        sample_cosine,
        group="diffuse",
        frame=frame,
        broad=True,
        values={"color": color},
    )


def cosine_pdf(d: DirectionPair) -> Array:
    """Return the pdf of `lookdev.brdf.microfacet.sample_cosine`."""
    return d.cos_theta_i * (1.0 / np.pi)


def parameters_with_normal(*model_parameters: Parameter) -> Mapping[str, Parameter]:
    """Return parameters by name, and the parameter ``"normal"`` last."""
    normal = normal_parameter("normal", "Normal of all lobes, in the frame of tangent, bitangent and shading normal.")
    return parameters_by_name(*model_parameters, normal)


def color_parameter(name: str, grey: float, help: str) -> Parameter:
    """Return a parameter that is a colour in [0, 1], by default `grey` in all channels."""
    return Parameter(name, "color", (grey, grey, grey), help=help)


def exponent_parameter(name: str, default: float, help: str) -> Parameter:
    """Return a parameter that is the exponent of a cosine."""
    return Parameter(name, "float", default, hard=(0.0, 1e5), soft=(0.0, 1000.0), help=help)


def versine(wm: Array) -> Array:
    """Return 1 - cos theta (...) of unit vectors (..., 3) with z at least 0; theta is their angle to the normal."""
    return (wm[..., 0] * wm[..., 0] + wm[..., 1] * wm[..., 1]) / (1.0 + wm[..., 2])


def power_cosine(axis: Array, w: Array, exponent: Real) -> Array:
    """Return ``max(0, axis . w)^exponent``, (...), for unit vectors (..., 3)."""
    difference = w - axis
    return cosine_power(dot(axis, w), 0.5 * dot(difference, difference), exponent)


def power_cosine_pdf(axis: Array, w: Array, exponent: Real) -> Array:
    """Return the pdf of `sample_power_cosine`."""
    return power_cosine(axis, w, exponent) * ((exponent + 1.0) * (0.5 / np.pi))


def sample_power_cosine(axis: Array, exponent: Real, u1: Array, u2: Array) -> Array:
    """Draw directions (..., 3) in proportion to a power of their cosine to `axis`, unit vectors (..., 3)."""
    tangent = perpendicular(axis)
    local = polar(sin2_of_power(2.0 / (exponent + 1.0), u2), u1)
    return scale(tangent, local[..., 0]) + scale(cross(axis, tangent), local[..., 1]) + scale(axis, local[..., 2])


def sin2_of_power(power: Real, u: Array) -> Array:
    """Return ``1 - (1 - u)^power`` for a uniform number u.

    It is the squared sine of a drawn angle. With power 2 / (e + 1), the density of the angle over solid angle is
    proportional to cos^e.
    """
    x = power * log_complement(u)
    return -x * expm1_ratio(x)


def log_complement(u: Array) -> Array:
    """Return ``log(1 - u)`` for a uniform number u; the result is finite even if float32 rounds u to 1."""
    return -u * log1p_ratio(-u, 1.0 - u)


def mirror(wo: Array) -> Array:
    """Mirror directions (..., 3) about the normal."""
    return vector(-wo[..., 0], -wo[..., 1], wo[..., 2])
