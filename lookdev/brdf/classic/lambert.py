"""Lambert's diffuse reflection: f = reflectance / pi.

- Lambert, J. H. 1760. Photometria.
"""

from __future__ import annotations

from lookdev.brdf.classic.parts import bsdf_of_lobes, color_parameter, lambert_builder, parameters_with_normal
from lookdev.brdf.model import Model, Preview

LAMBERT = Model(
    name="lambert",
    title="Lambert",
    text="Lambert's diffuse reflection (Lambert 1760).",
    parameters=parameters_with_normal(
        color_parameter("reflectance", 0.8, "The part of light that is reflected; linear.")
    ),
    bsdf=bsdf_of_lobes(lambert_builder("lambert", "reflectance")),
    identifier="LookdevLambert",
    reciprocal=lambda tokens: ("diffuse",),
    preview=Preview({"diffuseColor": "reflectance"}, lambda p: {"roughness": 1.0, "f0": 0.0}),
)
