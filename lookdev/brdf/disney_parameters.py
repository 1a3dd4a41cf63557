"""Inputs of Disney's principled BRDF (Burley 2012, section 5.1, with the 2014 addenda)."""

from __future__ import annotations

from lookdev.brdf.parameters import Parameter

DISNEY_PARAMETERS: dict[str, Parameter] = {
    parameter.name: parameter
    for parameter in (
        Parameter("baseColor", "color", (0.8, 0.8, 0.8), help="The surface colour, usually a texture; linear."),
        Parameter("subsurface", "float", 0.0, help="Blends the diffuse shape to a subsurface approximation."),
        Parameter("metallic", "float", 0.0, help="0 dielectric, 1 metallic; a linear blend of the two models."),
        Parameter(
            "specular",
            "float",
            0.5,
            hard=(0.0, 12.5),
            help="Incident specular amount: F0 = 0.08 specular; 0.5 is an index of refraction of 1.5.",
        ),
        Parameter("specularTint", "float", 0.0, help="Tints incident specular towards the base colour's hue."),
        Parameter(
            "roughness",
            "float",
            0.5,
            help="Controls both diffuse and specular response; alpha is its square.",
        ),
        Parameter("anisotropic", "float", 0.0, help="Aspect ratio of the highlight, up to 10:1 at 1."),
        Parameter("sheen", "float", 0.0, help="An additional grazing component, for cloth."),
        Parameter("sheenTint", "float", 0.5, help="Tints sheen towards the base colour's hue."),
        Parameter("clearcoat", "float", 0.0, help="A second specular lobe, GTR1, with an index of 1.5."),
        Parameter("clearcoatGloss", "float", 1.0, help="Clearcoat glossiness: 0 satin, 1 gloss."),
        Parameter(
            "normal",
            "normal",
            (0.0, 0.0, 1.0),
            hard=(-1.0, 1.0),
            soft=(-1.0, 1.0),
            help="Normal of all lobes, in the frame of tangent, bitangent and shading normal.",
        ),
        Parameter(
            "variant",
            "token",
            "2014",
            choices=("2014", "2012"),
            help="2014: Smith G with the lobe's own alpha (addenda). 2012: isotropic G with remapped roughness.",
        ),
    )
}
