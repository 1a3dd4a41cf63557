"""Expression graphs as OSL text, by scopes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from lookdev.codegen.trace.graph import Node, Scalar, in_order, reachable
from lookdev.errors import CodegenError

CODE: dict[str, str] = {
    "add": "({} + {})",
    "subtract": "({} - {})",
    "multiply": "({} * {})",
    "divide": "({} / {})",
    "negative": "(-{})",
    "absolute": "fabs({})",
    "sqrt": "sqrt({})",
    "exp": "exp({})",
    "expm1": "expm1({})",
    "log": "log({})",
    "sin": "sin({})",
    "cos": "cos({})",
    "tan": "tan({})",
    "arctan2": "atan2({}, {})",
    "floor": "floor({})",
    "power": "pow({}, {})",
    "maximum": "max({}, {})",
    "minimum": "min({}, {})",
    "greater": "({} > {})",
    "greater_equal": "({} >= {})",
    "less": "({} < {})",
    "less_equal": "({} <= {})",
    "equal": "({} == {})",
    "logical_and": "({} && {})",
    "logical_or": "({} || {})",
    "logical_not": "(!{})",
    "where": "({} ? {} : {})",
}

_BOOLEAN = {"greater", "greater_equal", "less", "less_equal", "equal", "logical_and", "logical_or", "logical_not"}

# Longer expressions get a name, so that the generated shader can be read.
_MAX_INLINE = 70


def literal(value: float | bool) -> str:
    """Write a constant; a CodegenError if it is not finite, which has no literal in OSL."""
    if isinstance(value, bool | np.bool_):
        return "1" if value else "0"
    if not np.isfinite(value):
        raise CodegenError(f"a constant folded to {value}; the model leaves its domain")
    return repr(float(value))


def bare(code: str) -> str:
    """Return the code of an expression without parentheses around all of it."""
    return code[1:-1] if code.startswith("(") and code.endswith(")") else code


Spell = Callable[[str], str]
"""Returns the text of a symbol; it is called when the symbol is written."""


class Block:
    """One scope of emitted code: nodes used more than once become variables, which are `named`, others are inline."""

    def __init__(
        self, prefix: str, indent: int, named: Mapping[Node, str] | None = None, spell: Spell = lambda symbol: symbol
    ) -> None:
        self.lines: list[str] = []
        self.named = dict(named or {})
        self._prefix = prefix
        self._pad = "    " * indent
        self._spell = spell
        self._uses: Counter[Node] = Counter()
        self._chosen: dict[Node, str] = {}

    def inner(self, prefix: str, indent: int) -> Block:
        """Return a scope inside this one, with the names that this one has now."""
        return Block(prefix, indent, self.named, self._spell)

    def write(self, text: str) -> None:
        """Append one line of code as it is."""
        self.lines.append(self._pad + text)

    def define(self, name: str, value: Scalar, comment: str = "") -> None:
        """Compute a number into a variable of that name."""
        if isinstance(value, Node) and value.op != "symbol" and value not in self.named:
            self._chosen[value] = name
            self.name(value)
        else:
            self.write(f"float {name} = {self.expression(value)};")
        self.lines[-1] += f"  // {comment}" if comment else ""

    def prepare(self, roots: Iterable[Any]) -> None:
        """Count uses under `roots`, all the expressions of this block, so that shared nodes get a name."""
        roots = list(roots)
        for node in reachable(roots, stop=self.named):
            if node not in self.named:
                self._uses.update(node.operands())
        self._uses.update(root for root in roots if isinstance(root, Node))

    def name(self, value: Scalar) -> str:
        """Compute `value` into a variable of its own; return the variable's name, or the literal of a constant."""
        code = self.expression(value)
        if isinstance(value, Node) and value.op != "symbol" and value not in self.named:
            self._define(value, code)
            return self.named[value]
        return code

    def expression(self, value: Scalar) -> str:
        """Return code for `value`, writing the variables it needs first."""
        inline: dict[Any, str] = {}

        def shown(part: Any) -> str:
            if not isinstance(part, Node):
                return literal(part)
            return self.named.get(part) or inline[part]

        for node in in_order([value], stop=lambda node: node in self.named):
            if node.op == "symbol":
                inline[node] = self._spell(str(node.args[0]))
                continue
            code = CODE[node.op].format(*(shown(arg) for arg in node.args))
            if self._uses[node] > 1 or len(code) > _MAX_INLINE:
                self._define(node, code)
            else:
                inline[node] = code
        return shown(value)

    def _define(self, node: Node, code: str) -> None:
        name = self._chosen.get(node, f"{self._prefix}{len(self.named)}")
        kind = "int" if node.op in _BOOLEAN else "float"
        self.write(f"{kind} {name} = {bare(code)};")
        self.named[node] = name
