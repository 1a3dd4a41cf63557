"""Writes the preview of a look: a UsdPreviewSurface that approximates it in other USD viewers.

`Model.preview` of a layer's model converts the layer to inputs of UsdPreviewSurface. The inputs of all layers are
blended by mask and presence. A value that varies is replaced by its mean over texture coordinates in [0, 1]². A layer
in mode "transmit" becomes a clear coat that tints the layers beneath.

The preview follows a layer with more than half of the weight: if the layer takes an input from a texture, a primvar or
an interface input of the material, the preview's input is connected to the same source, also in other variants.

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

# The inputs of UsdPreviewSurface that are written, with their types.
_FLOATS = ("metallic", "roughness", "clearcoat", "clearcoatRoughness", "ior", "opacity")
_TYPES = {"diffuseColor": Sdf.ValueTypeNames.Color3f} | dict.fromkeys(_FLOATS, Sdf.ValueTypeNames.Float)
# The defaults of UsdPreviewSurface, for inputs that a model's preview does not set. The value of "f0" is the
# reflectance at normal incidence for the default `ior`, 1.5.
_DERIVED_DEFAULTS: dict[str, Real] = {"clearcoat": 0.0, "clearcoatRoughness": 0.01, "f0": 0.04, "opacity": 1.0}
_DEFAULTS = {"diffuseColor": np.full(3, 0.18), "metallic": np.asarray(0.0), "roughness": np.asarray(0.5)}

_MAX_F0 = 0.9  # of an index of refraction of 38


class _Grid(ImagePoints):
    """A grid of (32, 32) points in the unit square of texture coordinates, over which values of a look are averaged.

    Primvars have their fallbacks. Each point is seen at another cosine. Together, these cosines are distributed as over
    the image of a sphere.
    """

    st: Floats = np.stack(np.meshgrid(*[(np.arange(32) + 0.5) / 32] * 2), axis=-1)

    def uv(self, name: str) -> Floats:
        return self.st

    def primvar(self, primvar: Primvar) -> Floats:
        return np.asarray(primvar.fallback, np.float64)

    def handedness(self) -> Floats:
        return np.ones(())

    def view(self) -> Floats:
        # The image of a sphere is a disc, over which squared cosines are uniformly distributed. The multiplier 387
        # spreads them evenly over the grid: 387 / 1024 is near the golden section.
        squares: Floats = (np.arange(1024) * 387 % 1024 + 0.5) / 1024
        return np.asarray(np.sqrt(squares).reshape(32, 32))


def preview_values(layers: Sequence[Layer]) -> dict[str, Floats]:
    """Return the inputs, by name, of the UsdPreviewSurface that approximates a stack of layers.

    `layers` begin with the base. The values are floats () and colours (3,).
    """
    values = _map_layer(layers[0])
    values["opacity"] = values["opacity"] * _coverage(layers[0])
    for layer in layers[1:]:
        above, cover = _map_layer(layer), _coverage(layer)
        above = _tint_by_coat(values, above) if layer.mode == "transmit" else above
        values = {name: (1.0 - cover) * values[name] + cover * above[name] for name in _TYPES}
    return values


def author_preview(material: UsdShade.Material, layers: Sequence[tuple[Layer, UsdShade.Shader]]) -> str:
    """Write or refresh the UsdPreviewSurface of a material, and return the path of its shader.

    `layers` are pairs of a layer of the material's look and its shader, base first. Inputs of the UsdPreviewSurface
    that the models do not have, such as displacement, stay as they are.

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
            # Six decimals are fewer than float32 has, so that a number which a user has typed is written as typed.
            rounded = np.round(values[name], 6).tolist()
            attribute.Set(tuple(rounded) if isinstance(rounded, list) else rounded)
    return str(shader.GetPath())


def _preview_shader(material: UsdShade.Material) -> UsdShade.Shader:
    """Return the UsdPreviewSurface of a material, a new one if nothing is connected to its outputs:surface."""
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
    """Return the connections to copy for an input of the preview; [] where the input gets a constant.

    If a layer has more than half of the weight, they are the connections of the layer's parameter of the same meaning.
    """
    # `covers` has the share of the layers beneath that each layer covers. `weights` has the share of each layer in the
    # result: its cover times 1 minus the cover of each layer above.
    covers = np.array([1.0, *(_coverage(layer) * (layer.mode == "over") for layer, _ in layers[1:])])
    weights = covers * np.append(np.cumprod(1.0 - covers[:0:-1])[::-1], 1.0)
    decisive = int(np.argmax(weights))
    layer, shader = layers[decisive]
    parameter = MODELS[layer.model].preview.same.get(name, "")
    # Whether the preview's colour differs from the layer's: it is derived for an exact metal, or tinted by a coat.
    is_changed = name == "diffuseColor" and (
        name in MODELS[layer.model].preview.derived(_mean_parameters(layer))
        or any(layer_above.mode == "transmit" for layer_above, _ in layers[decisive + 1 :])
    )
    # A constant is connected if it comes from an interface input of the material.
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
    """Return the mean of a parameter's value over `_Grid`: a float () or a colour (3,)."""
    assert not isinstance(value, str), "a token has no mean"
    values = np.asarray(SourceValues(_Grid()).parameter_value(value, parameter))
    return np.asarray(values.mean(axis=(0, 1)) if values.ndim >= 2 else values)


def _ior_of_f0(f0: Floats) -> Floats:
    """Return the index of refraction of a dielectric with the reflectance `f0` at normal incidence."""
    root = sqrt(min(float(f0), _MAX_F0))
    return np.asarray((1.0 + root) / (1.0 - root))


def _tint_by_coat(beneath: Mapping[str, Floats], coat: Mapping[str, Floats]) -> dict[str, Floats]:
    """Return the inputs of the preview for layers `beneath` a clear coat, which multiplies their colour by its own."""
    color = beneath["diffuseColor"] * coat["diffuseColor"]
    clearcoat = {"clearcoat": np.asarray(1.0), "clearcoatRoughness": coat["roughness"]}
    return {**beneath, "diffuseColor": color, **clearcoat}
