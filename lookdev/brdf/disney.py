"""Disney's principled BRDF, 2012 and 2014.

- Burley, B. 2012. Physically Based Shading at Disney. SIGGRAPH course notes, version 3 (2014), sections 5.1 to 5.6,
  addenda.
- Hanrahan, P. and Krueger, W. 1993. Reflection from Layered Surfaces due to Subsurface Scattering. SIGGRAPH.

Three lobes: `diffuse` (diffuse, subsurface shape and sheen), `specular` (GTR2) and `clearcoat` (GTR1). As published,
``specular = 0`` is not the absence of a specular lobe: Schlick's term still rises to 1 at grazing angles.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lookdev.brdf import microfacet as mf
from lookdev.brdf.closures import Closure
from lookdev.brdf.disney_closures import (
    COAT_F0,
    clearcoat_closures,
    diffuse_albedo,
    diffuse_closure,
    sheen_closure,
    specular_closures,
    subsurface_closures,
)
from lookdev.brdf.frames import facing_viewer, to_local, unit_normal
from lookdev.brdf.fresnel import schlick_blend, schlick_weight
from lookdev.brdf.lobes import Bsdf, Directions, Lobe
from lookdev.brdf.vectors import TINY, Array, mean, mix, mix_color, reflect, same, scale

PI = np.pi


def _tint(base_color: Array) -> Array:
    """Hue and saturation of the base colour: divided by its luminance, white where that is 0 (section 5.1)."""
    luminance = 0.3 * base_color[..., 0] + 0.6 * base_color[..., 1] + 0.1 * base_color[..., 2]
    positive = np.expand_dims(luminance > 0.0, -1)
    return np.where(positive, base_color / np.where(positive, np.expand_dims(luminance, -1), 1.0), np.ones(3))


def _diffuse(p: Mapping[str, Array], wo: Array, normal: Array) -> Lobe:
    base_color, roughness = p["baseColor"], p["roughness"]
    dielectric = 1.0 - p["metallic"]
    sheen_color = scale(mix_color(np.ones(3), _tint(base_color), p["sheenTint"]), p["sheen"])

    def evaluate(d: Directions) -> Array:
        fi, fo = schlick_weight(d.cos_theta_i), schlick_weight(d.cos_theta_o)
        # Burley 2012, section 5.3.
        retro = roughness * d.cos_theta_d * d.cos_theta_d
        fd90 = 0.5 + 2.0 * retro
        diffuse = mix(1.0, fd90, fi) * mix(1.0, fd90, fo)
        # Hanrahan and Krueger 1993 as in the BRDF Explorer: Fss90 flattens retroreflection by roughness,
        # 1.25 keeps the albedo.
        fss = schlick_blend(1.0, retro, d.cos_theta_i) * schlick_blend(1.0, retro, d.cos_theta_o)
        subsurface = 1.25 * (fss * (1.0 / np.maximum(d.cos_theta_i + d.cos_theta_o, TINY) - 0.5) + 0.5)
        # Burley 2012, addenda, "Sheen details".
        sheen = scale(sheen_color, schlick_weight(d.cos_theta_d))
        return scale(scale(base_color, mix(diffuse, subsurface, p["subsurface"]) * (1.0 / PI)) + sheen, dielectric)

    def closures() -> tuple[Closure, ...]:
        cos_theta = wo[..., 2]
        under = p["subsurface"]
        closures: tuple[Closure, ...] = (sheen_closure(scale(sheen_color, dielectric), cos_theta, normal),)
        if not same(under, 0.0):
            color = scale(base_color, dielectric * under)
            closures += subsurface_closures(color, cos_theta, roughness, normal)
        if not same(under, 1.0):
            color = scale(base_color, dielectric * (1.0 - under))
            albedo = diffuse_albedo(cos_theta, roughness)
            closures += (diffuse_closure(color, albedo, roughness, cos_theta, normal),)
        return closures

    return Lobe(
        "diffuse",
        # Sheen reflects about a tenth of what it would if it did not fall off as (1 - cos theta_d)^5.
        dielectric * (mean(base_color) + 0.1 * mean(sheen_color)),
        evaluate,
        pdf=lambda d: d.cos_theta_i * (1.0 / PI),
        sample=mf.sample_cosine,
        closures=closures,
        normal=normal,
        broad=True,
    )


def _specular(p: Mapping[str, Array], wo: Array, normal: Array) -> Lobe:
    base_color, roughness = p["baseColor"], p["roughness"]
    # Burley 2012, addenda, "Anisotropic specular details"; the floor is the BRDF Explorer's.
    aspect = np.sqrt(1.0 - 0.9 * p["anisotropic"])
    alpha_x = np.maximum(0.001, roughness * roughness / aspect)
    alpha_y = np.maximum(0.001, roughness * roughness * aspect)
    # Section 5.5 and figure 14: specular maps to [0, 0.08], tinted; metals take the base colour.
    dielectric = scale(mix_color(np.ones(3), _tint(base_color), p["specularTint"]), 0.08 * p["specular"])
    f0 = mix_color(dielectric, base_color, p["metallic"])

    def fresnel(cos_theta: Array) -> Array:
        return mix_color(f0, np.ones(3), schlick_weight(cos_theta))

    def shadowing(cos_theta: Array, w: Array) -> Array:
        if p["variant"] == "2012":
            # Section 5.6: roughness remapped to [0.5, 1] before squaring.
            alpha_g = 0.5 + 0.5 * roughness
            return mf.smith_ggx(cos_theta, alpha_g * alpha_g)
        return mf.smith_ggx_aniso(w, alpha_x, alpha_y)

    def evaluate(d: Directions) -> Array:
        # D F G / (4 cos_theta_i cos_theta_o), the denominator absorbed by both shadowing terms.
        g = shadowing(d.cos_theta_i, d.wi) * shadowing(d.cos_theta_o, d.wo)
        return scale(fresnel(d.cos_theta_d), mf.gtr2_aniso(d.wm, alpha_x, alpha_y) * g)

    return Lobe(
        "specular",
        # Microfacets lean away from the normal: with F0 = 0 the lobe is dark, not absent, as seen along it.
        np.maximum(mean(fresnel(wo[..., 2])), 0.001),
        evaluate=evaluate,
        pdf=lambda d: mf.visible_ggx_pdf(d.wo, mf.gtr2_aniso(d.wm, alpha_x, alpha_y), alpha_x, alpha_y),
        sample=lambda u1, u2: reflect(wo, mf.sample_visible_ggx(wo, alpha_x, alpha_y, u1, u2)),
        closures=lambda: specular_closures(f0, roughness, (alpha_x, alpha_y), p["variant"], wo, normal),
        normal=normal,
    )


def _clearcoat(p: Mapping[str, Array], wo: Array, normal: Array) -> Lobe:
    # Sections 5.4 to 5.6: GTR1, index 1.5, GGX shadowing with a fixed alpha of 0.25, scaled to [0, 0.25].
    weight = 0.25 * p["clearcoat"]
    alpha = mix(0.1, 0.001, p["clearcoatGloss"])

    def fresnel(cos_theta: Array) -> Array:
        return mix(COAT_F0, 1.0, schlick_weight(cos_theta))

    def evaluate(d: Directions) -> Array:
        g = mf.smith_ggx(d.cos_theta_i, 0.25) * mf.smith_ggx(d.cos_theta_o, 0.25)
        f = weight * mf.gtr1(d.wm, alpha) * fresnel(d.cos_theta_d) * g
        return np.expand_dims(f, -1) * np.ones(3)

    return Lobe(
        "clearcoat",
        weight * fresnel(wo[..., 2]),
        evaluate=evaluate,
        # Burley 2012, appendix B.1.
        pdf=lambda d: mf.gtr1(d.wm, alpha) * d.wm[..., 2] / (4.0 * d.cos_theta_d),
        sample=lambda u1, u2: reflect(wo, mf.sample_gtr1(alpha, u1, u2)),
        closures=lambda: clearcoat_closures(weight, alpha, wo[..., 2], normal),
        normal=normal,
    )


def disney_bsdf(parameters: Mapping[str, Array]) -> Bsdf:
    """Build Disney's principled BRDF.

    Parameters
    ----------
    parameters
        Every input of `DISNEY_PARAMETERS`: floats (...), colours and the normal (..., 3), `variant` a string.
    """

    def lobes(wo: Array) -> tuple[Lobe, ...]:
        normal = facing_viewer(unit_normal(parameters["normal"]), wo)
        local = to_local(normal, wo)
        return tuple(build(parameters, local, normal) for build in (_diffuse, _specular, _clearcoat))

    return Bsdf(lobes)
