"""Values of a look at points of a surface: numbers in the reference and the preview, symbols in generated code.

Only this module turns constants, textures, primvars and expressions into values of parameters, over any `Surface`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from lookdev.brdf import MASK, MODELS, Array, Bsdf, Parameter, Real, StackLayer, stack_bsdf
from lookdev.brdf.parameters import add_followers, complete, expand_tokens
from lookdev.brdf.vectors import Parameters, are_equal, vector
from lookdev.material import (
    VIEW,
    Bump,
    Coordinates,
    Formula,
    Input,
    InputSource,
    Layer,
    Look,
    Primvar,
    Texture,
    Varying,
    ViewCosine,
)
from lookdev.material.expression import ExpressionError, ExpressionKind, parse
from lookdev.material.textures import texture_value
from lookdev.material.translate import layer_parameters, translate_layer


class Surface(Protocol):
    """Points of a surface, and the data of the surface there."""

    def uv(self, name: str) -> Array:
        """Return the coordinates (..., 2) of a UV set."""

    def texels(self, texture: Texture) -> Array:
        """Return all four channels of the image, linear, (..., 4), at the texture's coordinates."""

    def slopes(self, height: Texture) -> Array:
        """Return the derivatives of the image's channel, (..., 2), by the image's own coordinates."""

    def primvar(self, primvar: Primvar) -> Array:
        """Return the values of a primvar: (...), or (..., 3) where its fallback is a colour."""

    def handedness(self) -> Array:
        """Return the direction in which v grows, (...): +1 along cross(normal, tangent), or -1."""

    def view(self) -> Array:
        """Return the cosine between the shading normal and the direction to the viewer, (...); see `ViewCosine`."""


def look_bsdf(look: Look, surface: Surface) -> Bsdf:
    """Combine the layers of a look at some points into one BSDF.

    Raises
    ------
    ModelError
        A constant is outside its hard range, or the layers cannot be combined.
    TextureError
        An image is missing or unreadable.
    """
    return stack_bsdf(look_layers(look, surface))


def look_layers(look: Look, surface: Surface) -> list[StackLayer]:
    """Return the layers of a look at some points, base first, with all parameters of their models.

    Layers of its translation replace a layer of a foreign model. Raises as `look_bsdf`.
    """
    values = SourceValues(surface)
    stack = [
        StackLayer(
            layer.model,
            _complete_parameters(layer, values),
            values.parameter_value(layer.mask, MASK),
            layer.mode,
            layer.name,
        )
        for layer in look.layers
    ]
    return [translated_layer for layer in stack for translated_layer in translate_layer(layer)]


def _complete_parameters(layer: Layer, values: SourceValues) -> Parameters:
    records = layer_parameters(layer.model)
    inputs = expand_tokens(layer.model, records, layer.inputs)
    varying = {name: source for name, source in inputs.items() if isinstance(source, Varying)}
    constants = {name: source for name, source in inputs.items() if name not in varying}
    parameters: dict[str, Real | str] = {**complete(layer.model, records, constants)}
    for name, value in parameters.items():
        if records[name].kind == "normal" and name in constants and not isinstance(value, float | str):
            parameters[name] = values.in_shading_frame(value)
    parameters |= {name: values.parameter_value(source, records[name]) for name, source in varying.items()}
    return parameters | add_followers(records, {name: parameters[name] for name in inputs})


@dataclass(frozen=True)
class SourceValues:
    """Values of sources at points of a surface."""

    surface: Surface
    # Keyed by identity: several inputs may share one formula. The formulas outlive this object.
    _formulas: dict[int, tuple[Array, bool]] = field(default_factory=dict)

    def parameter_value(self, source: InputSource | Bump, parameter: Parameter) -> Real:
        """Return the value of a parameter, clipped to its hard range: one number, or an array over the points."""
        if isinstance(source, Bump):
            return self.in_shading_frame(self._bump_normal(source))
        value = self.source_value(source, color=parameter.kind == "color")
        if isinstance(source, Varying):
            value = clip_to_range(value, parameter)
        return self.in_shading_frame(value) if parameter.kind == "normal" else value

    def in_shading_frame(self, normal: Array) -> Array:
        """Convert normals (..., 3) from the frame of the UVs to the shading frame, whose bitangent may be opposite."""
        if are_equal(normal[..., 1], 0.0):
            return normal
        hand = self.surface.handedness()
        ones = 1.0 + 0.0 * hand
        return normal * vector(ones, hand, ones)

    def source_value(self, source: InputSource, color: bool) -> Array:
        """Return the value of a source, not clipped. For a `color`, a float becomes three equal channels."""
        value: Array
        match source:
            case Texture():
                value, is_color = texture_value(source, self.surface.texels(source)), source.channel == "rgb"
            case Primvar():
                value, is_color = self.surface.primvar(source), isinstance(source.fallback, tuple)
            case Coordinates():
                s, t = transform_uv(source.transform, self.surface.uv(source.st))
                value, is_color = vector(s, t, 0.0 * s), True
            case ViewCosine():
                value, is_color = self.surface.view(), False
            case Formula():
                if id(source) not in self._formulas:
                    self._formulas[id(source)] = self._evaluate_formula(source)
                value, is_color = self._formulas[id(source)]
            case _:
                value, is_color = np.asarray(source, dtype=np.float64), isinstance(source, tuple)
        return vector(value, value, value) if color and not is_color else value

    def _evaluate_formula(self, formula: Formula) -> tuple[Array, bool]:
        kinds = formula.kinds
        values = {name: self.source_value(source, kinds[name] == "color") for name, source in formula.inputs.items()}
        return formula.expression.evaluate(values, kinds), formula.expression.check(kinds) == "color"

    def _bump_normal(self, bump: Bump) -> Array:
        slopes = self.surface.slopes(bump.height) * bump.scale
        # The chain rule: the image's coordinates are a linear transform of the surface's.
        a, b, _, c, d, _ = bump.height.transform
        s, t = slopes[..., 0], slopes[..., 1]
        slope_s, slope_t = s * a + t * c, s * b + t * d
        return vector(-slope_s, -slope_t, 1.0 + 0.0 * slope_s)


def view_dependent_value(text: str, parameter: Parameter, view: Array) -> Array:
    """Return the value of a parameter that an expression of the `view` (...) alone sets.

    Raises
    ------
    ExpressionError
        The text is wrong, does not use the view, uses another name, or its result has another type.
    """
    expression = parse(text)
    kinds: dict[str, ExpressionKind] = {VIEW: "float"}
    kind = expression.check(kinds)
    if VIEW not in expression.names:
        raise ExpressionError(text, 0, "does not depend on the view", "a number would be right")
    gray = (kind, parameter.kind) == ("float", "color")
    if not gray and (kind == "float") != (parameter.kind == "float"):
        raise ExpressionError(text, 0, f"the result is a {kind}", f"'{parameter.name}' is a {parameter.kind}")
    value = clip_to_range(expression.evaluate({VIEW: view}, kinds), parameter)
    return vector(value, value, value) if gray else value


def clip_to_range(value: Array, parameter: Parameter) -> Array:
    """Clip a value to the hard range of a parameter."""
    low, high = parameter.hard
    value = value if low == -np.inf else np.maximum(value, low)
    return value if high == np.inf else np.minimum(value, high)


def presence(layer: Layer) -> Input:
    """Return the input, constant or varying, for the presence of a layer; 1 for a model without that parameter."""
    return layer.inputs.get(MODELS[layer.model].preview.same.get("opacity", ""), 1.0)


def transform_uv(transform: tuple[float, ...], uv: Array) -> tuple[Array, Array]:
    """Apply a transform to coordinates (..., 2); return s and t, (...)."""
    a, b, c, d, e, f = transform
    s, t = uv[..., 0], uv[..., 1]
    return s * a + t * b + c, s * d + t * e + f
