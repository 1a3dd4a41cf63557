"""Closures of Cycles that stand for the lobes of Disney's BRDF (`lookdev.brdf.disney`).

The diffuse albedo is exact; what comes from `lookdev.closures.fits` is fitted. Cosines are those of the view
to the lobe's normal, weights are colours.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from lookdev.brdf.disney import COAT_F0
from lookdev.brdf.frames import Frame
from lookdev.brdf.fresnel import schlick_blend, schlick_weight
from lookdev.brdf.lobes import Lobe
from lookdev.brdf.microfacet import smith_ggx
from lookdev.brdf.vectors import TINY, Array, Real, mix, mix_color, same, scale
from lookdev.closures.closure import Closure, StandIn, rough_diffuse_albedo
from lookdev.closures.fits import fit, shape


def diffuse(lobe: Lobe, wo: Array) -> tuple[Closure, ...]:
    """Stand for the diffuse lobe: sheen, and light from under the surface, where there is any, and Oren and Nayar's."""
    p, cos_theta = lobe.values, lobe.frame.to_local(wo)[..., 2]
    dielectric, under, roughness = p["dielectric"], p["subsurface"], p["roughness"]
    closures: tuple[Closure, ...] = (sheen_closure(scale(p["sheen_color"], dielectric), cos_theta, lobe.frame),)
    if not same(under, 0.0):
        color = scale(p["base_color"], dielectric * under)
        closures += subsurface_closures(color, cos_theta, roughness, lobe.frame)
    if not same(under, 1.0):
        color = scale(p["base_color"], dielectric * (1.0 - under))
        albedo = diffuse_albedo(cos_theta, roughness)
        closures += (diffuse_closure(color, albedo, roughness, cos_theta, lobe.frame),)
    return closures


def specular(lobe: Lobe, wo: Array) -> tuple[Closure, ...]:
    """Stand for the specular lobe."""
    p = lobe.values
    alphas = p["alpha_x"], p["alpha_y"]
    return specular_closures(p["f0"], p["roughness"], alphas, p["variant"], lobe.frame.to_local(wo), lobe.frame)


def clearcoat(lobe: Lobe, wo: Array) -> tuple[Closure, ...]:
    """Stand for the clearcoat lobe."""
    p = lobe.values
    return clearcoat_closures(p["weight"], p["alpha"], lobe.frame.to_local(wo)[..., 2], lobe.frame)


# The integral of Burley 2012, section 5.3, times the cosine over all lights. With X = 1 + wi . wo = 2 cos^2 theta_d,
# fd90 - 1 is roughness X - 1/2; the cosine-weighted means of (1 - cos_theta_i)^5 times 1, X and X^2 are Beta functions.
def diffuse_albedo(cos_theta: Array, roughness: Array) -> Array:
    """Directional albedo of the diffuse term for a white base colour, (...)."""
    mean_x = 1.0 / 21.0 + cos_theta * (1.0 / 84.0)
    mean_x2 = 5.0 / 72.0 + cos_theta * (1.0 / 42.0 - cos_theta * (1.0 / 56.0))
    at_light = roughness * mean_x - 0.5 / 21.0
    at_view = roughness * (1.0 + cos_theta * (2.0 / 3.0)) - 0.5
    at_both = roughness * (roughness * mean_x2 - mean_x) + 0.25 / 21.0
    return 1.0 + at_light + schlick_weight(cos_theta) * (at_view + at_both)


def subsurface_albedo(cos_theta: Array, roughness: Array) -> Real:
    """Directional albedo of the subsurface term for a white base colour, (...): fitted, exactly quadratic in y."""
    return fit("subsurface")(cos_theta, roughness)


def diffuse_closure(color: Array, albedo: Array, retro: Array, cos_theta: Array, frame: Frame) -> Closure:
    """Stand for diffuse light of a `color`, (..., 3), that reflects `albedo` times it.

    retro : (...), the roughness by which light comes back to where it is from.
    """
    wanted = scale(color, albedo)
    if same(retro, 0.0):
        return Closure("diffuse", wanted, frame=frame)
    sigma = shape("retro")["strength"] * retro * (1.0 - cos_theta) * _square(1.0 - cos_theta)
    # Cycles divides by what even less roughness takes from the albedo, in float32.
    sigma = np.maximum(sigma, 0.01)
    # Of white, what is not scattered once is scattered again; of others, by about the square of their colour.
    once = np.expand_dims(rough_diffuse_albedo(sigma, fit("retro")(cos_theta)), -1)
    own = wanted / mix(once, 1.0, _square(np.minimum(wanted, 1.0)))
    return Closure("rough_diffuse", np.ones(3), frame=frame, f0=own, roughness=sigma)


# GGX of alpha 1 is 1 / (2 pi (cos_theta_i + cos_theta_o)): the term of Hanrahan and Krueger 1993 but for Fss, which is
# nearly what it is for the view alone. Its directional albedo is 1 - cos_theta ln(1 + 1 / cos_theta).
def subsurface_closures(color: Array, cos_theta: Array, roughness: Array, frame: Frame) -> tuple[Closure, ...]:
    """Stand for the subsurface term of a `color`, (..., 3): GGX of alpha 1, and Lambert where Fss is below 1."""
    # The mean of cos^2 theta_d is about 1/2.
    fss = schlick_blend(1.0, 0.5 * roughness, cos_theta)
    wide, even = 2.5 * fss, 0.625 * (1.0 - fss)
    c = np.maximum(cos_theta, TINY)
    reflected = wide * (1.0 - c * np.log(1.0 + 1.0 / c)) + even
    ratio = subsurface_albedo(cos_theta, roughness) / reflected
    return (
        Closure("ggx", scale(color, ratio * wide), frame=frame),
        Closure("diffuse", scale(color, ratio * even), frame=frame),
    )


def sheen_closure(color: Array, cos_theta: Array, frame: Frame) -> Closure:
    """Stand for sheen of a `color`, (..., 3): an exact shape but for a factor 1 / (cos_theta_i + cos_theta_o)."""
    return Closure("sheen", scale(color, fit("sheen")(cos_theta)), frame=frame)


def specular_closures(
    f0: Array, roughness: Array, alphas: tuple[Array, Array], variant: str, wo: Array, frame: Frame
) -> tuple[Closure, ...]:
    """Stand for the specular lobe: a metal and GGX with its alphas, seen along `wo`, (..., 3), in the lobe's frame.

    f0 : (..., 3), the reflectance at normal incidence.
    """
    cos_theta = wo[..., 2]
    seen = SeenAlphas(alphas[0], alphas[0], 1.0)
    x, y = alphas
    within: Real = 1.0
    if not same(*alphas):
        seen = seen_alphas(alphas, wo, shape("anisotropic"))
        # Cycles' alphas end at 1.
        x, y = np.minimum(x, 1.0), np.minimum(y, 1.0)
        # Of a wider lobe, about as much as is wider is shadowed; in 2012 shadowing does not know of it.
        within = x / alphas[0]
    ratio, grazing = (fit(f"specular_{name}{variant}")(cos_theta, seen.ratio) for name in ("", "grazing_"))
    # The cosine of a typical light to the half vector.
    typical = np.clip(fit(f"specular_cosine_{variant}")(cos_theta, seen.cosine), 0.0, 1.0)
    if variant == "2012":
        within = shadowing_2012(cos_theta, roughness) * shadowing_2012(typical, roughness)
    ratio, grazing = (np.clip(within * each, 0.001, 1.0) for each in (ratio, grazing))
    mean = schlick_weight(typical) * seen.skew
    # With B the albedo of GGX and B b that of its Schlick-weighted part, a metal of weight g reflects
    # g B (f (1 - b) + b). The lobe reflects B r (f0 (1 - s) + s), where r s = g b.
    own_mean = ratio * mean / grazing
    wanted = scale(mix_color(f0, np.ones(3), mean), ratio)
    own_f0 = (wanted / np.expand_dims(grazing, -1) - np.expand_dims(own_mean, -1)) / np.expand_dims(
        np.maximum(1.0 - own_mean, 0.001), -1
    )
    # What f in [0, 1] does not reach is reflected alike by all microfacets.
    rest = np.maximum(wanted - np.expand_dims(grazing, -1), 0.0)
    weight = np.expand_dims(grazing, -1) * np.ones(3)
    return (
        Closure("metal", weight, x, y, frame, f0=np.clip(own_f0, 0.0, 1.0)),
        Closure("ggx", rest, x, y, frame),
    )


@dataclass(frozen=True)
class SeenAlphas:
    """Alphas of the isotropic lobes that an anisotropic one is like as seen from one side, (...).

    ratio, cosine : for the fits of those names.
    skew : what Schlick's mean weight has to be multiplied by.
    """

    ratio: Array
    cosine: Array
    skew: Real


def seen_alphas(alphas: tuple[Array, Array], wo: Array, shape: Mapping[str, float]) -> SeenAlphas:
    """Return the alphas for a view `wo`, (..., 3): along its azimuth as it grazes, their mean from above.

    `shape` has the `azimuth`, how much of that the ratio follows, and the `skew` of a lobe of mean alpha 1 as it
    grazes, and how much `skew_rise` there is up to a view from above.
    """
    mean2 = alphas[0] * alphas[1]
    along2 = _square(alphas[0] * wo[..., 0]) + _square(alphas[1] * wo[..., 1]) + mean2 * _square(wo[..., 2])
    # None on the diagonals.
    towards = _square(wo[..., 0]) - _square(wo[..., 1])
    strength = (shape["skew"] + shape["skew_rise"] * wo[..., 2]) * np.sqrt(mean2)
    skew = np.power(alphas[0] / alphas[1], -strength * towards)
    ratio, cosine = (np.minimum(np.sqrt(square), 1.0) for square in (mix(mean2, along2, shape["azimuth"]), along2))
    return SeenAlphas(ratio, cosine, skew)


def clearcoat_closures(weight: Array, alpha: Array, cos_theta: Array, frame: Frame) -> tuple[Closure, ...]:
    """Stand for the clearcoat lobe, `weight` (...) times what Burley 2012 says: GTR1 as three GGX lobes."""
    ratio = weight * fit("clearcoat")(cos_theta, alpha)
    return tuple(
        Closure("metal", np.expand_dims(share * ratio, -1) * np.ones(3), a, a, frame, f0=COAT_F0 * np.ones(3))
        for share, a in coat_mix(alpha, shape("clearcoat"))
    )


def coat_mix(alpha: Array, shape: Mapping[str, Sequence[float]]) -> list[tuple[float, Array]]:
    """Return the share and the alpha of each GGX lobe in the mix for GTR1 of an `alpha`, (...), the broadest first.

    `shape` has the `shares`, and the `powers` of alpha that are the alphas.
    """
    # GTR1's energy is spread evenly over log tan theta_h, from alpha to 1; GGX lobes are steps there.
    return [(share, np.power(alpha, power)) for share, power in zip(shape["shares"], shape["powers"], strict=True)]


# Burley 2012, section 5.6.
def shadowing_2012(cos_theta: Array, roughness: Array) -> Array:
    """Smith's G1 as of 2012, for one direction, (...)."""
    return 2.0 * cos_theta * smith_ggx(cos_theta, _square(0.5 + 0.5 * roughness))


def _square(x: Array) -> Array:
    return x * x


STAND_INS: dict[tuple[str, str], StandIn] = {
    ("disney", "diffuse"): diffuse,
    ("disney", "specular"): specular,
    ("disney", "clearcoat"): clearcoat,
}
"""By the names of the model and of a lobe."""
