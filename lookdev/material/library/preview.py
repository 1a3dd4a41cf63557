"""UsdPreviewSurface: what other USD viewers show of a look. It is a likeness, not the look.

Each layer is first mapped on its own.

| UsdPreviewSurface | Disney | Pixar |
|---|---|---|
| diffuseColor | baseColor | surfaceColor |
| metallic | metallic | metallic |
| roughness | roughness | roughness |
| clearcoat | clearcoat / 4, the strength that the model gives it | 0 |
| clearcoatRoughness | the root of its alpha, mix(.1, .001, clearcoatGloss) | 0.01, unused |
| ior | the one of F0 = .08 specular | the one of F0 = .05 normalScale |
| opacity | 1 | 1 - clear (1 - metallic); that of the base times its presence |

Then layers are blended by mask and presence, with the mean over [0, 1]² of st for what varies. A layer in mode
"transmit" is a clear coat that tints what is beneath. Instead, what a layer with more than half of the weight takes
from a texture, a primvar or an interface input is connected to that, so that it follows it, variants included.

- UsdPreviewSurface Specification, Pixar. https://openusd.org/release/spec_usdpreviewsurface.html
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import sqrt
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, UsdShade

from lookdev.brdf import MODELS, Real
from lookdev.errors import Fault, LookError
from lookdev.material.library.nodes import clear_input, free_path
from lookdev.material.look import Coordinates, Formula, Input, Layer, Primvar, Texture
from lookdev.material.textures import sample_texture
from lookdev.material.usd.network import shader_id

Value: TypeAlias = NDArray[np.float64]

_TYPES = {
    "diffuseColor": Sdf.ValueTypeNames.Color3f,
    "metallic": Sdf.ValueTypeNames.Float,
    "roughness": Sdf.ValueTypeNames.Float,
    "clearcoat": Sdf.ValueTypeNames.Float,
    "clearcoatRoughness": Sdf.ValueTypeNames.Float,
    "ior": Sdf.ValueTypeNames.Float,
    "opacity": Sdf.ValueTypeNames.Float,
}
_DERIVED: dict[str, Real] = {"clearcoat": 0.0, "clearcoatRoughness": 0.01, "f0": 0.04, "opacity": 1.0}
_PLAIN = {"diffuseColor": np.full(3, 0.18), "metallic": np.asarray(0.0), "roughness": np.asarray(0.5)}
"""UsdPreviewSurface's own defaults: what a model's likeness does not set."""

_GRID = 32  # look-ups along each axis, for a mean
_LARGEST_F0 = 0.9  # an index of refraction of 38


def preview_values(layers: Sequence[Layer]) -> dict[str, Value]:
    """Return the inputs of the UsdPreviewSurface that is like a stack, base first: floats () and colours (3,).

    Raises
    ------
    TextureError
        A texture cannot be read.
    """
    values = _values(layers[0])
    values["opacity"] = values["opacity"] * _cover(layers[0])
    for layer in layers[1:]:
        own, cover = _values(layer), _cover(layer)
        above = _coated(values, own) if layer.mode == "transmit" else own
        values = {name: (1.0 - cover) * values[name] + cover * above[name] for name in _TYPES}
    return values


def author_preview(material: UsdShade.Material, layers: Sequence[tuple[Layer, UsdShade.Shader]]) -> str:
    """Write or refresh the UsdPreviewSurface of a material, and return the path of its shader.

    Inputs that have no counterpart in the models, such as displacement, stay as they are.

    Parameters
    ----------
    material
        On a stage whose edit target takes what is written.
    layers
        Of its look, base first, each with the shader that it was read from.

    Raises
    ------
    LookError
        The material's outputs:surface is connected to something else.
    TextureError
        A texture cannot be read.
    """
    shader = _preview_shader(material)
    values = preview_values([layer for layer, _ in layers])
    for name, type_name in _TYPES.items():
        attribute = shader.CreateInput(name, type_name).GetAttr()
        clear_input(attribute)
        if connections := _connections(name, layers):
            attribute.SetConnections(connections)
        else:
            # A digit less than float32 has, so that a number that was typed comes out as it was typed.
            rounded = np.round(values[name], 6).tolist()
            attribute.Set(tuple(rounded) if isinstance(rounded, list) else rounded)
    return str(shader.GetPath())


def _preview_shader(material: UsdShade.Material) -> UsdShade.Shader:
    terminal = material.CreateOutput("surface", Sdf.ValueTypeNames.Token).GetAttr()
    stage = material.GetPrim().GetStage()
    if paths := terminal.GetConnections():
        shader = UsdShade.Shader(stage.GetPrimAtPath(paths[0].GetPrimPath()))
        given = shader_id(shader) if shader else "no shader"
        if given == "UsdPreviewSurface":
            return shader
        file, place = stage.GetRootLayer().realPath, str(terminal.GetPath())
        what = f"is connected to <{paths[0]}>, {given}"
        raise LookError([Fault(file, place, what, "only a UsdPreviewSurface is refreshed; disconnect it to get one")])
    shader = UsdShade.Shader.Define(stage, free_path(stage, material.GetPath(), "Preview"))
    shader.CreateIdAttr("UsdPreviewSurface")
    terminal.SetConnections([shader.CreateOutput("surface", Sdf.ValueTypeNames.Token).GetAttr().GetPath()])
    return shader


def _connections(name: str, layers: Sequence[tuple[Layer, UsdShade.Shader]]) -> list[Sdf.Path]:
    """Return what an input of the preview is connected to: the source of the layer that decides it, if that varies."""
    covers = np.array([1.0, *(_cover(layer) * (layer.mode == "over") for layer, _ in layers[1:])])
    weights = covers * np.append(np.cumprod(1.0 - covers[:0:-1])[::-1], 1.0)
    decisive = int(np.argmax(weights))
    layer, shader = layers[decisive]
    parameter = MODELS[layer.model].preview.same.get(name, "")
    tinted = name == "diffuseColor" and any(each.mode == "transmit" for each, _ in layers[decisive + 1 :])
    value = layer.inputs.get(parameter)
    shown = isinstance(value, Texture | Primvar) or (isinstance(value, float | tuple) and name != "opacity")
    if not shown or tinted or weights[decisive] <= 0.5:
        return []
    connections: list[Sdf.Path] = shader.GetInput(parameter).GetAttr().GetConnections()
    return connections


def _cover(layer: Layer) -> float:
    """Return how much a layer covers of what is beneath it."""
    return float(_mean(layer.mask, (0.0, 1.0)) * _mean(layer.inputs.get("presence", 1.0), (0.0, 1.0)))


def _values(layer: Layer) -> dict[str, Value]:
    """Map one layer, of which all numbers and colours are taken by their mean."""
    given = {
        name: _mean(layer.inputs.get(name, parameter.default), parameter.hard)
        for name, parameter in MODELS[layer.model].parameters.items()
        if parameter.kind in ("float", "color")
    }
    preview = MODELS[layer.model].preview
    same = {name: given[own] for name, own in preview.same.items()}
    derived = {name: np.asarray(value) for name, value in (_DERIVED | preview.derived(given)).items()}
    derived["ior"] = _ior(derived.pop("f0"))
    return _PLAIN | same | derived


def _mean(value: Input, bounds: tuple[float, float]) -> Value:
    steps = (np.arange(_GRID) + 0.5) / _GRID
    sampled = np.clip(_sampled(value, np.stack(np.meshgrid(steps, steps), axis=-1)), *bounds)
    mean: Value = sampled.mean(axis=(0, 1)) if sampled.ndim >= 2 else sampled
    return mean


def _sampled(value: Any, st: Value) -> Value:
    """Return what varies at coordinates (..., 2); a constant, and a primvar's fallback, as it is."""
    match value:
        case Texture():
            return sample_texture(value, st)
        case Coordinates():
            matrix = np.array(value.transform).reshape(2, 3)
            moved = st @ matrix[:, :2].T + matrix[:, 2]
            return np.append(moved, np.zeros_like(moved[..., :1]), axis=-1)
        case Formula():
            inputs = {name: _sampled(source, st) for name, source in value.inputs.items()}
            return np.asarray(value.expression.evaluate(inputs, value.kinds))
        case Primvar():
            return np.asarray(value.fallback, dtype=np.float64)
        case _:
            return np.asarray(value, dtype=np.float64)


def _ior(f0: Value) -> Value:
    root = sqrt(min(float(f0), _LARGEST_F0))
    return np.asarray((1.0 + root) / (1.0 - root))


def _coated(beneath: Mapping[str, Value], coat: Mapping[str, Value]) -> dict[str, Any]:
    return {
        **beneath,
        "diffuseColor": beneath["diffuseColor"] * coat["diffuseColor"],
        "clearcoat": np.asarray(1.0),
        "clearcoatRoughness": coat["roughness"],
    }
