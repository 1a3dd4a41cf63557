"""The parameters of Pixar's reflection model for Wall-E and Up, and quotations about them for the documentation.

- Smits, B. Reflection Model Design for Wall-E and Up. Pixar Animation Studios. Sections "Transmission", "Additional
  Parameters" and "Layering".
"""

from __future__ import annotations

from lookdev.brdf.metal import metal_parameters
from lookdev.brdf.parameters import PRESENCE, Parameter, normal_parameter, parameters_by_name, token_parameter

_WHITE = (1.0, 1.0, 1.0)


def _scale(lobe: str, lobe_text: str) -> Parameter:
    """Return the parameter that scales a lobe; `lobe_text` names the lobe in the help."""
    return Parameter(f"{lobe}Scale", "float", 1.0, hard=(0.0, 10.0), help=f"Scales {lobe_text}.")


def _cone_scale(lobe: str, lobe_text: str, follows: str = "") -> Parameter:
    """Return the parameter that scales a lobe's cone angle; `lobe_text` names the lobe in the help."""
    help = f"Scales the {lobe_text} lobe's cone angle{f'; if not given, as {follows} does' * bool(follows)}."
    return Parameter(f"{lobe}ConeScale", "float", 1.0, (0.0, 2.0), (0.5, 1.5), help=help, follows=follows)


PARAMETERS = parameters_by_name(
    Parameter(
        "surfaceColor", "color", (0.8, 0.8, 0.8), help="What is left of the light that enters the surface; linear."
    ),
    Parameter("metallic", "float", 0.0, help="0 dielectric, which reflects 0.05 at normal incidence; 1 metal."),
    Parameter("roughness", "float", 0.5, help="Widens the highlights and fades them out; at 1 all light is diffuse."),
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
    _scale("diffuse", "the diffuse lobe"),
    _scale("specular", "the specular lobe"),
    _scale("reflection", "the reflection lobe"),
    _scale("diffuseTransmission", "diffuse transmission"),
    _scale("specularTransmission", "specular transmission"),
    _scale("refraction", "the refraction lobe"),
    _cone_scale("specular", "specular"),
    _cone_scale("reflection", "reflection"),
    _cone_scale("specularTransmission", "specular transmission", follows="specularConeScale"),
    _cone_scale("refraction", "refraction", follows="reflectionConeScale"),
    PRESENCE,
    normal_parameter(
        "diffuseNormal", "Normal of the diffuse lobes, in the frame of tangent, bitangent and shading normal."
    ),
    normal_parameter("highlightNormal", "Normal of the four highlight lobes, in the same frame."),
    token_parameter(
        "energy",
        ("published", "conserving"),
        "published: Smits' rules. conserving: Fresnel by the view's angle; no more light leaves than arrives.",
    ),
    *metal_parameters(agreement="own"),
)

_TINT_QUOTE = (
    "We also allowed two tint colors, one for specular and reflection, and one for transmitted specular and refraction."
)
_SCALE_QUOTE = "Each of the 6 lobes had its own scaling term."
_CONE_QUOTE = "There were also scaling terms on the cone angle for each of the highlight lobes."

QUOTES: dict[str, str] = {
    **dict.fromkeys((name for name in PARAMETERS if name.endswith("Scale")), _SCALE_QUOTE),
    **dict.fromkeys((name for name in PARAMETERS if name.endswith("ConeScale")), _CONE_QUOTE),
    "metallic": "The default dielectric response is .05 (with the option to adjust this by the user, corresponding to "
    "adjusting the index of refraction of the surface), and for a metal, it is 1.",
    "roughness": "The basic idea is that roughness determines an angle at which the falloff of the specular lobe drops "
    "to 10 percent.",
    "clear": "determines what fraction of the light that enters the surface (based on the Fresnel weights) passes "
    "straight through the surface, affected only by the surface color.",
    "back": "is a description of whether the scattered light (diffuse) passes through the surface and exits the "
    "opposite side, or if it exits on the side the light shines on.",
    "normalScale": "We allowed 2 scaling terms on the Fresnel behavior, a normal scaling term that affected nRefl and "
    "a grazing scaling term that affected gRefl.",
    "grazingScale": "The grazing angle scaling term could be used to dampen down overly hot grazing angle specular "
    "that could result when a displaced or bump mapped surface filtered out to a smooth result.",
    "specularTint": _TINT_QUOTE,
    "transmissionTint": _TINT_QUOTE,
}
