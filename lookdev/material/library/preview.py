"""UsdPreviewSurface: the approximation of a look that other USD viewers show.

Each layer is mapped by `Model.preview` of its model. Then layers are blended by mask and presence, with the mean over
[0, 1]² of st for what varies. A layer in mode "transmit" is a clear coat that tints what is beneath. An input that a
layer with more than half of the weight reads from a texture, a primvar or an interface input is connected to that
source instead, so that it follows the source, variants included.

- UsdPreviewSurface Specification, Pixar. https://openusd.org/release/spec_usdpreviewsurface.html
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, UsdShade

from lookdev.brdf import MASK, MODELS, Parameter, Real
from lookdev.brdf.parameters import spelled_out, with_followers
from lookdev.errors import Fault, LookError
from lookdev.material.library.nodes import clear_input, free_path
from lookdev.material.look import Layer, Primvar, Texture
from lookdev.material.textures import image_slopes, image_texels
from lookdev.material.usd.network import shader_id
from lookdev.material.values import Values, presence

Value = NDArray[np.float64]

_FLOATS = ("metallic", "roughness", "clearcoat", "clearcoatRoughness", "ior", "opacity")
_TYPES = {"diffuseColor": Sdf.ValueTypeNames.Color3f} | dict.fromkeys(_FLOATS, Sdf.ValueTypeNames.Float)
_DERIVED: dict[str, Real] = {"clearcoat": 0.0, "clearcoatRoughness": 0.01, "f0": 0.04, "opacity": 1.0}
_PLAIN = {"diffuseColor": np.full(3, 0.18), "metallic": np.asarray(0.0), "roughness": np.asarray(0.5)}
"""UsdPreviewSurface's own defaults: what a model's likeness does not set."""

_LARGEST_F0 = 0.9  # an index of refraction of 38


class _Grid:
    """The unit square of st as a `lookdev.material.values.Surface`, (32, 32) points; primvars are their fallbacks.

    Each has another view, of those that the disc of a sphere shows.
    """

    st: Value = np.stack(np.meshgrid(*[(np.arange(32) + 0.5) / 32] * 2), axis=-1)

    def uv(self, name: str) -> Value:
        return self.st

    def texels(self, texture: Texture) -> Value:
        return image_texels(texture, self.st)

    def slopes(self, height: Texture) -> Value:
        return image_slopes(height, self.st)

    def primvar(self, primvar: Primvar) -> Value:
        return np.asarray(primvar.fallback, np.float64)

    def handedness(self) -> Value:
        return np.ones(())

    def view(self) -> Value:
        # Squared cosines are uniform over the disc; 387 / 1024 is near the golden section: even over st, too.
        squares: Value = (np.arange(1024) * 387 % 1024 + 0.5) / 1024
        return np.asarray(np.sqrt(squares).reshape(32, 32))


def preview_values(layers: Sequence[Layer]) -> dict[str, Value]:
    """Return the inputs of the UsdPreviewSurface that approximates a stack, base first: floats () and colours (3,)."""
    values = _values(layers[0])
    values["opacity"] = values["opacity"] * _cover(layers[0])
    for layer in layers[1:]:
        own, cover = _values(layer), _cover(layer)
        above = _coated(values, own) if layer.mode == "transmit" else own
        values = {name: (1.0 - cover) * values[name] + cover * above[name] for name in _TYPES}
    return values


def author_preview(material: UsdShade.Material, layers: Sequence[tuple[Layer, UsdShade.Shader]]) -> str:
    """Write or refresh the UsdPreviewSurface of a material, and return the path of its shader.

    Inputs that have no counterpart in the models, such as displacement, stay as they are. `layers` are those of its
    look, base first, each with the shader that it was read from.

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
            # A digit less than float32 has, so that a number that was typed is written as it was typed.
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
    """Return the connection of an input of the preview: the source of the layer with most weight, if that varies."""
    covers = np.array([1.0, *(_cover(layer) * (layer.mode == "over") for layer, _ in layers[1:])])
    weights = covers * np.append(np.cumprod(1.0 - covers[:0:-1])[::-1], 1.0)
    decisive = int(np.argmax(weights))
    layer, shader = layers[decisive]
    parameter = MODELS[layer.model].preview.same.get(name, "")
    # The colour is that of an exact metal, or tinted from above.
    another = name == "diffuseColor" and (
        name in MODELS[layer.model].preview.derived(_given(layer))
        or any(each.mode == "transmit" for each, _ in layers[decisive + 1 :])
    )
    value = layer.inputs.get(parameter)
    shown = isinstance(value, Texture | Primvar) or (isinstance(value, float | tuple) and name != "opacity")
    if not shown or another or weights[decisive] <= 0.5:
        return []
    connections: list[Sdf.Path] = shader.GetInput(parameter).GetAttr().GetConnections()
    return connections


def _cover(layer: Layer) -> float:
    """Return the fraction of what is beneath a layer that it covers."""
    return float(_mean(layer.mask, MASK) * _mean(presence(layer), MASK))


def _given(layer: Layer) -> dict[str, Any]:
    """Return the tokens of a layer, and the means of all its numbers and colours."""
    model = MODELS[layer.model]
    inputs = with_followers(model.parameters, spelled_out(model.name, model.parameters, layer.inputs))
    means: dict[str, Any] = {
        name: _mean(inputs.get(name, parameter.default), parameter)
        for name, parameter in model.parameters.items()
        if parameter.kind in ("float", "color")
    }
    return means | model.tokens({name: value for name, value in inputs.items() if isinstance(value, str)})


def _values(layer: Layer) -> dict[str, Value]:
    """Map one layer."""
    given, preview = _given(layer), MODELS[layer.model].preview
    same = {name: given[own] for name, own in preview.same.items()}
    derived = {name: np.asarray(value) for name, value in (_DERIVED | preview.derived(given)).items()}
    derived["ior"] = _ior(derived.pop("f0"))
    return _PLAIN | same | derived


def _mean(value: Any, parameter: Parameter) -> Value:
    found = np.asarray(Values(_Grid()).of(value, parameter))
    return np.asarray(found.mean(axis=(0, 1)) if found.ndim >= 2 else found)


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
