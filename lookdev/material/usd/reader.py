"""Reads the networks of materials of foreign shading models: the values of inputs, be they constants or from nodes.

A value is *carried over* if a look can have it. Otherwise NotCarriedError is raised. The reason becomes a fault of the
network; the material is still read, and the input has its default. A *term* is a value that is carried over, a
`NodeValue`; its text can be part of the texts of other terms. The modules `nodes` and `sampling` read the single kinds
of nodes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TypeAlias

from pxr import Gf, Sdf, Usd, UsdShade

from lookdev.arrays import MAX_MAGNITUDE
from lookdev.errors import Fault, nearest_hint
from lookdev.material.usd.network import Network, OutputSource, is_authored, shader_id
from lookdev.material.usd.terms import NodeValue, NotCarriedError, Terms, constant, convert_channels
from lookdev.space import Color
from lookdev.stage.colorspaces import colorspace_named, colorspace_of, to_linear_rec709

ConstantValue: TypeAlias = "tuple[float, ...] | str | Sdf.AssetPath"
"""The constant of an attribute: numbers, text or a file."""

_MAX_DEPTH = 64  # nodes connected in a row
# The number of channels by the type that ends a node's identifier. The longer "float2" must come before "float".
_WIDTHS = {"float2": 2, "float3": 3, "float4": 4, "float": 1, "integer": 1, "boolean": 1}
_WIDTHS |= {"vector2": 2, "color3": 3, "vector3": 3, "color4": 4, "vector4": 4}
# A word of an identifier is a type if it begins with one of these. "surfaceshader" is not among them: it stays in the
# category of a node.
_TYPES = (*_WIDTHS, "multioutput", "displacementshader")
_NUMBERS = (bool, int, float, Gf.Vec2f, Gf.Vec3f, Gf.Vec4f, Gf.Vec2d, Gf.Vec3d, Gf.Vec4d, Gf.Vec2h, Gf.Vec3h, Gf.Vec4h)


class Reader:
    """Reads values of inputs in the network of one material.

    `node_readers` maps the category of a node to the function that reads the node. `terms` makes terms,
    from sources such as textures and from other terms. `missing` lists images that are missing or unreadable and have
    no fallback; they are not among the faults of the network.
    """

    def __init__(self, network: Network, node_readers: Mapping[str, Callable[[UsdNode], NodeValue]]) -> None:
        self.network = network
        self.terms = Terms()
        self.missing: list[Fault] = []
        self.fallbacks: dict[str, float | Color] = {}  # of primvars, by name
        self._node_readers = node_readers
        # Keys are pairs (path of the node, name of the output). The value is None where it cannot be carried over.
        self._terms_by_output: dict[tuple[Sdf.Path, str], NodeValue | None] = {}
        self._open_nodes: list[tuple[Sdf.Path, str]] = []  # keys being read; each is an input of the one before

    def read_term(self, attribute: Usd.Attribute | None, width: int) -> NodeValue | None:
        """Return the value of an input, converted to `width` channels; None where the input is missing or not set.

        Raises NotCarriedError where the value cannot be carried over.
        """
        if not attribute:
            return None
        source = self.network.follow(attribute)
        if source is None:
            raise NotCarriedError  # a connection is broken, and `follow` has added the fault
        if isinstance(source, OutputSource):
            return self._fit_channels(attribute, self.read_node(attribute, source), width)
        value = self.read_constant(attribute)
        if value is None:
            return None
        if not isinstance(value, tuple):
            raise NotCarriedError(f"holds a value of type {source.GetTypeName()}")
        if source.GetTypeName().role == Sdf.ValueRoleNames.Color and len(value) >= 3:
            space = self.colorspace(attribute, colorspace_of(source))
            value = (*to_linear_rec709(value[:3], space).tolist(), *value[3:])
        return self._fit_channels(attribute, constant(*value), width)

    def read_node(self, attribute: Usd.Attribute, source: OutputSource) -> NodeValue:
        """Return the value of an output of a node, to which `attribute` is connected. Each output is read once.

        Raises NotCarriedError where the value cannot be carried over. The reason is then a fault of the network.
        """
        key = source.path, source.output
        if key in self._open_nodes:
            self.network.add_fault(attribute, "its connections run in a cycle")
            raise NotCarriedError
        if key not in self._terms_by_output:
            if len(self._open_nodes) == _MAX_DEPTH:
                raise NotCarriedError(f"more than {_MAX_DEPTH} nodes are connected in a row")
            self._open_nodes.append(key)
            self._terms_by_output[key] = None
            try:
                self._terms_by_output[key] = self._compute(source)
            except NotCarriedError as error:
                if str(error):
                    self.network.add_fault(source.path, str(error))
            finally:
                self._open_nodes.pop()
        term = self._terms_by_output[key]
        if term is None:
            raise NotCarriedError
        return term

    def _compute(self, source: OutputSource) -> NodeValue:
        """Return the value of a node by the reader of its category, and add faults of inputs that are not read."""
        kind = node_category(source.shader)
        if kind not in self._node_readers:
            identifier = shader_id(source.shader) or "no info:id"
            raise NotCarriedError(f"a node of {identifier} is not supported")
        node = UsdNode(self, source)
        term = self._node_readers[kind](node)
        node.add_unread_faults()
        return term

    def read_constant(self, attribute: Usd.Attribute) -> ConstantValue | None:
        """Return the constant of an input; None where it is unset.

        Raises NotCarriedError where a node computes the value, or it is not finite or of an unsupported type.
        """
        source = self.network.follow(attribute)
        if source is None:
            raise NotCarriedError  # a connection is broken, and `follow` has added the fault
        if isinstance(source, OutputSource):
            raise NotCarriedError(f"{attribute.GetPath()} is computed by <{source.path}>; a constant would be right")
        if source.GetNumTimeSamples():
            self.network.add_fault(attribute, "is animated", "its first sample is taken")
        value = source.Get(Usd.TimeCode.EarliestTime())
        if value is None or isinstance(value, str | Sdf.AssetPath):
            return value
        if isinstance(value, _NUMBERS):
            numbers = (float(value),) if isinstance(value, bool | int | float) else tuple(map(float, value))
            if all(math.isfinite(number) and abs(number) <= MAX_MAGNITUDE for number in numbers):
                return numbers
            self.network.add_fault(attribute, f"{value} is not finite", f"it must be within {MAX_MAGNITUDE:g}")
        else:
            self.network.add_fault(attribute, f"holds a value of type {source.GetTypeName()}, which is not read")
        raise NotCarriedError

    def colorspace(self, attribute: Usd.Attribute, name: str) -> str:
        """Return USD's colour space `name` as a `Texture.colorspace`.

        For an unknown space, add a fault, and return sRGB if its name contains "srgb", else raw.
        """
        colorspace = colorspace_named(name)
        if colorspace is None:
            colorspace = "sRGB" if "srgb" in name.lower() else "raw"
            substitute = "sRGB" if colorspace == "sRGB" else "linear Rec.709"
            self.network.add_fault(attribute, f"the colour space '{name:.40}' is unknown", f"{substitute} is taken")
        return colorspace

    def _fit_channels(self, attribute: Usd.Attribute, term: NodeValue, width: int) -> NodeValue:
        """Convert a value to `width` channels, with a fault of `attribute` where channels are dropped or missing."""
        channels = 4 if term.alpha else term.width
        if width == 1 and channels > 1:
            self.network.add_fault(attribute, f"is a float, connected to {channels} channels", "the first is taken")
            return self.terms.channel(term, 0)
        if (channels, width) == (2, 3):
            self.network.add_fault(attribute, "has three channels, connected to 2", "the third is 0")
        return convert_channels(term, width)


class UsdNode:
    """A node of a network: reads its inputs by name and type, and remembers which inputs have been read."""

    def __init__(self, reader: Reader, source: OutputSource) -> None:
        self.reader = reader
        self.terms = reader.terms
        self.shader = source.shader
        self.path = source.path
        self.output = source.output
        self.identifier = shader_id(source.shader)
        self._used: set[str] = set()

    @property
    def name(self) -> str:
        """The name of the prim."""
        return str(self.path.name)

    @property
    def width(self) -> int:
        """The number of channels of the result, from the type at the end of the identifier."""
        words = self.identifier.removesuffix("_1_0").split("_")
        widths = (_WIDTHS[kind] for word in reversed(words) for kind in _WIDTHS if word.startswith(kind))
        return next(widths, 1)

    def attribute(self, name: str) -> Usd.Attribute | None:
        """Return the attribute of an input; None where it has no connection and no value. The input counts as read."""
        self._used.add(name)
        attribute = self.shader.GetPrim().GetAttribute(f"inputs:{name}")
        return attribute if attribute and is_authored(attribute) else None

    def mark_read(self, *names: str) -> None:
        """Count inputs as read, for instance because they have no effect on the result."""
        self._used.update(names)

    def read_term(self, name: str, width: int, *default: float) -> NodeValue:
        """Return the value of an input, or its default, converted to `width` channels."""
        term = self.reader.read_term(self.attribute(name), width)
        return convert_channels(constant(*default), width) if term is None else term

    def read_any_term(self, name: str, *default: float) -> NodeValue:
        """Return the value of an input, or its default, without a conversion of channels."""
        attribute = self.attribute(name)
        if attribute is None:
            return constant(*default)
        source = self.reader.network.follow(attribute)
        if isinstance(source, OutputSource):
            return self.reader.read_node(attribute, source)
        value = self.reader.read_constant(attribute)
        if value is not None and not isinstance(value, tuple):
            raise NotCarriedError(f"inputs:{name} is not a number")
        term = self.reader.read_term(attribute, len(value)) if value else None
        return constant(*default) if term is None else term

    def read_numbers(self, name: str, *default: float) -> tuple[float, ...]:
        """Return the numbers of a constant input, as many as `default` has; NotCarriedError where it is computed."""
        term = self.reader.read_term(self.attribute(name), len(default))
        if term is None:
            return default
        if term.numbers is None:
            raise NotCarriedError(f"inputs:{name} is not constant")
        return (*term.numbers, *(term.alpha.numbers or ())) if term.alpha else term.numbers

    def read_text(self, name: str, default: str, choices: Sequence[str] = ()) -> str:
        """Return a constant input as text. With `choices`, any other text is a fault, and the default is returned."""
        attribute = self.attribute(name)
        value = self.reader.read_constant(attribute) if attribute else None
        if value is None:
            return default
        text = value if isinstance(value, str) else f"{value[0]:g}" if isinstance(value, tuple) else value.path
        if choices and text not in choices:
            self.reader.network.add_fault(attribute, f"unknown value '{text:.40}'", nearest_hint(text, choices))
            return default
        return text

    def read_word(self, name: str) -> str:
        """Return a constant input that must be text, "" where it is unset; NotCarriedError for a number or a file."""
        attribute = self.attribute(name)
        value = self.reader.read_constant(attribute) if attribute else None
        if value is not None and not isinstance(value, str):
            raise NotCarriedError(f"inputs:{name} is not a text")
        return value or ""

    def add_fault(self, name: str, message: str, hint: str = "") -> None:
        """Add a fault of an input."""
        self.reader.network.add_fault(f"{self.path}.inputs:{name}", message, hint)

    def add_unread_faults(self) -> None:
        """Add a fault for each input that is set and was not read."""
        for shader_input in self.shader.GetInputs():
            name = shader_input.GetBaseName()
            if name not in self._used and self.attribute(name):
                self.add_fault(name, f"is not carried: {self.identifier} is read without it")


def node_category(shader: UsdShade.Shader) -> str:
    """Return the category of a node, for instance ``multiply`` for ``ND_multiply_color3``.

    This is the identifier without MaterialX's prefix, types and version.
    """
    identifier = shader_id(shader)
    words = identifier.removeprefix("ND_").split("_")
    while len(words) > 1 and (words[-1].isdigit() or words[-1].startswith(_TYPES)):
        words.pop()
    return "_".join(words)
