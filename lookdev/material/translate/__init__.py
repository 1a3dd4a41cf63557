"""Foreign shading models (UsdPreviewSurface, OpenPBR, ...) and their translation to layers of our models.

A `Layer` of a look may have the name of a foreign model as its model. When the look is evaluated,
`lookdev.material.values.look_layers` replaces this layer by layers of our models. As for any other layer, inputs may
therefore be textures and expressions, and constants fold in generated code.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from lookdev.brdf import Parameter, StackLayer, model_named
from lookdev.brdf.parameters import add_followers
from lookdev.brdf.vectors import are_equal
from lookdev.material import Input, Layer, Look, Primvar
from lookdev.material.translate.gltf_pbr import GLTF_PBR
from lookdev.material.translate.open_pbr import OPEN_PBR_SURFACE
from lookdev.material.translate.preview_surface import MATERIALX_PREVIEW_SURFACE, PREVIEW_SURFACE
from lookdev.material.translate.standard_surface import STANDARD_SURFACE, STANDARD_SURFACE_100

_SURFACES = (PREVIEW_SURFACE, MATERIALX_PREVIEW_SURFACE, STANDARD_SURFACE, STANDARD_SURFACE_100)
TRANSLATIONS = {translation.name: translation for translation in (*_SURFACES, OPEN_PBR_SURFACE, GLTF_PBR)}
"""The translations of all foreign models by the name of the model."""


def layer_parameters(model: str) -> Mapping[str, Parameter]:
    """Return the parameters of a model, ours or foreign; raises ModelError for an unknown name."""
    return TRANSLATIONS[model].parameters if model in TRANSLATIONS else model_named(model).parameters


def translate_layer(layer: StackLayer) -> list[StackLayer]:
    """Return the layers of our models to which a layer of a foreign model translates, base first.

    They have values for all parameters of their models. A layer of our models is returned unchanged.
    """
    if layer.model not in TRANSLATIONS:
        return [layer]
    base, *others = TRANSLATIONS[layer.model].layers(layer.parameters)
    masked = [replace(base, mask=layer.mask, mode=layer.mode)]
    masked += [
        replace(layer_above, mask=layer.mask * layer_above.mask)
        for layer_above in others
        if not are_equal(layer_above.mask, 0.0)
    ]
    return [_complete_part(layer, part) for part in masked]


def _complete_part(layer: StackLayer, part: StackLayer) -> StackLayer:
    """Return `part`, a layer of the translation of `layer`, with defaults filled in and both names joined."""
    model = model_named(part.model)
    parameters = model.complete({}) | add_followers(model.parameters, part.parameters)
    return replace(part, parameters=parameters, name=f"{layer.name} {part.name}".strip())


def foreign_shaders() -> dict[str, str]:
    """Return the names of the foreign models by the identifier (`info:id`) of their shader nodes."""
    return {translation.identifier: translation.name for translation in TRANSLATIONS.values()}


def display_color_look(name: str, *, opacity: bool = False) -> Look:
    """Return a look for geometry without a material, which shows its primvar `displayColor`, a linear colour.

    With `opacity`, it shows the primvar `displayOpacity` too. The look is a UsdPreviewSurface of roughness 0.5. Without
    the primvar, the colour is USD's default, a dark grey.
    """
    inputs: dict[str, Input] = {"diffuseColor": Primvar("displayColor", (0.18, 0.18, 0.18))}
    if opacity:
        inputs |= {"opacity": Primvar("displayOpacity", 1.0), "opacityMode": "presence"}
    return Look(name, (Layer("DisplayColor", PREVIEW_SURFACE.name, inputs),))
