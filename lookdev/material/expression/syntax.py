"""The parser of the expression language: a tokenizer, and an operator-precedence parser that builds a syntax tree.

The language has the syntax of SeExpr's expressions (Disney), without variables: see ``docs/expressions.md``.

- Pratt, V. 1973. Top Down Operator Precedence. POPL.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

from lookdev.arrays import MAX_MAGNITUDE
from lookdev.errors import LookdevError, nearest_hint
from lookdev.material.expression.shaping import CONSTANTS, FUNCTIONS, OPERATORS, LanguageFunction

MAX_LENGTH = 64 * 1024
"""The greatest length of an expression, in characters."""

_MAX_DEPTH = 64  # nested operations
_MAX_QUOTED_LENGTH = 40  # characters of a name in a message; twice as many for a faulty line


class ExpressionError(LookdevError):
    """A fault of an expression.

    `position` is the index of the fault in `text`. The message is the summary with the hint in brackets, then the
    faulty line with a caret under the position.
    """

    def __init__(self, text: str, position: int, summary: str, hint: str = "") -> None:
        self.text, self.position, self.summary, self.hint = text, position, summary, hint
        start = text.rfind("\n", 0, position) + 1
        end = text.find("\n", position)
        end = len(text) if end < 0 else end
        first = max(start, min(position - _MAX_QUOTED_LENGTH, end - 2 * _MAX_QUOTED_LENGTH))
        last = min(end, first + 2 * _MAX_QUOTED_LENGTH)
        before, after = "…" * (first > start), "…" * (last < end)
        line = "".join(c if c.isprintable() else " " for c in text[first:last])
        caret = " " * (len(before) + position - first) + "^"
        message = summary + (f" ({hint})" if hint else "")
        super().__init__(f"{message}\n    {before}{line}{after}\n    {caret}")


@dataclass(frozen=True)
class _Node:
    """A node of the syntax tree.

    `position` is the index in the text of the node's operator or first character. `depth` is 1 for a node without
    operands, else 1 more than the largest depth of an operand.
    """

    position: int
    depth: int


@dataclass(frozen=True)
class NumberNode(_Node):
    """A number, or the value of a named constant."""

    value: float


@dataclass(frozen=True)
class NameNode(_Node):
    """The name of an input."""

    name: str


@dataclass(frozen=True)
class ApplyNode(_Node):
    """A function or operator applied to its arguments."""

    name: str
    function: LanguageFunction
    arguments: tuple[ExpressionNode, ...]


@dataclass(frozen=True)
class ColorNode(_Node):
    """Three floats as a colour: ``[r, g, b]``."""

    channels: tuple[ExpressionNode, ...]


@dataclass(frozen=True)
class ChannelNode(_Node):
    """A channel of a colour: ``color[index]``."""

    color: ExpressionNode
    index: int


@dataclass(frozen=True)
class ChoiceNode(_Node):
    """One of two values: ``condition ? yes : no``."""

    condition: ExpressionNode
    yes: ExpressionNode
    no: ExpressionNode


ExpressionNode: TypeAlias = NumberNode | NameNode | ApplyNode | ColorNode | ChannelNode | ChoiceNode


class _Token(NamedTuple):
    """A token of the text. `kind` is the name of a group of `_TOKEN`, or ``"end"`` after the last token."""

    kind: str
    text: str
    position: int


_TOKEN = re.compile(
    r"(?P<space>(?:\s|\#[^\n]*)+)"
    r"|(?P<number>(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)"
    r"|(?P<name>[A-Za-z_][A-Za-z0-9_]*)"
    r"|(?P<sign>[<>=!]=|&&|\|\||[-+*/%^!<>?:(),\[\]])"
)

# The binding power (Pratt 1973) of each operator on its left operand. An operand between two operators belongs to the
# one with the higher power. Only ``^`` and ``?`` are right-associative.
_BINDING_POWER = {"?": 1, "||": 2, "&&": 3, "==": 4, "!=": 4, "<": 5, "<=": 5, ">": 5, ">=": 5}
_BINDING_POWER |= {"+": 6, "-": 6, "*": 7, "/": 7, "%": 7, "^": 9, "[": 10}
# The names in `OPERATORS` of the signs that stand before an operand.
_PREFIX = {"-": "negative", "!": "!"}
_PREFIX_BINDING_POWER = 8

# Hints for characters that begin no token, although another language would have them.
_SIGN_HINTS = {
    "=": "'==' compares",
    "&": "'&&' is the logical and",
    "|": "'||' is the logical or",
    "$": "names stand without '$'",
    "~": "invert(x) is 1 - x",
}


def parse_tree(text: str) -> tuple[ExpressionNode, tuple[str, ...]]:
    """Return the root of an expression's syntax tree, and the names of its inputs in order of appearance.

    Raises
    ------
    ExpressionError
        The syntax is wrong, a function is unknown or has a wrong number of arguments, or the text is too long or nested
        too deep.
    """
    if len(text) > MAX_LENGTH:
        message = f"an expression of {len(text)} characters; at most {MAX_LENGTH} are read"
        raise ExpressionError(text, MAX_LENGTH, message)
    parser = _Parser(text)
    return parser.parse_whole(), tuple(parser.names)


def shorten_name(text: str) -> str:
    """Return a name for a message: cut off with an ellipsis if it is long."""
    return text if len(text) <= _MAX_QUOTED_LENGTH else f"{text[:_MAX_QUOTED_LENGTH]}…"


def _tokenize(text: str) -> Iterator[_Token]:
    """Yield the tokens of a text, without space and comments, and then the token ``"end"``."""
    position = 0
    while position < len(text):
        match = _TOKEN.match(text, position)
        if match is None:
            raise ExpressionError(text, position, f"unexpected {text[position]!r}", _SIGN_HINTS.get(text[position], ""))
        if match.lastgroup != "space":
            yield _Token(str(match.lastgroup), match[0], position)
        position = match.end()
    yield _Token("end", "", position)


class _Parser:
    """Parses a text once. `names` has the names of its inputs, as keys of a dict, in order of appearance."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.names: dict[str, None] = {}
        self._tokens = _tokenize(text)
        self._token = next(self._tokens)  # the next token, not consumed yet
        self._nesting = 0  # the number of nested calls of `_parse`

    def parse_whole(self) -> ExpressionNode:
        """Return the root of the tree of the whole text."""
        root = self._parse(0)
        if self._token.kind != "end":
            raise self._unexpected_token("an operator")
        return root

    def _next(self) -> _Token:
        """Consume the next token and return it."""
        token, self._token = self._token, next(self._tokens)
        return token

    def _unexpected_token(self, expected: str) -> ExpressionError:
        """Return the error that `expected` should be in the place of the next token."""
        token = self._token
        present = "the end" if token.kind == "end" else f"'{shorten_name(token.text)}'"
        return ExpressionError(self.text, token.position, f"{expected} should stand here, not {present}")

    def _expect(self, sign: str) -> None:
        """Consume the next token, which must be `sign`."""
        if self._token.text != sign:
            raise self._unexpected_token(f"'{sign}'")
        self._next()

    def _depth(self, position: int, *parts: ExpressionNode) -> int:
        """Return the depth of a node with these operands; raises ExpressionError if it is too large."""
        depth = 1 + max((part.depth for part in parts), default=0)
        if depth > _MAX_DEPTH:
            raise self._depth_error(position)
        return depth

    def _depth_error(self, position: int) -> ExpressionError:
        """Return the error that operations are nested too deep."""
        return ExpressionError(self.text, position, f"more than {_MAX_DEPTH} operations one inside the other")

    def _parse(self, binding_power: int) -> ExpressionNode:
        """Parse an operand and the operators that follow, as long as their binding power is above `binding_power`."""
        # This bounds Python's recursion. `_Node.depth` does not, because parentheses make no node. Each pair of
        # parentheses is a nested call of this function, and an operator between two pairs is another.
        self._nesting += 1
        if self._nesting > 2 * _MAX_DEPTH:
            raise self._depth_error(self._token.position)
        left = self._parse_operand()
        while _BINDING_POWER.get(self._token.text, 0) > binding_power:
            left = self._parse_operation(left, self._next())
        self._nesting -= 1
        return left

    def _parse_operation(self, left: ExpressionNode, sign: _Token) -> ExpressionNode:
        """Parse what follows an operator `sign` on the operand `left`; return the node of the operation."""
        position = sign.position
        if sign.text == "[":
            index = self._token
            if index.text not in ("0", "1", "2"):
                raise self._unexpected_token("0, 1 or 2")
            self._next()
            self._expect("]")
            return ChannelNode(position, self._depth(position, left), left, int(index.text))
        if sign.text == "?":
            yes = self._parse(0)
            self._expect(":")
            no = self._parse(0)
            return ChoiceNode(position, self._depth(position, left, yes, no), left, yes, no)
        # One less for ^ makes it right-associative: the right operand includes a further ^.
        right = self._parse(_BINDING_POWER[sign.text] - (sign.text == "^"))
        return self._make_apply(position, sign.text, OPERATORS[sign.text], left, right)

    def _parse_operand(self) -> ExpressionNode:
        """Parse a number, name, call, prefix operator, parenthesised expression or colour."""
        token = self._token
        position = token.position
        if token.kind == "number":
            self._next()
            value = float(token.text)
            if value > MAX_MAGNITUDE:
                raise ExpressionError(self.text, position, f"a number above {MAX_MAGNITUDE:g}")
            return NumberNode(position, 1, value)
        if token.kind == "name":
            self._next()
            if self._token.text == "(":
                return self._parse_call(token)
            if token.text in CONSTANTS:
                return NumberNode(position, 1, CONSTANTS[token.text])
            self.names[token.text] = None
            return NameNode(position, 1, token.text)
        if token.text in _PREFIX:
            self._next()
            name = _PREFIX[token.text]
            return self._make_apply(position, name, OPERATORS[name], self._parse(_PREFIX_BINDING_POWER))
        if token.text == "(":
            self._next()
            inner = self._parse(0)
            self._expect(")")
            return inner
        if token.text == "[":
            self._next()
            channels = self._parse_list("]")
            if len(channels) != 3:
                raise ExpressionError(self.text, position, f"a color of {len(channels)} numbers", "it is [r, g, b]")
            return ColorNode(position, self._depth(position, *channels), channels)
        raise self._unexpected_token("a number, a name or '('")

    def _parse_list(self, closing: str) -> tuple[ExpressionNode, ...]:
        """Parse expressions separated by commas, and the `closing` bracket."""
        items = [] if self._token.text == closing else [self._parse(0)]
        while items and self._token.text == ",":
            self._next()
            items.append(self._parse(0))
        self._expect(closing)
        return tuple(items)

    def _parse_call(self, token: _Token) -> ExpressionNode:
        """Parse the arguments of the function that `token` names."""
        name = token.text
        if (function := FUNCTIONS.get(name)) is None:
            hint = nearest_hint(name, list(FUNCTIONS))
            raise ExpressionError(self.text, token.position, f"unknown function '{shorten_name(name)}'", hint)
        self._next()
        arguments = self._parse_list(")")
        maximum = len(function.parameters)
        if not maximum - function.optional <= len(arguments) <= maximum:
            count = f"{maximum - function.optional} to {maximum}" if function.optional else str(maximum)
            message = f"{name} takes {count} argument{'s' * (maximum > 1)}, not {len(arguments)}"
            raise ExpressionError(self.text, token.position, message, function.signature(name))
        return self._make_apply(token.position, name, function, *arguments)

    def _make_apply(
        self, position: int, name: str, function: LanguageFunction, *arguments: ExpressionNode
    ) -> ExpressionNode:
        """Return the node of a function or operator with these arguments."""
        return ApplyNode(position, self._depth(position, *arguments), name, function, arguments)
