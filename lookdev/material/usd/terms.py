"""The values of nodes in materials of foreign shading models, as terms from which a look's expressions are composed.

The value of a node is a `NodeValue`: a constant, a texture or other source, or a text of the expression language. The
text for a node contains the texts of its inputs. Operations on constants are evaluated at once. Linear arithmetic on a
single texture or UV set needs no expression: it becomes the scale and bias of the texture, or the transform of the
coordinates.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from lookdev.arrays import MAX_MAGNITUDE
from lookdev.material import Bump, Channel, Coordinates, Formula, InputSource, Primvar, Texture, to_transform
from lookdev.material.expression import ExpressionError, ExpressionKind, parse
from lookdev.material.expression.shaping import CONSTANTS
from lookdev.material.expression.syntax import MAX_LENGTH
from lookdev.space import Color

Leaf = Texture | Primvar | Coordinates | Bump
"""A source that varies over the surface and is not an expression."""

_CHANNELS: tuple[Channel, ...] = ("r", "g", "b", "a")
_ATOM = re.compile(r"[A-Za-z0-9_.]+")  # a text that needs no parentheses


class NotCarriedError(Exception):
    """A value cannot be carried over to a look.

    The message is the reason. It is empty where the reason is already a fault of the network.
    """

    @property
    def fault(self) -> str:
        """The message of the fault that is reported for the input with this value."""
        return f"is not carried: {self}" if str(self) else "is not carried"


@dataclass(frozen=True)
class NodeValue:
    """The value of a node, also called a term.

    text
        The value as an expression.
    width
        The number of channels of the text: 1, 2 or 3. Two channels are a colour whose third channel is unused.
    inputs
        The sources of the names in the text.
    numbers
        The channels of the value, if it is constant; else None.
    leaf
        The source, if the value is a single source; else None.
    alpha
        The fourth channel of a value of four channels, whose width is 3; else None.
    is_tangent_normal
        Whether the value is a normal in the frame of tangent, bitangent and shading normal.
    """

    text: str
    width: int
    inputs: Mapping[str, Leaf] = field(default_factory=dict)
    numbers: tuple[float, ...] | None = None
    leaf: Leaf | None = None
    alpha: NodeValue | None = None
    is_tangent_normal: bool = False

    @property
    def kind(self) -> ExpressionKind:
        """The type of the text as an expression."""
        return "float" if self.width == 1 else "color"

    def source(self) -> InputSource | Bump:
        """Return the value as the source of an input of a layer; raises NotCarriedError where the text is too large."""
        if self.numbers is not None:
            return self.numbers[0] if self.width == 1 else _to_color(self.numbers)
        if self.leaf is not None:
            return self.leaf
        sources: dict[str, InputSource] = {}
        kinds: dict[str, ExpressionKind] = {}
        try:
            expression = parse(self.text)
            for name in expression.names:
                leaf = self.inputs[name]
                assert not isinstance(leaf, Bump)
                sources[name], kinds[name] = leaf, _leaf_kind(leaf)
            expression.check(kinds)
        except ExpressionError as error:
            raise NotCarriedError(error.summary) from error
        return Formula(expression, sources, kinds)


def constant(*numbers: float) -> NodeValue:
    """Return a constant term of one to four channels."""
    clipped = tuple(min(max(float(number), -MAX_MAGNITUDE), MAX_MAGNITUDE) for number in numbers)
    if len(clipped) == 4:
        return replace(constant(*clipped[:3]), alpha=constant(clipped[3]))
    texts = [_format_number(number) for number in (clipped if len(clipped) == 1 else _to_color(clipped))]
    return NodeValue(texts[0] if len(texts) == 1 else f"[{', '.join(texts)}]", len(clipped), numbers=clipped)


def convert_channels(term: NodeValue, width: int) -> NodeValue:
    """Return a term converted to `width` channels, 1 to 4.

    A single channel is repeated. Extra channels are dropped. Missing channels are 0, except that alpha is 1.
    """
    channels = 4 if term.alpha else term.width
    if width == channels:
        return term
    if width == 4:
        return replace(convert_channels(term, 3), alpha=constant(1.0))
    if term.numbers is not None:
        numbers = term.numbers * width if term.width == 1 else (*term.numbers, 0.0)[:width]
        return constant(*numbers)
    if channels == 1:
        # The leaf is kept: a float as the source of a colour is three equal channels.
        return replace(term, text=f"{_parenthesize(term.text)} + [0, 0, 0]", width=width)
    if width == 3 and term.width == 2:
        return replace(term, text=f"{_parenthesize(term.text)} * [1, 1, 0]", width=3, leaf=None)
    return replace(term, width=width, alpha=None)


class Terms:
    """Makes the terms of one material, and gives each leaf the same name in all expressions."""

    def __init__(self) -> None:
        self._names: dict[Leaf, str] = {}

    def leaf_term(self, leaf: Leaf, width: int, hint: str) -> NodeValue:
        """Return the term for a source of `width` channels. The source's name in expressions derives from `hint`."""
        if leaf not in self._names:
            stem = re.sub(r"[^A-Za-z0-9_]", "_", hint)[:24].lstrip("0123456789") or "value"
            used_names = {*self._names.values(), *CONSTANTS}
            number = 1
            while (name := stem if number == 1 else f"{stem}_{number}") in used_names:
                number += 1
            self._names[leaf] = name
        name = self._names[leaf]
        return NodeValue(name, width, {name: leaf}, leaf=leaf)

    def apply(self, template: str, operands: Mapping[str, NodeValue], linear: Sequence[str] = ()) -> NodeValue:
        """Return the term for a template: an expression with the names of operands in braces, applied to each channel.

        The template is a linear function (with a constant term) of each of the operands named in `linear` if the others
        are fixed. Raises NotCarriedError where the expression is too large, or an operand is a bump map.
        """
        if any(operand.alpha for operand in operands.values()):
            colors = {name: replace(operand, alpha=None) for name, operand in operands.items()}
            opaque = constant(1.0)
            alphas = {name: term.alpha or (term if term.width == 1 else opaque) for name, term in operands.items()}
            return replace(self.apply(template, colors, linear), alpha=self.apply(template, alphas, linear))
        if any(isinstance(operand.leaf, Bump) for operand in operands.values()):
            raise NotCarriedError("a bump has no value to compute with")
        varying = [name for name, operand in operands.items() if operand.numbers is None]
        if not varying:
            return _evaluate(template, operands)
        if len(varying) == 1 and varying[0] in linear:
            folded = self._fold(template, operands, varying[0])
            if folded:
                return folded
        text = template.format_map({name: _parenthesize(operand.text) for name, operand in operands.items()})
        if len(text) > MAX_LENGTH:
            raise NotCarriedError(f"makes an expression of more than {MAX_LENGTH} characters")
        inputs = {name: leaf for operand in operands.values() for name, leaf in operand.inputs.items()}
        vectors = [operand for operand in operands.values() if operand.width > 1 and operand.numbers is None]
        tangent = bool(vectors) and all(vector.is_tangent_normal for vector in vectors)
        return NodeValue(text, max(operand.width for operand in operands.values()), inputs, is_tangent_normal=tangent)

    def _fold(self, template: str, operands: Mapping[str, NodeValue], name: str) -> NodeValue | None:
        """Fold a template into its operand `name`. The others are constant, and the template is linear in this one.

        If the operand is a texture or coordinates, return it with the template's scale and bias. Else return None.
        """
        term = operands[name]
        leaf, width = term.leaf, term.width
        if not isinstance(leaf, Texture | Coordinates) or width != max(operand.width for operand in operands.values()):
            return None
        if isinstance(leaf, Texture) and (leaf.channel == "rgb") != (width > 1):
            return None
        # The values of the template at 0 and 1 determine the linear function.
        ends = [constant(*(value,) * width) for value in (0.0, 1.0)]
        at_zero, at_one = (np.array(_evaluate(template, {**operands, name: end}).numbers) for end in ends)
        # np.resize repeats the number of a single channel for r, g, b and a.
        scale, bias = (np.resize(numbers, 3 if width > 1 else 4) for numbers in (at_one - at_zero, at_zero))
        hint = self._names[leaf]
        if isinstance(leaf, Coordinates):
            matrix = np.reshape(leaf.transform, (2, 3)) * scale[:2, np.newaxis]
            matrix[:, 2] += bias[:2]
            return replace(self.leaf_term(Coordinates(leaf.st, to_transform(matrix)), 2, hint), is_tangent_normal=False)
        full_scale, full_bias = np.ones(4), np.zeros(4)
        full_scale[: scale.size], full_bias[: bias.size] = scale, bias
        scaled = np.array(leaf.scale) * full_scale
        biased = np.array(leaf.bias) * full_scale + full_bias
        return self.leaf_term(replace(leaf, scale=_to_rgba(scaled), bias=_to_rgba(biased)), width, hint)

    def channel(self, term: NodeValue, index: int) -> NodeValue:
        """Return one channel of a term; raises NotCarriedError where it has no such channel."""
        channels = 4 if term.alpha else term.width
        if index >= channels:
            raise NotCarriedError(f"there is no channel {index} of {channels}")
        if index == 3:
            assert term.alpha
            return term.alpha
        if term.numbers is not None:
            return constant(term.numbers[index])
        if term.width == 1:
            return term
        if isinstance(term.leaf, Texture):
            single = _CHANNELS[index] if term.leaf.channel == "rgb" else term.leaf.channel
            return self.leaf_term(replace(term.leaf, channel=single), 1, f"{self._names[term.leaf]}_{single}")
        if isinstance(term.leaf, Bump):
            raise NotCarriedError("a bump has no value to compute with")
        return NodeValue(f"{_parenthesize(term.text)}[{index}]", 1, term.inputs)

    def join_channels(self, *channels: NodeValue) -> NodeValue:
        """Join two to four terms of one channel each into one term with all these channels."""
        if len(channels) == 4:
            return replace(self.join_channels(*channels[:3]), alpha=channels[3])
        if all(channel.numbers is not None for channel in channels):
            return constant(*(channel.numbers[0] for channel in channels if channel.numbers))
        texts = [channel.text for channel in channels] + ["0"] * (3 - len(channels))
        inputs = {name: leaf for channel in channels for name, leaf in channel.inputs.items()}
        return NodeValue(f"[{', '.join(texts)}]", len(channels), inputs)


def _evaluate(template: str, operands: Mapping[str, NodeValue]) -> NodeValue:
    """Return the value of a template whose operands are all constant."""
    text = template.format_map({name: _parenthesize(operand.text) for name, operand in operands.items()})
    try:
        value = np.atleast_1d(parse(text).evaluate({}, {}))
    except ExpressionError as error:
        raise NotCarriedError(error.summary) from error
    return constant(*value.tolist()[: max(operand.width for operand in operands.values())])


def _parenthesize(text: str) -> str:
    """Return a text that can be an operand: in parentheses unless it is a name or a number."""
    return text if _ATOM.fullmatch(text) else f"({text})"


def _format_number(number: float) -> str:
    """Return a number as text of the expression language, with all its digits."""
    return f"{number:.17g}" if number >= 0.0 else f"(-{-number:.17g})"


def _leaf_kind(leaf: InputSource) -> ExpressionKind:
    """Return the type of a leaf as the input of an expression; coordinates are a colour."""
    match leaf:
        case Texture(channel=channel):
            return "color" if channel == "rgb" else "float"
        case Primvar(fallback=fallback):
            return "color" if isinstance(fallback, tuple) else "float"
    return "color"


def _to_color(numbers: Sequence[float]) -> Color:
    """Return one to three numbers as a colour; missing channels are 0."""
    a, b, c = (*numbers, 0.0, 0.0)[:3]
    return a, b, c


def _to_rgba(values: Iterable[float]) -> tuple[float, float, float, float]:
    """Return four numbers as a tuple of floats."""
    a, b, c, d = (float(value) for value in values)
    return a, b, c, d
