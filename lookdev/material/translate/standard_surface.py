"""Autodesk Standard Surface, as the MaterialX node `standard_surface`.

- Georgiev, I. et al. 2019. Autodesk Standard Surface, version 1.0.1.
"""

from __future__ import annotations

from dataclasses import replace
from math import inf

import numpy as np

from lookdev.brdf import Parameter, StackLayer
from lookdev.brdf.parameters import normal_parameter
from lookdev.brdf.vectors import Array, Parameters, are_equal, mean, mix, mix_color, scale
from lookdev.material.translate.lobes import (
    WHITE,
    Interface,
    color_under_sheen,
    disney_anisotropy,
    load_fit,
    mix_with_metal,
    surface,
    varnish,
)
from lookdev.material.translate.translation import (
    DIFFUSE_ROUGHNESS,
    EMISSION,
    HUE_AT_GRAZING,
    ROTATION,
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
        Parameter("base", "float", 1.0),
        Parameter("base_color", "color", (0.8, 0.8, 0.8)),
        Parameter("diffuse_roughness", "float", 0.0),
        Parameter("metalness", "float", 0.0),
        Parameter("specular", "float", 1.0),
        Parameter("specular_color", "color", (1.0, 1.0, 1.0)),
        Parameter("specular_roughness", "float", 0.2),
        Parameter("specular_IOR", "float", 1.5, (0.0, inf)),
        Parameter("specular_anisotropy", "float", 0.0),
        Parameter("specular_rotation", "float", 0.0),
        Parameter("transmission", "float", 0.0),
        Parameter("transmission_color", "color", (1.0, 1.0, 1.0)),
        Parameter("transmission_depth", "float", 0.0, (0.0, inf)),
        Parameter("transmission_scatter", "color", (0.0, 0.0, 0.0)),
        Parameter("transmission_scatter_anisotropy", "float", 0.0),
        Parameter("transmission_dispersion", "float", 0.0, (0.0, inf)),
        Parameter("transmission_extra_roughness", "float", 0.0, (-1.0, 1.0)),
        Parameter("subsurface", "float", 0.0),
        Parameter("subsurface_color", "color", (1.0, 1.0, 1.0)),
        Parameter("subsurface_radius", "color", (1.0, 1.0, 1.0)),
        Parameter("subsurface_scale", "float", 1.0, (0.0, inf)),
        Parameter("subsurface_anisotropy", "float", 0.0, (-1.0, 1.0)),
        Parameter("sheen", "float", 0.0),
        Parameter("sheen_color", "color", (1.0, 1.0, 1.0)),
        Parameter("sheen_roughness", "float", 0.3),
        Parameter("coat", "float", 0.0),
        Parameter("coat_color", "color", (1.0, 1.0, 1.0)),
        Parameter("coat_roughness", "float", 0.1),
        Parameter("coat_anisotropy", "float", 0.0),
        Parameter("coat_rotation", "float", 0.0),
        Parameter("coat_IOR", "float", 1.5, (0.0, inf)),
        normal_parameter("coat_normal", ""),
        Parameter("coat_affect_color", "float", 0.0),
        Parameter("coat_affect_roughness", "float", 0.0),
        Parameter("thin_film_thickness", "float", 0.0, (0.0, inf)),
        Parameter("thin_film_IOR", "float", 1.5, (0.0, inf)),
        Parameter("emission", "float", 0.0, (0.0, inf)),
        Parameter("emission_color", "color", (1.0, 1.0, 1.0)),
        Parameter("opacity", "color", (1.0, 1.0, 1.0)),
        Parameter("thin_walled", "token", "0", choices=("0", "1")),
        normal_parameter("normal", ""),
        tangent_parameter("tangent"),
    )
}


_PARAMETERS_100 = _PARAMETERS | {
    "base": Parameter("base", "float", 0.8),
    "base_color": Parameter("base_color", "color", (1.0, 1.0, 1.0)),
}


def _layers(p: Parameters) -> list[StackLayer]:
    metalness, coat_weight, normal = p["metalness"], p["coat"], p["normal"]
    presence = mean(p["opacity"])
    tint = mix_color(WHITE, p["coat_color"], coat_weight)
    roughness = mix(p["specular_roughness"], 1.0, coat_weight * p["coat_affect_roughness"] * p["coat_roughness"])
    dielectric = Interface.from_ior(p["specular_IOR"], roughness, p["specular_color"], p["specular"])
    metal = Interface(scale(p["base_color"], p["base"]), 1.0, roughness)
    emerging, interface = mix_with_metal(_diffuse(p), dielectric, metal, metalness)
    thin = p["thin_walled"] == "1"
    layers = surface(
        emerging * tint,
        interface.tint_by(tint),
        normal,
        presence=presence,
        coat_presence=presence,
        anisotropic=disney_anisotropy(p["specular_anisotropy"]),
        back=p["subsurface"] if thin else 0.0,
        clear=p["transmission"] * (1.0 - metalness),
        ior=1.0 if thin else p["specular_IOR"],
    )
    anisotropic, mask = disney_anisotropy(p["coat_anisotropy"]), coat_weight * presence
    return [*layers, varnish("coat", p["coat_IOR"], p["coat_roughness"], p["coat_normal"], mask, anisotropic)]


def _diffuse(p: Parameters) -> Array:
    """Return the diffuse colour, (..., 3), under the specular lobe."""
    gamma = np.expand_dims(1.0 + p["coat"] * p["coat_affect_color"], -1)
    rough = 1.0 if are_equal(p["diffuse_roughness"], 0.0) else load_fit("rough")(p["diffuse_roughness"])
    diffuse = scale(np.power(p["base_color"], gamma), p["base"] * rough)
    color = mix_color(diffuse, np.power(p["subsurface_color"], gamma), p["subsurface"])
    color = color_under_sheen(color, p["sheen"], p["sheen_color"], "sheen", p["sheen_roughness"])
    return mix_color(color, p["transmission_color"], p["transmission"])


_LOSSES = {
    "diffuse_roughness": Loss(DIFFUSE_ROUGHNESS),
    "specular_color": Loss(HUE_AT_GRAZING, gray=True),
    "specular_rotation": Loss(ROTATION, "specular_anisotropy"),
    "transmission": Loss(TRANSMISSION),
    **{
        f"transmission_{name}": Loss(VOLUME, "transmission")
        for name in ("depth", "scatter", "scatter_anisotropy", "dispersion")
    },
    "transmission_extra_roughness": Loss(TRANSMISSION, "transmission"),
    "subsurface": Loss(SUBSURFACE),
    **{f"subsurface_{name}": Loss(SUBSURFACE, "subsurface") for name in ("radius", "scale", "anisotropy")},
    "sheen": Loss(SHEEN),
    "coat_color": Loss(HUE_AT_GRAZING, "coat", gray=True),
    "coat_rotation": Loss(ROTATION, "coat_anisotropy"),
    "thin_film_thickness": Loss(THIN_FILM),
    "thin_film_IOR": Loss(THIN_FILM, "thin_film_thickness"),
    "emission": Loss(EMISSION),
    "emission_color": Loss(EMISSION, "emission"),
    "opacity": Loss("the surface is there in part, by the mean of the colour", gray=True),
    "tangent": Loss(TANGENT),
}

STANDARD_SURFACE = Translation(
    "standard_surface",
    "Standard Surface",
    ("ND_standard_surface_surfaceshader",),
    _PARAMETERS,
    _layers,
    losses_of(_PARAMETERS, _LOSSES),
)
STANDARD_SURFACE_100 = replace(
    STANDARD_SURFACE,
    name="standard_surface_100",
    identifiers=("ND_standard_surface_surfaceshader_100",),
    parameters=_PARAMETERS_100,
    losses=losses_of(_PARAMETERS_100, _LOSSES),
)
"""Version 1.0.0, whose defaults differ."""
