"""The expression language of looks: parses, type-checks and evaluates the expressions of inputs and masks.

The values are float64 arrays, or the symbolic arrays that code generation traces. `syntax` parses the text, and
`shaping` defines the functions. ``docs/expressions.md`` describes the language.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal, cast

import numpy as np

from lookdev.brdf.vectors import Array, BooleanArray, Real
from lookdev.errors import nearest_hint
from lookdev.material.expression import syntax
from lookdev.material.expression.shaping import CONSTANTS, FUNCTIONS, clip_to_bound
from lookdev.material.expression.syntax import ExpressionError

__all__ = ["Expression", "ExpressionError", "ExpressionKind", "parse"]

ExpressionKind = Literal["float", "color"]
"""The type of an input or of a result of an expression."""


@dataclass(frozen=True)
class Expression:
    """A parsed expression.

    `root` is the root of its syntax tree. `names` has the names of its inputs in order of appearance.
    """

    text: str
    root: syntax.ExpressionNode
    names: tuple[str, ...]

    def check(self, types: Mapping[str, ExpressionKind]) -> ExpressionKind:
        """Return the type of the result for the given types of the inputs.

        Raises
        ------
        ExpressionError
            A name is unknown, or a colour is in place of a float or a float in place of a colour.
        """
        return _Checker(self.text, types).kind(self.root)

    def evaluate(self, values: Mapping[str, Array], types: Mapping[str, ExpressionKind]) -> Array:
        """Evaluate the expression for values of its inputs; raises as `check`.

        Parameters
        ----------
        values
            Floats (...) and linear colours (..., 3) by name, as float64 or symbolic arrays.
        types
            The type of each value. The shape alone is ambiguous: three floats and one colour have the same shape.

        Returns
        -------
        (...) or (..., 3)
            A float or a colour, according to `check`; finite and within ±1e18.
        """
        kind = self.check(types)
        # Every operation on numbers clips its result, so NumPy's warnings of overflow have no meaning.
        with np.errstate(all="ignore"):
            channels = [clip_to_bound(channel) for channel in _Evaluation(values, types).value(self.root)]
            if kind == "float":
                return channels[0]
            zero = sum(channel * 0.0 for channel in channels)  # has the shape to which the channels broadcast
            return np.stack([channel + zero for channel in channels], axis=-1)


def parse(text: str) -> Expression:
    """Parse an expression; raises as `parse_tree`."""
    return Expression(text, *syntax.parse_tree(text))


class _Checker:
    """Determines the types of the nodes of an expression's tree, and raises ExpressionError where types do not fit."""

    def __init__(self, text: str, types: Mapping[str, ExpressionKind]) -> None:
        self.text, self.types = text, types

    def kind(self, node: syntax.ExpressionNode) -> ExpressionKind:
        """Return the type of a node."""
        match node:
            case syntax.NameNode(position=position, name=name) if name not in self.types:
                hint = nearest_hint(name, [*self.types, *CONSTANTS])
                if name in FUNCTIONS:
                    hint = f"a function: {FUNCTIONS[name].signature(name)}"
                raise ExpressionError(self.text, position, f"unknown name '{syntax.shorten_name(name)}'", hint)
            case syntax.NameNode(name=name):
                return self.types[name]
            case syntax.ColorNode(channels=channels):
                for channel in channels:
                    self._check_float(channel, "a channel of a color")
                return "color"
            case syntax.ChannelNode(position=position, color=color):
                if self.kind(color) == "float":
                    raise ExpressionError(self.text, position, "a channel of a float; only colors have channels")
                return "float"
            case syntax.ChoiceNode(condition=condition, yes=yes, no=no):
                self._check_float(condition, "the condition of '?'")
                return "color" if "color" in (self.kind(yes), self.kind(no)) else "float"
            case syntax.ApplyNode(name=name, function=function, arguments=arguments):
                # A function of domain "each" takes floats and colours, and is applied to each channel.
                if function.domain == "each":
                    return "color" if "color" in [self.kind(argument) for argument in arguments] else "float"
                for argument in arguments:
                    if function.domain == "color" and argument is arguments[0]:
                        self.kind(argument)
                    else:
                        self._check_float(argument, f"'{name}'")
                return "color" if function.result == "color" else "float"
            case syntax.NumberNode():
                return "float"

    def _check_float(self, node: syntax.ExpressionNode, user: str) -> None:
        """Raise ExpressionError if a node is a colour. The message names the node's `user`, which needs a float."""
        if self.kind(node) == "color":
            hint = "take luminance(color), or a channel: color[0]"
            raise ExpressionError(self.text, node.position, f"{user} needs a float, this is a color", hint)


class _Evaluation:
    """Evaluates a tree whose types are checked. A value is a tuple of channels: one for a float, three for a colour."""

    def __init__(self, values: Mapping[str, Array], types: Mapping[str, ExpressionKind]) -> None:
        self.values, self.types = values, types

    def value(self, node: syntax.ExpressionNode) -> tuple[Array, ...]:
        """Return the channels of a node."""
        match node:
            case syntax.NumberNode(value=value):
                return (np.asarray(value),)
            case syntax.NameNode(name=name):
                operand = self.values[name]
                return tuple(operand[..., i] for i in range(3)) if self.types[name] == "color" else (operand,)
            case syntax.ColorNode(channels=channels):
                return tuple(self._float(channel) for channel in channels)
            case syntax.ChannelNode(color=color, index=index):
                return (self.value(color)[index],)
            case syntax.ChoiceNode(condition=condition, yes=yes, no=no):
                truth = self.truth_value(condition)
                return _map_channels(lambda a, b: np.where(truth, a, b), self.value(yes), self.value(no))
            case syntax.ApplyNode():
                results = self._apply_function(node)
                # Numbers are clipped here, because code generation writes each as a float32 literal. Symbols are
                # clipped only once, in the final result.
                return tuple(clip_to_bound(x) if isinstance(x, np.ndarray | np.floating) else x for x in results)

    def truth_value(self, node: syntax.ExpressionNode) -> BooleanArray:
        """Return the truth values of a node; a number is true where it is not 0."""
        if isinstance(node, syntax.ApplyNode) and node.function.result == "truth":
            operand = self.truth_value if node.function.domain == "truth" else self._float
            return cast(BooleanArray, node.function.evaluate(*(operand(argument) for argument in node.arguments)))
        truth: BooleanArray = np.logical_not(np.equal(self._float(node), 0.0))
        return truth

    def _float(self, node: syntax.ExpressionNode) -> Array:
        """Return the value of a node that is a float."""
        return self.value(node)[0]

    def _apply_function(self, node: syntax.ApplyNode) -> tuple[Array, ...]:
        """Return the channels of a function's or an operator's result; a truth value becomes 1 or 0."""
        function = node.function
        if function.result == "truth":
            return (np.where(self.truth_value(node), 1.0, 0.0),)
        values = [self.value(argument) for argument in node.arguments]
        if function.domain == "color":
            color = _map_channels(lambda a, _: a, values[0], (0.0, 0.0, 0.0))
            result = function.evaluate(color, *(value[0] for value in values[1:]))
            return result if isinstance(result, tuple) else (cast(Array, result),)
        return _map_channels(cast(Callable[..., Array], function.evaluate), *values)


def _map_channels(function: Callable[..., Array], *values: tuple[Real, ...]) -> tuple[Array, ...]:
    """Return the results of a function for each channel of its arguments; beside a colour, a float is a grey."""
    count = max(len(value) for value in values)
    return tuple(function(*(value[i % len(value)] for value in values)) for i in range(count))
