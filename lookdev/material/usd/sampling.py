"""Reads nodes in materials of foreign shading models: images, primvars and texture coordinates of USD and MaterialX.

Each reader ``read_...`` maps a `UsdNode` to its value. It raises NotCarriedError where a look cannot have this value.

- UsdPreviewSurface Specification 2.6, Pixar: UsdUVTexture, UsdPrimvarReader, UsdTransform2d.
- MaterialX Specification 1.39: Texture, Geometric and 2D placement nodes.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
from pxr import Sdf

from lookdev.arrays import Floats
from lookdev.errors import Fault, TextureError
from lookdev.material import WRAPS, Coordinates, Primvar, Texture, Transform, Wrap, to_transform, transform2d
from lookdev.material.textures import check_images, resolve_texture
from lookdev.material.usd.network import image_path
from lookdev.material.usd.reader import UsdNode
from lookdev.material.usd.terms import NodeValue, NotCarriedError, constant, convert_channels
from lookdev.stage.colorspaces import colorspace_of

_WrapMode = Wrap | Literal["useMetadata"]

# The wrap modes by the words of USD's UsdUVTexture, of MaterialX's images, and of MaterialX's UsdUVTexture.
_USD_WRAPS: dict[str, _WrapMode] = {"useMetadata": "useMetadata", **WRAPS}
_ADDRESS_MODES: dict[str, _WrapMode] = {"constant": "black", "clamp": "clamp", "periodic": "repeat", "mirror": "mirror"}
_MATERIALX_WRAPS: dict[str, _WrapMode] = _ADDRESS_MODES | {"black": "black", "repeat": "repeat"}
_DEFAULT_UV_HINT = "the UV set st is taken"


def read_uv_texture(node: UsdNode) -> NodeValue:
    """Read a UsdUVTexture, also as a node of MaterialX."""
    file = _read_file(node, "fallback", 4)
    if isinstance(file, NodeValue):
        node.mark_read("st", "wrapS", "wrapT", "scale", "bias", "sourceColorSpace", "isSRGB")
        return _select_output(node, file)
    st, transform = _read_image_coordinates(node, "st")
    if node.identifier.startswith("ND_"):
        space, modes, default = _read_file_colorspace(node) or "raw", _MATERIALX_WRAPS, "periodic"
    else:
        space = node.read_text("sourceColorSpace", _read_file_colorspace(node) or "auto", ("raw", "sRGB", "auto"))
        if node.read_text("isSRGB", "auto") != "auto":  # the name of sourceColorSpace before version 2.1
            node.add_fault("isSRGB", "is not carried", "inputs:sourceColorSpace counts")
        modes, default = _USD_WRAPS, "useMetadata"
    wraps = [modes[node.read_text(name, default, list(modes))] for name in ("wrapS", "wrapT")]
    r, g, b, a = node.read_numbers("scale", 1.0, 1.0, 1.0, 1.0)
    x, y, z, w = node.read_numbers("bias", 0.0, 0.0, 0.0, 0.0)
    texture = Texture(file, "rgb", space, wraps[0], wraps[1], st, transform, (r, g, b, a), (x, y, z, w))
    return _select_output(node, _texel_term(node, texture, 4))


def _select_output(node: UsdNode, rgba: NodeValue) -> NodeValue:
    """Return those channels of a texture's value `rgba` that the connected output of the node has."""
    if node.output in ("r", "g", "b", "a"):
        return node.terms.channel(rgba, "rgba".index(node.output))
    if node.output in ("rgb", "rgba"):
        return convert_channels(rgba, len(node.output))
    raise NotCarriedError(f"has no outputs:{node.output}; r, g, b, a and rgb are there")


def read_image(node: UsdNode) -> NodeValue:
    """Read an image node of MaterialX."""
    return _read_image_node(node, np.eye(3), _read_address_modes(node))


def read_tiled_image(node: UsdNode) -> NodeValue:
    """Read a tiledimage, which MaterialX's library defines by NG_tiledimage."""
    tiling = np.array(node.read_numbers("uvtiling", 1.0, 1.0))
    offset = np.array(node.read_numbers("uvoffset", 0.0, 0.0))
    size, tile = (np.array(node.read_numbers(name, 1.0, 1.0)) for name in ("realworldimagesize", "realworldtilesize"))
    if not np.all(size):
        raise NotCarriedError("has a realworldimagesize of 0")
    scale, shift = tiling * tile / size, -offset * tile / size
    matrix = np.array([[scale[0], 0.0, shift[0]], [0.0, scale[1], shift[1]], [0.0, 0.0, 1.0]])
    return _read_image_node(node, matrix, ["repeat", "repeat"])


def read_gltf_image(node: UsdNode) -> NodeValue:
    """Read a gltf_image, gltf_colorimage or gltf_normalmap, with the transform of glTF's textures."""
    scale = np.array(node.read_numbers("scale", 1.0, 1.0))
    (x, y), (rotation,) = node.read_numbers("offset", 0.0, 0.0), node.read_numbers("rotate", 0.0)
    color = node.identifier.startswith("ND_gltf_colorimage")
    order = node.read_text("operationorder", "1" if color else "0", ("0", "1"))
    pivot = np.array(node.read_numbers("pivot", 0.0, 1.0))
    # As in MaterialX's node graph of gltf_image: a place2d with the inverse scale, -rotation and the offset (-x, y).
    matrix = _placement_matrix(pivot, 1.0 / _check_nonzero(node, scale), -rotation, np.array([-x, y]), order)
    texels = _read_image_node(node, matrix, _read_address_modes(node), 4 if color else 0)
    if color:
        for name in ("color", "geomcolor"):
            factor = node.read_term(name, 4, 1.0, 1.0, 1.0, 1.0)
            texels = node.terms.apply("{a} * {b}", {"a": texels, "b": factor}, ("a", "b"))
        return node.terms.channel(texels, 3) if node.output == "outa" else convert_channels(texels, 3)
    if node.identifier.startswith("ND_gltf_normalmap"):
        return tangent_normal(node, texels, constant(1.0))
    return node.terms.apply("{a} * {b}", {"a": texels, "b": node.read_any_term("factor", 1.0)}, ("a", "b"))


def tangent_normal(node: UsdNode, encoded: NodeValue, scale: NodeValue) -> NodeValue:
    """Return the normal that a normal map encodes: 0 to 1 stand for -1 to 1, as in mx_normalmap of MaterialX.

    `scale` multiplies x and y of the normal.
    """
    centred = node.terms.apply("{a} * 2 - 1", {"a": convert_channels(encoded, 3)}, ("a",))
    if scale.numbers == (1.0,) * len(scale.numbers or ()) and scale.numbers:
        return replace(centred, is_tangent_normal=True)
    pair = convert_channels(scale, 2)
    factors = node.terms.join_channels(node.terms.channel(pair, 0), node.terms.channel(pair, 1), constant(1.0))
    return replace(node.terms.apply("{a} * {b}", {"a": centred, "b": factors}, ("a", "b")), is_tangent_normal=True)


def read_texcoord(node: UsdNode) -> NodeValue:
    """Read a texcoord: its index selects the UV set ``st``, ``st1``, ``st2``, ..."""
    (index,) = node.read_numbers("index", 0.0)
    return _uv_term(node, "st" if index == 0.0 else f"st{index:.0f}")


def read_primvar(node: UsdNode) -> NodeValue:
    """Read a UsdPrimvarReader or a geompropvalue. Two channels are taken as the coordinates of a UV set."""
    name = node.read_word("geomprop" if "geomprop" in node.identifier else "varname")
    if not name:
        raise NotCarriedError("names no primvar")
    if node.width == 2:
        node.mark_read("default", "fallback")  # without effect: a mesh without these UVs is an error
        return _uv_term(node, name)
    width = 3 if node.identifier.endswith(("_normal", "_point", "_vector")) else node.width
    if width == 4 or node.identifier.endswith(("string", "filename", "matrix", "matrix33", "matrix44")):
        raise NotCarriedError("only primvars of one to three numbers are supported")
    default = node.read_term("default" if "geomprop" in node.identifier else "fallback", width, 0.0)
    if default.numbers is None:
        raise NotCarriedError("its fallback is not constant")
    fallback = default.numbers[0] if width == 1 else (default.numbers[0], default.numbers[1], default.numbers[2])
    # Generated code reads a primvar once: as one type, with one fallback. The first node that reads it decides.
    first_fallback = node.reader.fallbacks.setdefault(name, fallback)
    if isinstance(first_fallback, tuple) != isinstance(fallback, tuple):
        raise NotCarriedError(f"the primvar '{name}' is read as a float and as a colour; only the first is carried")
    if first_fallback != fallback:
        network = node.reader.network
        network.add_fault(node.path, f"the primvar '{name}' is read with two fallbacks", "the first is taken")
    return node.terms.leaf_term(Primvar(name, first_fallback), width, name)


def read_transform2d(node: UsdNode) -> NodeValue:
    """Read a UsdTransform2d: scale, then rotate counter-clockwise in degrees, then translate."""
    scale, translation = node.read_numbers("scale", 1.0, 1.0), node.read_numbers("translation", 0.0, 0.0)
    (rotation,) = node.read_numbers("rotation", 0.0)
    return _transform_coordinates(node, "in", transform2d(scale, rotation, translation))


def read_place2d(node: UsdNode) -> NodeValue:
    """Read a place2d, which MaterialX's library defines by NG_place2d_vector2. It rotates clockwise."""
    defaults = {"pivot": 0.0, "scale": 1.0, "offset": 0.0}
    pivot, scale, offset = (np.array(node.read_numbers(name, number, number)) for name, number in defaults.items())
    order = node.read_text("operationorder", "0", ("0", "1"))
    scale = _check_nonzero(node, scale)
    matrix = _placement_matrix(pivot, scale, node.read_numbers("rotate", 0.0)[0], offset, order)
    return _transform_coordinates(node, "texcoord", matrix)


def read_rotate2d(node: UsdNode) -> NodeValue:
    """Read a rotate2d, which rotates texture coordinates clockwise, in degrees."""
    (amount,) = node.read_numbers("amount", 0.0)
    return _transform_coordinates(node, "in", transform2d((1.0, 1.0), -amount, (0.0, 0.0)))


def read_coordinates(node: UsdNode, name: str) -> NodeValue:
    """Return the value of an input that takes texture coordinates; if it is unset, the coordinates of the UV set st."""
    return node.reader.read_term(node.attribute(name), 2) or _uv_term(node, "st")


def _uv_term(node: UsdNode, name: str) -> NodeValue:
    """Return the coordinates of a UV set."""
    return node.terms.leaf_term(Coordinates(name), 2, name)


def _check_nonzero(node: UsdNode, scale: Floats) -> Floats:
    """Return `scale`, (2,); raises NotCarriedError where a component is 0."""
    if not np.all(np.abs(scale) > 1e-18):
        raise NotCarriedError("has a scale of 0, which divides the texture coordinates")
    return scale


def _placement_matrix(pivot: Floats, scale: Floats, degrees: float, offset: Floats, order: str) -> Floats:
    """Return the matrix (3, 3) of a place2d with these inputs, applied to column vectors (s, t, 1).

    `order` is its operationorder: ``"0"`` scales, then rotates, then translates; ``"1"`` does so in the reverse order.
    """

    def shift(translation: Floats) -> Floats:
        return np.array([[1.0, 0.0, translation[0]], [0.0, 1.0, translation[1]], [0.0, 0.0, 1.0]])

    rotation, scaling = transform2d((1.0, 1.0), -degrees, (0.0, 0.0)), np.diag([1.0 / scale[0], 1.0 / scale[1], 1.0])
    if order == "1":
        return np.asarray(shift(pivot) @ scaling @ rotation @ shift(-pivot - offset))
    return np.asarray(shift(pivot - offset) @ rotation @ scaling @ shift(-pivot))


def _transform_coordinates(node: UsdNode, name: str, matrix: Floats) -> NodeValue:
    """Return the texture coordinates of the input `name`, transformed by a matrix (3, 3).

    If the coordinates are a UV set, the result is this set with another transform. Otherwise, it is an expression.
    """
    term = node.reader.read_term(node.attribute(name), 2)
    if term is None:
        node.add_fault(name, "texture coordinates are not connected", _DEFAULT_UV_HINT)
        term = _uv_term(node, "st")
    if isinstance(term.leaf, Coordinates):
        product = _to_square_matrix(term.leaf.transform)
        leaf = Coordinates(term.leaf.st, to_transform(matrix @ product))
        return node.terms.leaf_term(leaf, 2, term.leaf.st)
    st = {name: node.terms.channel(term, index) for index, name in enumerate("xy")}
    rows = [st | dict(zip("abc", map(constant, row), strict=True)) for row in matrix[:2].tolist()]
    return node.terms.join_channels(*(node.terms.apply("{x} * {a} + {y} * {b} + {c}", row) for row in rows))


def _to_square_matrix(transform: Transform) -> Floats:
    """Return a transform as a matrix (3, 3)."""
    return np.vstack([np.reshape(transform, (2, 3)), [0.0, 0.0, 1.0]])


def _read_image_coordinates(node: UsdNode, name: str) -> tuple[str, Transform]:
    """Return the UV set and the transform of the texture coordinates that an image node takes as its input `name`.

    Constant coordinates are a transform whose linear part is 0. If the coordinates are neither constant nor a
    transformed UV set, the network gets a fault, and the UV set st is taken.
    """
    try:
        term = read_coordinates(node, name)
        if node.attribute(name) is None and not node.identifier.startswith("ND_"):
            # The default of UsdUVTexture is the constant (0, 0). The default of MaterialX's nodes is a UV set.
            node.add_fault(name, "texture coordinates are not connected", "the texture's value at (0, 0) is everywhere")
            term = constant(0.0, 0.0)
    except NotCarriedError as error:
        node.add_fault(name, error.fault, _DEFAULT_UV_HINT)
        term = _uv_term(node, "st")
    if term.numbers is not None:
        s, t = term.numbers
        return "st", (0.0, 0.0, s, 0.0, 0.0, t)
    if not isinstance(term.leaf, Coordinates):
        node.add_fault(name, "is computed", _DEFAULT_UV_HINT)
        return "st", Coordinates("st").transform
    return term.leaf.st, term.leaf.transform


def _read_address_modes(node: UsdNode) -> list[_WrapMode]:
    """Return the wrap modes along s and t of an image node of MaterialX."""
    modes = [node.read_text(f"{axis}addressmode", "periodic", list(_ADDRESS_MODES)) for axis in "uv"]
    return [_ADDRESS_MODES[mode] for mode in modes]


def _read_image_node(node: UsdNode, matrix: Floats, wraps: list[_WrapMode], width: int = 0) -> NodeValue:
    """Return the value of an image node of MaterialX: its image or, where it has no file, its default.

    `matrix` (3, 3) transforms the texture coordinates. `width` is the number of channels; 0 stands for the node's own.
    """
    width = width or node.width
    file = _read_file(node, "default", width)
    if node.read_text("filtertype", "linear") != "linear":
        node.add_fault("filtertype", "is not carried", "images are looked up linearly")
    if isinstance(file, NodeValue):
        node.mark_read("texcoord")
        return file
    st, transform = _read_image_coordinates(node, "texcoord")
    # MaterialX converts colour spaces only of images that a node reads as colours.
    space = _read_file_colorspace(node) if "color" in node.identifier else ""
    placed = to_transform(matrix @ _to_square_matrix(transform))
    texture = Texture(file, "rgb", space or "raw", wraps[0], wraps[1], st, placed)
    return _texel_term(node, texture, width)


def _texel_term(node: UsdNode, texture: Texture, width: int) -> NodeValue:
    """Return the first `width` channels of a texture."""
    if node.reader.network.opens_images:
        texture = resolve_texture(texture)
    if width == 1:
        return node.terms.leaf_term(replace(texture, channel="r"), 1, node.name)
    rgb = node.terms.leaf_term(texture, min(width, 3), node.name)
    if width < 4:
        return rgb
    return replace(rgb, alpha=node.terms.leaf_term(replace(texture, channel="a"), 1, f"{node.name}_a"))


def _read_file_colorspace(node: UsdNode) -> str:
    """Return the colour space that the USD file states for the image of a node; "" where it states none."""
    attribute = node.attribute("file")
    holder = node.reader.network.follow(attribute) if attribute else None
    name = colorspace_of(holder) if holder is not None and hasattr(holder, "GetColorSpace") else ""
    return node.reader.colorspace(attribute, name) if name and attribute else ""


def _read_file(node: UsdNode, fallback: str, width: int) -> Path | NodeValue:
    """Return the image file of a node, or the value of its input `fallback` where there is no file that can be read.

    Raises NotCarriedError where there is no such value either; the image is then one of `Reader.missing`.
    """
    node.mark_read(fallback, "note")
    attribute = node.attribute("file")
    asset = node.reader.read_constant(attribute) if attribute else None
    if attribute is None or (isinstance(asset, Sdf.AssetPath) and not asset.path):
        node.add_fault("file", "names no image file", f"inputs:{fallback} is taken")
        return node.read_term(fallback, width, 0.0)
    if not isinstance(asset, Sdf.AssetPath):
        raise NotCarriedError("inputs:file is not an asset")
    network = node.reader.network
    try:
        file = image_path(network, attribute, asset)
        if network.opens_images:
            check_images(Texture(file, "rgb", "auto"))
        return file
    except TextureError as error:
        if node.attribute(fallback):
            node.add_fault("file", str(error), f"inputs:{fallback} is taken")
            return node.read_term(fallback, width)
        where = f"{node.path}.inputs:file"
        node.reader.missing.append(Fault(str(network.file), where, str(error), "a path to an image, or a fallback"))
        raise NotCarriedError from error
