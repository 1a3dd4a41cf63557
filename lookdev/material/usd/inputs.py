"""Reads the inputs of layers of `lookdev` in USD: constants, and nodes for textures, bumps, primvars and expressions.

The functions return None where an input is unset. Where an input is wrong, they add a fault to the network and return
None. Materials of other shading models are read by `lookdev.material.usd.bound`.
"""

from __future__ import annotations

from math import inf
from pathlib import Path
from typing import cast

import numpy as np
from pxr import Gf, Sdf, Usd, UsdShade

from lookdev.brdf import Parameter
from lookdev.errors import ModelError, TextureError, nearest_hint
from lookdev.material import (
    VIEW,
    Bump,
    Channel,
    Coordinates,
    Formula,
    Input,
    Primvar,
    Texture,
    ViewCosine,
    Wrap,
    to_transform,
    transform2d,
)
from lookdev.material import InputSource as FormulaInput
from lookdev.material.definitions import USD_TYPES
from lookdev.material.expression import ExpressionError, ExpressionKind, parse
from lookdev.material.textures import check_images, is_uncentred_normal_map, resolve_texture
from lookdev.material.usd.network import Network, OutputSource, asset_file, image_path, is_authored, shader_id
from lookdev.space import Color

_TYPES = {kind: Sdf.ValueTypeNames.Find(name) for kind, name in USD_TYPES.items()}
# The channels of a texture that an input can be connected to, by the kind of the input's parameter.
_CHANNELS: dict[str, tuple[Channel, ...]] = {"float": ("r", "g", "b", "a"), "color": ("rgb",), "normal": ("rgb",)}
# The node that can be the source of an input, by the kind of the input's parameter. UsdUVTexture and LookdevExpression
# can be sources of all kinds.
_SOURCE_NODES = {"float": "UsdPrimvarReader_float", "color": "UsdPrimvarReader_float3", "normal": "LookdevBump"}
_MAX_DEPTH = 32  # nested expressions
_IMAGE_HINT = "a path to an image, relative to the file that names it"
_ST_HINT = "connect inputs:st to a UsdPrimvarReader_float2, or to a UsdTransform2d that is connected to one"


def read_input(
    network: Network, attribute: Usd.Attribute, parameter: Parameter, enclosing: tuple[Sdf.Path, ...] = ()
) -> Input | None:
    """Return the value of an input of a layer or an expression; None where it is unset or, with a fault added, wrong.

    `enclosing` has the paths of the nested expressions that read this input, the outermost first.
    """
    expected = Sdf.ValueTypeNames.Asset if parameter.file else _TYPES[parameter.kind]
    if not network.check_type(attribute, attribute, expected):
        return None
    holder = network.follow(attribute)
    if isinstance(holder, OutputSource):
        return _read_varying(network, attribute, parameter, holder, enclosing)
    value: float | str | Gf.Vec3f | None = None if holder is None else network.read_value(attribute, holder, expected)
    if parameter.file and value is not None:
        return _read_file(network, attribute, parameter, value)
    return None if value is None else _check_range(network, attribute, parameter, value)


def _read_file(network: Network, attribute: Usd.Attribute, parameter: Parameter, asset: Sdf.AssetPath) -> str | None:
    """Return the value of a parameter that names a file: the file's path, or one of the parameter's choices."""
    assert parameter.file is not None, "only such a parameter is an asset"
    try:
        file = asset.path if asset.path in parameter.choices else str(asset_file(asset))
        if network.opens_images:
            parameter.file(file)
        return file
    except (ModelError, TextureError) as error:
        network.add_fault(attribute, str(error), "a path to a file, relative to the file that names it")
        return None


def _check_range(
    network: Network, where: object, parameter: Parameter, value: float | str | Gf.Vec3f
) -> float | Color | str | None:
    """Return a constant as a float, a colour or text; None, with a fault added, where it is out of range."""
    if isinstance(value, str):
        if value not in parameter.choices:
            network.add_fault(where, f"unknown value '{value}'", nearest_hint(value, parameter.choices))
            return None
        return value
    low, high = parameter.hard
    # USD rounds constants to float32. A constant that is rounded from an end of the range becomes this end again.
    ends = {np.float32(end): end for end in parameter.hard}
    channels = (value,) if isinstance(value, float) else tuple(value)
    numbers = tuple(ends.get(np.float32(number), number) for number in channels)
    if parameter.kind == "normal" and not any(numbers):
        network.add_fault(where, "a normal cannot be the zero vector", "(0, 0, 1) is the surface's own")
        return None
    if not all(low <= number <= high for number in numbers):
        number_text = ", ".join(f"{number:g}" for number in numbers)
        network.add_fault(where, f"{number_text} is out of range", f"it must be within [{low:g}, {high:g}]")
        return None
    return numbers[0] if isinstance(value, float) else (numbers[0], numbers[1], numbers[2])


def _read_varying(
    network: Network,
    attribute: Usd.Attribute,
    parameter: Parameter,
    source: OutputSource,
    enclosing: tuple[Sdf.Path, ...],
) -> Input | None:
    """Return the value of an input that is connected to the output of a node."""
    kind = parameter.kind
    if kind == "token":
        hint = "name a file" if parameter.file else f"choose one of {', '.join(parameter.choices)}"
        network.add_fault(attribute, f"is computed by <{source.path}>", hint)
        return None
    identifier = shader_id(source.shader)
    if identifier == "UsdUVTexture":
        texture = _read_texture(network, attribute, _CHANNELS[kind], source)
        if texture and kind == "normal":
            _check_normal_map(network, source, texture)
        return texture
    if identifier == _SOURCE_NODES[kind]:
        return _read_bump(network, source) if kind == "normal" else _read_primvar(network, attribute, parameter, source)
    if identifier == "LookdevExpression":
        return _read_formula(network, attribute, kind, source, enclosing)
    message = f"a {kind} cannot come from <{source.path}>, whose info:id is '{identifier}'"
    network.add_fault(attribute, message, f"use UsdUVTexture, {_SOURCE_NODES[kind]} or LookdevExpression")
    return None


def _read_formula(
    network: Network, attribute: Usd.Attribute, kind: str, source: OutputSource, enclosing: tuple[Sdf.Path, ...]
) -> Formula | None:
    """Read an expression node and its sources. A node that several inputs of a kind share is read once.

    `kind` is the kind of the parameter that the expression sets.
    """
    if source.path in enclosing:
        network.add_fault(attribute, f"<{source.path}> reads its own result", "expressions must not run in a cycle")
        return None
    if source.output != "result":
        network.add_fault(attribute, f"cannot use <{source.path}.outputs:{source.output}>", "use outputs:result")
    key = source.path, kind
    formula = network.formulas.get(key)
    if len(enclosing) + network.depths.get(id(formula), 1) > _MAX_DEPTH:
        message = f"more than {_MAX_DEPTH} expressions read one another"
        network.add_fault(attribute, message, "join some of them into one")
        return None
    if key not in network.formulas:
        formula = network.formulas[key] = _read_new_formula(network, kind, source, enclosing)
        inputs = formula.inputs.values() if formula else ()
        network.depths[id(formula)] = 1 + max((network.depths.get(id(operand), 0) for operand in inputs), default=0)
    return formula


def _read_new_formula(
    network: Network, kind: str, source: OutputSource, enclosing: tuple[Sdf.Path, ...]
) -> Formula | None:
    """Read an expression node that has not been read yet; parameters as `_read_formula`."""
    where = f"{source.path}.inputs:expression"
    attribute = source.shader.GetPrim().GetAttribute("inputs:expression")
    text = network.read_constant(attribute, Sdf.ValueTypeNames.String)
    if not isinstance(text, str) or not text:
        if not attribute or text == "":
            network.add_fault(where, "holds no expression", 'for instance "clamp(dirt * 2, 0, 1)"')
        return None
    try:
        expression = parse(text)
    except ExpressionError as error:
        network.add_fault(where, str(error))
        return None
    network.check_inputs(source.shader, ("expression", *expression.names))
    kinds: dict[str, ExpressionKind] = {}
    inputs: dict[str, FormulaInput] = {}
    for name in expression.names:
        read = _read_formula_input(network, source, name, (*enclosing, source.path))
        if read is not None:
            kinds[name], inputs[name] = read
    if len(inputs) < len(expression.names):
        return None
    try:
        result = expression.check(kinds)
        if kind == "float" and result == "color":
            raise ExpressionError(text, 0, "the result is a color", "a float is needed: luminance(...)")
        if kind == "normal" and result == "float":
            raise ExpressionError(text, 0, "the result is a float", "a normal is needed: [x, y, z]")
    except ExpressionError as error:
        network.add_fault(where, str(error))
        return None
    return Formula(expression, inputs, kinds)


def _read_formula_input(
    network: Network, node: OutputSource, name: str, enclosing: tuple[Sdf.Path, ...]
) -> tuple[ExpressionKind, FormulaInput] | None:
    """Return the type and the source of the input `name` of an expression node."""
    attribute = node.shader.GetPrim().GetAttribute(f"inputs:{name}")
    where = f"{node.path}.inputs:{name}"
    if name == VIEW and not (attribute and is_authored(attribute)):
        if attribute and not network.check_type(attribute, attribute, _TYPES["float"]):
            return None
        return "float", ViewCosine()
    if not attribute:
        message = f"the expression reads '{name}', which is not an input of its node"
        network.add_fault(where, message, f"add float inputs:{name}")
        return None
    value_type = attribute.GetTypeName().type
    if value_type == Sdf.ValueTypeNames.Float2.type:
        coordinates = _read_coordinates(network, node.shader, name)
        return ("color", coordinates) if coordinates else None
    kind: ExpressionKind | None = {_TYPES["float"].type: "float", _TYPES["color"].type: "color"}.get(value_type)  # type: ignore[assignment]
    if kind is None:
        hint = "it must be float, color3f or, for coordinates, float2"
        network.add_fault(where, f"has type {attribute.GetTypeName()}", hint)
        return None
    fault_count = len(network.faults)
    value = read_input(network, attribute, Parameter(name, kind, 0.0, (-inf, inf), (-inf, inf)), enclosing)
    if value is None and len(network.faults) == fault_count and not isinstance(network.follow(attribute), OutputSource):
        network.add_unset_fault(where)
    return None if value is None or isinstance(value, str | Bump) else (kind, value)


def _check_normal_map(network: Network, source: OutputSource, texture: Texture) -> None:
    """Add faults of a normal map that is decoded as sRGB, or that is not scaled to -1 to 1."""
    if texture.colorspace == "sRGB":
        message = f"{texture.file} would be decoded as sRGB, but a normal map is data"
        network.add_fault(f"{source.path}.inputs:sourceColorSpace", message, "set it to 'raw'")
    if is_uncentred_normal_map(texture):
        message = "the image holds 0 to 1, so no normal has a negative component"
        hint = "set scale to (2, 2, 2, 1) and bias to (-1, -1, -1, 0)"
        network.add_fault(f"{source.path}.inputs:bias", message, hint)


def _read_bump(network: Network, source: OutputSource) -> Bump | None:
    """Read a LookdevBump node."""
    shader = source.shader
    network.check_inputs(shader, ("height", "scale"))
    attribute, scale = (shader.GetPrim().GetAttribute(f"inputs:{name}") for name in ("height", "scale"))
    factor = network.read_float(scale, 1.0)
    height = _read_height(network, source, attribute)
    return Bump(height, factor) if height else None


def _read_height(network: Network, bump: OutputSource, attribute: Usd.Attribute) -> Texture | None:
    """Return the height map of a LookdevBump node; `attribute` is its input ``height``."""
    if attribute and not network.check_type(attribute, attribute, _TYPES["float"]):
        return None
    source = network.follow(attribute) if attribute else attribute
    if isinstance(source, OutputSource) and shader_id(source.shader) == "UsdUVTexture":
        return _read_texture(network, attribute, _CHANNELS["float"], source)
    if source is not None:
        message = f"comes from <{source.path}>" if isinstance(source, OutputSource) else "is not connected"
        hint = "only a UsdUVTexture has a slope; connect it to outputs:r, g, b or a of one"
        network.add_fault(f"{bump.path}.inputs:height", message, hint)
    return None


def _read_primvar(
    network: Network, attribute: Usd.Attribute, parameter: Parameter, source: OutputSource
) -> Primvar | None:
    """Read a UsdPrimvarReader. The fallback must be within the parameter's range."""
    shader = source.shader
    network.check_node(attribute, source)
    name = _read_varname(network, shader)
    fallback: float | str | Gf.Vec3f | None = network.read_node_value(shader, "fallback", object)
    if fallback is not None:
        fallback = _check_range(network, f"{source.path}.inputs:fallback", parameter, fallback)
    return Primvar(name, fallback) if name and isinstance(fallback, float | tuple) else None


def _read_varname(network: Network, shader: UsdShade.Shader) -> str:
    """Return the name of the primvar that a UsdPrimvarReader reads; "", with a fault added, where it names none."""
    name = network.read_node_value(shader, "varname", str)
    if name == "":
        network.add_fault(f"{shader.GetPath()}.inputs:varname", "names no primvar", "for instance 'st'")
    return name or ""


def _read_texture(
    network: Network, attribute: Usd.Attribute, channels: tuple[Channel, ...], source: OutputSource
) -> Texture | None:
    """Read a UsdUVTexture whose output must be one of `channels`."""
    shader = source.shader
    network.check_node(attribute, source, channels)
    file = _read_image(network, shader)
    uv = _read_coordinates(network, shader, "st")
    colorspace = network.read_node_value(shader, "sourceColorSpace", str)
    wrap_s, wrap_t = (network.read_node_value(shader, name, str) for name in ("wrapS", "wrapT"))
    scale, bias = (network.read_node_value(shader, name, Gf.Vec4f) for name in ("scale", "bias"))
    channel = next((candidate for candidate in channels if candidate == source.output), None)
    if channel is None or file is None or uv is None or colorspace is None or scale is None or bias is None:
        return None
    if wrap_s is None or wrap_t is None:
        return None
    wraps = cast(Wrap, wrap_s), cast(Wrap, wrap_t)  # or "useMetadata"
    texture = Texture(file, channel, colorspace, *wraps, uv.st, uv.transform, tuple(scale), tuple(bias))
    try:
        if not network.opens_images:
            return texture
        check_images(texture)
        return resolve_texture(texture)
    except TextureError as error:
        network.add_fault(f"{shader.GetPath()}.inputs:file", str(error), _IMAGE_HINT)
        return None


def _read_image(network: Network, shader: UsdShade.Shader) -> Path | None:
    """Return the image file of a texture node, without opening it."""
    attribute = shader.GetPrim().GetAttribute("inputs:file")
    asset = network.read_node_value(shader, "file", Sdf.AssetPath)
    if asset is None:
        return None
    try:
        return image_path(network, attribute, asset)
    except TextureError as error:
        network.add_fault(f"{shader.GetPath()}.inputs:file", str(error), _IMAGE_HINT)
    return None


def _read_coordinates(network: Network, shader: UsdShade.Shader, name: str) -> Coordinates | None:
    """Return the texture coordinates of the input `name` of a node: a UV set and a transform.

    The transform is the product of the transforms of all UsdTransform2d nodes between the input and the UV set's
    reader.
    """
    matrix = np.eye(3)
    path, seen = f"{shader.GetPath()}.inputs:{name}", set()
    while True:
        attribute = shader.GetPrim().GetAttributeAtPath(path)
        source = network.follow(attribute) if attribute else None
        if not isinstance(source, OutputSource):
            if not attribute or source is not None:
                network.add_fault(path, "texture coordinates are not connected", _ST_HINT)
            return None
        if source.path in seen:
            network.add_fault(path, "its connections run in a cycle", _ST_HINT)
            return None
        seen.add(source.path)
        identifier = shader_id(source.shader)
        if identifier not in ("UsdPrimvarReader_float2", "UsdTransform2d"):
            network.add_fault(path, f"cannot come from <{source.path}>, whose info:id is '{identifier}'", _ST_HINT)
            return None
        network.check_node(path, source)
        if identifier == "UsdPrimvarReader_float2":
            name = _read_varname(network, source.shader)
            return Coordinates(name, to_transform(matrix)) if name else None
        scale = network.read_node_value(source.shader, "scale", Gf.Vec2f)
        rotation = network.read_node_value(source.shader, "rotation", float)
        translation = network.read_node_value(source.shader, "translation", Gf.Vec2f)
        if scale is None or rotation is None or translation is None:
            return None
        matrix = matrix @ transform2d(scale, rotation, translation)
        path = f"{source.path}.inputs:in"
