"""Closures of Cycles that approximate the lobes of Disney's BRDF (`lookdev.brdf.disney`).

The directional albedo of the diffuse term is exact. For the other terms and lobes, fitted factors
(`lookdev.closures.fits`) give the closures the directional albedo of the lobe. `cos_theta` (...) is the cosine between
the lobe's normal and the direction to the viewer.

- Burley, B. 2012. Physically Based Shading at Disney. SIGGRAPH Courses.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lookdev.brdf.disney import COAT_F0
from lookdev.brdf.film import film_reflectance, metal_film_reflectance
from lookdev.brdf.frames import Frame
from lookdev.brdf.fresnel import schlick_blend, schlick_weight
from lookdev.brdf.lobes import Lobe
from lookdev.brdf.metal import is_exact, metal_fresnel
from lookdev.brdf.microfacet import smith_ggx
from lookdev.brdf.vectors import TINY, Array, Real, are_equal, mix, mix_color, scale
from lookdev.closures.closure import Closure, StandIn, rough_diffuse_albedo
from lookdev.closures.fits import AnisotropicShape, CoatShape, closure_fit, closure_table
from lookdev.errors import CodegenError


def diffuse_closures(lobe: Lobe, wo: Array) -> tuple[Closure, ...]:
    """Return closures for the diffuse lobe: for sheen, for the subsurface term and for the diffuse term.

    The closure of sheen has the shape of Disney's term but for a factor 1 / (cos_theta_i + cos_theta_o). The parameter
    `subsurface` blends the other two terms; a term of share 0 has no closures. Oren and Nayar's closure approximates
    the diffuse term.
    """
    # `p` has the values of the lobe by name: parameters of the model and numbers that derive from them.
    p, cos_theta = lobe.values, lobe.frame.to_local(wo)[..., 2]
    dielectric, subsurface, roughness = p["dielectric"], p["subsurface"], p["roughness"]
    sheen = scale(scale(p["sheen_color"], dielectric), closure_fit("sheen")(cos_theta))
    closures: tuple[Closure, ...] = (Closure("sheen", sheen, frame=lobe.frame),)
    if not are_equal(subsurface, 0.0):
        color = scale(p["baseColor"], dielectric * subsurface)
        closures += _subsurface(color, cos_theta, roughness, lobe.frame)
    if not are_equal(subsurface, 1.0):
        color = scale(p["baseColor"], dielectric * (1.0 - subsurface))
        closures += (
            _rough_diffuse(scale(color, diffuse_albedo(cos_theta, roughness)), roughness, cos_theta, lobe.frame),
        )
    return closures


# The albedo is the integral of the diffuse term of Burley 2012, section 5.3, times the cosine, over all directions of
# light. FD90 is the paper's factor at grazing angles. With X = 1 + wi . wo = 2 cos^2 theta_d, FD90 - 1 is
# roughness X - 1/2. With S = (1 - cos_theta_i)^5, the cosine-weighted means of S, S X and S X^2 are Beta functions:
# 1/21, `mean_x` and `mean_x2`.
def diffuse_albedo(cos_theta: Array, roughness: Array) -> Array:
    """Return the directional albedo of the diffuse term for a white base colour, (...)."""
    mean_x = 1.0 / 21.0 + cos_theta * (1.0 / 84.0)
    mean_x2 = 5.0 / 72.0 + cos_theta * (1.0 / 42.0 - cos_theta * (1.0 / 56.0))
    at_light = roughness * mean_x - 0.5 / 21.0
    at_view = roughness * (1.0 + cos_theta * (2.0 / 3.0)) - 0.5
    at_both = roughness * (roughness * mean_x2 - mean_x) + 0.25 / 21.0
    return 1.0 + at_light + schlick_weight(cos_theta) * (at_view + at_both)


def _rough_diffuse(reflected: Array, retro: Array, cos_theta: Array, frame: Frame) -> Closure:
    """Return a diffuse closure that has retroreflection and the directional albedo `reflected`, (..., 3).

    `retro`, (...), is the roughness of Disney's lobe. Retroreflection grows with `retro`, and is absent at 0.
    """
    if are_equal(retro, 0.0):
        return Closure("diffuse", reflected, frame=frame)
    sigma = closure_table()["shapes"]["retro"]["strength"] * retro * (1.0 - cos_theta) * _square(1.0 - cos_theta)
    # The lower bound is for Cycles, which divides in float32 by 1 minus an albedo. For small sigma, this albedo is
    # nearly 1.
    sigma = np.maximum(sigma, 0.01)
    # Single scattering loses the part 1 - `single` of the light. Multiple scattering, which the closure adds, restores
    # all of it for a white base colour. For any other colour, it restores about the share colour^2 of this part.
    single = np.expand_dims(rough_diffuse_albedo(sigma, closure_fit("retro")(cos_theta)), -1)
    base_color = reflected / mix(single, 1.0, _square(np.minimum(reflected, 1.0)))
    return Closure("rough_diffuse", np.ones(3), frame=frame, f0=base_color, roughness=sigma)


# The subsurface term, after Hanrahan and Krueger 1993, is 1.25 / pi (Fss (1 / (cos_theta_i + cos_theta_o) - 1/2) + 1/2)
# with Burley's factor Fss. GGX of alpha 1 is 1 / (2 pi (cos_theta_i + cos_theta_o)). The term is therefore 2.5 Fss
# times this GGX, plus 0.625 (1 - Fss) times Lambert's 1 / pi. Fss depends on little but the view. The directional
# albedo of this GGX is 1 - cos_theta ln(1 + 1 / cos_theta). The directional albedo of the whole term is quadratic in
# roughness.
def _subsurface(color: Array, cos_theta: Array, roughness: Array, frame: Frame) -> tuple[Closure, ...]:
    """Return closures for the subsurface term of a `color`, (..., 3): GGX of alpha 1, and Lambert for the rest."""
    # Fss is the product of a factor at the view and a factor at the light. `fss` is the factor at the view, in which
    # the mean of cos^2 theta_d, about 1/2, replaces cos^2 theta_d.
    fss = schlick_blend(1.0, 0.5 * roughness, cos_theta)
    ggx_weight, diffuse_weight = 2.5 * fss, 0.625 * (1.0 - fss)
    cosine = np.maximum(cos_theta, TINY)
    reflected = ggx_weight * (1.0 - cosine * np.log(1.0 + 1.0 / cosine)) + diffuse_weight
    ratio = closure_fit("subsurface")(cos_theta, roughness) / reflected
    return (
        Closure("ggx", scale(color, ratio * ggx_weight), frame=frame),
        Closure("diffuse", scale(color, ratio * diffuse_weight), frame=frame),
    )


def specular_closures(lobe: Lobe, wo: Array) -> tuple[Closure, ...]:
    """Return closures for the specular lobe: a metal and GGX; for an exact metal, also a conductor and a second GGX.

    The closures have the lobe's alphas. An exact metal has the Fresnel term of conductors in place of Schlick's; see
    `lookdev.brdf.metal`. The only closure of a lobe with a thin film is GGX.

    Raises
    ------
    CodegenError
        The lobe's gamma is not 2.
    """
    # `p` has the values of the lobe by name: parameters of the model and numbers that derive from them.
    p, wo = lobe.values, lobe.frame.to_local(wo)
    if not are_equal(p["gamma"], 2.0):
        raise CodegenError(
            "no closures of Cycles stand for a specular lobe whose gamma is not 2; backend 'exact' or 'nodes-exact' "
            "would be right"
        )
    alphas, variant, cos_theta = (p["alpha_x"], p["alpha_y"]), p["variant"], wo[..., 2]
    apparent = ApparentAlphas(alphas[0], alphas[0], 1.0)
    x, y = alphas
    shadowing: Real = 1.0
    if not are_equal(*alphas):
        apparent = apparent_alphas(alphas, wo, closure_table()["shapes"]["anisotropic"])
        # Cycles' alphas are at most 1.
        x, y = np.minimum(x, 1.0), np.minimum(y, 1.0)
        # If alpha_x exceeds 1, the closure is narrower than Disney's lobe. The shadowing of Disney's lobe removes about
        # the part that the limit cuts off. The factor is the limited alpha_x divided by the original alpha_x. In the
        # 2012 variant, shadowing does not depend on the alphas.
        shadowing = x / alphas[0]
    # Fitted ratios of the lobe's directional albedo to the closure's: `ratio` with a Fresnel term of 1, `grazing` with
    # Schlick's weight (1 - cosine)^5 as the Fresnel term.
    ratio, grazing = (closure_fit(f"specular_{name}{variant}")(cos_theta, apparent.ratio) for name in ("", "grazing_"))
    # The cosine, between light and half vector, at which Schlick's weight equals its mean over the lobe.
    typical_cosine = np.clip(closure_fit(f"specular_cosine_{variant}")(cos_theta, apparent.cosine), 0.0, 1.0)
    if variant == "2012":
        shadowing = shadowing_2012(cos_theta, p["roughness"]) * shadowing_2012(typical_cosine, p["roughness"])
    ratio, grazing = (np.clip(shadowing * value, 0.001, 1.0) for value in (ratio, grazing))
    schlick_mean = schlick_weight(typical_cosine) * apparent.skew
    # Let B be the albedo of the GGX closure of weight 1, and b = `metal_mean` the mean of Schlick's weight over it. A
    # metal closure of weight g = `grazing` and f = `metal_f0` reflects g B (f (1 - b) + b). Disney's lobe reflects
    # r B (f0 (1 - s) + s), with r = `ratio` and s = `schlick_mean`. The fit of `grazing` makes the parts with Schlick's
    # weight equal, r s = g b. This equation gives b. The whole amounts are equal, too. This gives f.
    metal_mean = ratio * schlick_mean / grazing
    fresnel = mix_color(p["f0"], np.ones(3), schlick_mean)
    if not are_equal(p["filmThickness"], 0.0):
        # All microfacets get the film's colour at the typical cosine.
        film = typical_cosine, p["filmThickness"], p["filmIor"]
        color = film_reflectance(fresnel, *film)
        if is_exact(p):
            color = mix_color(color, metal_film_reflectance(p["eta"], p["k"], *film), p["metallic"])
        return (Closure("ggx", scale(color, ratio), x, y, lobe.frame),)
    reflected = scale(fresnel, ratio)
    metal_f0 = (reflected / np.expand_dims(grazing, -1) - np.expand_dims(metal_mean, -1)) / np.expand_dims(
        np.maximum(1.0 - metal_mean, 0.001), -1
    )
    # The f0 of a metal is at most 1. GGX, which reflects alike at all angles of incidence, adds the rest.
    excess = np.maximum(reflected - np.expand_dims(grazing, -1), 0.0)
    weight = np.expand_dims(grazing, -1) * np.ones(3)
    closures = (
        Closure("metal", weight, x, y, lobe.frame, f0=np.clip(metal_f0, 0.0, 1.0)),
        Closure("ggx", excess, x, y, lobe.frame),
    )
    if not is_exact(p):
        return closures
    # F is the exact reflectance of the metal. A conductor closure of weight g, here `grey`, reflects g B F(c). Disney's
    # lobe reflects r B F(c). In each, c is the cosine at which Schlick's weight (1 - c)^5 equals its mean: b for the
    # conductor, s for the lobe. Each channel needs another weight, but the conductor's weight has to be grey. It is the
    # smallest of the three, and GGX adds the rest.
    reflected_metal, target = (
        metal_fresnel(p, 1.0 - np.power(np.clip(value, 0.0, 1.0), 0.2)) for value in (metal_mean, schlick_mean)
    )
    exact = scale(target, ratio)
    channels = exact / np.maximum(reflected_metal, TINY)
    grey = np.clip(np.minimum(np.minimum(channels[..., 0], channels[..., 1]), channels[..., 2]), 0.0, 1.0)
    metals = (
        Closure("conductor", np.expand_dims(grey, -1) * np.ones(3), x, y, lobe.frame, eta=p["eta"], k=p["k"]),
        Closure("ggx", np.maximum(exact - scale(reflected_metal, grey), 0.0), x, y, lobe.frame),
    )
    parts = (closures, 1.0 - p["metallic"]), (metals, p["metallic"])
    return tuple(replace(closure, weight=scale(closure.weight, share)) for part, share in parts for closure in part)


@dataclass(frozen=True)
class ApparentAlphas:
    """The alphas (...) of isotropic lobes that resemble an anisotropic lobe from one view; fits are evaluated at them.

    ratio : the alpha for the fits of ratios of albedos, ``specular_<variant>`` and ``specular_grazing_<variant>``.
    cosine : the alpha for the fit of the typical cosine, ``specular_cosine_<variant>``.
    skew : a correction that multiplies the mean of Schlick's weight; 1 for an isotropic lobe.
    """

    ratio: Array
    cosine: Array
    skew: Real


def apparent_alphas(alphas: tuple[Array, Array], wo: Array, shape: AnisotropicShape) -> ApparentAlphas:
    """Return the alphas at which fits of isotropic lobes are evaluated for a lobe of `alphas` (alpha_x, alpha_y).

    They depend on the directions `wo`, (..., 3), to the viewer. From above, they are the geometric mean of the two
    alphas. At grazing views, `ApparentAlphas.cosine` is the alpha along the azimuth of the view.

    `shape` has three fitted numbers. `azimuth`, in [0, 1], is a weight: the square of `ApparentAlphas.ratio` is a
    mixture of alpha_x alpha_y (at weight 0) and the squared alpha along the view's azimuth (at weight 1).
    `ApparentAlphas.skew` is a power of the aspect ratio alpha_x / alpha_y. `skew` is the exponent for a lobe of mean
    alpha 1 at grazing views. `skew_rise` is the increase of this exponent up to a view from above.
    """
    # The squares of the mean alpha, and of the alpha along the view's azimuth. From above, the latter is the mean
    # alpha.
    mean2 = alphas[0] * alphas[1]
    along2 = _square(alphas[0] * wo[..., 0]) + _square(alphas[1] * wo[..., 1]) + mean2 * _square(wo[..., 2])
    # The cosine of twice the azimuth, times sin^2 theta. It is 0 on the diagonals between the axes.
    azimuth_cosine = _square(wo[..., 0]) - _square(wo[..., 1])
    exponent = (shape["skew"] + shape["skew_rise"] * wo[..., 2]) * np.sqrt(mean2)
    skew = np.power(alphas[0] / alphas[1], -exponent * azimuth_cosine)
    ratio, cosine = (np.minimum(np.sqrt(square), 1.0) for square in (mix(mean2, along2, shape["azimuth"]), along2))
    return ApparentAlphas(ratio, cosine, skew)


def clearcoat_closures(lobe: Lobe, wo: Array) -> tuple[Closure, ...]:
    """Return closures for the clearcoat lobe, whose distribution is GTR1: three metals (GGX) of different alphas."""
    weight, alpha, frame = lobe.values["weight"], lobe.values["alpha"], lobe.frame
    ratio = weight * closure_fit("clearcoat")(frame.to_local(wo)[..., 2], alpha)
    return tuple(
        Closure(
            "metal",
            np.expand_dims(share * ratio, -1) * np.ones(3),
            part_alpha,
            part_alpha,
            frame,
            f0=COAT_F0 * np.ones(3),
        )
        for share, part_alpha in coat_mix(alpha, closure_table()["shapes"]["clearcoat"])
    )


def coat_mix(alpha: Array, shape: CoatShape) -> list[tuple[float, Array]]:
    """Return pairs (share, alpha) of the GGX lobes whose sum approximates GTR1 of an `alpha`, (...), broadest first.

    `shape` has the `shares`, and the `powers`: the alphas of the GGX lobes are `alpha` to these powers.
    """
    # GTR1 spreads its energy evenly over log tan theta_h, from log alpha to 0. A GGX lobe is a single step on this
    # axis.
    return [(share, np.power(alpha, power)) for share, power in zip(shape["shares"], shape["powers"], strict=True)]


# Burley 2012, section 5.6.
def shadowing_2012(cos_theta: Array, roughness: Array) -> Array:
    """Return the shadowing factor of the 2012 variant, Smith's G1, for a direction of cosine `cos_theta`, (...)."""
    return 2.0 * cos_theta * smith_ggx(cos_theta, _square(0.5 + 0.5 * roughness))


def _square(x: Array) -> Array:
    """Return the square of x."""
    return x * x


STAND_INS: dict[tuple[str, str], StandIn] = {
    ("disney", "diffuse"): diffuse_closures,
    ("disney", "specular"): specular_closures,
    ("disney", "clearcoat"): clearcoat_closures,
}
"""The functions that return the closures of a lobe, by the names of the model and of the lobe."""
