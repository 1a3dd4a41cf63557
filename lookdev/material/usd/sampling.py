"""Nodes that read images, primvars and texture coordinates: USD's own, and those of MaterialX.

- UsdPreviewSurface Specification 2.6, Pixar: UsdUVTexture, UsdPrimvarReader, UsdTransform2d.
- MaterialX Specification 1.39: Texture, Geometric and 2D placement nodes.
"""

from __future__ import annotations

from dataclasses import replace
from math import cos, radians, sin
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf

from lookdev.errors import Fault, TextureError
from lookdev.material.look import Channel, Coordinates, Primvar, Texture, Transform, Wrap
from lookdev.material.textures import image_header, resolved, udim_tiles
from lookdev.material.usd.images import image_path
from lookdev.material.usd.reader import Node
from lookdev.material.usd.terms import Term, Unread, constant, passed
from lookdev.stage.colorspaces import colorspace_of

_Wrap = Wrap | Literal["useMetadata"]

_USD_WRAPS: dict[str, _Wrap] = {
    "black": "black",
    "clamp": "clamp",
    "repeat": "repeat",
    "mirror": "mirror",
    "useMetadata": "useMetadata",
}
_ADDRESS_MODES: dict[str, _Wrap] = {"constant": "black", "clamp": "clamp", "periodic": "repeat", "mirror": "mirror"}
_MATERIALX_WRAPS: dict[str, _Wrap] = _ADDRESS_MODES | {"black": "black", "repeat": "repeat"}
_CHANNELS: dict[str, Channel] = {"r": "r", "g": "g", "b": "b", "a": "a"}
_PLACED = "the UV set st is taken"


def uv_texture(node: Node) -> Term:
    """UsdUVTexture, also as a node of MaterialX."""
    file = _image(node, "fallback", 4)
    if isinstance(file, Term):
        node.ignore("st", "wrapS", "wrapT", "scale", "bias", "sourceColorSpace", "isSRGB")
        return _output(node, file)
    st, transform = _coordinates(node, "st")
    if node.identifier.startswith("ND_"):
        space, modes, default = _file_space(node) or "raw", _MATERIALX_WRAPS, "periodic"
    else:
        space = node.text("sourceColorSpace", _file_space(node) or "auto", ("raw", "sRGB", "auto"))
        if node.text("isSRGB", "auto") != "auto":  # its name before version 2.1
            node.note("isSRGB", "is not carried", "inputs:sourceColorSpace counts")
        modes, default = _USD_WRAPS, "useMetadata"
    wraps = [modes[node.text(name, default, list(modes))] for name in ("wrapS", "wrapT")]
    r, g, b, a = node.numbers("scale", 1.0, 1.0, 1.0, 1.0)
    x, y, z, w = node.numbers("bias", 0.0, 0.0, 0.0, 0.0)
    texture = Texture(file, "rgb", space, wraps[0], wraps[1], st, transform, (r, g, b, a), (x, y, z, w))
    return _output(node, _texels(node, texture, 4))


def _output(node: Node, rgba: Term) -> Term:
    """Return the output of a texture that the source asks for."""
    if node.output in _CHANNELS:
        return node.terms.channel(rgba, "rgba".index(node.output))
    if node.output in ("rgb", "rgba"):
        return passed(rgba, len(node.output))
    raise Unread(f"has no outputs:{node.output}; r, g, b, a and rgb are there")


def image(node: Node) -> Term:
    """An image by MaterialX."""
    return _looked_up(node, np.eye(3), [_address(node, name) for name in ("uaddressmode", "vaddressmode")])


def tiled_image(node: Node) -> Term:
    """tiledimage: NG_tiledimage of the MaterialX library."""
    tiling, offset = np.array(node.numbers("uvtiling", 1.0, 1.0)), np.array(node.numbers("uvoffset", 0.0, 0.0))
    size, tile = (np.array(node.numbers(name, 1.0, 1.0)) for name in ("realworldimagesize", "realworldtilesize"))
    if not np.all(size):
        raise Unread("has a realworldimagesize of 0")
    scale, shift = tiling * tile / size, -offset * tile / size
    matrix = np.array([[scale[0], 0.0, shift[0]], [0.0, scale[1], shift[1]], [0.0, 0.0, 1.0]])
    return _looked_up(node, matrix, ["repeat", "repeat"])


def gltf_image(node: Node) -> Term:
    """gltf_image, gltf_colorimage and gltf_normalmap: the image placed by the transform of glTF's textures."""
    scale = np.array(node.numbers("scale", 1.0, 1.0))
    (x, y), (turn,) = node.numbers("offset", 0.0, 0.0), node.numbers("rotate", 0.0)
    color = node.identifier.startswith("ND_gltf_colorimage")
    order = node.text("operationorder", "1" if color else "0", ("0", "1"))
    pivot = np.array(node.numbers("pivot", 0.0, 1.0))
    matrix = _placement(pivot, 1.0 / _nonzero(node, scale), -turn, np.array([-x, y]), order)
    wraps = [_address(node, name) for name in ("uaddressmode", "vaddressmode")]
    texels = _looked_up(node, matrix, wraps, 4 if color else 0)
    if color:
        for name in ("color", "geomcolor"):
            factor = node.term(name, 4, 1.0, 1.0, 1.0, 1.0)
            texels = node.terms.apply("{a} * {b}", {"a": texels, "b": factor}, ("a", "b"))
        return node.terms.channel(texels, 3) if node.output == "outa" else passed(texels, 3)
    if node.identifier.startswith("ND_gltf_normalmap"):
        return tangent_normal(node, texels, constant(1.0))
    return node.terms.apply("{a} * {b}", {"a": texels, "b": node.any_term("factor", 1.0)}, ("a", "b"))


def tangent_normal(node: Node, encoded: Term, scale: Term) -> Term:
    """Return the normal of a normal map, which holds -1 to 1 as 0 to 1: mx_normalmap of the MaterialX library."""
    centred = node.terms.apply("{a} * 2 - 1", {"a": passed(encoded, 3)}, ("a",))
    if scale.numbers == (1.0,) * len(scale.numbers or ()) and scale.numbers:
        return replace(centred, tangent=True)
    pair = passed(scale, 2)
    wide = node.terms.joined(node.terms.channel(pair, 0), node.terms.channel(pair, 1), constant(1.0))
    return replace(node.terms.apply("{a} * {b}", {"a": centred, "b": wide}, ("a", "b")), tangent=True)


def texcoord(node: Node) -> Term:
    """texcoord: UV set st, st1, ..."""
    (index,) = node.numbers("index", 0.0)
    return _uv(node, "st" if index == 0.0 else f"st{index:.0f}")


def primvar(node: Node) -> Term:
    """UsdPrimvarReader, geompropvalue."""
    name = node.word("geomprop" if "geomprop" in node.identifier else "varname")
    if not name:
        raise Unread("names no primvar")
    if node.width == 2:
        node.ignore("default", "fallback")  # a mesh has UVs, or is refused
        return _uv(node, name)
    width = 3 if node.identifier.endswith(("_normal", "_point", "_vector")) else node.width
    if width == 4 or node.identifier.endswith(("string", "filename", "matrix", "matrix33", "matrix44")):
        raise Unread("only primvars of one to three numbers are supported")
    default = node.term("default" if "geomprop" in node.identifier else "fallback", width, 0.0)
    if default.numbers is None:
        raise Unread("its fallback is not constant")
    fallback = default.numbers[0] if width == 1 else (default.numbers[0], default.numbers[1], default.numbers[2])
    # Generated code reads each primvar as one type, with one fallback.
    known = node.reader.fallbacks.setdefault(name, fallback)
    if isinstance(known, tuple) != isinstance(fallback, tuple):
        raise Unread(f"the primvar '{name}' is read as a float and as a colour; only the first is carried")
    if known != fallback:
        network = node.reader.network
        network.fault(node.path, f"the primvar '{name}' is read with two fallbacks", "the first is taken")
    return node.terms.leaf(Primvar(name, known), width, name)


def transform2d(node: Node) -> Term:
    """UsdTransform2d: ``in * scale * rotate + translation``, counter-clockwise degrees."""
    (x, y), (dx, dy) = node.numbers("scale", 1.0, 1.0), node.numbers("translation", 0.0, 0.0)
    c, s = _turn(node.numbers("rotation", 0.0)[0])
    return _transformed(node, "in", np.array([[c * x, -s * y, dx], [s * x, c * y, dy], [0.0, 0.0, 1.0]]))


def place2d(node: Node) -> Term:
    """place2d: NG_place2d_vector2 of the MaterialX library, whose rotation is clockwise."""
    pivot, scale, offset = (
        np.array(node.numbers(name, default, default))
        for name, default in (("pivot", 0.0), ("scale", 1.0), ("offset", 0.0))
    )
    order = node.text("operationorder", "0", ("0", "1"))
    return _transformed(
        node, "texcoord", _placement(pivot, _nonzero(node, scale), node.numbers("rotate", 0.0)[0], offset, order)
    )


def rotate2d(node: Node) -> Term:
    """rotate2d: clockwise degrees."""
    c, s = _turn(-node.numbers("amount", 0.0)[0])
    return _transformed(node, "in", np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]))


def coordinates(node: Node, name: str) -> Term:
    """Return an input of texture coordinates, UV set st where it is not set."""
    attribute = node.attribute(name)
    return (node.reader.term(attribute, 2) if attribute else None) or _uv(node, "st")


def _uv(node: Node, name: str) -> Term:
    return node.terms.leaf(Coordinates(name), 2, name)


def _turn(degrees: float) -> tuple[float, float]:
    return cos(radians(degrees)), sin(radians(degrees))


def _nonzero(node: Node, scale: NDArray[np.float64]) -> NDArray[np.float64]:
    if not np.all(np.abs(scale) > 1e-18):
        raise Unread("has a scale of 0, which divides the texture coordinates")
    return scale


def _placement(
    pivot: NDArray[np.float64], scale: NDArray[np.float64], degrees: float, offset: NDArray[np.float64], order: str
) -> NDArray[np.float64]:
    """Return the matrix (3, 3) of place2d."""

    def shift(by: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.array([[1.0, 0.0, by[0]], [0.0, 1.0, by[1]], [0.0, 0.0, 1.0]])

    c, s = _turn(-degrees)
    turned, scaled = (
        np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]),
        np.diag([1.0 / scale[0], 1.0 / scale[1], 1.0]),
    )
    if order == "1":
        return np.asarray(shift(pivot) @ scaled @ turned @ shift(-pivot - offset))
    return np.asarray(shift(pivot - offset) @ turned @ scaled @ shift(-pivot))


def _transformed(node: Node, name: str, matrix: NDArray[np.float64]) -> Term:
    attribute = node.attribute(name)
    term = node.reader.term(attribute, 2) if attribute else None
    if term is None:
        node.note(name, "texture coordinates are not connected", _PLACED)
        term = _uv(node, "st")
    if isinstance(term.leaf, Coordinates):
        product = _square(term.leaf.transform)
        leaf = Coordinates(term.leaf.st, _flat(matrix @ product))
        return node.terms.leaf(leaf, 2, term.leaf.st)
    (a, b, c), (d, e, f) = matrix[0].tolist(), matrix[1].tolist()
    x, y = (node.terms.channel(term, index) for index in (0, 1))
    rows = [
        node.terms.apply(
            "{x} * {a} + {y} * {b} + {c}", {"x": x, "y": y, "a": constant(p), "b": constant(q), "c": constant(r)}
        )
        for p, q, r in ((a, b, c), (d, e, f))
    ]
    return node.terms.joined(*rows)


def _square(transform: Transform) -> NDArray[np.float64]:
    return np.vstack([np.reshape(transform, (2, 3)), [0.0, 0.0, 1.0]])


def _flat(matrix: NDArray[np.float64]) -> Transform:
    a, b, c, d, e, f = (float(number) for number in matrix[:2].ravel())
    return a, b, c, d, e, f


def _coordinates(node: Node, name: str) -> tuple[str, Transform]:
    """Return the UV set and the transform of the coordinates of an image."""
    try:
        term = coordinates(node, name)
        if node.attribute(name) is None and not node.identifier.startswith("ND_"):
            # Unlike a node of MaterialX, whose geometric default is a UV set, UsdUVTexture has the constant (0, 0).
            node.note(name, "texture coordinates are not connected", "the texture's value at (0, 0) is everywhere")
            term = constant(0.0, 0.0)
    except Unread as unread:
        node.note(name, f"is not carried{f': {unread}' if str(unread) else ''}", _PLACED)
        term = _uv(node, "st")
    if term.numbers is not None:
        s, t = term.numbers
        return "st", (0.0, 0.0, s, 0.0, 0.0, t)
    if not isinstance(term.leaf, Coordinates):
        node.note(name, "is computed", _PLACED)
        return "st", Coordinates("st").transform
    return term.leaf.st, term.leaf.transform


def _address(node: Node, name: str) -> _Wrap:
    return _ADDRESS_MODES[node.text(name, "periodic", list(_ADDRESS_MODES))]


def _looked_up(node: Node, matrix: NDArray[np.float64], wraps: list[_Wrap], width: int = 0) -> Term:
    """Return the texels of an image node of MaterialX, whose coordinates `matrix` transforms."""
    width = width or node.width
    file = _image(node, "default", width)
    if node.text("filtertype", "linear") != "linear":
        node.note("filtertype", "is not carried", "images are looked up linearly")
    if isinstance(file, Term):
        node.ignore("texcoord")
        return file
    st, transform = _coordinates(node, "texcoord")
    # MaterialX manages the colour of colours only.
    is_color = "color" in node.identifier
    space = _file_space(node) if is_color else ""
    texture = Texture(file, "rgb", space or "raw", wraps[0], wraps[1], st, _flat(matrix @ _square(transform)))
    return _texels(node, texture, width)


def _texels(node: Node, texture: Texture, width: int) -> Term:
    if node.reader.network.opens_images:
        texture = resolved(texture)
    if width == 1:
        return node.terms.leaf(replace(texture, channel="r"), 1, node.name)
    rgb = node.terms.leaf(texture, min(width, 3), node.name)
    if width < 4:
        return rgb
    return replace(rgb, alpha=node.terms.leaf(replace(texture, channel="a"), 1, f"{node.name}_a"))


def _file_space(node: Node) -> str:
    """Return the colour space that is authored for a file; empty where none is."""
    attribute = node.attribute("file")
    holder = node.reader.network.follow(attribute) if attribute else None
    name = colorspace_of(holder) if holder is not None and hasattr(holder, "GetColorSpace") else ""
    return node.reader.colorspace(attribute, name) if name and attribute else ""


def _image(node: Node, fallback: str, width: int) -> Path | Term:
    """Return the image of a node, or the value in place of one: where none is named, or where none can be read."""
    node.ignore(fallback, "note")
    attribute = node.attribute("file")
    asset = node.reader.plain(attribute) if attribute else None
    if attribute is None or (isinstance(asset, Sdf.AssetPath) and not asset.path):
        node.note("file", "names no image file", f"inputs:{fallback} is taken")
        return node.term(fallback, width, 0.0)
    if not isinstance(asset, Sdf.AssetPath):
        raise Unread("inputs:file is not an asset")
    network = node.reader.network
    try:
        file = image_path(network, attribute, asset)
        if network.opens_images:
            texture = Texture(file, "rgb", "auto")
            for tile in udim_tiles(texture).values() or [texture]:
                image_header(tile.file)
        return file
    except TextureError as error:
        if node.attribute(fallback):
            node.note("file", str(error), f"inputs:{fallback} is taken")
            return node.term(fallback, width)
        where = f"{node.path}.inputs:file"
        node.reader.missing.append(Fault(str(network.file), where, str(error), "a path to an image, or a fallback"))
        raise Unread from error
