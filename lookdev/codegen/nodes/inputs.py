"""Add the nodes that read a look's inputs, which are the symbols of `SymbolicSurface`: images, primvars and UV sets.

An image node of Blender has one wrap mode for both axes. A texture with two wrap modes, or with UDIM tiles, becomes
several image nodes, whose values are combined by the arithmetic of `lookdev/shaders/texture.h`.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from lookdev.brdf.vectors import Array, BooleanArray
from lookdev.cache import Content
from lookdev.codegen.inputs import SymbolicSurface
from lookdev.codegen.nodes.builder import TreeBuilder
from lookdev.codegen.source import AttributeBinding, ImageBinding, NodeLink, NodeTree
from lookdev.codegen.trace.graph import Graph
from lookdev.codegen.trace.symbolic import elements_of, symbols, vector_symbols

_EXTENSION = {"black": "CLIP", "clamp": "EXTEND", "repeat": "REPEAT", "mirror": "MIRROR"}
_IDENTITY = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)  # the `ImageBinding.transform` that leaves coordinates unchanged


def bind_inputs(builder: TreeBuilder, inputs: SymbolicSurface, names: Iterable[str]) -> tuple[AttributeBinding, ...]:
    """Add the nodes that compute the symbols `names` of a look, bind the symbols, and return the attributes read.

    Names that are not symbols of `inputs` are skipped.

    Raises
    ------
    TextureError
        An image is missing or unreadable.
    """
    names = list(names)
    attributes = tuple(inputs.attributes_read_by(names))
    for binding in attributes:
        _bind_attribute(builder, binding)
    for name in inputs.look_ups_read_by(names):
        _bind_look_up(builder, inputs.graph, inputs.look_up(name), inputs.label(name))
    return attributes


def node_digest(trees: Sequence[NodeTree], attributes: Sequence[AttributeBinding]) -> str:
    """Return the digest of trees, of the mesh attributes that they read, and of the contents of their images."""
    hashed = [repr(tuple(attributes))]
    for tree in trees:
        hashed.append(repr(replace(tree, nodes=())))
        hashed += [f"{replace(node, image=None)!r}{node.image.digest if node.image else ''}" for node in tree.nodes]
    return hashlib.sha256("".join(hashed).encode()).hexdigest()


def _bind_attribute(builder: TreeBuilder, binding: AttributeBinding) -> None:
    """Add the node that reads a mesh attribute, and bind the symbols of the attribute's components."""
    if binding.kind == "uv":
        components = [f"{binding.parameter}[{i}]" for i in range(3)]
        builder.bind(components, NodeLink(builder.add("UVMap", {"uv_map": binding.mesh_name}), "UV"))
        return
    node = builder.add("Attribute", {"attribute_type": "GEOMETRY", "attribute_name": binding.mesh_name})
    builder.bind(binding.symbols, NodeLink(node, "Fac" if binding.kind == "float" else "Vector"))


def _bind_look_up(builder: TreeBuilder, graph: Graph, look_up: ImageBinding, label: str) -> None:
    """Add the nodes of a look-up, labelled `label`, and bind the symbols of the image's channels."""
    uv = vector_symbols(graph, look_up.uv)
    a, b, c, d, e, f = look_up.transform
    s, t = uv[0] * a + uv[1] * b + c, uv[0] * d + uv[1] * e + f
    # Image nodes ignore the third coordinate. If the coordinates are not transformed, the UV set's third coordinate is
    # used: the vector is then the output of the UV Map node itself, and needs no further node.
    w = uv[2] if look_up.transform == _IDENTITY else np.array(0.0)

    def sample_image(file: Content, uv: Sequence[Array], wrap: str) -> Array:
        vector = builder.vector(elements_of(np.stack(uv)))
        if not isinstance(vector, NodeLink):  # an image node whose vector is not linked reads the mesh's UVs
            vector = NodeLink(builder.add("CombineXYZ", inputs=dict(zip("XYZ", vector, strict=True))), "Vector")
        properties = {"interpolation": "Linear", "projection": "FLAT", "extension": _EXTENSION[wrap]}
        node = builder.add("TexImage", properties, {"Vector": vector}, label, image=file)
        names = [f"{node}[{i}]" for i in range(4)]
        builder.bind(names[:3], NodeLink(node, "Color"))
        builder.bind(names[3:], NodeLink(node, "Alpha"))
        return symbols(graph, names)

    wraps = look_up.wrap_s, look_up.wrap_t
    if 0 not in look_up.files:  # only an image without UDIM tiles has the key 0
        # Tile 1001 + i + 10 j has s in [i, i + 1) and t in [j, j + 1). Where there is no tile, all channels are 0.
        column, row = np.floor(s), np.floor(t)
        value: Array = np.zeros(4)
        for number, file in look_up.files.items():
            i, j = (number - 1001) % 10, (number - 1001) // 10
            in_tile = np.where(_is_tile(column, i) & _is_tile(row, j), 1.0, 0.0)
            value = value + sample_image(file, (s - column, t - row, np.array(0.0)), "clamp") * in_tile
    elif wraps[0] == wraps[1]:
        value = sample_image(look_up.files[0], (s, t, w), wraps[0])
    else:
        value = np.zeros(4)
        for y in _copy_coordinates(t, wraps[1]):
            for x in _copy_coordinates(s, wraps[0]):
                value = value + sample_image(look_up.files[0], (x, y, np.array(0.0)), "black")
    if look_up.slopes and 0 in look_up.files:
        value = value * np.stack(
            [_wrap_derivative(s, wraps[0]), _wrap_derivative(t, wraps[1]), np.array(1.0), np.array(1.0)]
        )
    *color, alpha = elements_of(value)
    color_link, alpha_link = builder.vector(color), builder.scalar(alpha)
    assert isinstance(color_link, NodeLink), "the values of an image are links, not constants"
    assert isinstance(alpha_link, NodeLink), "the values of an image are links, not constants"
    builder.bind([f"{look_up.name}[{i}]" for i in range(3)], color_link)
    builder.bind([f"{look_up.name}_a"], alpha_link)


def _is_tile(coordinate: Array, number: int) -> BooleanArray:
    """Return whether a whole coordinate is `number`; nodes compute the coordinate in float32, so it is rounded."""
    return (coordinate > number - 0.5) & (coordinate < number + 0.5)


def _copy_coordinates(s: Array, wrap: str) -> tuple[Array, ...]:
    """Return coordinates at which look-ups with a black border add up to one look-up at `s` with the mode `wrap`.

    Under the bilinear filter, an image with a black border fades to 0 within half a texel beyond its edge. An image
    that repeats or mirrors is therefore the sum of copies with black borders. Along an axis, at most two of them
    overlap at a point.
    """
    if wrap == "black":
        return (s,)
    if wrap == "repeat":
        position = s - np.floor(s)
        return position, np.where(position < 0.5, position + 1.0, position - 1.0)
    # Within half a texel of an edge, clamping and mirroring are the same.
    position = np.absolute(s - 2.0 * np.floor(0.5 * s + 0.5)) if wrap == "mirror" else np.clip(s, 0.0, 1.0)
    return position, np.where(position < 0.5, -position, 2.0 - position)


def _wrap_derivative(s: Array, wrap: str) -> Array:
    """Return the derivative of the wrapped `s` by `s`: -1 in mirrored copies, 0 beyond a clamped edge, else 1."""
    if wrap == "mirror":
        whole: Array = np.floor(s)
        return 1.0 - 2.0 * (whole - 2.0 * np.floor(0.5 * whole))
    if wrap == "clamp":
        return np.where((s >= 0.0) & (s <= 1.0), 1.0, 0.0)
    return np.array(1.0)
