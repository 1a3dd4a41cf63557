"""One input of a layer: a constant, or what USD's texture and primvar nodes make of it."""

from __future__ import annotations

from math import cos, radians, sin
from pathlib import Path
from typing import Literal

import numpy as np
from pxr import Ar, Sdf, Usd, UsdShade

from lookdev.brdf import Parameter
from lookdev.errors import TextureError, nearest_hint
from lookdev.material.look import Bump, Color, Input, Primvar, Texture
from lookdev.material.textures import ImageHeader, image_header
from lookdev.material.usd_network import Network, Source, shader_id

Constant = float | Color | str
Channel = Literal["r", "g", "b", "a", "rgb"]

_TYPES = {
    "float": Sdf.ValueTypeNames.Float,
    "color": Sdf.ValueTypeNames.Color3f,
    "normal": Sdf.ValueTypeNames.Normal3f,
    "token": Sdf.ValueTypeNames.Token,
}
_CHANNELS: dict[str, tuple[Channel, ...]] = {"float": ("r", "g", "b", "a"), "color": ("rgb",), "normal": ("rgb",)}
_NODES = {"float": "UsdPrimvarReader_float", "color": "UsdPrimvarReader_float3", "normal": "LookdevBump"}
"""The node that a value of each kind can come from, beside UsdUVTexture."""
_ST_HINT = "connect inputs:st to a UsdPrimvarReader_float2, or to a UsdTransform2d behind which there is one"


def read_input(network: Network, attribute: Usd.Attribute, parameter: Parameter) -> Input | None:
    """Read one input of a layer; None where it is not set or, with a fault noted, where it is wrong."""
    expected = _TYPES[parameter.kind]
    if not network.has_type(attribute, attribute, expected):
        return None
    holder = network.follow(attribute)
    if isinstance(holder, Source):
        return _read_varying(network, attribute, parameter, holder)
    value = None if holder is None else network.value(attribute, holder, expected)
    return None if value is None else _in_range(network, attribute, parameter, value)


def _in_range(network: Network, place: object, parameter: Parameter, value: Constant) -> Constant | None:
    """Return a constant as plain Python if the model has a meaning for it."""
    if isinstance(value, str):
        if value not in parameter.choices:
            network.fault(place, f"unknown value '{value}'", nearest_hint(value, parameter.choices))
            return None
        return value
    low, high = parameter.hard
    numbers = (value,) if isinstance(value, float) else tuple(value)
    if parameter.kind == "normal" and not any(numbers):
        network.fault(place, "a normal cannot be the zero vector", "(0, 0, 1) is the surface's own")
        return None
    if not all(low <= number <= high for number in numbers):
        shown = ", ".join(f"{number:g}" for number in numbers)
        network.fault(place, f"{shown} is out of range", f"it must be within [{low:g}, {high:g}]")
        return None
    return value if isinstance(value, float) else (numbers[0], numbers[1], numbers[2])


def _read_varying(network: Network, place: Usd.Attribute, parameter: Parameter, source: Source) -> Input | None:
    kind = parameter.kind
    if kind == "token":
        network.fault(place, f"is computed by <{source.path}>", f"choose one of {', '.join(parameter.choices)}")
        return None
    given = shader_id(source.shader)
    if given == "UsdUVTexture":
        texture = _read_texture(network, place, _CHANNELS[kind], source)
        if texture and kind == "normal":
            _check_normal_map(network, source, texture)
        return texture
    if given == _NODES[kind]:
        if kind == "normal":
            return _read_bump(network, source)
        return _read_primvar(network, place, parameter, source)
    what = f"a {kind} cannot come from <{source.path}>, whose info:id is '{given}'"
    if given == "LookdevExpression":
        what = f"<{source.path}> is a LookdevExpression, which is not supported in this version"
    network.fault(place, what, f"use UsdUVTexture or {_NODES[kind]}")
    return None


def _check_normal_map(network: Network, source: Source, texture: Texture) -> None:
    if texture.colorspace == "sRGB":
        what = f"{texture.file} would be decoded as sRGB, but a normal map is data"
        network.fault(f"{source.path}.inputs:sourceColorSpace", what, "set it to 'raw'")
    # Flipped or weakened axes are centred too; half a step of 8 bits may go into where the centre is.
    centred = all(abs(texture.bias[axis] + 0.5 * texture.scale[axis]) < 0.01 for axis in (0, 1))
    if image_header(texture.file).unsigned and not centred:
        what = "the image holds 0 to 1, so it cannot lean either way"
        network.fault(f"{source.path}.inputs:bias", what, "set scale to (2, 2, 2, 1) and bias to (-1, -1, -1, 0)")


def _read_bump(network: Network, source: Source) -> Bump | None:
    shader = source.shader
    network.check_inputs(shader, ("height", "scale"))
    attribute, scale = (shader.GetPrim().GetAttribute(f"inputs:{name}") for name in ("height", "scale"))
    factor = network.constant(scale, _TYPES["float"]) if scale else None
    height = _read_height(network, source, attribute)
    return Bump(height, 1.0 if factor is None else factor) if height else None


def _read_height(network: Network, bump: Source, attribute: Usd.Attribute) -> Texture | None:
    if attribute and not network.has_type(attribute, attribute, _TYPES["float"]):
        return None
    source = network.follow(attribute) if attribute else attribute
    if isinstance(source, Source) and shader_id(source.shader) == "UsdUVTexture":
        return _read_texture(network, attribute, _CHANNELS["float"], source)
    if source is not None:
        what = f"comes from <{source.path}>" if isinstance(source, Source) else "is not connected"
        hint = "only a UsdUVTexture has a slope; connect it to outputs:r, g, b or a of one"
        network.fault(f"{bump.path}.inputs:height", what, hint)
    return None


def _read_primvar(network: Network, place: Usd.Attribute, parameter: Parameter, source: Source) -> Primvar | None:
    shader = source.shader
    network.check_node(place, source)
    name = _read_varname(network, shader)
    fallback = network.node_value(shader, "fallback")
    if fallback is not None:
        fallback = _in_range(network, f"{source.path}.inputs:fallback", parameter, fallback)
    return Primvar(name, fallback) if name and fallback is not None else None


def _read_varname(network: Network, shader: UsdShade.Shader) -> str:
    name: str | None = network.node_value(shader, "varname")
    if name == "":
        network.fault(f"{shader.GetPath()}.inputs:varname", "names no primvar", "for instance 'st'")
    return name or ""


def _read_texture(
    network: Network, place: Usd.Attribute, channels: tuple[Channel, ...], source: Source
) -> Texture | None:
    shader = source.shader
    network.check_node(place, source, channels)
    opened = _read_image(network, shader)
    coordinates = _read_coordinates(network, shader)
    colorspace, wrap_s, wrap_t, scale, bias = (
        network.node_value(shader, name) for name in ("sourceColorSpace", "wrapS", "wrapT", "scale", "bias")
    )
    channel = next((each for each in channels if each == source.output), None)
    if channel is None or opened is None or coordinates is None:
        return None
    if None in (colorspace, wrap_s, wrap_t, scale, bias):
        return None
    file, header = opened
    if colorspace == "auto":
        colorspace = "sRGB" if header.is_srgb else "raw"
    wraps = [own if said == "useMetadata" else said for said, own in zip((wrap_s, wrap_t), header.wraps, strict=True)]
    st, transform = coordinates
    return Texture(
        file=file,
        channel=channel,
        colorspace=colorspace,
        wrap_s=wraps[0],
        wrap_t=wraps[1],
        st=st,
        transform=transform,
        scale=tuple(scale),
        bias=tuple(bias),
    )


def _read_image(network: Network, shader: UsdShade.Shader) -> tuple[Path, ImageHeader] | None:
    """Find a texture's image and read its header, so that an unreadable one is a fault of the look."""
    place = f"{shader.GetPath()}.inputs:file"
    asset = network.node_value(shader, "file")
    if asset is None:
        return None
    what = ""
    if not asset.path:
        what = "names no image file"
    elif "<UDIM>" in asset.path:
        what = f"{asset.path} is a UDIM set, which is not supported in this version"
    elif not asset.resolvedPath:
        what = f"no such image file: {asset.path}"
    elif Ar.IsPackageRelativePath(asset.resolvedPath):
        what = f"{asset.path} lies inside a usdz package, which is not supported in this version"
    else:
        file = Path(asset.resolvedPath)
        try:
            return file, image_header(file)
        except TextureError as error:
            what = str(error)
    network.fault(place, what, "a path to one image, relative to the file that names it")
    return None


def _read_coordinates(
    network: Network, shader: UsdShade.Shader
) -> tuple[str, tuple[float, float, float, float, float, float]] | None:
    """Walk from a texture's st to the reader that names the UV set, gathering the transforms between."""
    matrix = np.eye(3)
    place, seen = f"{shader.GetPath()}.inputs:st", set()
    while True:
        attribute = shader.GetPrim().GetAttributeAtPath(place)
        source = network.follow(attribute) if attribute else None
        if not isinstance(source, Source):
            if not attribute or source is not None:
                network.fault(place, "texture coordinates are not connected", _ST_HINT)
            return None
        if source.path in seen:
            network.fault(place, "its connections run in a cycle", _ST_HINT)
            return None
        seen.add(source.path)
        given = shader_id(source.shader)
        if given not in ("UsdPrimvarReader_float2", "UsdTransform2d"):
            network.fault(place, f"cannot come from <{source.path}>, whose info:id is '{given}'", _ST_HINT)
            return None
        network.check_node(place, source)
        if given == "UsdPrimvarReader_float2":
            name = _read_varname(network, source.shader)
            a, b, c, d, e, f = (float(number) for number in matrix[:2].ravel())
            return (name, (a, b, c, d, e, f)) if name else None
        values = [network.node_value(source.shader, name) for name in ("scale", "rotation", "translation")]
        if None in values:
            return None
        matrix = matrix @ _transform2d(*values)
        place = f"{source.path}.inputs:in"


def _transform2d(
    scale: tuple[float, float], rotation: float, translation: tuple[float, float]
) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """Give UsdTransform2d as a matrix: ``in * scale * rotate + translation``, counter-clockwise degrees."""
    c, s = cos(radians(rotation)), sin(radians(rotation))
    return np.array(
        [
            [c * scale[0], -s * scale[1], translation[0]],
            [s * scale[0], c * scale[1], translation[1]],
            [0.0, 0.0, 1.0],
        ]
    )
