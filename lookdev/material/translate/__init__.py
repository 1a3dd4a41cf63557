"""Registry of translations: each is the record of a foreign shading model as layers of our models.

A `Layer` of a look may have the name of a translation as its model. `lookdev.material.values.look_layers` replaces it
by layers of our models, so its inputs may vary, and constants fold, as those of any other layer.
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
"""All translations by name."""


def layer_parameters(model: str) -> Mapping[str, Parameter]:
    """Return the parameters of a model, ours or foreign; raises ModelError for an unknown name."""
    return TRANSLATIONS[model].parameters if model in TRANSLATIONS else model_named(model).parameters


def translate_layer(layer: StackLayer) -> list[StackLayer]:
    """Return the layers, with all their parameters, that a layer of a foreign model translates to; others unchanged."""
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
    model = model_named(part.model)
    parameters = model.complete({}) | add_followers(model.parameters, part.parameters)
    return replace(part, parameters=parameters, name=f"{layer.name} {part.name}".strip())


def foreign_shaders() -> dict[str, str]:
    """Return the names of translations by the identifiers of their shader nodes."""
    return {translation.identifier: translation.name for translation in TRANSLATIONS.values()}


def display_color_look(name: str, *, opacity: bool = False) -> Look:
    """Return the look of a part with a linear `displayColor` and, with `opacity`, a `displayOpacity`.

    It is a UsdPreviewSurface of roughness 0.5. Without the primvar, the colour is USD's default, a dark grey.
    """
    inputs: dict[str, Input] = {"diffuseColor": Primvar("displayColor", (0.18, 0.18, 0.18))}
    if opacity:
        inputs |= {"opacity": Primvar("displayOpacity", 1.0), "opacityMode": "presence"}
    return Look(name, (Layer("DisplayColor", PREVIEW_SURFACE.name, inputs),))
