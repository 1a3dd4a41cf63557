"""Reading the networks of foreign shading models: values of inputs, whatever nodes they come from.

Reading is lenient: what cannot be carried is noted as a fault of the network, and the input has its default. The nodes
are in `nodes` and `sampling`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TypeAlias

from pxr import Gf, Sdf, Usd, UsdShade

from lookdev.errors import Fault, nearest_hint
from lookdev.material.look import Color
from lookdev.material.usd.network import Network, Source, shader_id
from lookdev.material.usd.terms import Term, Terms, Unread, constant, passed
from lookdev.stage.colorspaces import colorspace_named, colorspace_of, to_linear_rec709

Plain: TypeAlias = "tuple[float, ...] | str | Sdf.AssetPath"
"""The value of an attribute: numbers, text or a file."""

_DEEPEST = 64  # nodes in a row
_LARGEST = 1e18  # the product of two larger numbers is not a float32
# Channels of a type that ends an identifier; those that begin as others do come first.
_WIDTHS = {"float2": 2, "float3": 3, "float4": 4, "float": 1, "integer": 1, "boolean": 1}
_WIDTHS |= {"vector2": 2, "color3": 3, "vector3": 3, "color4": 4, "vector4": 4}
_TYPES = (*_WIDTHS, "multioutput", "displacementshader")
_NUMBERS = (bool, int, float, Gf.Vec2f, Gf.Vec3f, Gf.Vec4f, Gf.Vec2d, Gf.Vec3d, Gf.Vec4d, Gf.Vec2h, Gf.Vec3h, Gf.Vec4h)


class Reader:
    """Values of inputs in the network of one material.

    Images that are missing or unreadable, and that no fallback replaces, are in `missing`, not among the faults of
    the network.
    """

    def __init__(self, network: Network, kinds: Mapping[str, Callable[[Node], Term]]) -> None:
        self.network = network
        self.terms = Terms()
        self.missing: list[Fault] = []
        self.fallbacks: dict[str, float | Color] = {}  # of primvars
        self._kinds = kinds
        self._read: dict[tuple[Sdf.Path, str], Term | None] = {}
        self._within: list[tuple[Sdf.Path, str]] = []

    def term(self, attribute: Usd.Attribute, width: int) -> Term | None:
        """Return the value of an input with a number of channels; None where it is not set.

        Raises Unread where it cannot be carried.
        """
        holder = self.network.follow(attribute)
        if holder is None:
            raise Unread
        if isinstance(holder, Source):
            return self._fitted(attribute, self.node(attribute, holder), width)
        value = self.plain(attribute)
        if value is None:
            return None
        if not isinstance(value, tuple):
            raise Unread(f"holds a value of type {holder.GetTypeName()}")
        return self._fitted(attribute, constant(*self._linear(attribute, holder, value)), width)

    def node(self, place: Usd.Attribute, source: Source) -> Term:
        """Return the value of an output of a node; raises Unread where it cannot be carried."""
        key = source.path, source.output
        if key in self._within:
            self.network.fault(place, "its connections run in a cycle")
            raise Unread
        if key not in self._read:
            if len(self._within) == _DEEPEST:
                raise Unread(f"more than {_DEEPEST} nodes are connected in a row")
            self._within.append(key)
            self._read[key] = None
            try:
                self._read[key] = self._compute(source)
            except Unread as unread:
                if str(unread):
                    self.network.fault(source.path, str(unread))
            finally:
                self._within.pop()
        term = self._read[key]
        if term is None:
            raise Unread
        return term

    def _compute(self, source: Source) -> Term:
        given = category(source.shader)
        if given not in self._kinds:
            identifier = shader_id(source.shader) or "no info:id"
            raise Unread(f"a node of {identifier} is not supported")
        node = Node(self, source)
        term = self._kinds[given](node)
        node.note_the_rest()
        return term

    def plain(self, attribute: Usd.Attribute) -> Plain | None:
        """Return the constant of an input; None where unset. Raises Unread where it is computed or no such value."""
        holder = self.network.follow(attribute)
        if holder is None:
            raise Unread
        if isinstance(holder, Source):
            raise Unread(f"{attribute.GetPath()} is computed by <{holder.path}>; a constant would be right")
        if holder.GetNumTimeSamples():
            self.network.fault(attribute, "is animated", "its first sample is taken")
        value = holder.Get(Usd.TimeCode.EarliestTime())
        if value is None or isinstance(value, str | Sdf.AssetPath):
            return value
        if isinstance(value, _NUMBERS):
            numbers = (float(value),) if isinstance(value, bool | int | float) else tuple(map(float, value))
            if all(math.isfinite(number) and abs(number) <= _LARGEST for number in numbers):
                return numbers
            self.network.fault(attribute, f"{value} is not finite", f"it must be within {_LARGEST:g}")
        else:
            self.network.fault(attribute, f"holds a value of type {holder.GetTypeName()}, which is not read")
        raise Unread

    def _linear(self, place: Usd.Attribute, holder: Usd.Attribute, value: tuple[float, ...]) -> tuple[float, ...]:
        """Return a constant with its colour, if it is one, as linear Rec.709."""
        if holder.GetTypeName().role != Sdf.ValueRoleNames.Color or len(value) < 3:
            return value
        space = self.colorspace(place, colorspace_of(holder))
        return (*to_linear_rec709(value[:3], space).tolist(), *value[3:])

    def colorspace(self, place: Usd.Attribute, name: str) -> str:
        """Return the `Texture.colorspace` of a colour space, with a note where it is unknown."""
        known = colorspace_named(name)
        if known is None:
            known = "sRGB" if "srgb" in name.lower() else "raw"
            taken = "sRGB" if known == "sRGB" else "linear Rec.709"
            self.network.fault(place, f"the colour space '{name:.40}' is unknown", f"{taken} is taken")
        return known

    def _fitted(self, place: Usd.Attribute, term: Term, width: int) -> Term:
        have = 4 if term.alpha else term.width
        if width == 1 and have > 1:
            self.network.fault(place, f"is a float, connected to {have} channels", "the first is taken")
            return self.terms.channel(term, 0)
        if (have, width) == (2, 3):
            self.network.fault(place, "has three channels, connected to 2", "the third is 0")
        return passed(term, width)


class Node:
    """A node that is being read, and the names of those of its inputs that were."""

    def __init__(self, reader: Reader, source: Source) -> None:
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
        """The channels of the result, by the end of the identifier."""
        words = self.identifier.removesuffix("_1_0").split("_")
        found = (_WIDTHS[kind] for word in reversed(words) for kind in _WIDTHS if word.startswith(kind))
        return next(found, 1)

    def attribute(self, name: str) -> Usd.Attribute | None:
        """Return an input that has a connection or a value, and count it as read."""
        self._used.add(name)
        attribute = self.shader.GetPrim().GetAttribute(f"inputs:{name}")
        if attribute and (attribute.HasAuthoredConnections() or attribute.HasAuthoredValue()):
            return attribute
        return None

    def ignore(self, *names: str) -> None:
        """Count inputs without effect on the result as read."""
        self._used.update(names)

    def term(self, name: str, width: int, *default: float) -> Term:
        """Return the value of an input."""
        attribute = self.attribute(name)
        term = self.reader.term(attribute, width) if attribute else None
        return passed(constant(*default), width) if term is None else term

    def any_term(self, name: str, *default: float) -> Term:
        """Return the value of an input with the channels that it has."""
        attribute = self.attribute(name)
        if attribute is None:
            return constant(*default)
        holder = self.reader.network.follow(attribute)
        if isinstance(holder, Source):
            return self.reader.node(attribute, holder)
        value = self.reader.plain(attribute)
        if value is not None and not isinstance(value, tuple):
            raise Unread(f"inputs:{name} is no number")
        term = self.reader.term(attribute, len(value)) if value else None
        return constant(*default) if term is None else term

    def numbers(self, name: str, *default: float) -> tuple[float, ...]:
        """Return a constant input of as many numbers as its default."""
        attribute = self.attribute(name)
        term = self.reader.term(attribute, len(default)) if attribute else None
        if term is None:
            return default
        if term.numbers is None:
            raise Unread(f"inputs:{name} is not constant")
        return (*term.numbers, *(term.alpha.numbers or ())) if term.alpha else term.numbers

    def text(self, name: str, default: str, known: Sequence[str] = ()) -> str:
        """Return a constant input of text, one of those `known` where any are given."""
        attribute = self.attribute(name)
        value = self.reader.plain(attribute) if attribute else None
        if value is None:
            return default
        text = value if isinstance(value, str) else f"{value[0]:g}" if isinstance(value, tuple) else value.path
        if known and text not in known:
            self.reader.network.fault(attribute, f"unknown value '{text:.40}'", nearest_hint(text, known))
            return default
        return text

    def word(self, name: str) -> str:
        """Return a constant input of text, "" where it is not set; raises Unread where it is a number or a file."""
        attribute = self.attribute(name)
        value = self.reader.plain(attribute) if attribute else None
        if value is not None and not isinstance(value, str):
            raise Unread(f"inputs:{name} is no text")
        return value or ""

    def note(self, name: str, what: str, hint: str = "") -> None:
        """Note something about an input that is not carried."""
        self.reader.network.fault(f"{self.path}.inputs:{name}", what, hint)

    def note_the_rest(self) -> None:
        """Note the inputs that were set and not read."""
        for each in self.shader.GetInputs():
            name = each.GetBaseName()
            if name not in self._used and self.attribute(name):
                self.note(name, f"is not carried: {self.identifier} is read without it")


def category(shader: UsdShade.Shader) -> str:
    """Return the kind of a node: its identifier without the prefix and the types of MaterialX."""
    identifier = shader_id(shader)
    words = identifier.removeprefix("ND_").split("_")
    while len(words) > 1 and (words[-1].isdigit() or words[-1].startswith(_TYPES)):
        words.pop()
    return "_".join(words)
