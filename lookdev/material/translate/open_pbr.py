"""OpenPBR Surface 1.1, as the MaterialX node `open_pbr_surface`.

- Andersson, Z. et al. 2024. OpenPBR Surface Specification. Academy Software Foundation.
"""

from __future__ import annotations

from math import inf, pi

import numpy as np

from lookdev.brdf import Parameter, StackLayer
from lookdev.brdf.parameters import normal_parameter
from lookdev.brdf.vectors import Array, Parameters, Real, mix, mix_color, same, scale
from lookdev.material.translate.lobes import WHITE, Interface, aspect_of, f0_of_ior, fabric, mixture, surface, varnish
from lookdev.material.translate.translation import (
    DIFFUSE_ROUGHNESS,
    EMISSION,
    HUE_AT_GRAZING,
    SHEEN,
    SUBSURFACE,
    TANGENT,
    THIN_FILM,
    TRANSMISSION,
    VOLUME,
    Loss,
    Translation,
    losses_of,
    tangent_parameter,
)

_PARAMETERS = {
    parameter.name: parameter
    for parameter in (
        Parameter("base_weight", "float", 1.0),
        Parameter("base_color", "color", (0.8, 0.8, 0.8)),
        Parameter("base_diffuse_roughness", "float", 0.0),
        Parameter("base_metalness", "float", 0.0),
        Parameter("specular_weight", "float", 1.0, (0.0, inf)),
        Parameter("specular_color", "color", (1.0, 1.0, 1.0)),
        Parameter("specular_roughness", "float", 0.3),
        Parameter("specular_ior", "float", 1.5, (0.0, inf)),
        Parameter("specular_roughness_anisotropy", "float", 0.0),
        Parameter("transmission_weight", "float", 0.0),
        Parameter("transmission_color", "color", (1.0, 1.0, 1.0)),
        Parameter("transmission_depth", "float", 0.0, (0.0, inf)),
        Parameter("transmission_scatter", "color", (0.0, 0.0, 0.0)),
        Parameter("transmission_scatter_anisotropy", "float", 0.0, (-1.0, 1.0)),
        Parameter("transmission_dispersion_scale", "float", 0.0),
        Parameter("transmission_dispersion_abbe_number", "float", 20.0, (0.0, inf)),
        Parameter("subsurface_weight", "float", 0.0),
        Parameter("subsurface_color", "color", (0.8, 0.8, 0.8)),
        Parameter("subsurface_radius", "float", 1.0, (0.0, inf)),
        Parameter("subsurface_radius_scale", "color", (1.0, 0.5, 0.25)),
        Parameter("subsurface_scatter_anisotropy", "float", 0.0, (-1.0, 1.0)),
        Parameter("fuzz_weight", "float", 0.0),
        Parameter("fuzz_color", "color", (1.0, 1.0, 1.0)),
        Parameter("fuzz_roughness", "float", 0.5),
        Parameter("coat_weight", "float", 0.0),
        Parameter("coat_color", "color", (1.0, 1.0, 1.0)),
        Parameter("coat_roughness", "float", 0.0),
        Parameter("coat_roughness_anisotropy", "float", 0.0),
        Parameter("coat_ior", "float", 1.6, (0.0, inf)),
        Parameter("coat_darkening", "float", 1.0),
        Parameter("thin_film_weight", "float", 0.0),
        Parameter("thin_film_thickness", "float", 0.5, (0.0, inf)),
        Parameter("thin_film_ior", "float", 1.4, (0.0, inf)),
        Parameter("emission_luminance", "float", 0.0, (0.0, inf)),
        Parameter("emission_color", "color", (1.0, 1.0, 1.0)),
        Parameter("geometry_opacity", "float", 1.0),
        Parameter("geometry_thin_walled", "token", "0", choices=("0", "1")),
        normal_parameter("geometry_normal", ""),
        normal_parameter("geometry_coat_normal", ""),
        tangent_parameter("geometry_tangent"),
        tangent_parameter("geometry_coat_tangent"),
    )
}


def _layers(p: Parameters) -> list[StackLayer]:
    metalness, over, blurred = p["base_metalness"], p["coat_weight"], _blurred(p)
    weight = np.minimum(p["specular_weight"], 1.0)
    presence, thin = p["geometry_opacity"], p["geometry_thin_walled"] == "1"
    dielectric = Interface.of_ior(_ior(p), blurred, p["specular_color"])
    metal = Interface(scale(p["base_color"], p["base_weight"]), 1.0, blurred)
    emerging, interface = mixture(_diffuse(p), dielectric, metal, metalness, weight)
    tint = _tint(p)
    emerging = fabric(emerging * tint, p["fuzz_weight"], p["fuzz_color"], "fuzz", p["fuzz_roughness"])
    roughness, anisotropic = _stretched(blurred, p["specular_roughness_anisotropy"])
    layers = surface(
        emerging,
        interface.tinted(tint),
        p["geometry_normal"],
        presence=presence,
        kept=presence,
        roughness=roughness,
        anisotropic=anisotropic,
        back=0.5 * p["subsurface_weight"] if thin else 0.0,
        clear=p["transmission_weight"] * (1.0 - metalness),
        ior=1.0 if thin else p["specular_ior"],
    )
    roughness, anisotropic = _stretched(p["coat_roughness"], p["coat_roughness_anisotropy"])
    mask = over * presence
    return [*layers, varnish("coat", p["coat_ior"], roughness, p["geometry_coat_normal"], mask, anisotropic)]


def _diffuse(p: Parameters) -> Array:
    """Return the colour, (..., 3), that is under the specular lobe."""
    color = p["base_color"]
    if not same(p["base_diffuse_roughness"], 0.0):
        # Portsmouth et al. 2024, EON: the mean albedo of one scattering, and all others.
        single = 1.0 / (1.0 + (0.5 - 2.0 / (3.0 * pi)) * p["base_diffuse_roughness"])
        albedo = np.expand_dims(single * (1.0 + (2.0 / 3.0 - 28.0 / (15.0 * pi)) * p["base_diffuse_roughness"]), -1)
        color = color * albedo + color * color * albedo * (1.0 - albedo) / (1.0 - color * (1.0 - albedo))
    color = mix_color(scale(color, p["base_weight"]), p["subsurface_color"], p["subsurface_weight"])
    return mix_color(color, p["transmission_color"], p["transmission_weight"])


def _ior(p: Parameters) -> Real:
    """Return the index of the dielectric, by whose reflectance its weight is meant, in the coat where that is."""
    quotient = p["specular_ior"] / np.maximum(p["coat_ior"], 1e-3)
    coated = np.maximum(quotient, 1.0 / np.maximum(quotient, 1e-3))
    f0 = p["specular_weight"] * f0_of_ior(mix(p["specular_ior"], coated, p["coat_weight"]))
    root: Real = np.sqrt(np.clip(f0, 0.0, 0.99999))
    return (1.0 + root) / (1.0 - root)


def _blurred(p: Parameters) -> Real:
    """Return the roughness of the base, seen through the coat."""
    own, over = (p[name] * p[name] for name in ("specular_roughness", "coat_roughness"))
    both = np.sqrt(np.sqrt(np.minimum(2.0 * over * over + own * own, 1.0)))
    return mix(p["specular_roughness"], both, p["coat_weight"])


def _tint(p: Parameters) -> Array:
    """Return the colour (..., 3) that the coat gives to the base, and what is lost between both."""
    inside = 1.0 - (1.0 - f0_of_ior(p["coat_ior"])) / np.maximum(p["coat_ior"] * p["coat_ior"], 1e-6)
    dielectric = mix_color(p["base_color"], p["subsurface_color"], p["subsurface_weight"])
    base = mix_color(dielectric, scale(p["base_color"], np.minimum(p["specular_weight"], 1.0)), p["base_metalness"])
    inside = np.expand_dims(np.clip(inside, 0.0, 0.999), -1)
    darker = mix_color(WHITE, (1.0 - inside) / (1.0 - base * inside), p["coat_weight"] * p["coat_darkening"])
    return darker * mix_color(WHITE, p["coat_color"], p["coat_weight"])


def _stretched(roughness: Real, anisotropy: Real) -> tuple[Real, Real]:
    """Return roughness and `anisotropic`.

    They are those of ``alpha_x = roughness^2 sqrt(2 / (1 + (1 - a)^2))`` and ``alpha_y = (1 - a) alpha_x``.
    """
    across = 1.0 - anisotropy
    along2 = 2.0 / (1.0 + across * across)
    # Of the alphas' product, the fourth root; at most ten to one.
    return roughness * np.sqrt(np.sqrt(along2 * np.maximum(across, 0.1))), aspect_of(anisotropy)


OPEN_PBR_SURFACE = Translation(
    "open_pbr_surface",
    "OpenPBR Surface",
    ("ND_open_pbr_surface_surfaceshader",),
    _PARAMETERS,
    _layers,
    losses_of(
        _PARAMETERS,
        {
            "base_diffuse_roughness": Loss(DIFFUSE_ROUGHNESS),
            "specular_color": Loss(HUE_AT_GRAZING, gray=True),
            "transmission_weight": Loss(TRANSMISSION),
            **{
                f"transmission_{name}": Loss(VOLUME, "transmission_weight")
                for name in ("depth", "scatter", "scatter_anisotropy", "dispersion_scale", "dispersion_abbe_number")
            },
            "subsurface_weight": Loss(SUBSURFACE),
            **{
                f"subsurface_{name}": Loss(SUBSURFACE, "subsurface_weight")
                for name in ("radius", "radius_scale", "scatter_anisotropy")
            },
            "fuzz_weight": Loss(SHEEN),
            "coat_color": Loss(HUE_AT_GRAZING, "coat_weight", gray=True),
            "thin_film_weight": Loss(THIN_FILM),
            "thin_film_thickness": Loss(THIN_FILM, "thin_film_weight"),
            "thin_film_ior": Loss(THIN_FILM, "thin_film_weight"),
            "emission_luminance": Loss(EMISSION),
            "emission_color": Loss(EMISSION, "emission_luminance"),
            "geometry_tangent": Loss(TANGENT),
            "geometry_coat_tangent": Loss(TANGENT),
        },
    ),
)
