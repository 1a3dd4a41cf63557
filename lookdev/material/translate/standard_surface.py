"""The translation of Autodesk Standard Surface, as the MaterialX node `standard_surface`, to layers of our models.

- Georgiev, I. et al. 2019. Autodesk Standard Surface, version 1.0.1.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lookdev.brdf import StackLayer
from lookdev.brdf.vectors import Array, Parameters, are_equal, mean, mix, mix_color, scale
from lookdev.material.translate import lobes
from lookdev.material.translate.translation import Loss, Reason, Translation


def _layers(p: Parameters) -> list[StackLayer]:
    """Return the layers of our models for parameters of the node: a base, its specular coat and the clear coat."""
    metalness, coat_weight, normal = p["metalness"], p["coat"], p["normal"]
    presence = mean(p["opacity"])
    tint = mix_color(lobes.WHITE, p["coat_color"], coat_weight)
    roughness = mix(p["specular_roughness"], 1.0, coat_weight * p["coat_affect_roughness"] * p["coat_roughness"])
    dielectric = lobes.Interface.from_ior(p["specular_IOR"], roughness, p["specular_color"], p["specular"])
    metal = lobes.Interface(scale(p["base_color"], p["base"]), 1.0, roughness)
    emerging_light, interface = lobes.mix_with_metal(_diffuse(p), dielectric, metal, metalness)
    thin = p["thin_walled"] == "1"
    layers = lobes.base_and_coat(
        emerging_light * tint,
        interface.tint_by(tint),
        normal,
        presence=presence,
        anisotropic=lobes.disney_anisotropy(p["specular_anisotropy"]),
        back=p["subsurface"] if thin else 0.0,
        clear=p["transmission"] * (1.0 - metalness),
        ior=1.0 if thin else p["specular_IOR"],
    )
    anisotropic, mask = lobes.disney_anisotropy(p["coat_anisotropy"]), coat_weight * presence
    return [
        *layers,
        lobes.dielectric_coat("coat", p["coat_IOR"], p["coat_roughness"], p["coat_normal"], mask, anisotropic),
    ]


def _diffuse(p: Parameters) -> Array:
    """Return the diffuse colour, (..., 3), under the specular interface."""
    # The exponent with which the coat changes the colours beneath.
    gamma = np.expand_dims(1.0 + p["coat"] * p["coat_affect_color"], -1)
    rough = 1.0 if are_equal(p["diffuse_roughness"], 0.0) else lobes.load_fit("rough")(p["diffuse_roughness"])
    diffuse = scale(np.power(p["base_color"], gamma), p["base"] * rough)
    color = mix_color(diffuse, np.power(p["subsurface_color"], gamma), p["subsurface"])
    color = lobes.color_under_sheen(color, p["sheen"], p["sheen_color"], "sheen", p["sheen_roughness"])
    return mix_color(color, p["transmission_color"], p["transmission"])


STANDARD_SURFACE = Translation(
    "standard_surface",
    "Standard Surface",
    "ND_standard_surface_surfaceshader",
    "standard_surface",
    _layers,
    {
        "diffuse_roughness": Loss(Reason.DIFFUSE_ROUGHNESS),
        "specular_color": Loss(Reason.HUE_AT_GRAZING, unless_gray=True),
        "specular_rotation": Loss(Reason.ROTATION, "specular_anisotropy"),
        "transmission": Loss(Reason.TRANSMISSION),
        **{
            f"transmission_{name}": Loss(Reason.VOLUME, "transmission")
            for name in ("depth", "scatter", "scatter_anisotropy", "dispersion")
        },
        "transmission_extra_roughness": Loss(Reason.TRANSMISSION, "transmission"),
        "subsurface": Loss(Reason.SUBSURFACE),
        **{f"subsurface_{name}": Loss(Reason.SUBSURFACE, "subsurface") for name in ("radius", "scale", "anisotropy")},
        "sheen": Loss(Reason.SHEEN),
        "coat_color": Loss(Reason.HUE_AT_GRAZING, "coat", unless_gray=True),
        "coat_rotation": Loss(Reason.ROTATION, "coat_anisotropy"),
        "thin_film_thickness": Loss(Reason.THIN_FILM),
        "thin_film_IOR": Loss(Reason.THIN_FILM, "thin_film_thickness"),
        "emission": Loss(Reason.EMISSION),
        "emission_color": Loss(Reason.EMISSION, "emission"),
        "opacity": Loss("the surface is there in part, by the mean of the colour", unless_gray=True),
        "tangent": Loss(Reason.TANGENT),
    },
)
STANDARD_SURFACE_100 = replace(
    STANDARD_SURFACE, name="standard_surface_100", identifier=f"{STANDARD_SURFACE.identifier}_100"
)
"""Version 1.0.0 of Standard Surface, which has other defaults."""
