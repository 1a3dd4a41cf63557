"""UsdPreviewSurface.

- UsdPreviewSurface Specification, Pixar. https://openusd.org/release/spec_usdpreviewsurface.html
"""

from __future__ import annotations

from dataclasses import replace
from math import inf

import numpy as np

from lookdev.brdf import Parameter, StackLayer
from lookdev.brdf.parameters import normal_parameter
from lookdev.brdf.vectors import Parameters, Real, mix_color, scale
from lookdev.material.translate.lobes import WHITE, Interface, coat, f0_of_ior, max_channel, surface
from lookdev.material.translate.translation import EMISSION, Loss, Translation, losses_of

_PARAMETERS = {
    parameter.name: parameter
    for parameter in (
        Parameter("diffuseColor", "color", (0.18, 0.18, 0.18)),
        Parameter("emissiveColor", "color", (0.0, 0.0, 0.0), (0.0, inf)),
        Parameter("useSpecularWorkflow", "token", "0", choices=("0", "1")),
        Parameter("specularColor", "color", (0.0, 0.0, 0.0)),
        Parameter("metallic", "float", 0.0),
        Parameter("roughness", "float", 0.5),
        Parameter("clearcoat", "float", 0.0),
        Parameter("clearcoatRoughness", "float", 0.01),
        Parameter("opacity", "float", 1.0),
        Parameter("opacityMode", "token", "transparent", choices=("transparent", "presence")),
        Parameter("opacityThreshold", "float", 0.0),
        Parameter("ior", "float", 1.5, (0.0, inf)),
        normal_parameter("normal", ""),
        Parameter("displacement", "float", 0.0, (-inf, inf)),
        Parameter("occlusion", "float", 1.0),
    )
}


def _layers(p: Parameters) -> list[StackLayer]:
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
    layers = surface(interface.emerging_light(color), interface, normal, presence=presence, coat_presence=coat_presence)
    at_normal = scale(WHITE, f0_of_ior(p["ior"]))
    return [*layers, coat("clearcoat", at_normal, 1.0, p["clearcoatRoughness"], normal, p["clearcoat"] * coat_presence)]


def _presence(p: Parameters) -> tuple[Real, Real]:
    """Return the presence of the diffuse part, and that of the reflecting coats."""
    opacity = p["opacity"]
    cut = np.where(opacity + np.zeros(()) >= p["opacityThreshold"], 1.0, 0.0)
    masked = np.where(p["opacityThreshold"] > 0.0, cut, opacity)
    if p["opacityMode"] in ("presence", "1"):
        return masked, masked
    # "Even a fully transparent object still receives lighting": its ground is absent, its coats are not.
    return masked, np.where(p["opacityThreshold"] > 0.0, cut, 1.0)


PREVIEW_SURFACE = Translation(
    "preview_surface",
    "UsdPreviewSurface",
    ("UsdPreviewSurface",),
    _PARAMETERS,
    _layers,
    losses_of(
        _PARAMETERS,
        {"emissiveColor": Loss(EMISSION), "occlusion": Loss("the light that reaches a point is traced")},
    ),
)

_AS_INTEGER = {"opacityMode": Parameter("opacityMode", "token", "0", choices=("0", "1"))}
MATERIALX_PREVIEW_SURFACE = replace(
    PREVIEW_SURFACE,
    name="materialx_preview_surface",
    identifiers=("ND_UsdPreviewSurface_surfaceshader",),
    parameters=_PARAMETERS | _AS_INTEGER,
)
"""The MaterialX node of the same name."""
