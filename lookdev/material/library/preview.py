"""UsdPreviewSurface approximations of looks, for other USD viewers.

`Model.preview` of a layer's model maps each layer. Then layers are blended by mask and presence; varying values count
as their mean over [0, 1]² of st. A layer in mode "transmit" is a clear coat that tints the layers beneath. Where a
layer with more than half of the weight reads an input from a texture, a primvar or an interface input, the preview's
input is connected to that source, so that it follows the source in all variants.

- UsdPreviewSurface Specification, Pixar. https://openusd.org/release/spec_usdpreviewsurface.html
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import sqrt

import numpy as np
from pxr import Sdf, UsdShade

from lookdev.arrays import Floats
from lookdev.brdf import MASK, MODELS, Parameter, Real
from lookdev.brdf.parameters import add_followers, expand_tokens
from lookdev.brdf.vectors import Parameters
from lookdev.errors import LookError
from lookdev.material import Input, Layer, Primvar, Texture
from lookdev.material.library.nodes import clear_input, free_path
from lookdev.material.points import ImagePoints
from lookdev.material.usd.network import shader_id
from lookdev.material.values import SourceValues, presence

_FLOATS = ("metallic", "roughness", "clearcoat", "clearcoatRoughness", "ior", "opacity")
_TYPES = {"diffuseColor": Sdf.ValueTypeNames.Color3f} | dict.fromkeys(_FLOATS, Sdf.ValueTypeNames.Float)
_DERIVED_DEFAULTS: dict[str, Real] = {"clearcoat": 0.0, "clearcoatRoughness": 0.01, "f0": 0.04, "opacity": 1.0}
_DEFAULTS = {"diffuseColor": np.full(3, 0.18), "metallic": np.asarray(0.0), "roughness": np.asarray(0.5)}
"""Defaults of inputs that a model's preview does not set: those of UsdPreviewSurface."""

_MAX_F0 = 0.9  # an index of refraction of 38


class _Grid(ImagePoints):
    """The unit square of st as a `lookdev.material.values.Surface` of (32, 32) points; primvars have their fallbacks.

    Each point has another view, from the distribution of views over the image of a sphere.
    """

    st: Floats = np.stack(np.meshgrid(*[(np.arange(32) + 0.5) / 32] * 2), axis=-1)

    def uv(self, name: str) -> Floats:
        return self.st

    def primvar(self, primvar: Primvar) -> Floats:
        return np.asarray(primvar.fallback, np.float64)

    def handedness(self) -> Floats:
        return np.ones(())

    def view(self) -> Floats:
        # Squared cosines are uniform over the disc that a sphere's image is. 387 / 1024 is near the golden section, so
        # that they are spread evenly over st, too.
        squares: Floats = (np.arange(1024) * 387 % 1024 + 0.5) / 1024
        return np.asarray(np.sqrt(squares).reshape(32, 32))


def preview_values(layers: Sequence[Layer]) -> dict[str, Floats]:
    """Return the inputs of the UsdPreviewSurface that approximates a stack, base first: floats () and colours (3,)."""
    values = _map_layer(layers[0])
    values["opacity"] = values["opacity"] * _coverage(layers[0])
    for layer in layers[1:]:
        above, cover = _map_layer(layer), _coverage(layer)
        above = _tint_by_coat(values, above) if layer.mode == "transmit" else above
        values = {name: (1.0 - cover) * values[name] + cover * above[name] for name in _TYPES}
    return values


def author_preview(material: UsdShade.Material, layers: Sequence[tuple[Layer, UsdShade.Shader]]) -> str:
    """Write or refresh the UsdPreviewSurface of a material, and return the path of its shader.

    Inputs without counterpart in the models, such as displacement, do not change. `layers` are the layers of its look,
    base first, each with its shader.

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
        if connections := _preview_connections(name, layers):
            attribute.SetConnections(connections)
        else:
            # One digit less than float32 has, so that a typed number is written as typed.
            rounded = np.round(values[name], 6).tolist()
            attribute.Set(tuple(rounded) if isinstance(rounded, list) else rounded)
    return str(shader.GetPath())


def _preview_shader(material: UsdShade.Material) -> UsdShade.Shader:
    terminal = material.CreateOutput("surface", Sdf.ValueTypeNames.Token).GetAttr()
    stage = material.GetPrim().GetStage()
    if paths := terminal.GetConnections():
        shader = UsdShade.Shader(stage.GetPrimAtPath(paths[0].GetPrimPath()))
        identifier = shader_id(shader) if shader else "no shader"
        if identifier == "UsdPreviewSurface":
            return shader
        file, where = stage.GetRootLayer().realPath, str(terminal.GetPath())
        message = f"is connected to <{paths[0]}>, {identifier}"
        raise LookError.at(file, where, message, "only a UsdPreviewSurface is refreshed; disconnect it to get one")
    shader = UsdShade.Shader.Define(stage, free_path(stage, material.GetPath(), "Preview"))
    shader.CreateIdAttr("UsdPreviewSurface")
    terminal.SetConnections([shader.CreateOutput("surface", Sdf.ValueTypeNames.Token).GetAttr().GetPath()])
    return shader


def _preview_connections(name: str, layers: Sequence[tuple[Layer, UsdShade.Shader]]) -> list[Sdf.Path]:
    """Return the connection of an input of the preview; [] if no layer with more than half of the weight has one."""
    covers = np.array([1.0, *(_coverage(layer) * (layer.mode == "over") for layer, _ in layers[1:])])
    weights = covers * np.append(np.cumprod(1.0 - covers[:0:-1])[::-1], 1.0)
    decisive = int(np.argmax(weights))
    layer, shader = layers[decisive]
    parameter = MODELS[layer.model].preview.same.get(name, "")
    # The colour differs from the layer's input: it is that of an exact metal, or tinted from above.
    is_changed = name == "diffuseColor" and (
        name in MODELS[layer.model].preview.derived(_mean_parameters(layer))
        or any(layer_above.mode == "transmit" for layer_above, _ in layers[decisive + 1 :])
    )
    value = layer.inputs.get(parameter)
    is_source = isinstance(value, Texture | Primvar) or (isinstance(value, float | tuple) and name != "opacity")
    if not is_source or is_changed or weights[decisive] <= 0.5:
        return []
    connections: list[Sdf.Path] = shader.GetInput(parameter).GetAttr().GetConnections()
    return connections


def _coverage(layer: Layer) -> float:
    """Return the fraction of the layers beneath that a layer covers."""
    return float(_mean_value(layer.mask, MASK) * _mean_value(presence(layer), MASK))


def _mean_parameters(layer: Layer) -> Parameters:
    """Return the parameters of a layer: its tokens, and the means of its numbers and colours."""
    model = MODELS[layer.model]
    inputs = add_followers(model.parameters, expand_tokens(model.name, model.parameters, layer.inputs))
    means: dict[str, Floats | str] = {
        name: _mean_value(inputs.get(name, parameter.default), parameter)
        for name, parameter in model.parameters.items()
        if parameter.kind in ("float", "color")
    }
    return means | model.tokens({name: value for name, value in inputs.items() if isinstance(value, str)})


def _map_layer(layer: Layer) -> dict[str, Floats]:
    """Return the inputs of the UsdPreviewSurface that approximates one layer."""
    parameters, preview = _mean_parameters(layer), MODELS[layer.model].preview
    same = {name: parameters[parameter] for name, parameter in preview.same.items()}
    derived = {name: np.asarray(value) for name, value in (_DERIVED_DEFAULTS | preview.derived(parameters)).items()}
    derived["ior"] = _ior_of_f0(derived.pop("f0"))
    return _DEFAULTS | same | derived


def _mean_value(value: Input, parameter: Parameter) -> Floats:
    assert not isinstance(value, str), "a token has no mean"
    values = np.asarray(SourceValues(_Grid()).parameter_value(value, parameter))
    return np.asarray(values.mean(axis=(0, 1)) if values.ndim >= 2 else values)


def _ior_of_f0(f0: Floats) -> Floats:
    root = sqrt(min(float(f0), _MAX_F0))
    return np.asarray((1.0 + root) / (1.0 - root))


def _tint_by_coat(beneath: Mapping[str, Floats], coat: Mapping[str, Floats]) -> dict[str, Floats]:
    color = beneath["diffuseColor"] * coat["diffuseColor"]
    clearcoat = {"clearcoat": np.asarray(1.0), "clearcoatRoughness": coat["roughness"]}
    return {**beneath, "diffuseColor": color, **clearcoat}
