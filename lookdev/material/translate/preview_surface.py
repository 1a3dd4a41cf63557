"""The translation of UsdPreviewSurface, as a node of USD or MaterialX, to layers of our models.

- UsdPreviewSurface Specification, Pixar. https://openusd.org/release/spec_usdpreviewsurface.html
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lookdev.brdf import Parameter, StackLayer
from lookdev.brdf.vectors import Parameters, Real, mix_color, scale
from lookdev.material.translate.lobes import WHITE, Interface, base_and_coat, coat, f0_of_ior, max_channel
from lookdev.material.translate.translation import Loss, Reason, Translation


def _layers(p: Parameters) -> list[StackLayer]:
    """Return the layers of our models for parameters of the node: a base, its specular coat and the clearcoat.

    Comments quote the specification in quotation marks.
    """
    color, roughness, normal = p["diffuseColor"], p["roughness"], p["normal"]
    presence, coat_presence = _presence(p)
    if p["useSpecularWorkflow"] == "1":
        # The colour at normal incidence; "edge color is assumed white".
        interface = Interface(p["specularColor"], 1.0, roughness)
    else:
        # "F0 is derived from ior and F90 is white"; for a metal both are the albedo; "in between, we interpolate".
        specular = mix_color(WHITE, color, p["metallic"])
        f0 = mix_color(scale(specular, f0_of_ior(p["ior"])), specular, p["metallic"])
        interface, color = Interface(f0, max_channel(specular), roughness), scale(color, 1.0 - p["metallic"])
    layers = base_and_coat(
        interface.emerging_light(color), interface, normal, presence=presence, coat_presence=coat_presence
    )
    at_normal = scale(WHITE, f0_of_ior(p["ior"]))
    return [*layers, coat("clearcoat", at_normal, 1.0, p["clearcoatRoughness"], normal, p["clearcoat"] * coat_presence)]


def _presence(p: Parameters) -> tuple[Real, Real]:
    """Return the presence (...) of the diffuse base, and the presence (...) of the reflecting coats.

    With an opacity threshold, points are either opaque or absent.
    """
    opacity = p["opacity"]
    # Adding np.zeros(()) turns a number into an array.
    cut = np.where(opacity + np.zeros(()) >= p["opacityThreshold"], 1.0, 0.0)
    masked = np.where(p["opacityThreshold"] > 0.0, cut, opacity)
    if p["opacityMode"] in ("presence", "1"):
        return masked, masked
    # "Even a fully transparent object still receives lighting": its base is absent, its coats are not.
    return masked, np.where(p["opacityThreshold"] > 0.0, cut, 1.0)


MATERIALX_PREVIEW_SURFACE = Translation(
    "materialx_preview_surface",
    "UsdPreviewSurface",
    "ND_UsdPreviewSurface_surfaceshader",
    "usd_preview_surface",
    _layers,
    {"emissiveColor": Loss(Reason.EMISSION), "occlusion": Loss("the light that reaches a point is traced")},
)
"""UsdPreviewSurface as a node of MaterialX, where the opacity modes are numbers."""

_MODES = ("transparent", "presence")  # of opacity
PREVIEW_SURFACE = replace(
    MATERIALX_PREVIEW_SURFACE,
    name="preview_surface",
    identifier="UsdPreviewSurface",
    overrides={"opacityMode": Parameter("opacityMode", "token", _MODES[0], choices=_MODES)},
)
"""UsdPreviewSurface as a node of USD, where the opacity modes are words."""
