"""The translation of OpenPBR Surface 1.1, as the MaterialX node `open_pbr_surface`, to layers of our models.

- Andersson, Z. et al. 2024. OpenPBR Surface Specification. Academy Software Foundation.
"""

from __future__ import annotations

from math import pi

import numpy as np

from lookdev.brdf import StackLayer
from lookdev.brdf.vectors import Array, Parameters, Real, are_equal, mix, mix_color, scale
from lookdev.material.translate import lobes
from lookdev.material.translate.translation import Loss, Reason, Translation


def _layers(p: Parameters) -> list[StackLayer]:
    """Return the layers of our models for parameters of the node: a base, its specular coat and the clear coat."""
    metalness, coat_weight, base_roughness = p["base_metalness"], p["coat_weight"], _coated_roughness(p)
    weight = np.minimum(p["specular_weight"], 1.0)
    presence, thin = p["geometry_opacity"], p["geometry_thin_walled"] == "1"
    dielectric = lobes.Interface.from_ior(_ior(p), base_roughness, p["specular_color"])
    metal = lobes.Interface(scale(p["base_color"], p["base_weight"]), 1.0, base_roughness)
    # `emerging_light`, (..., 3), is the diffuse light that leaves the base. At first it is the light that passes the
    # specular interface. Then the coat tints it, and fuzz covers it.
    emerging_light, interface = lobes.mix_with_metal(_diffuse(p), dielectric, metal, metalness, weight)
    tint = _tint(p)
    emerging_light = lobes.color_under_sheen(
        emerging_light * tint, p["fuzz_weight"], p["fuzz_color"], "fuzz", p["fuzz_roughness"]
    )
    roughness, anisotropic = _disney_roughness(base_roughness, p["specular_roughness_anisotropy"])
    layers = lobes.base_and_coat(
        emerging_light,
        interface.tint_by(tint),
        p["geometry_normal"],
        presence=presence,
        roughness=roughness,
        anisotropic=anisotropic,
        back=0.5 * p["subsurface_weight"] if thin else 0.0,
        clear=p["transmission_weight"] * (1.0 - metalness),
        ior=1.0 if thin else p["specular_ior"],
    )
    roughness, anisotropic = _disney_roughness(p["coat_roughness"], p["coat_roughness_anisotropy"])
    mask = coat_weight * presence
    return [
        *layers,
        lobes.dielectric_coat("coat", p["coat_ior"], roughness, p["geometry_coat_normal"], mask, anisotropic),
    ]


def _diffuse(p: Parameters) -> Array:
    """Return the diffuse colour, (..., 3), under the specular interface."""
    color = p["base_color"]
    if not are_equal(p["base_diffuse_roughness"], 0.0):
        # The mean albedo of EON, energy-preserving Oren-Nayar (Portsmouth et al. 2024): first of single scattering for
        # white, then of all scattering for the colour.
        single = 1.0 / (1.0 + (0.5 - 2.0 / (3.0 * pi)) * p["base_diffuse_roughness"])
        albedo = np.expand_dims(single * (1.0 + (2.0 / 3.0 - 28.0 / (15.0 * pi)) * p["base_diffuse_roughness"]), -1)
        color = color * albedo + color * color * albedo * (1.0 - albedo) / (1.0 - color * (1.0 - albedo))
    color = mix_color(scale(color, p["base_weight"]), p["subsurface_color"], p["subsurface_weight"])
    return mix_color(color, p["transmission_color"], p["transmission_weight"])


def _ior(p: Parameters) -> Real:
    """Return the effective index of refraction of the dielectric, under the coat and scaled by the specular weight."""
    # Beneath a coat, the index relative to the coat counts, or its inverse if it is below 1. The weight scales f0, not
    # the index.
    quotient = p["specular_ior"] / np.maximum(p["coat_ior"], 1e-3)
    coated_ior = np.maximum(quotient, 1.0 / np.maximum(quotient, 1e-3))
    f0 = p["specular_weight"] * lobes.f0_of_ior(mix(p["specular_ior"], coated_ior, p["coat_weight"]))
    root: Real = np.sqrt(np.clip(f0, 0.0, 0.99999))
    return (1.0 + root) / (1.0 - root)


def _coated_roughness(p: Parameters) -> Real:
    """Return the roughness of the base's interface as it appears through a rough coat, which blurs the highlight."""
    base_alpha, coat_alpha = (p[name] * p[name] for name in ("specular_roughness", "coat_roughness"))
    coated = np.sqrt(np.sqrt(np.minimum(2.0 * coat_alpha * coat_alpha + base_alpha * base_alpha, 1.0)))
    return mix(p["specular_roughness"], coated, p["coat_weight"])


def _tint(p: Parameters) -> Array:
    """Return the factor (..., 3) of the coat on the base's colour: the coat's colour, times a darkening.

    The base appears darker under a coat, because the base absorbs a part of the light that the coat's surface reflects
    back.
    """
    # `internal` approximates the reflectance of the coat's surface for diffuse light from below.
    internal = 1.0 - (1.0 - lobes.f0_of_ior(p["coat_ior"])) / np.maximum(p["coat_ior"] * p["coat_ior"], 1e-6)
    dielectric = mix_color(p["base_color"], p["subsurface_color"], p["subsurface_weight"])
    base = mix_color(dielectric, scale(p["base_color"], np.minimum(p["specular_weight"], 1.0)), p["base_metalness"])
    internal = np.expand_dims(np.clip(internal, 0.0, 0.999), -1)
    weight = p["coat_weight"] * p["coat_darkening"]
    darkening = mix_color(lobes.WHITE, (1.0 - internal) / (1.0 - base * internal), weight)
    return darkening * mix_color(lobes.WHITE, p["coat_color"], p["coat_weight"])


def _disney_roughness(roughness: Real, anisotropy: Real) -> tuple[Real, Real]:
    """Return the parameters `roughness` and `anisotropic` with which Disney's lobe has the alphas of OpenPBR's lobe.

    For an anisotropy a, OpenPBR's alphas are:
    ``alpha_x = roughness^2 sqrt(2 / (1 + (1 - a)^2))`` and ``alpha_y = (1 - a) alpha_x``.
    """
    aspect = 1.0 - anisotropy
    squared_scale = 2.0 / (1.0 + aspect * aspect)
    # Disney's roughness is the fourth root of the product of the alphas. Disney's alphas have a ratio of at most ten.
    return roughness * np.sqrt(np.sqrt(squared_scale * np.maximum(aspect, 0.1))), lobes.disney_anisotropy(anisotropy)


OPEN_PBR_SURFACE = Translation(
    "open_pbr_surface",
    "OpenPBR Surface",
    "ND_open_pbr_surface_surfaceshader",
    "open_pbr_surface",
    _layers,
    {
        "base_diffuse_roughness": Loss(Reason.DIFFUSE_ROUGHNESS),
        "specular_color": Loss(Reason.HUE_AT_GRAZING, unless_gray=True),
        "transmission_weight": Loss(Reason.TRANSMISSION),
        **{
            f"transmission_{name}": Loss(Reason.VOLUME, "transmission_weight")
            for name in ("depth", "scatter", "scatter_anisotropy", "dispersion_scale", "dispersion_abbe_number")
        },
        "subsurface_weight": Loss(Reason.SUBSURFACE),
        **{
            f"subsurface_{name}": Loss(Reason.SUBSURFACE, "subsurface_weight")
            for name in ("radius", "radius_scale", "scatter_anisotropy")
        },
        "fuzz_weight": Loss(Reason.SHEEN),
        "coat_color": Loss(Reason.HUE_AT_GRAZING, "coat_weight", unless_gray=True),
        "thin_film_weight": Loss(Reason.THIN_FILM),
        "thin_film_thickness": Loss(Reason.THIN_FILM, "thin_film_weight"),
        "thin_film_ior": Loss(Reason.THIN_FILM, "thin_film_weight"),
        "emission_luminance": Loss(Reason.EMISSION),
        "emission_color": Loss(Reason.EMISSION, "emission_luminance"),
        "geometry_tangent": Loss(Reason.TANGENT),
        "geometry_coat_tangent": Loss(Reason.TANGENT),
    },
)
