"""The translation of glTF's metallic-roughness model, as the MaterialX node `gltf_pbr`, to layers of our models.

- glTF 2.0 Specification, appendix B, and its material extensions. Khronos Group.
"""

from __future__ import annotations

import numpy as np

from lookdev.brdf import StackLayer
from lookdev.brdf.vectors import Array, Parameters, Real, mix, scale
from lookdev.material.translate import lobes
from lookdev.material.translate.translation import Loss, Reason, Translation


def _layers(p: Parameters) -> list[StackLayer]:
    """Return the layers of our models for parameters of the node: a base, its specular coat and the clearcoat."""
    color, metallic, base_roughness = p["base_color"], p["metallic"], p["roughness"]
    presence = _presence(p)
    f0 = scale(np.minimum(scale(p["specular_color"], lobes.f0_of_ior(p["ior"])), 1.0), p["specular"])
    emerging_light, interface = lobes.mix_with_metal(
        color, lobes.Interface(f0, p["specular"], base_roughness), lobes.Interface(color, 1.0, base_roughness), metallic
    )
    # glTF's sheen has a colour but no weight. Here the weight is the largest channel, and `hue` is colour / weight.
    weight = lobes.max_channel(p["sheen_color"])
    hue = scale(p["sheen_color"], 1.0 / np.where(weight > 0.0, weight, 1.0))
    emerging_light = lobes.color_under_sheen(
        emerging_light, weight, hue, "sheen", p["sheen_roughness"] * p["sheen_roughness"]
    )
    roughness, anisotropic = _disney_roughness(p)
    layers = lobes.base_and_coat(
        emerging_light,
        interface,
        p["normal"],
        presence=presence,
        roughness=roughness,
        anisotropic=anisotropic,
        clear=p["transmission"] * (1.0 - metallic),
        ior=p["ior"],
    )
    mask = p["clearcoat"] * presence
    return [
        *layers,
        lobes.dielectric_coat("clearcoat", np.asarray(1.5), p["clearcoat_roughness"], p["clearcoat_normal"], mask),
    ]


def _presence(p: Parameters) -> Real:
    """Return the presence of the surface, (...), for the alpha modes ``"0"`` opaque, ``"1"`` mask and ``"2"`` blend."""
    if p["alpha_mode"] == "0":
        return np.asarray(1.0)
    alpha: Array = p["alpha"]
    return np.where(alpha >= p["alpha_cutoff"], 1.0, 0.0) if p["alpha_mode"] == "1" else alpha


def _disney_roughness(p: Parameters) -> tuple[Real, Real]:
    """Return the parameters `roughness` and `anisotropic` with which Disney's lobe has the alphas of glTF's lobe.

    glTF's alphas are alpha_x = ``mix(roughness^2, 1, strength^2)`` and alpha_y = ``roughness^2``.
    """
    roughness, strength = p["roughness"], p["anisotropy_strength"]
    alpha_y = np.maximum(roughness * roughness, 1e-5)
    alpha_x = mix(alpha_y, 1.0, strength * strength)
    quotient = alpha_y / alpha_x
    # In Disney's lobe, the quotient is 1 - 0.9 anisotropic, so at least 0.1. If glTF's quotient is smaller, only
    # alpha_y is kept.
    aspect2 = np.maximum(quotient, 0.1)
    return np.sqrt(alpha_y / np.sqrt(aspect2)), (1.0 - aspect2) * (1.0 / 0.9)


GLTF_PBR = Translation(
    "gltf_pbr",
    "glTF PBR",
    "ND_gltf_pbr_surfaceshader",
    "gltf_pbr",
    _layers,
    {
        "tangent": Loss(Reason.TANGENT),
        "occlusion": Loss("the light that reaches a point is traced"),
        "transmission": Loss(Reason.TRANSMISSION),
        "specular_color": Loss(Reason.HUE_AT_GRAZING, unless_gray=True),
        "iridescence": Loss(Reason.THIN_FILM),
        "iridescence_ior": Loss(Reason.THIN_FILM, "iridescence"),
        "iridescence_thickness": Loss(Reason.THIN_FILM, "iridescence"),
        "sheen_color": Loss(Reason.SHEEN),
        "emissive": Loss(Reason.EMISSION),
        "emissive_strength": Loss(Reason.EMISSION, "emissive"),
        **{
            name: Loss(Reason.VOLUME, "transmission")
            for name in ("thickness", "attenuation_distance", "attenuation_color", "dispersion")
        },
        "anisotropy_rotation": Loss(Reason.ROTATION, "anisotropy_strength"),
    },
)
