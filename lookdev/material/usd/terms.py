"""Values of shading networks as text of the expression language: built bottom up, folded where they are constant.

A value of a node is a `Term`. One that is a single texture or UV set stays one: a term that is linear in it becomes the
scale and bias of the texture, or the transform of the coordinates, so that such arithmetic costs nothing.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from lookdev.material.expression import ExpressionError, Kind, parse
from lookdev.material.expression.shaping import CONSTANTS, LARGEST
from lookdev.material.expression.syntax import LONGEST
from lookdev.material.look import Bump, Channel, Color, Coordinates, Formula, Primvar, Source, Texture

Leaf = Texture | Primvar | Coordinates | Bump

_CHANNELS: tuple[Channel, ...] = ("r", "g", "b", "a")
_SIMPLE = re.compile(r"[A-Za-z0-9_.]+")


class Unread(Exception):
    """A value cannot be carried; the message is the reason, or empty where the fault is noted already."""


@dataclass(frozen=True)
class Term:
    """The value of a node.

    text
        An expression of `width` channels, 1, 2 or 3; two are those of a colour whose third has no meaning.
    inputs
        The sources that the text names.
    numbers
        The channels of a constant.
    leaf
        The source of which the value consists, where it is a single one.
    alpha
        The fourth channel, beside a width of 3.
    tangent
        Whether it is a normal in the frame of tangent, bitangent and shading normal.
    """

    text: str
    width: int
    inputs: Mapping[str, Leaf] = field(default_factory=dict)
    numbers: tuple[float, ...] | None = None
    leaf: Leaf | None = None
    alpha: Term | None = None
    tangent: bool = False

    @property
    def kind(self) -> Kind:
        """The type of the text."""
        return "float" if self.width == 1 else "color"

    def source(self) -> Source | Bump:
        """Return what a layer reads; raises Unread where the expression is too large."""
        if self.numbers is not None:
            return self.numbers[0] if self.width == 1 else _color(self.numbers)
        if self.leaf is not None:
            return self.leaf
        sources: dict[str, Source] = {}
        kinds: dict[str, Kind] = {}
        try:
            expression = parse(self.text)
            for name in expression.names:
                leaf = self.inputs[name]
                assert not isinstance(leaf, Bump)
                sources[name], kinds[name] = leaf, _kind(leaf)
            expression.check(kinds)
        except ExpressionError as error:
            raise Unread(error.what) from error
        return Formula(expression, sources, kinds)


def constant(*numbers: float) -> Term:
    """Return a constant of one to four channels."""
    clipped = tuple(min(max(float(number), -LARGEST), LARGEST) for number in numbers)
    if len(clipped) == 4:
        return replace(constant(*clipped[:3]), alpha=constant(clipped[3]))
    text = _number(clipped[0]) if len(clipped) == 1 else f"[{', '.join(map(_number, _color(clipped)))}]"
    return Term(text, len(clipped), numbers=clipped)


def passed(term: Term, width: int) -> Term:
    """Return a term with another number of channels: repeated, left out, or 0 (alpha 1)."""
    have = 4 if term.alpha else term.width
    if width == have:
        return term
    if width == 4:
        return replace(passed(term, 3), alpha=constant(1.0))
    if term.numbers is not None:
        numbers = term.numbers * width if term.width == 1 else (*term.numbers, 0.0)[:width]
        return constant(*numbers)
    if have == 1:
        # The leaf stays: where a colour is read, a float stands for three equal channels.
        return replace(term, text=f"{_operand(term.text)} + [0, 0, 0]", width=width)
    if width == 3 and term.width == 2:
        return replace(term, text=f"{_operand(term.text)} * [1, 1, 0]", width=3, leaf=None)
    return replace(term, width=width, alpha=None)


class Terms:
    """Makes the terms of one look, whose inputs it names."""

    def __init__(self) -> None:
        self._names: dict[Leaf, str] = {}

    def leaf(self, leaf: Leaf, width: int, hint: str) -> Term:
        """Return a term of a source, whose name is made of `hint`, such as the node's."""
        if leaf not in self._names:
            stem = re.sub(r"[^A-Za-z0-9_]", "_", hint)[:24].lstrip("0123456789") or "value"
            taken = {*self._names.values(), *CONSTANTS}
            number = 1
            while (name := stem if number == 1 else f"{stem}_{number}") in taken:
                number += 1
            self._names[leaf] = name
        name = self._names[leaf]
        return Term(name, width, {name: leaf}, leaf=leaf)

    def apply(self, template: str, operands: Mapping[str, Term], linear: Sequence[str] = ()) -> Term:
        """Return the value of a template, in which operands stand in braces, by channel.

        `linear` are the operands in each of which the template is a straight line, as long as the others are constant.
        Raises Unread where the expression is too large, or an operand is a bump.
        """
        if any(each.alpha for each in operands.values()):
            colors = {name: replace(each, alpha=None) for name, each in operands.items()}
            alphas = {
                name: each.alpha or (each if each.width == 1 else constant(1.0)) for name, each in operands.items()
            }
            return replace(self.apply(template, colors, linear), alpha=self.apply(template, alphas, linear))
        if any(isinstance(each.leaf, Bump) for each in operands.values()):
            raise Unread("a bump has no value to compute with")
        varying = [name for name, each in operands.items() if each.numbers is None]
        if not varying:
            return _evaluated(template, operands)
        if len(varying) == 1 and varying[0] in linear:
            folded = self._folded(template, operands, varying[0])
            if folded:
                return folded
        text = template.format_map({name: _operand(each.text) for name, each in operands.items()})
        if len(text) > LONGEST:
            raise Unread(f"makes an expression of more than {LONGEST} characters")
        inputs = {name: leaf for each in operands.values() for name, leaf in each.inputs.items()}
        vectors = [each for each in operands.values() if each.width > 1 and each.numbers is None]
        tangent = bool(vectors) and all(each.tangent for each in vectors)
        return Term(text, max(each.width for each in operands.values()), inputs, tangent=tangent)

    def _folded(self, template: str, operands: Mapping[str, Term], name: str) -> Term | None:
        """Return a texture or coordinates of another scale and bias for a template linear in it."""
        term = operands[name]
        leaf, width = term.leaf, term.width
        if not isinstance(leaf, Texture | Coordinates) or width != max(each.width for each in operands.values()):
            return None
        if isinstance(leaf, Texture) and (leaf.channel == "rgb") != (width > 1):
            return None
        zero, one = (
            np.array(_evaluated(template, {**operands, name: constant(*(value,) * width)}).numbers)
            for value in (0.0, 1.0)
        )
        scale, bias = (np.resize(each, 3 if width > 1 else 4) for each in (one - zero, zero))
        hint = self._names[leaf]
        if isinstance(leaf, Coordinates):
            matrix = np.reshape(leaf.transform, (2, 3)) * scale[:2, np.newaxis]
            matrix[:, 2] += bias[:2]
            return replace(self.leaf(Coordinates(leaf.st, _six(matrix.ravel())), 2, hint), tangent=False)
        full_scale, full_bias = np.ones(4), np.zeros(4)
        full_scale[: scale.size], full_bias[: bias.size] = scale, bias
        scaled = np.array(leaf.scale) * full_scale
        biased = np.array(leaf.bias) * full_scale + full_bias
        return self.leaf(replace(leaf, scale=_four(scaled), bias=_four(biased)), width, hint)

    def channel(self, term: Term, index: int) -> Term:
        """Return one channel; raises Unread where there is none."""
        have = 4 if term.alpha else term.width
        if index >= have:
            raise Unread(f"there is no channel {index} of {have}")
        if index == 3:
            assert term.alpha
            return term.alpha
        if term.numbers is not None:
            return constant(term.numbers[index])
        if term.width == 1:
            return term
        if isinstance(term.leaf, Texture):
            single = _CHANNELS[index] if term.leaf.channel == "rgb" else term.leaf.channel
            return self.leaf(replace(term.leaf, channel=single), 1, f"{self._names[term.leaf]}_{single}")
        if isinstance(term.leaf, Bump):
            raise Unread("a bump has no value to compute with")
        return Term(f"{_operand(term.text)}[{index}]", 1, term.inputs)

    def joined(self, *channels: Term) -> Term:
        """Return one term of two to four floats."""
        if len(channels) == 4:
            return replace(self.joined(*channels[:3]), alpha=channels[3])
        if all(each.numbers is not None for each in channels):
            return constant(*(each.numbers[0] for each in channels if each.numbers))
        texts = [each.text for each in channels] + ["0"] * (3 - len(channels))
        inputs = {name: leaf for each in channels for name, leaf in each.inputs.items()}
        return Term(f"[{', '.join(texts)}]", len(channels), inputs)


def _evaluated(template: str, operands: Mapping[str, Term]) -> Term:
    text = template.format_map({name: _operand(each.text) for name, each in operands.items()})
    try:
        value = np.atleast_1d(parse(text).evaluate({}, {}))
    except ExpressionError as error:
        raise Unread(error.what) from error
    return constant(*value.tolist()[: max(each.width for each in operands.values())])


def _operand(text: str) -> str:
    return text if _SIMPLE.fullmatch(text) else f"({text})"


def _number(number: float) -> str:
    return f"{number:.17g}" if number >= 0.0 else f"(-{-number:.17g})"


def _kind(leaf: Source) -> Kind:
    match leaf:
        case Texture(channel=channel):
            return "color" if channel == "rgb" else "float"
        case Primvar(fallback=fallback):
            return "color" if isinstance(fallback, tuple) else "float"
    return "color"


def _color(numbers: Sequence[float]) -> Color:
    a, b, c = (*numbers, 0.0, 0.0)[:3]
    return a, b, c


def _four(values: Iterable[float]) -> tuple[float, float, float, float]:
    a, b, c, d = (float(each) for each in values)
    return a, b, c, d


def _six(values: Iterable[float]) -> tuple[float, float, float, float, float, float]:
    a, b, c, d, e, f = (float(each) for each in values)
    return a, b, c, d, e, f
