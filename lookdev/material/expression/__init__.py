"""Mask expressions: parsed, checked, and evaluated with numbers or with symbolic arrays alike.

`syntax` reads the text, `shaping` has the functions; the language is told in ``docs/expressions.md``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from lookdev.brdf.vectors import Array, Real
from lookdev.errors import nearest_hint
from lookdev.material.expression.shaping import CONSTANTS, FUNCTIONS, Function, bounded
from lookdev.material.expression.syntax import (
    Apply,
    Channel,
    Choice,
    Color,
    ExpressionError,
    Name,
    Node,
    Number,
    clipped,
    parse_tree,
)

__all__ = ["Expression", "ExpressionError", "Kind", "parse"]

Kind = Literal["float", "color"]


@dataclass(frozen=True)
class Expression:
    """A parsed expression. `names` are its inputs, in order of appearance; `text` is what was parsed."""

    text: str
    root: Node
    names: tuple[str, ...]

    def check(self, types: Mapping[str, Kind]) -> Kind:
        """Return the type of the result, given those of the inputs.

        Raises
        ------
        ExpressionError
            A name is unknown, or a colour stands where a float is needed or the other way round.
        """
        return _Checker(self.text, types).kind(self.root)

    def evaluate(self, values: Mapping[str, Array], types: Mapping[str, Kind]) -> Array:
        """Compute the expression.

        Parameters
        ----------
        values
            Floats (...) and linear colours (..., 3) by name: float64 arrays or symbolic ones.
        types
            Which they are: three floats and one colour have the same shape.

        Returns
        -------
        (...) or (..., 3)
            A float or a colour, as `check` says, finite and within ±1e18.

        Raises
        ------
        ExpressionError
            As from `check`.
        """
        kind = self.check(types)
        # What overflows on the way is bounded after every operation on numbers, and told by no warning.
        with np.errstate(all="ignore"):
            channels = [bounded(channel) for channel in _Evaluation(values, types).value(self.root)]
            if kind == "float":
                return channels[0]
            # Nothing of the values, but all of their shape.
            nothing = sum(channel * 0.0 for channel in channels)
            return np.stack([channel + nothing for channel in channels], axis=-1)


def parse(text: str) -> Expression:
    """Parse an expression.

    Raises
    ------
    ExpressionError
        It is none, names an unknown function, gives a wrong number of arguments, is too long or nested too deep.
    """
    return Expression(text, *parse_tree(text))


class _Checker:
    def __init__(self, text: str, types: Mapping[str, Kind]) -> None:
        self.text, self.types = text, types

    def kind(self, node: Node) -> Kind:
        """Return the type of a node."""
        match node:
            case Name(position=position, name=name) if name not in self.types:
                signature = f"a function: {FUNCTIONS[name].signature(name)}" if name in FUNCTIONS else ""
                hint = signature or nearest_hint(name, [*self.types, *CONSTANTS])
                raise ExpressionError(self.text, position, f"unknown name '{clipped(name)}'", hint)
            case Name(name=name):
                return self.types[name]
            case Color(channels=channels):
                for channel in channels:
                    self._float(channel, "a channel of a color")
                return "color"
            case Channel(position=position, color=color):
                if self.kind(color) == "float":
                    raise ExpressionError(self.text, position, "a channel of a float; only colors have channels")
                return "float"
            case Choice(condition=condition, yes=yes, no=no):
                self._float(condition, "the condition of '?'")
                return "color" if "color" in (self.kind(yes), self.kind(no)) else "float"
            case Apply(name=name, function=function, arguments=arguments):
                if function.domain == "each":
                    return "color" if "color" in [self.kind(argument) for argument in arguments] else "float"
                for argument in arguments:
                    if function.domain == "color" and argument is arguments[0]:
                        self.kind(argument)
                    else:
                        self._float(argument, f"'{name}'")
                return "color" if function.gives == "color" else "float"
            case Number():
                return "float"

    def _float(self, node: Node, user: str) -> None:
        if self.kind(node) == "color":
            hint = "take luminance(color), or a channel: color[0]"
            raise ExpressionError(self.text, node.position, f"{user} needs a float, this is a color", hint)


class _Evaluation:
    """Evaluation of a checked tree; a value is a tuple of channels: one of a float, three of a colour."""

    def __init__(self, values: Mapping[str, Array], types: Mapping[str, Kind]) -> None:
        self.values, self.types = values, types

    def value(self, node: Node) -> tuple[Array, ...]:
        """Return the channels of a node."""
        match node:
            case Number(value=value):
                return (np.asarray(value),)
            case Name(name=name):
                given = self.values[name]
                return tuple(given[..., i] for i in range(3)) if self.types[name] == "color" else (given,)
            case Color(channels=channels):
                return tuple(self._float(channel) for channel in channels)
            case Channel(color=color, index=index):
                return (self.value(color)[index],)
            case Choice(condition=condition, yes=yes, no=no):
                truth = self.truth(condition)
                return _each(lambda a, b: np.where(truth, a, b), self.value(yes), self.value(no))
            case Apply(function=function, arguments=arguments):
                return tuple(_bounded_number(channel) for channel in self._applied(node, function, arguments))

    def truth(self, node: Node) -> Any:
        """Return a node as truth values: a number is true where it is not 0."""
        if isinstance(node, Apply) and node.function.gives == "truth":
            operand = self.truth if node.function.domain == "truth" else self._float
            return node.function.evaluate(*(operand(argument) for argument in node.arguments))
        return np.logical_not(np.equal(self._float(node), 0.0))

    def _float(self, node: Node) -> Array:
        return self.value(node)[0]

    def _applied(self, node: Node, function: Function, arguments: tuple[Node, ...]) -> tuple[Array, ...]:
        if function.gives == "truth":
            return (np.where(self.truth(node), 1.0, 0.0),)
        values = [self.value(argument) for argument in arguments]
        if function.domain == "color":
            color = _each(lambda a, _: a, values[0], (0.0, 0.0, 0.0))
            result = function.evaluate(color, *(value[0] for value in values[1:]))
            return result if function.gives == "color" else (result,)
        return _each(function.evaluate, *values)


def _each(function: Callable[..., Any], *values: tuple[Real, ...]) -> tuple[Array, ...]:
    """Call a function for every channel; a float stands for three equal ones."""
    count = max(len(value) for value in values)
    return tuple(function(*(value[i % len(value)] for value in values)) for i in range(count))


def _bounded_number(value: Array) -> Array:
    # What is known only at run time is bounded once, at the end. Constants must be float32 literals wherever they are.
    return bounded(value) if isinstance(value, np.ndarray | np.floating) else value
