"""Evaluates the inputs of a look at points of a surface, and combines its layers there into a BSDF.

Textures, primvars and expressions become values of parameters only here. A `Surface` supplies the data at the points.
Its arrays hold float64 numbers in the reference and the preview, and symbols where shader code is generated: the same
functions are then traced.
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
    """Points of a surface with the data of the surface there.

    In the shapes of its arrays, ``...`` stands for the axes of the points.
    """

    def uv(self, name: str) -> Array:
        """Return the texture coordinates (..., 2) of the points in a UV set."""

    def texels(self, texture: Texture) -> Array:
        """Return all four channels of a texture's image, linear, (..., 4), at the texture coordinates of the points."""

    def slopes(self, height: Texture) -> Array:
        """Return the derivatives of a height map's channel with respect to the image's own s and t, (..., 2)."""

    def primvar(self, primvar: Primvar) -> Array:
        """Return the values of a primvar: (...), or (..., 3) where its fallback is a colour."""

    def handedness(self) -> Array:
        """Return (...): +1 where v of the UV set grows along cross(normal, tangent), and -1 where v falls."""

    def view(self) -> Array:
        """Return the cosine between the shading normal and the direction to the viewer, (...); see `ViewCosine`."""


def look_bsdf(look: Look, surface: Surface) -> Bsdf:
    """Return the BSDF of a look at some points, combined from its layers.

    Raises
    ------
    ModelError
        A constant is outside its hard range, or the layers cannot be combined.
    TextureError
        An image is missing or unreadable.
    """
    return stack_bsdf(look_layers(look, surface))


def look_layers(look: Look, surface: Surface) -> list[StackLayer]:
    """Return the layers of a look at some points, base first, with the values of all parameters of their models.

    A layer of a foreign model is replaced by the layers of its translation. Raises as `look_bsdf`.
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
    """Return the values of all parameters of a layer's model.

    An unset input has the value of the parameter that it follows, or else its default.
    """
    records = layer_parameters(layer.model)
    inputs = expand_tokens(layer.model, records, layer.inputs)
    varying = {name: source for name, source in inputs.items() if isinstance(source, Varying)}
    constants = {name: source for name, source in inputs.items() if name not in varying}
    parameters: dict[str, Real | str] = {**complete(layer.model, records, constants)}
    for name, value in parameters.items():
        if records[name].kind == "normal" and name in constants and not isinstance(value, float | str):
            parameters[name] = values.in_shading_frame(value)
    parameters |= {name: values.parameter_value(source, records[name]) for name, source in varying.items()}
    # `complete` has only seen constants. Parameters that follow a varying parameter get their values here.
    return parameters | add_followers(records, {name: parameters[name] for name in inputs})


@dataclass(frozen=True)
class SourceValues:
    """Evaluates sources at the points of a surface."""

    surface: Surface
    # Pairs (value, whether the value is a colour) of evaluated formulas, by the formula's id(): several inputs may
    # share a formula. The look keeps its formulas while this object exists.
    _formulas: dict[int, tuple[Array, bool]] = field(default_factory=dict)

    def parameter_value(self, source: InputSource | Bump, parameter: Parameter) -> Real:
        """Return the value of a parameter: one number, or an array over the points.

        Values of textures, primvars and expressions are clipped to the parameter's hard range. Constants are not.
        Normals are returned in the shading frame.
        """
        if isinstance(source, Bump):
            return self.in_shading_frame(self._bump_normal(source))
        value = self.source_value(source, color=parameter.kind == "color")
        if isinstance(source, Varying):
            value = clip_to_range(value, parameter)
        return self.in_shading_frame(value) if parameter.kind == "normal" else value

    def in_shading_frame(self, normal: Array) -> Array:
        """Convert normals (..., 3) from the frame of the UVs to the shading frame.

        In the frame of the UVs, y points along increasing v. In the shading frame, y is cross(normal, tangent). The two
        are opposite where `Surface.handedness` is -1.
        """
        if are_equal(normal[..., 1], 0.0):
            return normal
        hand = self.surface.handedness()
        # Adding 0 times an array gives a constant the array's shape. Other functions here do the same.
        ones = 1.0 + 0.0 * hand
        return normal * vector(ones, hand, ones)

    def source_value(self, source: InputSource, color: bool) -> Array:
        """Return the value of a source, not clipped. If `color`, a float becomes a colour of three equal channels."""
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
        """Return the value of a formula, and whether it is a colour."""
        kinds = formula.kinds
        values = {name: self.source_value(source, kinds[name] == "color") for name, source in formula.inputs.items()}
        return formula.expression.evaluate(values, kinds), formula.expression.check(kinds) == "color"

    def _bump_normal(self, bump: Bump) -> Array:
        """Return normals (..., 3) of heights h in the frame of the UVs, not normalised: (-dh/ds, -dh/dt, 1)."""
        slopes = self.surface.slopes(bump.height) * bump.scale
        # The chain rule: the image's coordinates are a linear function of the surface's coordinates.
        a, b, _, c, d, _ = bump.height.transform
        s, t = slopes[..., 0], slopes[..., 1]
        slope_s, slope_t = s * a + t * c, s * b + t * d
        return vector(-slope_s, -slope_t, 1.0 + 0.0 * slope_s)


def view_dependent_value(text: str, parameter: Parameter, view: Array) -> Array:
    """Return the value of a parameter from the text of an expression whose only input is the view cosine.

    `view` has the cosines (...) at the points; see `ViewCosine`. The result is clipped to the parameter's hard range.

    Raises
    ------
    ExpressionError
        The text is not an expression, does not use the view, uses another name, or has a result of another type than
        the parameter. A float result is also right for a colour parameter.
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
    """Return the input that sets the presence of a layer: how much of the layer is there. The default is 1."""
    # The presence is the parameter that corresponds to UsdPreviewSurface's ``opacity`` in `Preview.same` of the model.
    return layer.inputs.get(MODELS[layer.model].preview.same.get("opacity", ""), 1.0)


def transform_uv(transform: tuple[float, ...], uv: Array) -> tuple[Array, Array]:
    """Apply a `Transform` to texture coordinates (..., 2); return the new s (...) and t (...)."""
    a, b, c, d, e, f = transform
    s, t = uv[..., 0], uv[..., 1]
    return s * a + t * b + c, s * d + t * e + f
