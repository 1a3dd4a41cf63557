"""Foreign shading models as layers of our models: a record each, in one registry.

A `Layer` of a look may have the name of a translation as its model; `lookdev.material.values.look_layers` returns
layers of our models in its place, so that its inputs may vary, and constants fold, as those of any other layer.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from lookdev.brdf import Parameter, StackLayer, model_named
from lookdev.brdf.parameters import with_followers
from lookdev.brdf.vectors import Parameters, same
from lookdev.material.look import Input, Layer, Look, Primvar
from lookdev.material.translate.gltf_pbr import GLTF_PBR
from lookdev.material.translate.open_pbr import OPEN_PBR_SURFACE
from lookdev.material.translate.preview_surface import MATERIALX_PREVIEW_SURFACE, PREVIEW_SURFACE
from lookdev.material.translate.standard_surface import STANDARD_SURFACE, STANDARD_SURFACE_100
from lookdev.material.translate.translation import Translation

__all__ = ["TRANSLATIONS", "Translation", "display_color_look", "foreign_shaders", "layer_parameters", "translated"]

TRANSLATIONS: dict[str, Translation] = {
    each.name: each
    for each in (
        PREVIEW_SURFACE,
        MATERIALX_PREVIEW_SURFACE,
        STANDARD_SURFACE,
        STANDARD_SURFACE_100,
        OPEN_PBR_SURFACE,
        GLTF_PBR,
    )
}
"""Every translation by its name."""


def layer_parameters(model: str) -> Mapping[str, Parameter]:
    """Return the parameters of a layer of a model, foreign ones included; an unknown name raises ModelError."""
    return TRANSLATIONS[model].parameters if model in TRANSLATIONS else model_named(model).parameters


def translated(layer: StackLayer) -> list[StackLayer]:
    """Return the layers, with all their parameters, that stand for one of a foreign model; any other as it is."""
    if layer.model not in TRANSLATIONS:
        return [layer]
    base, *others = TRANSLATIONS[layer.model].layers(layer.parameters)
    masked = [replace(base, mask=layer.mask, mode=layer.mode)]
    masked += [replace(each, mask=layer.mask * each.mask) for each in others if not same(each.mask, 0.0)]
    return [replace(each, parameters=_complete(each), name=f"{layer.name} {each.name}".strip()) for each in masked]


def _complete(layer: StackLayer) -> Parameters:
    model = model_named(layer.model)
    return model.complete({}) | with_followers(model.parameters, layer.parameters)


def foreign_shaders() -> dict[str, str]:
    """Return the name of each translation by the identifiers of its shader nodes."""
    return {identifier: each.name for each in TRANSLATIONS.values() for identifier in each.identifiers}


def display_color_look(name: str, *, opacity: bool = False) -> Look:
    """Return the look of a part that has a `displayColor`, linear as USD's are, or a `displayOpacity`.

    It is a UsdPreviewSurface, whose roughness is 0.5; without the primvar, the colour is USD's, a dark grey.
    """
    inputs: dict[str, Input] = {"diffuseColor": Primvar("displayColor", (0.18, 0.18, 0.18))}
    if opacity:
        inputs |= {"opacity": Primvar("displayOpacity", 1.0), "opacityMode": "presence"}
    return Look(name, (Layer("DisplayColor", PREVIEW_SURFACE.name, inputs),))
