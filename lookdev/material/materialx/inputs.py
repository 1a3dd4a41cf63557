"""Reads the inputs of a shader in a MaterialX document that is imported: constants, and nodes for images and primvars.

Between the shader and an image, nodes may select a channel of the image or place its texture coordinates. Where a value
cannot be carried over, the functions return None or a default, and the network gets a *loss*. A *fault* is an error of
the document itself.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Literal

import MaterialX as mx

from lookdev.arrays import MAX_MAGNITUDE
from lookdev.brdf import Parameter
from lookdev.material import Channel, Primvar, Wrap
from lookdev.material.materialx.network import DocumentNetwork, PortSource
from lookdev.mtlx.document import INVALID_IMAGE_PATH
from lookdev.space import Color
from lookdev.stage.colorspaces import srgb_to_linear

Colorspace = Literal["sRGB", "raw"]
"""The colour space of an image, as in UsdUVTexture."""

Pair = tuple[float, float]

MATERIALX_TYPES = {"float": "float", "color": "color3"}
"""The type in MaterialX of a parameter, by its `Parameter.kind`."""

_VALUE_INPUTS = {"constant": "value"}
"""The input whose value a node passes on unchanged, by the node's category."""

# Wrap modes by MaterialX's words.
_WRAPS: dict[str, Wrap] = {"constant": "black", "clamp": "clamp", "periodic": "repeat", "mirror": "mirror"}
# The categories of nodes that select a channel, and the types from which they can select one.
_SPLITTERS = ("extract", "swizzle", "separate3", "separate4")
_SPLIT_TYPES = ("color3", "color4", "vector3", "vector4")
_RGBA: tuple[Channel, ...] = ("r", "g", "b", "a")
# The channels of an image by MaterialX's names: indices, letters of colours and letters of vectors.
_CHANNELS = {name: channel for names in ("0123", "rgba", "xyzw") for name, channel in zip(names, _RGBA, strict=True)}

_INDEX = re.compile(r"0|[1-9][0-9]?")  # the index of a UV set


@dataclass(frozen=True)
class Transform2d:
    """A UsdTransform2d: scales, then rotates counter-clockwise by `rotation` degrees, then translates."""

    scale: Pair = (1.0, 1.0)
    rotation: float = 0.0
    translation: Pair = (0.0, 0.0)


@dataclass(frozen=True)
class ImageNode:
    """An image with its texture coordinates.

    `name` is the name of the node. `file` is a path relative to the document. `st` is the name of the UV set.
    `transforms` apply to its coordinates one after another, the first one first.
    """

    name: str
    file: str
    colorspace: Colorspace
    wrap_s: Wrap
    wrap_t: Wrap
    st: str
    transforms: tuple[Transform2d, ...]


@dataclass(frozen=True)
class ImageChannel:
    """The value of an input that is a channel of an image, or its colour (``"rgb"``)."""

    image: ImageNode
    channel: Channel


DocumentValue = float | Color | ImageChannel | Primvar
"""The value of an input of a layer."""


def _parse_numbers(text: str) -> tuple[float, ...]:
    """Parse numbers separated by commas; () where the text has other contents, or a number is above `MAX_MAGNITUDE`."""
    try:
        numbers = tuple(float(part) for part in text.split(","))
    except ValueError:
        return ()
    return numbers if all(abs(number) <= MAX_MAGNITUDE for number in numbers) else ()


def parse_constant(text: str) -> float | Color | None:
    """Parse the text of a float or a colour; None for any other text."""
    return _as_constant(_parse_numbers(text))


def _as_constant(numbers: tuple[float, ...]) -> float | Color | None:
    """Return three numbers as a colour, one as a float, and none as None."""
    if len(numbers) == 3:
        return numbers[0], numbers[1], numbers[2]
    return numbers[0] if numbers else None


def read_value(network: DocumentNetwork, port: mx.Input, parameter: Parameter) -> DocumentValue | None:
    """Return the value of an input for a parameter; None where it is wrong or cannot be carried over."""
    source, kind = network.source_of(port), MATERIALX_TYPES[parameter.kind]
    # Follow nodes that pass a value on.
    while source.is_computed and not source.channels and source.element.getType() == kind:
        node = source.element
        if node.getCategory() == "geompropvalue":
            return _read_primvar(network, node, parameter)
        name = _VALUE_INPUTS.get(node.getCategory(), "")
        if (value_port := node.getInput(name)) is None:
            break
        network.mark_carried(node, name)
        source = network.source_of(value_port)
    if not source.is_computed:
        return _read_constant(network, source.element, parameter)
    return _read_rgb(network, source) if kind == "color3" else _read_channel(network, port)


def _read_constant(network: DocumentNetwork, holder: mx.PortElement, parameter: Parameter) -> float | Color | None:
    """Return the constant of a port, as linear Rec.709 for a colour, clipped to the parameter's range.

    None, with a fault added, where it has a wrong number of channels.
    """
    numbers = _read_floats(network, holder, 1 if parameter.kind == "float" else 3)
    if parameter.kind == "color" and numbers and _read_colorspace(network, holder) == "sRGB":
        numbers = tuple(float(number) for number in srgb_to_linear(numbers))
    low, high = parameter.hard
    clipped = tuple(min(max(number, low), high) for number in numbers)
    if clipped != numbers:
        clipped_text = ", ".join(f"{number:g}" for number in clipped)
        message = f"{holder.getValueString()} is outside [{low:g}, {high:g}]"
        network.add_loss(holder, message, f"{clipped_text} is taken")
    return _as_constant(clipped)


def _read_primvar(network: DocumentNetwork, node: mx.Node, parameter: Parameter) -> Primvar | None:
    """Read a geompropvalue node; None where it names no primvar or its default is wrong."""
    name, default = _read_text(network, node, "geomprop", ""), node.getInput("default")
    if not name:
        return None
    network.mark_carried(node, "geomprop", "default")
    fallback: float | Color | None = 0.0 if parameter.kind == "float" else (0.0, 0.0, 0.0)
    if default and _check_constant(network, default, "0 is taken"):
        fallback = _read_constant(network, network.source_of(default).element, parameter)
    return None if fallback is None else Primvar(name, fallback)


def _read_rgb(network: DocumentNetwork, source: PortSource) -> ImageChannel | None:
    """Return the colour of an image; None where the source is not an image of colours."""
    if source.channels or source.element.getType() != "color3":
        return None
    image = _read_image(network, source.element)
    return ImageChannel(image, "rgb") if image else None


def _read_channel(network: DocumentNetwork, port: mx.Input) -> ImageChannel | None:
    """Return the value of a float input from an image of floats, or from one channel of another image.

    The channel is selected by the connection's attribute ``channels``, or by a node before the image. The result is
    None for other sources.
    """
    source = network.source_of(port)
    node, names, splitter = source.element, source.channels, None
    if not names and node.getCategory() in _SPLITTERS and (split_port := node.getInput("in")):
        splitter, outer = node, source
        source = network.source_of(split_port)
        if not source.is_computed or source.channels:
            return None
        node, names = source.element, _split_channel(network, splitter, outer.output)
    is_split = bool(splitter or names)
    types = _SPLIT_TYPES if is_split else ("float",)
    channel = _CHANNELS.get(names if is_split else "r")
    image = _read_image(network, node) if channel and node.getType() in types else None
    if channel is None or image is None:
        return None
    if splitter:
        network.mark_carried(splitter, "in", "index", "channels")
    return ImageChannel(image, channel)


def _split_channel(network: DocumentNetwork, splitter: mx.Node, output: str) -> str:
    """Return MaterialX's name of the channel that a node selects at its output `output`."""
    if splitter.getCategory() == "extract":
        return _read_text(network, splitter, "index", "0")
    if splitter.getCategory() == "swizzle":
        return _read_text(network, splitter, "channels", "")
    return output.removeprefix("out")


def _read_image(network: DocumentNetwork, node: mx.Node) -> ImageNode | None:
    """Read an image or tiledimage node; None for other nodes, and where the file cannot be carried over."""
    tiled = node.getCategory() == "tiledimage"
    port = node.getInput("file") if tiled or node.getCategory() == "image" else None
    if port is None or not _check_constant(network, port, "the image is not taken"):
        return None
    holder = network.source_of(port).element
    # Documents come from all operating systems: slashes and backslashes both separate folders.
    file = mx.FilePath(holder.getActiveFilePrefix() + holder.getValueString()).asString(mx.FormatPosix)
    if not holder.getValueString() or INVALID_IMAGE_PATH.search(file):
        network.add_loss(port, f"'{file}' is not carried over", "the path of one image or of a <UDIM> set is")
        return None
    placement_inputs = ("uvtiling", "uvoffset") if tiled else ("uaddressmode", "vaddressmode")
    network.mark_carried(node, "file", "texcoord", "filtertype", *placement_inputs)
    if (filtering := _read_text(network, node, "filtertype", "linear")) != "linear":
        message = f"'{filtering}' is not carried over"
        network.add_loss(node.getInput("filtertype"), message, "images are looked up linearly")
    st, transforms = _read_coordinates(network, node)
    wraps: list[Wrap] = ["repeat", "repeat"]
    if tiled:
        tiling, (x, y) = _read_pair(network, node, "uvtiling", 1.0), _read_pair(network, node, "uvoffset", 0.0)
        transforms = (*transforms, Transform2d(tiling, 0.0, (0.0 - x, 0.0 - y)))
    else:
        wraps = [_read_wrap(network, node, name) for name in placement_inputs]
    # MaterialX converts colour spaces only of images that a node reads as colours.
    colorspace = _read_colorspace(network, holder) if node.getType().startswith("color") else "raw"
    placed = tuple(transform for transform in transforms if transform != Transform2d())
    return ImageNode(node.getName(), file, colorspace, wraps[0], wraps[1], st, placed)


def _read_coordinates(network: DocumentNetwork, image: mx.Node) -> tuple[str, tuple[Transform2d, ...]]:
    """Return the UV set of an image, and the transforms that apply to its coordinates, the first one first.

    The transforms come from the place2d nodes between the image and the node of the UV set.
    """
    transforms: tuple[Transform2d, ...] = ()
    node = image
    while port := node.getInput("texcoord"):
        source = network.source_of(port)
        category = source.element.getCategory() if source.is_computed and not source.channels else ""
        if category == "place2d":
            node = source.element
            network.mark_carried(node, "texcoord", "pivot", "scale", "rotate", "offset", "operationorder")
            transforms = (*_read_place2d(network, node), *transforms)
            continue
        st = ""
        if category == "texcoord":
            index = _read_text(network, source.element, "index", "0")
            st = ("st" if index == "0" else f"st{index}") if _INDEX.fullmatch(index) else ""
        elif category == "geompropvalue":
            st = _read_text(network, source.element, "geomprop", "")
        if st:
            network.mark_carried(source.element, "index" if category == "texcoord" else "geomprop")
            return st, transforms
        network.add_value_loss(port, "the UV set st is taken")
        return "st", transforms
    if node is not image:
        network.add_loss(node, "places one point, as it has no texcoord", "the UV set st is taken")
    return "st", transforms


def _read_place2d(network: DocumentNetwork, node: mx.Node) -> tuple[Transform2d, ...]:
    """Return a place2d as transforms. It rotates clockwise, as NG_place2d_vector2 of MaterialX's library defines."""
    pivot, offset = (_read_pair(network, node, name, 0.0) for name in ("pivot", "offset"))
    scale = _read_pair(network, node, "scale", 1.0)
    rotate = node.getInput("rotate")
    is_constant = rotate and _check_constant(network, rotate, "0 is taken")
    angle = sum(_read_floats(network, network.source_of(rotate).element, 1)) if is_constant else 0.0
    degrees = 0.0 - (math.degrees(angle) if is_constant and rotate.getUnit() == "radian" else angle)
    if min(map(abs, scale)) < 1.0 / MAX_MAGNITUDE:
        network.add_fault(node.getNamePath(), "has a scale of 0", "it divides the texture coordinates")
        return ()
    inverse = (1.0 / scale[0], 1.0 / scale[1])
    order = _read_text(network, node, "operationorder", "0")
    if order not in ("0", "1"):
        network.add_fault(f"{node.getNamePath()}/operationorder", f"unknown value '{order:.40}'", "0 or 1")
    # Order 1 translates, rotates, then scales, which takes two transforms. Order 0 scales, rotates, then translates.
    # The pivot is subtracted first and added last. (x, y) is the subtracted point, scaled (order 0 only) and rotated.
    if order == "1":
        x, y = _rotate((pivot[0] + offset[0], pivot[1] + offset[1]), degrees)
        return Transform2d((1.0, 1.0), degrees, (0.0 - x, 0.0 - y)), Transform2d(inverse, 0.0, pivot)
    x, y = _rotate((pivot[0] * inverse[0], pivot[1] * inverse[1]), degrees)
    return (Transform2d(inverse, degrees, (pivot[0] - offset[0] - x, pivot[1] - offset[1] - y)),)


def _rotate(point: Pair, degrees: float) -> Pair:
    """Rotate a point counter-clockwise about the origin."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return c * point[0] - s * point[1], s * point[0] + c * point[1]


def _check_constant(network: DocumentNetwork, port: mx.Input, hint: str) -> bool:
    """Return whether an input of a node is a constant; otherwise add a loss, with `hint`."""
    if network.source_of(port).is_computed:
        network.add_value_loss(port, hint)
        return False
    return True


def _read_text(network: DocumentNetwork, node: mx.Node, name: str, default: str) -> str:
    """Return the text of a constant input, or `default` where it is unset or computed."""
    port = node.getInput(name)
    if not port or not _check_constant(network, port, f"'{default}' is taken" if default else ""):
        return default
    return str(network.source_of(port).element.getValueString()) or default


def _read_pair(network: DocumentNetwork, node: mx.Node, name: str, default: float) -> Pair:
    """Return the two numbers of a constant input, or twice `default` where it is unset, computed or wrong."""
    port = node.getInput(name)
    if not port or not _check_constant(network, port, f"{default:g} is taken"):
        return default, default
    numbers = _read_floats(network, network.source_of(port).element, 2)
    return (numbers[0], numbers[1]) if numbers else (default, default)


def _read_floats(network: DocumentNetwork, holder: mx.PortElement, count: int) -> tuple[float, ...]:
    """Parse the text of a port as `count` numbers; (), with a fault added, for any other text."""
    numbers = _parse_numbers(holder.getValueString())
    if len(numbers) == count:
        return numbers
    # The message quotes only the beginning, because a value may be a megabyte long.
    message = f"'{holder.getValueString():.40}' is not a value"
    hint = f"{count} finite numbers, separated by commas, within {MAX_MAGNITUDE:g}"
    network.add_fault(holder.getNamePath(), message, hint)
    return ()


def _read_wrap(network: DocumentNetwork, node: mx.Node, name: str) -> Wrap:
    """Return the wrap mode of an input of an image node; an unknown mode is a fault."""
    mode = _read_text(network, node, name, "periodic")
    if mode not in _WRAPS:
        where = f"{node.getNamePath()}/{name}"
        network.add_fault(where, f"unknown value '{mode:.40}'", f"one of {', '.join(_WRAPS)}")
    return _WRAPS.get(mode, "repeat")


def _read_colorspace(network: DocumentNetwork, holder: mx.PortElement) -> Colorspace:
    """Return the colour space of a value; add a loss for a space that is neither sRGB nor linear Rec.709."""
    name = holder.getActiveColorSpace()
    raw = name in ("raw", "none", "") or name.startswith(("lin_", "acescg"))
    if name not in ("srgb_texture", "lin_rec709", "raw", "none", ""):
        message = f"the colour space '{name:.40}' is not carried over"
        network.add_loss(holder, message, f"{'linear Rec.709' if raw else 'sRGB'} is taken")
    return "raw" if raw else "sRGB"
