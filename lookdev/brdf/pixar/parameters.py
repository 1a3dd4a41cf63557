"""Inputs of Pixar's reflection model for Wall-E and Up (Smits, "Transmission", "Additional Parameters", "Layering")."""

from __future__ import annotations

from lookdev.brdf.parameters import Parameter

_WHITE = (1.0, 1.0, 1.0)

_SCALE = (0.0, 10.0)
_CONE_SCALE = (0.0, 2.0)
_CONE_SOFT = (0.5, 1.5)

PARAMETERS: dict[str, Parameter] = {
    parameter.name: parameter
    for parameter in (
        Parameter(
            "surfaceColor", "color", (0.8, 0.8, 0.8), help="What is left of the light that enters the surface; linear."
        ),
        Parameter("metallic", "float", 0.0, help="0 dielectric, which reflects 0.05 at normal incidence; 1 metal."),
        Parameter(
            "roughness", "float", 0.5, help="Widens the highlights and fades them out; at 1 all light is diffuse."
        ),
        Parameter("clear", "float", 0.0, help="Fraction of the entering light that passes straight through."),
        Parameter("back", "float", 0.0, help="Fraction of the scattered light that leaves on the other side."),
        Parameter("ior", "float", 1.5, hard=(1.0, 10.0), soft=(1.0, 2.5), help="Bends the view that is transmitted."),
        Parameter(
            "normalScale",
            "float",
            1.0,
            hard=(0.0, 20.0),
            soft=(0.0, 2.0),
            help="Scales the reflectance at normal incidence, which never rises above 1.",
        ),
        Parameter("grazingScale", "float", 1.0, help="Scales the reflectance at grazing angles."),
        Parameter("specularTint", "color", _WHITE, help="Multiplies the specular and reflection lobes."),
        Parameter("transmissionTint", "color", _WHITE, help="Multiplies specular transmission and refraction."),
        Parameter("diffuseScale", "float", 1.0, hard=_SCALE, help="Scales the diffuse lobe."),
        Parameter("specularScale", "float", 1.0, hard=_SCALE, help="Scales the specular lobe."),
        Parameter("reflectionScale", "float", 1.0, hard=_SCALE, help="Scales the reflection lobe."),
        Parameter("diffuseTransmissionScale", "float", 1.0, hard=_SCALE, help="Scales diffuse transmission."),
        Parameter("specularTransmissionScale", "float", 1.0, hard=_SCALE, help="Scales specular transmission."),
        Parameter("refractionScale", "float", 1.0, hard=_SCALE, help="Scales the refraction lobe."),
        Parameter(
            "specularConeScale", "float", 1.0, _CONE_SCALE, _CONE_SOFT, help="Scales the specular lobe's cone angle."
        ),
        Parameter(
            "reflectionConeScale",
            "float",
            1.0,
            _CONE_SCALE,
            _CONE_SOFT,
            help="Scales the reflection lobe's cone angle.",
        ),
        Parameter(
            "specularTransmissionConeScale",
            "float",
            1.0,
            _CONE_SCALE,
            _CONE_SOFT,
            help="Scales the specular transmission lobe's cone angle, over what specularConeScale does.",
        ),
        Parameter(
            "refractionConeScale",
            "float",
            1.0,
            _CONE_SCALE,
            _CONE_SOFT,
            help="Scales the refraction lobe's cone angle, over what reflectionConeScale does.",
        ),
        Parameter(
            "presence",
            "float",
            1.0,
            help="How much of the layer is there; what is beneath it, or behind, shows through.",
        ),
        Parameter(
            "diffuseNormal",
            "normal",
            (0.0, 0.0, 1.0),
            hard=(-1.0, 1.0),
            soft=(-1.0, 1.0),
            help="Normal of the diffuse lobes, in the frame of tangent, bitangent and shading normal.",
        ),
        Parameter(
            "highlightNormal",
            "normal",
            (0.0, 0.0, 1.0),
            hard=(-1.0, 1.0),
            soft=(-1.0, 1.0),
            help="Normal of the four highlight lobes, in the same frame.",
        ),
        Parameter(
            "energy",
            "token",
            "published",
            choices=("published", "conserving"),
            help="published: Smits' rules. conserving: Fresnel by the view's angle; no more light leaves than arrives.",
        ),
    )
}
